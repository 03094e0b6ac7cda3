"""Records a short session of the emulated robot in which many things go wrong: devices, wires, camera, button box.

    python -m tests.robot.recording.faulty_session FOLDER

The same on every run. `golden_faults_2.tar.xz` keeps it.
"""

import math
import struct
import sys
from collections import Counter
from pathlib import Path

from tests.faulty_robot import eyes_with, nodes_with
from truearc import robot
from truearc.hw.devices.button_box import make_heartbeat, open_button_box
from truearc.hw.devices.odrive import frames as odrive
from truearc.hw.emulated.nodes import StepClock, Twin
from truearc.hw.fault_codes import CAMERA_FROZEN, CAN_SILENT, SERIAL_ERROR
from truearc.hw.protocols import LinkLost
from truearc.hw.real.can_bus import open_can
from truearc.hw.real.wires import open_serial
from truearc.robot.config.schema import load_config
from truearc.robot.motors import guard
from truearc.robot.recording.files import TappedBus
from truearc.robot.recording.session import make_header
from truearc.robot.recording.writer import SessionWriter
from truearc.robot.rig import HardwareRig, RecordingRig
from truearc.robot.runtime import run
from truearc.sim.world.emulated_robot import CHANNELS, Driver
from truearc.sim.world.world import World
from truearc_proof.world import faults as kinds

SEED, MS = 13, 1_000_000
END_MS = 5400
CAN_GONE, CAMERA_GONE, BOX_GONE = (2500, 2530), (2700, 2730), (4200, 4220)          # ms
GARBLED_MS, LOST_MS = 4000, 4800      # the box sends garbage; then counts presses that never came


def make_faults(config):
    """Device -> what goes wrong with it."""
    left, right = config.axes.flywheels

    def fault(kind, begin_ms, end_ms, frame_id=None, **how):
        return kinds.Fault(kind, begin_ms * MS, end_ms * MS, frame_id, **how)

    speeds = [axis.node << 5 | 0x09 for axis in (left, right)]
    heartbeat = odrive.frame_id(odrive.OdriveAxis(config.axes.feeder.node, 1), "Heartbeat")
    return {"flywheel_a": (fault(kinds.TRUNCATED, 600, 620, length=3), fault(kinds.DEAF, 3000, 3250),
                           fault(kinds.STUCK, 1800, 1950, speeds[0])),
            "flywheel_b": (fault(kinds.OVERWRITTEN, 700, 715, speeds[1], at=4, data=struct.pack("<f", math.nan)),
                           fault(kinds.OVERWRITTEN, 2000, 2100, speeds[1], at=4, data=struct.pack("<f", 40.0))),
            "hood": (fault(kinds.SILENT, 900, 1050),), "feeder": (fault(kinds.SILENT, 1100, 1400, heartbeat),),
            "hood_encoder": (fault(kinds.SILENT, 1450, 1600), fault(kinds.DOUBLED, 2800, 3900)),
            "camera": (fault(kinds.SILENT, 3300, 3700),)}


class Wire:
    """A wire that is lost for a while; everything else of it is the wire's own."""

    def __init__(self, wire, clock, gone_ms, lost):
        self._wire, self._clock, self._lost = wire, clock, lost
        self._begin_ns, self._end_ns = (ms * MS for ms in gone_ms)

    def __getattr__(self, name):
        return getattr(self._wire, name)

    def read(self):
        if self._begin_ns <= self._clock.now_ns() < self._end_ns:
            raise self._lost
        return self._wire.read()


class Box(Wire):
    """A button box that also garbles a line, and later counts presses that never came."""

    def __init__(self, *args):
        super().__init__(*args)
        self._says = [(GARBLED_MS * MS, b"$B,7,fi\x80e*00\r\n"), (LOST_MS * MS, make_heartbeat(40))]

    def read(self):
        data = super().read()
        if self._says and self._clock.now_ns() >= self._says[0][0]:
            data += self._says.pop(0)[1]
        return data


def record(folder: Path) -> None:
    config = load_config(Path(robot.__file__).parent / "launcher.toml")
    world, box, faults = World(SEED), open_button_box(), make_faults(config)
    recorder = SessionWriter(folder, make_header(config, None, None), config, None, lossless=True)
    eyes = eyes_with(faults["camera"])(world, config, SEED)
    driver = Driver(world, box.press, 1, SEED)
    clock = StepClock(lambda t_ns: twin.advance(t_ns))
    channel = f"truearc-{next(CHANNELS)}"
    near, far = (open_can("virtual", channel, config.can.bitrate, clock) for _ in range(2))
    twin = Twin(world, far, tuple(nodes_with(faults)(config, world).values()), (box.step, driver.step, eyes.step))
    stream = open_serial(box.port, config.buttons.baud)
    bus = Wire(guard(near, config, clock, Counter()), clock, CAN_GONE, LOST_CAN)
    rig = HardwareRig(config, TappedBus(bus, recorder.tap), Box(stream, clock, BOX_GONE, LOST_BOX),
                      Wire(eyes, clock, CAMERA_GONE, LOST_CAMERA), clock, lambda: clock.now_ns() > END_MS * MS)
    try:
        run(RecordingRig(rig, recorder.trouble), config, None, recorder)
    finally:
        for wire in (near, far, stream, eyes):
            wire.close()
        box.unplug()
        recorder.close()
    (folder / "frames" / "frames.jsonl").unlink(missing_ok=True)


LOST_CAN = LinkLost(CAN_SILENT(bus="CAN slcan /dev/ttyACM0", silence_s=1.0))
LOST_BOX = LinkLost(SERIAL_ERROR(port="/dev/ttyUSB0", detail="read failed: device reports readiness to read but "
                                 "returned no data"))
LOST_CAMERA = LinkLost(CAMERA_FROZEN(camera="0"))

if __name__ == "__main__":
    record(Path(sys.argv[1]))
