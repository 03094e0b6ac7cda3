"""A motor that is heard and never commanded; drivers of all families add the commands."""

from collections.abc import Callable, Iterable

from truearc.hw.encoder_plausibility import LAG_S, Agreement
from truearc.hw.protocols import Frame, MotorReading, Order
from truearc.hw.reason import Reason

Parse = Callable[[Frame, MotorReading], MotorReading]


class HeardMotor:
    """A truearc.hw.protocols.Motor that sends no frame, whatever torque it is given.

    device: as messages name it, such as "odrive node 1". frame_ids: of the frames that `parse` understands. lag_s: by
    which its filter may report a changing speed late.
    """

    def __init__(self, device: str, frame_ids: Iterable[int], is_extended: bool, parse: Parse,
                 lag_s: float = LAG_S) -> None:
        self.reading = MotorReading()
        self._device, self._parse = device, parse
        self._ids = tuple((frame_id, is_extended) for frame_id in frame_ids)
        self._agreement = Agreement(lag_s)

    def ids(self) -> tuple[tuple[int, bool], ...]:
        return self._ids

    def take(self, frame: Frame) -> None:
        before, self.reading = self.reading, self._parse(frame, self.reading)
        self._agreement.take(before, self.reading)

    def faults(self, t_ns: int) -> tuple[Reason, ...]:
        fault = self._agreement.fault(self._device, self.reading)
        return () if fault is None else (fault,)

    def order(self, torque_nm: float | None, t_ns: int) -> Order:
        return Order()

    def release(self) -> tuple[Frame, ...]:
        return ()
