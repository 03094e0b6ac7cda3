"""The sample motor's driver, an implementation of Motor that converts torques to duties.

It drives the motor only with fresh readings and without a fault.
"""

from truearc.hw.devices.drivers import OWN_LAG_S, Agreement, DcMotor, duty_for, torque_of
from truearc.hw.protocols import Frame, MotorReading, Order
from truearc.hw.reason import Reason
from truearc_samplemotor import frames
from truearc_samplemotor.frames import FIRMWARE, SampleAxis
from truearc_samplemotor.reasons import WRONG_FIRMWARE

LET_GO = 3                            # ticks in which a duty of 0 is sent: one may be lost; then its watchdog stops it
STALE_NS = 100_000_000                # a duty is not worked out from a speed or a voltage older than this


class SampleMotor:
    """A Motor that is sent a duty each tick. Its faults stand until it is wanted again.

    How late its frames come is not known: the answer to a question looks like a report that comes by itself.
    """

    def __init__(self, axis: SampleAxis, motor: DcMotor) -> None:
        self.reading = MotorReading()
        self._axis, self._motor = axis, motor
        self._agreement = Agreement(OWN_LAG_S)
        self._is_wanted = False
        self._let_go = 0              # how many more times it is told to let go
        self._firmware = FIRMWARE     # as the device names it

    def ids(self) -> tuple[tuple[int, bool], ...]:
        return tuple((frames.frame_id(self._axis, name), False) for name in frames.READINGS)

    def take(self, frame: Frame) -> None:
        before, self.reading = self.reading, frames.parse(self._axis, frame, self.reading)
        self._agreement.take(before, self.reading)
        if (firmware := frames.firmware_of(self._axis, frame)) is not None:
            self._firmware = firmware

    def faults(self, t_ns: int) -> tuple[Reason, ...]:
        if self._firmware != FIRMWARE:
            return (WRONG_FIRMWARE(node=self._axis.node, firmware=self._firmware, wanted=FIRMWARE),)
        fault = self._agreement.fault(f"samplemotor node {self._axis.node}", self.reading)
        return () if fault is None else (fault,)

    def order(self, torque_nm: float | None, t_ns: int) -> Order:
        sent = [frames.make_clear(self._axis)] if torque_nm is not None and not self._is_wanted else []
        self._is_wanted = torque_nm is not None
        if torque_nm is None or not self._may_drive(t_ns):
            self._let_go = max(self._let_go - 1, 0)
            return Order((*sent, *(self.release() if self._let_go else ())))
        self._let_go = LET_GO + 1
        reading = self.reading
        duty = duty_for(self._motor, torque_nm, reading.velocity_rad_s, reading.bus_v)
        torque_nm = torque_of(self._motor, duty, reading.velocity_rad_s, reading.bus_v)
        return Order((*sent, frames.make_duty(self._axis, duty)), torque_nm, duty)

    def release(self) -> tuple[Frame, ...]:
        return (frames.make_duty(self._axis, 0.0),)

    def _may_drive(self, t_ns: int) -> bool:
        oldest_ns = min(self.reading.t_ns, self.reading.bus_t_ns)
        return (oldest_ns > 0 and t_ns - oldest_ns <= STALE_NS and self.reading.bus_v > 0.0
                and not self.reading.axis_error)
