"""Every press once: presses lost and sent twice, by the numbers on a button box's lines. No IO, no clock."""

from collections.abc import Sequence
from typing import NamedTuple

from truearc.hw.devices.button_box.frames import HEARTBEAT_NS, SEQ_COUNT, BoxHeartbeat, lost_presses
from truearc.hw.fault_codes import BOX_PRESSES_LOST, BOX_PRESSES_REPEATED, BOX_RESTARTED
from truearc.hw.protocols import ButtonEvent
from truearc.hw.reason import Reason


class Counted(NamedTuple):
    """What came of some lines. `missed`: the newest fault by which presses may be lost; None: there is none."""

    presses: list[ButtonEvent]
    faults: list[Reason]
    missed: Reason | None


class PressCount:
    """Keeps the number of the newest press that was heard.

    The same button under the same number again is the same press, but only for as long as a box is never silent: after
    that it could be the first press of a box that was without power.
    """

    def __init__(self) -> None:
        self._seq: int | None = None
        self._press: ButtonEvent | None = None

    def take(self, events: Sequence[ButtonEvent | BoxHeartbeat]) -> Counted:
        """The presses among what the box has said, and what is wrong with their numbers."""
        presses: list[ButtonEvent] = []
        faults: list[Reason] = []
        twice = 0
        for event in events:
            if isinstance(event, ButtonEvent):
                if self._is_known(event):
                    twice += 1
                    continue
                self._press = event
                presses.append(event)
            # A press counts itself; a heartbeat repeats the number of the newest press.
            expected = event.seq if isinstance(event, ButtonEvent) else event.seq + 1
            lost = 0 if self._seq is None else lost_presses(self._seq, expected)
            self._seq = event.seq
            if lost:
                # Half the count ahead is behind: a box that was without power counts from the start again.
                faults.append(BOX_RESTARTED() if lost >= SEQ_COUNT // 2 else BOX_PRESSES_LOST(presses=lost))
        missed = faults[-1] if faults else None
        return Counted(presses, faults + ([BOX_PRESSES_REPEATED(presses=twice)] if twice else []), missed)

    def _is_known(self, event: ButtonEvent) -> bool:
        last = self._press
        return (last is not None and event.seq == last.seq == self._seq and event.button == last.button
                and event.t_ns - last.t_ns < HEARTBEAT_NS)
