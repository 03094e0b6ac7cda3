"""A rig that says how it is to whoever started the service; the tick knows nothing of it."""

from collections.abc import Callable

from truearc.hw.readings import CameraFrame, MotorReading
from truearc.robot.config.schema import Config
from truearc.robot.gate.verdict import HEARTBEAT_S
from truearc.robot.reasons import text
from truearc.robot.runtime import RobotIo
from truearc.robot.types import Command, Inputs, Sent

NS_PER_S = 1_000_000_000
ALIVE_NS = 100_000_000                # how often the watchdog is fed; it wants to hear it once a second


class WatchedRig:
    """Passes everything through, and says READY after the first full set of fresh readings, then WATCHDOG.

    WATCHDOG is said on the way out of a tick whose commands have been sent, and nowhere else: a loop that hangs falls
    silent, whatever other threads still do. Until READY the status line names what has not been heard yet.
    """

    def __init__(self, rig: RobotIo, config: Config, say: Callable[[str], None]) -> None:
        self._rig, self._config, self._say = rig, config, say
        self._seen_ns: int | None = None          # when the newest image was taken, whatever it showed
        self._missing: str | None = None
        self._ready = False
        self._alive_ns = 0
        self._t_ns = 0

    def read(self) -> Inputs | None:
        inputs = self._rig.read()
        if inputs is not None:
            self._t_ns = inputs.t_ns
            if not self._ready:
                self._look(inputs)
        return inputs

    def write(self, command: Command) -> Sent:
        sent = self._rig.write(command)
        if self._ready and self._t_ns - self._alive_ns >= ALIVE_NS:
            self._alive_ns = self._t_ns
            self._say("WATCHDOG=1")
        return sent

    def picture(self) -> CameraFrame | None:
        return self._rig.picture()

    def _look(self, inputs: Inputs) -> None:
        if inputs.sighting is not None:
            self._seen_ns = inputs.sighting.t_ns
        missing = first_missing(inputs, self._seen_ns, self._config)
        self._ready = not missing
        if missing != self._missing:
            self._missing = missing
            self._say("READY=1\nSTATUS=running" if self._ready else f"STATUS=waiting: {missing}")


def first_missing(inputs: Inputs, seen_ns: int | None, config: Config) -> str:
    """What a full set of fresh readings still lacks, as text; "" when it is full.

    `seen_ns`: when the newest image was taken, None before the first.
    """
    age_s = config.gate.reading_age_s
    motors = [(f"flywheel motor {number}", motor) for number, motor in enumerate(inputs.flywheels, 1)]
    for name, motor in (*motors, ("hood motor", inputs.hood_motor), ("feeder motor", inputs.feeder)):
        if not _is_fresh(motor, inputs.t_ns, age_s):
            return name
    if inputs.hood_angle is None or not _is_young(inputs.t_ns, inputs.hood_angle.t_ns, age_s):
        return "hood encoder"
    if inputs.faults:                             # a silent button box is one of them
        return text(inputs.faults[0])
    if seen_ns is None or not _is_young(inputs.t_ns, seen_ns, config.gate.sighting_age_s):
        return "camera"
    return ""


def _is_fresh(motor: MotorReading, t_ns: int, age_s: float) -> bool:
    return (motor.t_ns > 0 and motor.heartbeat_t_ns > 0 and _is_young(t_ns, motor.t_ns, age_s)
            and _is_young(t_ns, motor.heartbeat_t_ns, HEARTBEAT_S))


def _is_young(t_ns: int, stamp_ns: int, limit_s: float) -> bool:
    return 0 <= t_ns - stamp_ns <= limit_s * NS_PER_S
