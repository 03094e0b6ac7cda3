"""Every press once: what the numbers on a button box's lines say of presses lost and told twice. No IO, no clock."""

from collections.abc import Sequence

from hw.buttons import HEARTBEAT_NS, SEQ_COUNT, Heartbeat, lost_presses
from hw.reading import ButtonEvent


class PressCount:
    """Keeps the number of the newest press that was heard.

    A press that is told again, the same button under the same number, is none; but only for as long as a box is never
    silent: after that it could be the first press of a box that was without power.
    """

    def __init__(self) -> None:
        self._seq: int | None = None
        self._press: ButtonEvent | None = None

    def take(self, events: Sequence[ButtonEvent | Heartbeat]) -> tuple[list[ButtonEvent], list[str]]:
        """The presses among what the box has said, and what is wrong with their numbers, in words."""
        presses: list[ButtonEvent] = []
        faults: list[str] = []
        twice = 0
        for event in events:
            if isinstance(event, ButtonEvent):
                if self._is_known(event):
                    twice += 1
                    continue
                self._press = event
                presses.append(event)
            # A press counts itself; a heartbeat repeats the number of the newest press.
            faults += self._gap(event.seq if isinstance(event, ButtonEvent) else event.seq + 1)
            self._seq = event.seq
        return presses, faults + ([f"{twice} presses told twice"] if twice else [])

    def _is_known(self, event: ButtonEvent) -> bool:
        last = self._press
        return (last is not None and event.seq == last.seq == self._seq and event.button == last.button
                and event.t_ns - last.t_ns < HEARTBEAT_NS)

    def _gap(self, expected: int) -> list[str]:
        lost = 0 if self._seq is None else lost_presses(self._seq, expected)
        if not lost:
            return []
        # Half the count ahead is behind: a box that was without power counts from the start again.
        return [f"{lost} presses lost" if lost < SEQ_COUNT // 2 else "restarted"]
