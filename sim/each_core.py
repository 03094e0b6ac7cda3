"""Jobs on all cores of one process, in threads: for code that lets other threads run, as compiled code does."""

import os
from collections.abc import Callable, Hashable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import TypeVar

Job = TypeVar("Job")
Result = TypeVar("Result")


_compiled: set[Hashable] = set()


def each_core(function: Callable[[Job], Result], jobs: Sequence[Job], code: Hashable) -> list[Result]:
    """The results in the order of the jobs. code: what a job compiles; where that has not been done, the first is done
    alone, and the others find it."""
    alone = 0 if code in _compiled else 1
    first = [function(job) for job in jobs[:alone]]
    _compiled.add(code)
    rest = jobs[alone:]
    return first + list(_pool().map(function, rest) if len(rest) > 1 else map(function, rest))


def usable_cores() -> int:
    """Cores that this process may use; all of the machine's where the system does not say (Windows, macOS)."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(usable_cores(), thread_name_prefix="each-core")


if hasattr(os, "register_at_fork"):   # threads do not survive it
    os.register_at_fork(after_in_child=_pool.cache_clear)
