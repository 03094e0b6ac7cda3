"""Requests of a process with real-time deadlines to Linux. A refusal is an answer, never an error."""

import contextlib
import ctypes
import os
import sys
import threading
from collections.abc import Callable
from typing import NamedTuple

CURRENT, FUTURE, ON_FAULT = 1, 2, 4               # mlockall's flags in <sys/mman.h>
ELSEWHERE = "this is not Linux"


class Answer(NamedTuple):
    """A request to the system; `refused` says why not, and is empty when it was granted."""

    asked: str
    refused: str


def ask_fifo(priority: int) -> Answer:
    """SCHED_FIFO for the calling thread; threads and processes that it starts are ordinary ones again."""
    return _ask(f"real-time scheduling (SCHED_FIFO {priority})", lambda: _set_fifo(0, priority))


def ask_fifo_beside(priority: int) -> Answer:
    """SCHED_FIFO, too, for all threads of this process that run by now, below the calling one: a thread that has the
    interpreter while it waits for a core holds up all others, whatever their own priority."""
    def ask() -> None:
        for name in os.listdir("/proc/self/task"):
            if int(name) == threading.get_native_id():
                continue
            with contextlib.suppress(ProcessLookupError):     # it has ended meanwhile
                _set_fifo(int(name), max(priority - 1, 1))

    return _ask(f"the same for its other threads (SCHED_FIFO {priority - 1})", ask)


def ask_core(core: int) -> Answer:
    """One core for the calling thread alone; threads that run already stay where they may."""
    return _ask(f"core {core}", lambda: os.sched_setaffinity(0, {core}))


def ask_locked_memory() -> Answer:
    """Memory that is never written out to disk, from now on.

    Asked only where there is no limit to it: under one, later allocations would fail in the middle of a run.
    """
    def ask() -> None:
        import resource  # POSIX only

        soft, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
        if soft != resource.RLIM_INFINITY and os.geteuid() != 0:
            raise OSError(f"only {soft // 1024} KiB are allowed")
        _call("mlockall", CURRENT | FUTURE | ON_FAULT)

    return _ask("locked memory", ask)


def rehearse(priority: int) -> tuple[Answer, ...]:
    """What would be granted of scheduling and memory: asked in a thread of its own, and given back."""
    answers: list[Answer] = []

    def ask() -> None:
        answers.append(ask_fifo(priority))
        answers.append(ask_locked_memory())
        if sys.platform == "linux" and not answers[-1].refused:
            _call("munlockall")

    thread = threading.Thread(target=ask, name="rehearsal")
    thread.start()
    thread.join()
    return tuple(answers)


def _set_fifo(thread: int, priority: int) -> None:
    os.sched_setscheduler(thread, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))


def _ask(asked: str, call: Callable[[], None]) -> Answer:
    if sys.platform != "linux":
        return Answer(asked, ELSEWHERE)
    try:
        call()
    except (OSError, ValueError) as error:        # ValueError: no such core at all
        return Answer(asked, (error.strerror if isinstance(error, OSError) else None) or str(error))
    return Answer(asked, "")


def _call(name: str, *arguments: int) -> None:
    if getattr(ctypes.CDLL(None, use_errno=True), name)(*arguments) != 0:
        code = ctypes.get_errno()
        raise OSError(code, os.strerror(code))
