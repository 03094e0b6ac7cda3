"""Somebody else's motor: heard, and never spoken to. For use beside a competition controller, which drives it."""

from collections.abc import Callable

from truearc.hw.encoder_plausibility import Agreement
from truearc.hw.motor import Order
from truearc.hw.protocols import Frame
from truearc.hw.readings import MotorReading
from truearc.hw.reason import Reason

Parse = Callable[[Frame, MotorReading], MotorReading]


class AdvisoryMotor:
    """A Motor that commands nothing: whatever is asked of it, no frame comes out.

    `parse` is that of the family of the device that is listened to, `frame_ids` what it understands.
    """

    def __init__(self, frame_ids: tuple[int, ...], is_extended: bool, parse: Parse) -> None:
        self.reading = MotorReading()
        self._ids = tuple((frame_id, is_extended) for frame_id in frame_ids)
        self._parse = parse
        self._agreement = Agreement()

    def ids(self) -> tuple[tuple[int, bool], ...]:
        return self._ids

    def take(self, frame: Frame) -> None:
        before, self.reading = self.reading, self._parse(frame, self.reading)
        self._agreement.take(before, self.reading)

    def faults(self, t_ns: int) -> tuple[Reason, ...]:
        fault = self._agreement.fault("its controller", self.reading)
        return () if fault is None else (fault,)

    def order(self, torque_nm: float | None, t_ns: int) -> Order:
        return Order()

    def release(self) -> tuple[Frame, ...]:
        return ()
