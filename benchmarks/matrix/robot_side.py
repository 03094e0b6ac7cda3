"""The robot's side of a run: the code that runs on the robot, and whatever breaks on this side of the wires."""

from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import msgspec

from benchmarks.matrix.beside import Beside
from benchmarks.matrix.breaking import Breaking, Camera, Disk, Model, Motion, Process, Time, Wire
from benchmarks.matrix.disks import break_disk
from benchmarks.matrix.models import BrokenGate
from benchmarks.matrix.motion import ToldEyes
from benchmarks.matrix.pictures import Scenery, SteppedCamera, open_camera
from benchmarks.matrix.span import Span
from benchmarks.matrix.wires import FlakyBus, StallingClock, StandingWall
from truearc.cli.run_processes import make_see
from truearc.hw.protocols import NS_PER_S, Bus, CameraFrame, Clock, Stream
from truearc.hw.protocols import Camera as CameraLink
from truearc.hw.real.can_bus import ROOM, WAIT_S, CanBus, SupervisedBus, open_can
from truearc.hw.real.wires import MendedCamera, MendedStream, open_serial
from truearc.robot.config.schema import Config
from truearc.robot.gate.model import Rating
from truearc.robot.motors import guard
from truearc.robot.processes.loop_health import Lateness, TimedRig, WatchedRig
from truearc.robot.recording.files import TappedBus
from truearc.robot.recording.session import make_header
from truearc.robot.recording.writer import SessionWriter
from truearc.robot.rig import HardwareRig, RecordingRig
from truearc.robot.runtime import RobotIo, run
from truearc.robot.types import Command, Inputs, Sent
from truearc.robot.vision_source import Eyes, InlineEyes

SMALL_ROOM = 64                       # frames that may wait for the tick, where an overrun is wanted


class AdvisedRig:
    """Passes everything through, and lets another controller know what is asked."""

    def __init__(self, rig: RobotIo, span: Span) -> None:
        self._rig, self._span = rig, span

    def read(self) -> Inputs | None:
        return self._rig.read()

    def write(self, command: Command) -> Sent:
        self._span.advise(command.flywheel_torque_nm, command.hood_torque_nm, command.feeder_torque_nm)
        return self._rig.write(command)

    def picture(self) -> CameraFrame | None:
        return self._rig.picture()


class RobotSide(msgspec.Struct):
    """Facts of a run that the robot's side reports beside its recording."""

    tally: dict[str, int]
    answers: list[Rating | None] | None           # what the gate said, if there was one
    failed: str = ""                              # why the recording is not whole


def run_robot(config: Config, breaking: Breaking, bus: tuple[str, str], box_port: str, folder: Path, span: Span,
              clock: Clock, stepped: bool, hurry: Callable[[], None] = lambda: None) -> None:
    """Run until the span is over, and leave `folder`/session and robot.json.

    On a stepped clock nothing needs threads of its own: the bus is read by the tick, and is not supervised.
    """
    tally: Counter[str] = Counter()
    clock = StallingClock(clock, span, breaking in (Time("late ticks"), Wire("overrun")))
    gate = BrokenGate(breaking.what, span.stands, clock) if isinstance(breaking, Model) else None
    with ExitStack() as wires, StandingWall(breaking, span):
        beside = Beside(config, folder, wires) if is_beside(breaking) else None
        hurry()                                   # as on the robot: vision and recorder have no real time
        wire, box = _open(config, breaking, bus, box_port, span, clock, stepped, tally, wires)
        eyes = beside.open_eyes(clock) if beside else _open_eyes(config, breaking, span, clock, stepped, wires)
        recorder = SessionWriter(folder / "session", make_header(config, None, None), config, None, lossless=stepped,
                                 open_keeper=beside.open_keeper if beside else None)
        wires.callback(recorder.close)
        if isinstance(breaking, Disk):
            wires.callback(break_disk(recorder, breaking.what, span))

        lateness = Lateness(recorder.keep_lateness, NS_PER_S // config.tick_hz)
        rig = HardwareRig(config, TappedBus(wire, recorder.tap), box, eyes, clock,
                          lambda: span.over_ns > 0 or recorder.is_over())
        wires.callback(rig.release)
        kept = RecordingRig(TimedRig(rig, lateness), recorder.trouble)
        run(WatchedRig(AdvisedRig(kept, span), config, lambda words: None), config, gate, recorder)
    side = RobotSide(dict(tally), None if gate is None else gate.answers, str(recorder.failed or ""))
    (folder / "robot.json").write_bytes(msgspec.json.encode(side))


def is_beside(breaking: Breaking) -> bool:
    """Whether it breaks a process beside control, which is there then."""
    return isinstance(breaking, Process) and breaking.who in ("vision", "recorder")


def _open(config: Config, breaking: Breaking, bus: tuple[str, str], box_port: str, span: Span, clock: Clock,
          stepped: bool, tally: Counter[str], wires: ExitStack) -> tuple[Bus, Stream]:
    what = breaking.what if isinstance(breaking, Wire) else ""

    def open_flaky() -> CanBus:
        return FlakyBus.over(open_can(*bus, config.can.bitrate, clock, WAIT_S, tally), what, span)

    wire: CanBus | SupervisedBus = open_can(*bus, config.can.bitrate, clock, 0.0, tally) if stepped else SupervisedBus(
        _watching(open_flaky, what, span), clock, tally, SMALL_ROOM if what == "overrun" else ROOM)
    if stepped:
        FlakyBus.over(wire, what, span)
    wires.callback(wire.close)
    box = MendedStream(lambda: open_serial(box_port, config.buttons.baud))
    wires.callback(box.close)
    return guard(wire, config, clock, tally), box


def _open_eyes(config: Config, breaking: Breaking, span: Span, clock: Clock, stepped: bool, wires: ExitStack) -> Eyes:
    if isinstance(breaking, Motion):
        return ToldEyes(clock, lambda: breaking.what == "no target" and span.stands())
    scenery = Scenery(config, breaking.what if isinstance(breaking, Camera) else "", span.stands)
    fps = config.camera.fps
    camera: CameraLink = SteppedCamera(scenery, fps, clock) if stepped else MendedCamera(
        lambda: open_camera(scenery, fps, clock))
    wires.callback(camera.close)
    return InlineEyes(camera, make_see(config))


def _watching(open_flaky: Callable[[], CanBus], what: str, span: Span) -> Callable[[], CanBus]:
    """Opening fails, too, while the adapter is out."""
    def open_again() -> CanBus:
        FlakyBus.check(what, span)
        return open_flaky()
    return open_again
