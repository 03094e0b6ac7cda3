"""Every press once: what the numbers on a button box's lines say of presses lost and told twice. No IO, no clock."""

from collections.abc import Sequence
from typing import NamedTuple

from truearc.hw.devices.button_box.frames import HEARTBEAT_NS, SEQ_COUNT, BoxHeartbeat, lost_presses
from truearc.hw.readings import ButtonEvent


class Counted(NamedTuple):
    """What came of some lines. `missed`: what the box did that lost presses may be due to, in words; "" for nothing."""

    presses: list[ButtonEvent]
    faults: list[str]
    missed: str


class PressCount:
    """Keeps the number of the newest press that was heard.

    A press that is told again, the same button under the same number, is none; but only for as long as a box is never
    silent: after that it could be the first press of a box that was without power.
    """

    def __init__(self) -> None:
        self._seq: int | None = None
        self._press: ButtonEvent | None = None

    def take(self, events: Sequence[ButtonEvent | BoxHeartbeat]) -> Counted:
        """The presses among what the box has said, and what is wrong with their numbers, in words."""
        presses: list[ButtonEvent] = []
        faults: list[str] = []
        twice, missed = 0, ""
        for event in events:
            if isinstance(event, ButtonEvent):
                if self._is_known(event):
                    twice += 1
                    continue
                self._press = event
                presses.append(event)
            # A press counts itself; a heartbeat repeats the number of the newest press.
            lost = self._lost(event.seq if isinstance(event, ButtonEvent) else event.seq + 1)
            self._seq = event.seq
            if lost:
                # Half the count ahead is behind: a box that was without power counts from the start again.
                restarted = lost >= SEQ_COUNT // 2
                faults.append("restarted" if restarted else f"{lost} presses lost")
                missed = "has restarted" if restarted else "lost presses"
        return Counted(presses, faults + ([f"{twice} presses told twice"] if twice else []), missed)

    def _is_known(self, event: ButtonEvent) -> bool:
        last = self._press
        return (last is not None and event.seq == last.seq == self._seq and event.button == last.button
                and event.t_ns - last.t_ns < HEARTBEAT_NS)

    def _lost(self, expected: int) -> int:
        return 0 if self._seq is None else lost_presses(self._seq, expected)
