"""An emulated Canandmag: 14 bits of absolute angle, and a count of turns since power-up."""

import math

from truearc.hw.codec import Values, load_codec
from truearc.hw.devices.canandmag.frames import FETCH_ONE, POSITION_PERIOD_SETTING, frame_id, make
from truearc.hw.emulated.nodes import Plant, Report, ReportingNode, take_reports
from truearc.hw.protocols import NS_PER_MS as MS
from truearc.hw.protocols import Frame

COUNTS = 16384                                    # per turn
POSITION_PERIOD_NS = 20 * MS                      # of a new device
STATUS_PERIOD_NS = 100 * MS
POWER_CYCLE = 0x01
MAGNET_OUT_OF_RANGE = 0x20
MAGNET_LOST_STATUS = 3
TEMPERATURE_DEGC = 25
RELATIVE_COUNTS = 1 << 31                         # the count is 32 bits, signed, and wraps


class CanandmagNode(ReportingNode):
    """The encoder on the hood's pivot.

    `zero_deg`: what it reads when the launch elevation is 0; `direction`: +1 if the reading grows with elevation.
    `magnet_ok` may be set by whoever wants the magnet to fall off.
    """

    def __init__(self, device: int, plant: Plant, zero_deg: float, direction: int) -> None:
        self.magnet_ok = True
        self._device, self._plant = device, plant
        self._zero_rad, self._direction = math.radians(zero_deg), direction
        self._codec = load_codec("canandmag")
        self.restart(0)

    def restart(self, t_ns: int) -> None:
        """Power is back: an ephemeral period is forgotten, and the count of turns starts at 0 again."""
        self._sticky = POWER_CYCLE
        self._start_counts = self._counts()
        self._position = Report(POSITION_PERIOD_NS, t_ns, self._make_position)
        self._reports = (self._position, Report(STATUS_PERIOD_NS, t_ns, self._make_status))
        self._due_ns = t_ns

    def ids(self) -> tuple[tuple[int, bool], ...]:
        return tuple((frame_id(self._device, name), True)
                     for name in ("SETTING_COMMAND", "SET_SETTING", "CLEAR_STICKY_FAULTS"))

    def receive(self, frame: Frame, t_ns: int) -> list[Frame]:
        """Take a setting, or forget sticky faults; a malformed frame is ignored and counted."""
        if frame.is_remote:
            return []
        if frame.arbitration_id == frame_id(self._device, "CLEAR_STICKY_FAULTS"):
            self._sticky = 0
            return []
        if frame.arbitration_id == frame_id(self._device, "SETTING_COMMAND"):
            return self._answer(self._parse(self._codec, "SETTING_COMMAND", frame))
        values = self._parse(self._codec, "SET_SETTING", frame)
        return [] if values is None else [self._take_setting(int(values["setting"]), int(values["value"]), t_ns)]

    def step(self, t_ns: int) -> list[Frame]:
        if t_ns < self._due_ns:
            return []
        frames = take_reports(self._reports, t_ns)
        self._plan()
        return frames

    def _take_setting(self, setting: int, value: int, t_ns: int) -> Frame:
        accepted = setting == POSITION_PERIOD_SETTING and value <= 0xFFFF
        if accepted:
            self._position.set_period(value * MS, t_ns)
            self._plan()
        return make(self._device, "REPORT_SETTING", {"setting": setting, "value": value, "accepted": int(accepted),
                                                      "committed": 0})

    def _answer(self, values: Values | None) -> list[Frame]:
        """The one setting that is emulated, where it is asked for."""
        if values is None or (values["command"], values["setting"]) != (FETCH_ONE, POSITION_PERIOD_SETTING):
            return []
        return [make(self._device, "REPORT_SETTING", {
            "setting": POSITION_PERIOD_SETTING, "value": self._position.period_ns // MS, "accepted": 1,
            "committed": 0})]

    def _counts(self) -> int:
        angle_rad = self._zero_rad + self._direction * self._plant.hood_encoder_rad()
        return round(angle_rad / math.tau * COUNTS)

    def _make_position(self) -> Frame:
        counts = self._counts()
        relative = (counts - self._start_counts + RELATIVE_COUNTS) % (2 * RELATIVE_COUNTS) - RELATIVE_COUNTS
        return make(self._device, "POSITION_OUTPUT", {
            "relative_rev": relative / COUNTS, "absolute_rev": counts % COUNTS / COUNTS,
            "magnet_status": 0 if self.magnet_ok else MAGNET_LOST_STATUS})

    def _make_status(self) -> Frame:
        faults = 0 if self.magnet_ok else MAGNET_OUT_OF_RANGE
        self._sticky |= faults
        return make(self._device, "STATUS", {"faults": faults, "sticky_faults": self._sticky,
                                              "temperature_degc": TEMPERATURE_DEGC})
