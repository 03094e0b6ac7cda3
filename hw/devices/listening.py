"""Frames that devices send while none of them is commanded."""

from collections.abc import Callable, Iterable
from typing import NamedTuple, TypeVar

from truearc.hw.protocols import BadFrame, Bus, Clock, Frame

Reading = TypeVar("Reading")
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

    def read(self, keys: Iterable[tuple[int, bool]], parse: Callable[[Frame, Reading], Reading],
             reading: Reading) -> tuple[Reading, list[BadFrame]]:
        """`reading` brought up to date by the frames of these ids, and what was wrong with others of them."""
        wanted, refused = set(keys), []
        for frame in self.frames:
            if (frame.arbitration_id, frame.is_extended) in wanted and not frame.is_remote:
                try:
                    reading = parse(frame, reading)
                except BadFrame as error:
                    refused.append(error)
        return reading, refused


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
