"""A motor that is heard and never commanded, and one that is asked how late its readings come; drivers of all families
add the commands."""

from collections.abc import Callable, Iterable

from msgspec import UNSET
from msgspec.structs import replace

from truearc.hw.devices.round_trip import RoundTrip
from truearc.hw.encoder_plausibility import Agreement
from truearc.hw.protocols import Frame, MotorReading, Order
from truearc.hw.reason import Reason

Parse = Callable[[Frame, MotorReading], MotorReading]
STAMPS = ("t_ns", "heartbeat_t_ns", "current_t_ns", "bus_t_ns", "endstop_t_ns", "errors_t_ns")


class HeardMotor:
    """A truearc.hw.protocols.Motor that sends no frame, whatever torque it is given.

    device: as messages name it, such as "odrive node 1". frame_ids: of the frames that `parse` understands.
    """

    def __init__(self, device: str, frame_ids: Iterable[int], is_extended: bool, parse: Parse) -> None:
        self.reading = MotorReading()
        self._device, self._parse = device, parse
        self._ids = tuple((frame_id, is_extended) for frame_id in frame_ids)
        self._agreement = Agreement()
        self._late_ns = 0             # by which its frames come late, as far as that is known

    def ids(self) -> tuple[tuple[int, bool], ...]:
        return self._ids

    def take(self, frame: Frame) -> None:
        if self._late_ns:
            frame = older(frame, self._late_ns)
        before, self.reading = self.reading, self._parse(frame, self.reading)
        self._agreement.take(before, self.reading)

    def faults(self, t_ns: int) -> tuple[Reason, ...]:
        fault = self._agreement.fault(self._device, self.reading)
        return () if fault is None else (fault,)

    def order(self, torque_nm: float | None, t_ns: int) -> Order:
        return Order()

    def release(self) -> tuple[Frame, ...]:
        return ()


class AskedMotor(HeardMotor):
    """One that answers `question`, a remote frame, once a second: its readings are older by the time that this takes.

    `faults` is called before `order` in each tick, at the tick's own time.
    """

    def __init__(self, device: str, frame_ids: Iterable[int], is_extended: bool, parse: Parse, question: Frame) -> None:
        super().__init__(device, frame_ids, is_extended, parse)
        self._question, self._trip = question, RoundTrip(device)

    def faults(self, t_ns: int) -> tuple[Reason, ...]:
        trip = self._trip
        trip.tick(t_ns)
        fault = None if trip.is_timely else trip.fault()
        return super().faults(t_ns) if fault is None else (fault,)

    def _take_answer(self, frame: Frame) -> None:
        """An answer that has been found to be one."""
        if by_ns := self._trip.answered(frame.t_ns):
            self._late_ns += by_ns
            stamps = {name: stamp_ns - by_ns for name in STAMPS
                      if (stamp_ns := getattr(self.reading, name)) is not UNSET and stamp_ns > 0}
            self.reading = replace(self.reading, **stamps)
            self._agreement = Agreement()         # it measures times between stamps, which have just moved

    def _asked(self) -> tuple[Frame, ...]:
        """The question, in a tick in which it is due."""
        if not self._trip.is_due:
            return ()
        self._trip.asked()
        return (self._question,)


def older(frame: Frame, late_ns: int) -> Frame:
    """A device's data frame, stamped when it was sent by a device whose frames come so late."""
    return Frame(frame.t_ns - late_ns, frame.arbitration_id, frame.data, frame.is_extended)
