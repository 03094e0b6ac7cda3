"""A rig that says how it is to whoever started the service; the tick knows nothing of it."""

from collections.abc import Callable

from truearc.robot.config.schema import Config
from truearc.robot.gate.doubts import doubted_readings
from truearc.robot.reasons import DEVICE_HEARTBEAT_STALE, DEVICE_NEVER_RECEIVED, DEVICE_STALE, text
from truearc.robot.runtime import RigLayer, RobotIo
from truearc.robot.types import Command, Inputs, Sent

NS_PER_S = 1_000_000_000
NOT_FRESH = {code.name for code in (DEVICE_NEVER_RECEIVED, DEVICE_STALE, DEVICE_HEARTBEAT_STALE)}
ALIVE_NS = 100_000_000                # how often the watchdog is fed; it wants to hear it once a second


class WatchedRig(RigLayer):
    """Passes everything through, and says READY after the first full set of fresh readings, then WATCHDOG.

    WATCHDOG is said on the way out of a tick whose commands have been sent, and nowhere else: a loop that hangs falls
    silent, whatever other threads still do. Until READY the status line names what has not been heard yet.
    """

    def __init__(self, rig: RobotIo, config: Config, say: Callable[[str], None]) -> None:
        super().__init__(rig)
        self._config, self._say = config, say
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

    def _look(self, inputs: Inputs) -> None:
        if inputs.sighting is not None:
            self._seen_ns = inputs.sighting.t_ns
        missing = first_missing(inputs, self._seen_ns, self._config)
        self._ready = not missing
        if missing != self._missing:
            self._missing = missing
            self._say("READY=1\nSTATUS=running" if self._ready else f"STATUS=waiting: {missing}")


def first_missing(inputs: Inputs, seen_ns: int | None, config: Config) -> str:
    """Name the first reading that is not there or not fresh; "" when all are.

    `seen_ns`: when the newest image was taken, None before the first.
    """
    for reason in doubted_readings(inputs, config):
        if reason.code in NOT_FRESH:
            return str(reason.params["device"])
    if inputs.faults:                             # a silent button box is one of them
        return text(inputs.faults[0])
    if seen_ns is None or not 0 <= inputs.t_ns - seen_ns <= config.gate.sighting_age_s * NS_PER_S:
        return "camera"
    return ""
