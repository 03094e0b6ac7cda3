"""Work that the tick hands to a thread, so that it never waits for a disk."""

import queue
import threading
from collections.abc import Callable

LONGEST = 1000                        # jobs that may wait; more than a minute and a half of ticks
Job = Callable[[], None]


class Lane:
    """One thread that does what it is handed, in order.

    `trouble` is what the newest job met, None when it went well. `patient`: whoever hands over waits until all before
    is done, instead of losing a job (`dropped`) when too many wait; for the twin, whose time can wait.
    """

    def __init__(self, name: str, patient: bool, longest: int = LONGEST) -> None:
        self.dropped = 0
        self.trouble: Exception | None = None
        self._patient = patient
        self._jobs: queue.Queue[Job | None] = queue.Queue(longest)
        self._thread = threading.Thread(target=self._work, name=f"recorder {name}", daemon=True)
        self._thread.start()

    def hand(self, job: Job) -> None:
        if self._patient:
            self._jobs.join()
        try:
            self._jobs.put_nowait(job)
        except queue.Full:
            self.dropped += 1

    def waiting(self) -> int:
        """How many jobs have not been begun."""
        return self._jobs.qsize()

    def close(self) -> None:
        """Do what waits, and end."""
        self._jobs.put(None)
        self._thread.join()

    def _work(self) -> None:
        while (job := self._jobs.get()) is not None:
            try:
                job()
                self.trouble = None
            except Exception as error:    # whatever it was: the robot runs on, and holds while this stands
                self.trouble = error
            finally:
                self._jobs.task_done()
