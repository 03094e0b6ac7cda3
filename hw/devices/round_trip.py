"""How late a device's frames come: a frame is stamped when it arrives, and only an answer tells when it was sent.

An adapter or a queue may hold every frame back for the same time; readings then look fresh and are not. A question and
its answer take as long as that, or longer, so readings count as older by the whole of it. No IO, no clock.
"""

from collections import deque

from truearc.hw.fault_codes import CONTROLLER_NOT_ANSWERING, FEEDBACK_LATE, FEEDBACK_UNMEASURED
from truearc.hw.reason import Reason

MS = 1_000_000
# From one question to the next, after an answer and without one. Each answer is counted from the newest question: one
# that is later than a gap looks early. With gaps that differ it does not four times running, for delays up to 4 s.
ANSWERED_NS = (1000 * MS, 850 * MS, 1150 * MS)
UNANSWERED_NS = (500 * MS, 350 * MS, 650 * MS)
COUNTED = 4                           # of this number of answers the shortest counts, unless one is later than LATE_NS
STEP_NS = 5 * MS                      # it is counted in steps of this: a little more or less does not move every stamp
HICCUP_NS = 30 * MS                   # what takes longer is asked again at once: something may have held it up once
LATE_NS = 100 * MS                    # later readings are of no use to a loop, however fresh the gate would have them
STALL_NS = 60 * MS                    # ticks come every 50 ms at least: after a longer gap the answer has waited for us
# Of questions and answers half may be lost, and 60 in a row are not in the life of a robot (0.75 ** 60 = 3e-8)
SILENT_NS = 30_000 * MS


class RoundTrip:
    """Questions to one device, once a second, and how long the answers take.

    device: as messages name it, such as "odrive node 1". `late_ns`: by which its readings are older than they look.
    """

    def __init__(self, device: str) -> None:
        self.late_ns = 0
        self.is_due = False           # a question is to be sent in this tick
        self.is_open = False          # the newest question has had no answer
        self.is_measured = self.is_timely = False     # timely: readings may be acted on
        self._device = device
        self._took_ns: deque[int] = deque(maxlen=COUNTED)
        self._asked_ns = self._due_ns = self._tick_ns = 0
        self._heard_ns: int | None = None         # when it last answered, or was first asked
        self._turn = 0
        self._unanswered = 0          # questions since the last answer
        self._doubted_ns = 0          # a long time that has not been confirmed; 0: none

    def tick(self, t_ns: int) -> None:
        """Once a tick, at the time that is recorded of it, before anything is sent."""
        self._tick_ns = t_ns
        if t_ns >= self._due_ns:
            self.is_due = True
            if self._heard_ns is not None and t_ns - self._heard_ns > SILENT_NS:
                self.is_timely = False

    def asked(self) -> None:
        """The question is sent in this tick; its time is the tick's, which is recorded, and a little earlier."""
        t_ns = self._tick_ns
        if self._heard_ns is None:
            self._heard_ns = t_ns
        self._turn = (self._turn + 1) % len(UNANSWERED_NS)
        self.is_due, self.is_open = False, True
        self._unanswered += 1
        self._asked_ns, self._due_ns = t_ns, t_ns + UNANSWERED_NS[self._turn]

    def answered(self, t_ns: int) -> int:
        """An answer came at `t_ns`; by how much `late_ns` has changed."""
        if self._heard_ns is None:
            return 0                  # to another host
        was_open, self.is_open, self._heard_ns = self.is_open, False, t_ns
        alone, self._unanswered = self._unanswered == 1, 0       # it is the answer to the newest question
        if t_ns - self._tick_ns > STALL_NS:
            self.is_timely = bool(self._took_ns) and max(self._took_ns) <= LATE_NS
            return 0                  # asked again without waiting for the usual time
        took_ns, doubted_ns = max(t_ns - self._asked_ns, 0), self._doubted_ns
        if alone and took_ns > HICCUP_NS and not doubted_ns and took_ns > self.late_ns:
            self._doubted_ns, self._due_ns = took_ns, t_ns
            return 0
        if was_open:
            self._due_ns = self._asked_ns + ANSWERED_NS[self._turn]
        self._doubted_ns = 0
        self._took_ns.append(max(took_ns, doubted_ns) if took_ns > HICCUP_NS else took_ns)
        longest_ns, before_ns = max(self._took_ns), self.late_ns
        # a delay of all frames is in the shortest, too, unless one of them shows that they were counted from the wrong
        # question; what some have beyond it is the computer's, which had other things to do
        steps_ns = -(-(longest_ns if longest_ns > LATE_NS else min(self._took_ns)) // STEP_NS) * STEP_NS
        if not before_ns - STEP_NS <= steps_ns <= before_ns:
            self.late_ns = steps_ns
        self.is_measured, self.is_timely = True, longest_ns <= LATE_NS
        return self.late_ns - before_ns

    def fault(self) -> Reason | None:
        """Why the device's readings may not be acted on; None while they may."""
        if self.is_timely:
            return None
        if not self.is_measured or self._heard_ns is None:
            return FEEDBACK_UNMEASURED(controller=self._device)
        if (silence_ns := self._tick_ns - self._heard_ns) > SILENT_NS:
            return CONTROLLER_NOT_ANSWERING(controller=self._device, silence_s=silence_ns * 1e-9)
        return FEEDBACK_LATE(controller=self._device, delay_s=max(self._took_ns) * 1e-9)
