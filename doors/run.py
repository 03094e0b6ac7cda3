"""truearc run: the robot."""

import argparse
import signal
import sys
from contextlib import ExitStack
from pathlib import Path
from types import FrameType

import cv2

from hw.link import Bus, Camera, Clock, LinkLost, Stream
from hw.reading import CameraFrame
from hw.real.camera import open_camera
from hw.real.can_bus import open_can
from hw.real.clock import MonotonicClock, wall_clock
from hw.real.serial_port import open_serial
from robot.config import BadInput, Config, load_config
from robot.eyes import InlineEyes
from robot.gate.model import load_gate
from robot.plan import load_plan, with_plan
from robot.recording.candump import TappedBus
from robot.recording.session import make_header
from robot.recording.writer import SessionWriter
from robot.rig import HardwareRig
from robot.runtime import run
from robot.types import Sighting
from robot.vision import detect

DESCRIPTION = "Run the launcher on its real wires and record it; ends on Ctrl-C or SIGTERM with the motors idle."
EXAMPLE = "truearc run --config launcher.toml --gate gate.onnx --out sessions"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--config", type=Path, required=True, help="launcher.toml")
    parser.add_argument("--plan", type=Path, metavar="TABLE", help="shoot these configurations: a CSV file with "
                        "distance_m, motor_ratio, hood_deg, or a dataset directory; it says where to stand")
    parser.add_argument("--repeats", type=int, metavar="N", help="shots at each configuration (default: [collect])")
    parser.add_argument("--gate", type=Path, help="exported model; needed when the policy is 'model'")
    parser.add_argument("--out", type=Path, default=Path("sessions"), help="folder to make the session's folder in")


class Ending:
    """Set by a signal; the loop looks at it before each tick."""

    def __init__(self) -> None:
        self.asked = False
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._ask)

    def _ask(self, number: int, frame: FrameType | None) -> None:
        self.asked = True


def main(args: argparse.Namespace) -> int:
    config = load_config(args.config)
    config = with_plan(config, load_plan(args.plan, config) if args.plan else (), args.repeats)
    gate = None if args.gate is None else load_gate(args.gate)
    if config.gate.policy == "model" and gate is None:
        raise BadInput(f"{args.config}: gate.policy is 'model', so --gate is needed")
    if config.gate.policy != "model" and gate is not None:
        print(f"truearc run: {args.config} has gate.policy {config.gate.policy!r}: the model is asked, not obeyed",
              file=sys.stderr)
    started = wall_clock()
    folder = args.out / started.replace(":", "")
    ending = Ending()
    with ExitStack() as wires:
        bus, box, camera, clock = _open_wires(config, wires)
        recorder = SessionWriter(folder, make_header(config, gate, started), config,
                                 args.gate.read_bytes() if args.gate else None, lossless=False)
        wires.callback(recorder.close)

        def see(frame: CameraFrame) -> Sighting:
            return detect(frame, config.camera, config.tape, config.vision)

        eyes = InlineEyes(camera, see)
        rig = HardwareRig(config, TappedBus(bus, recorder.tap), box, eyes, clock, lambda: ending.asked)
        wires.callback(rig.release)               # first of all to be done on the way out, whatever happened
        ticks = run(rig, config, gate, recorder)
    print(f"{folder}: {ticks} ticks" + (f", {recorder.dropped} batches lost" if recorder.dropped else ""))
    if recorder.failed is not None:
        raise BadInput(f"{folder}: the recording stopped: {recorder.failed}")
    return 0


def _open_wires(config: Config, wires: ExitStack) -> tuple[Bus, Stream, Camera, Clock]:
    """Every wire of the configuration, to be closed by `wires`; BadInput names the one that cannot be opened."""
    cv2.setNumThreads(1)
    clock = MonotonicClock()
    try:
        bus = open_can(config.can.interface, config.can.channel, config.can.bitrate, clock)
        wires.callback(bus.close)
        box = open_serial(config.buttons.port, config.buttons.baud)
        wires.callback(box.close)
        camera = open_camera(config.camera.device, config.camera.width_px, config.camera.height_px, config.camera.fps,
                             clock, config.camera.exposure_s)
        wires.callback(camera.close)
    except LinkLost as error:
        raise BadInput(f"cannot start: {error}") from error
    return bus, box, camera, clock
