"""What devices say while nobody tells them to do anything."""

from collections.abc import Iterable
from typing import NamedTuple

from truearc.hw.protocols import Bus, Clock, Frame

NS_PER_S = 1_000_000_000
LOOK_NS = 5_000_000                   # between looks at the bus


class Heard(NamedTuple):
    """Everything that the bus carried in `seconds`."""

    frames: tuple[Frame, ...]
    seconds: float

    def of(self, frame_id: int, extended: bool = False) -> list[Frame]:
        """Devices' frames with one id, oldest first."""
        return [frame for frame in self.frames
                if frame.arbitration_id == frame_id and frame.is_extended == extended and not frame.is_remote]


def listen(bus: Bus, clock: Clock, questions: Iterable[Frame], seconds: float) -> Heard:
    """Put the questions, none of which may change anything, and listen; LinkLost when the adapter goes."""
    bus.read()                                    # what was said before we asked
    for question in questions:
        bus.write(question)
    began_ns = clock.now_ns()
    frames: list[Frame] = []
    while (now_ns := clock.now_ns()) - began_ns < seconds * NS_PER_S:
        clock.sleep_until_ns(now_ns + LOOK_NS)
        frames += bus.read()
    return Heard(tuple(frames), (now_ns - began_ns) / NS_PER_S)
