"""A process of ours beside the one that must be on time: started, watched, started again."""

import ctypes
import multiprocessing
import signal
import sys
import threading
from collections.abc import Callable
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any

from truearc.hw.fault_codes import PROCESS_ENDED, PROCESS_KILLED, PROCESS_STARTING
from truearc.hw.protocols import LinkLost
from truearc.hw.real.clock import make_pauses_s
from truearc.hw.reason import Reason

CONTEXT = multiprocessing.get_context("spawn")    # forking a process that has threads may hang the child
FIRST_S, LONGEST_S = 0.2, 5.0                     # pauses before it is started again
LOOK_S = 0.1                                      # how often a thread that waits for the first word looks up
ENDING_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")  # go to the whole group; who ends is the parent's to say
PR_SET_PDEATHSIG = 1
WORKS = "works"

Work = Callable[..., None]            # work(line, is_first, *args), importable by its name


class Line:
    """The child's end of what connects it with its parent; nothing is ever sent to a child, but that it is closed."""

    def __init__(self, connection: "Connection[Any, Any]") -> None:
        self._connection = connection

    def say(self, why_not: Reason | None) -> None:
        """Once: that it works, None, or why it cannot."""
        try:
            self._connection.send(why_not)
        except OSError:               # the parent has gone: the next look at the line says so
            return

    def is_over(self, wait_s: float) -> bool:
        """Whether the parent wants it to end, or is no more; waits for that."""
        try:
            return self._connection.poll(wait_s)
        except OSError:
            return True


class Child:
    """A process that does `work` until `close`, or until this process is no more.

    `trouble` is what is wrong with it: it has not started yet, cannot, or has ended; None while it works.
    `restarts`: started again when it has ended, after pauses that grow while it does no good. `mortal`: killed by the
    system when this process has died, where the system can; for one that has nothing to finish.

    A thread of its own starts the process and waits for its end: it is there before real time is asked for, so that a
    child, too, is ordinary, on whichever core; and Linux takes the death of the thread that started it for the
    parent's.
    """

    def __init__(self, name: str, work: Work, args: tuple[Any, ...], *, restarts: bool, mortal: bool) -> None:
        self.name = name
        self.trouble: Reason | None = PROCESS_STARTING(process=name)
        self.pid: int | None = None
        self.starts = 0
        self._work, self._args, self._restarts, self._mortal = work, args, restarts, mortal
        self._answered, self._over = threading.Event(), threading.Event()
        self._lock = threading.Lock()
        self._line: Connection[Any, Any] | None = None
        self._process: BaseProcess | None = None
        self._thread = threading.Thread(target=self._keep, name=f"{name} process", daemon=True)
        self._thread.start()

    def wait(self) -> None:
        """Until it works, the first time; LinkLost, saying why, when it cannot."""
        self._answered.wait()
        if self.trouble is not None:
            raise LinkLost(self.trouble)

    def is_gone(self) -> bool:
        """Whether it has ended for good."""
        return not self._restarts and self._answered.is_set() and not self._thread.is_alive()

    def close(self, patience_s: float) -> None:
        """Have it end, and kill it if it takes longer than that."""
        self._over.set()
        with self._lock:
            if self._line is not None:
                self._line.close()
        self._thread.join(patience_s)
        if self._thread.is_alive() and self._process is not None:
            self._process.kill()
            self._thread.join()

    def _keep(self) -> None:
        pauses_s = make_pauses_s(FIRST_S, LONGEST_S)
        while not self._over.is_set():
            worked = self._live_once()
            self._answered.set()
            if not self._restarts:
                return
            if worked:
                pauses_s = make_pauses_s(FIRST_S, LONGEST_S)
            self._over.wait(next(pauses_s))

    def _live_once(self) -> bool:
        """From a start to its end; whether it has worked between."""
        ours, theirs = CONTEXT.Pipe()
        work = (self._work, Line(theirs), self.starts == 0, self._mortal, self._args)
        process = CONTEXT.Process(target=_live, args=work, name=self.name, daemon=True)
        process.start()
        theirs.close()
        self.starts += 1
        with self._lock:
            self._line, self._process, self.pid = ours, process, process.pid
        said = self._listen(ours)
        process.join()
        if not isinstance(said, Reason):          # why it cannot says more
            self.trouble = _ended(self.name, process.exitcode or 0)
        with self._lock:
            ours.close()
        return said == WORKS

    def _listen(self, line: "Connection[Any, Any]") -> Reason | str | None:
        """Its first word: WORKS, or its trouble; None when it has ended, or is to, without any."""
        try:
            while not self._over.is_set():
                if line.poll(LOOK_S):
                    said: Reason | None = line.recv()
                    self.trouble = said
                    self._answered.set()
                    return said or WORKS
        except (OSError, EOFError):
            pass
        return None


def make_shared(size: int) -> Any:
    """Return `size` zero bytes that a child may share; the system frees them once no process holds them, however its
    holders ended."""
    return CONTEXT.RawArray(ctypes.c_ubyte, size)


def _ended(name: str, code: int) -> Reason:
    return PROCESS_KILLED(process=name, signal=-code) if code < 0 else PROCESS_ENDED(process=name, exit_code=code)


def _live(work: Work, line: Line, is_first: bool, mortal: bool, args: tuple[Any, ...]) -> None:
    for name in ENDING_SIGNALS:
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    if mortal and sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    work(line, is_first, *args)
