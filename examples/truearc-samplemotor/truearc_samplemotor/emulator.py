"""The emulated sample motor.

It sends its reports at their rates and goes limp if no duty arrives within its watchdog timeout.
"""

from truearc.hw.codec import Values
from truearc.hw.devices.family import AttachedMotor
from truearc.hw.emulated.nodes import NEVER_NS, Report, take_reports
from truearc.hw.protocols import NS_PER_MS as MS
from truearc.hw.protocols import BadFrame, Frame
from truearc_samplemotor import frames
from truearc_samplemotor.frames import REVOLUTION_RAD, SampleAxis

LOOP_NS = 1 * MS                      # the device works out its output this often


class SampleNode:
    """One device with one motor of the plant. Coasts at a duty of 0."""

    def __init__(self, axis: SampleAxis, motor: AttachedMotor) -> None:
        self.motor: str | None = motor.name
        self.faults = 0               # as in Health
        self.bad_frames = 0
        self._axis, self._attached = axis, motor
        self._duty_id, self._clear_id, self._health_id = (
            frames.frame_id(axis, name) for name in ("Set_Duty", "Clear_Faults", "Health"))
        self.restart(0)

    def restart(self, t_ns: int) -> None:
        self._truth = self._attached.plant.motor(self._attached.name)
        self._start_rad = self._truth.position_rad
        self._duty, self._expires_ns = 0.0, NEVER_NS
        self._reports = (Report(10 * MS, t_ns + 3 * MS, self._make_motion),
                         Report(50 * MS, t_ns + 3 * MS, self._make_health))
        self._due_ns = t_ns

    def ids(self) -> tuple[tuple[int, bool], ...]:
        return tuple((frame_id, False) for frame_id in (self._duty_id, self._clear_id, self._health_id))

    def receive(self, frame: Frame, t_ns: int) -> list[Frame]:
        """Obey one frame; a malformed one is ignored and counted, and does not feed the watchdog."""
        if frame.is_remote:
            return [self._make_health()] if frame.arbitration_id == self._health_id else []
        if frame.arbitration_id == self._clear_id:
            self.faults = 0
        elif frame.arbitration_id == self._duty_id:
            try:
                self._duty = frames.codec().parse("Set_Duty", frame.data)["duty"]
            except BadFrame:
                self.bad_frames += 1
                return []
            self._expires_ns = t_ns + frames.WATCHDOG_MS * MS
            self._due_ns = min(self._due_ns, t_ns + LOOP_NS)
        return []

    def due_ns(self) -> int:
        return self._due_ns

    def step(self, t_ns: int) -> list[Frame]:
        self._truth = self._attached.plant.motor(self._attached.name)
        if t_ns >= self._expires_ns or self.faults:
            self._duty, self._expires_ns = 0.0, NEVER_NS
        sent = take_reports(self._reports, t_ns)
        loop_ns = t_ns + LOOP_NS if self._expires_ns < NEVER_NS else NEVER_NS
        self._due_ns = min(loop_ns, *(report.due_ns for report in self._reports))
        return sent

    def torque_nm(self) -> float:
        """Torque of the motor now; positive launches a ball or raises the hood."""
        if self._duty == 0.0:
            return 0.0
        motor, sign = self._attached, self._axis.direction
        back_v = motor.kt_nm_a * sign * self._truth.velocity_rad_s
        return sign * motor.kt_nm_a * (self._duty * motor.plant.bus_v() - back_v) / motor.resistance_ohm

    def _make_motion(self) -> Frame:
        sign, truth = self._axis.direction, self._truth
        return self._make("Motion", {"position_rev": sign * (truth.position_rad - self._start_rad) / REVOLUTION_RAD,
                                     "velocity_rev_s": sign * truth.velocity_rad_s / REVOLUTION_RAD})

    def _make_health(self) -> Frame:
        return self._make("Health", {
            "is_driven": int(self._expires_ns < NEVER_NS), "faults": self.faults,
            "bus_v": self._attached.plant.bus_v(), "current_a": self._axis.direction * self._truth.current_a,
            "firmware": frames.FIRMWARE})

    def _make(self, message: str, values: Values) -> Frame:
        return Frame(0, frames.frame_id(self._axis, message), frames.codec().make(message, values))
