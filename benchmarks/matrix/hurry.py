"""Real time for a run's processes, as `truearc run` asks for its own."""

import contextlib
import os
import sys
from collections.abc import Iterator


def hurry() -> None:
    """Before others of this machine, threads that are started from now on too; not where that is refused."""
    if sys.platform == "linux":
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(10))


@contextlib.contextmanager
def in_a_hurry() -> Iterator[None]:
    """The same for a while, in a process that has other things to do afterwards and should not keep others from it."""
    if sys.platform != "linux":
        yield
        return
    before, param = os.sched_getscheduler(0), os.sched_getparam(0)
    hurry()
    try:
        yield
    finally:
        os.sched_setscheduler(0, before, param)
