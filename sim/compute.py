"""Parallel jobs on all cores, and an on-disk cache of compiled JAX code, so that only the first run compiles."""

import os
import platform
from collections.abc import Callable, Hashable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path
from typing import TypeVar

import jax

Job = TypeVar("Job")
Result = TypeVar("Result")
_compiled: set[Hashable] = set()
MIN_COMPILE_S = 0.3                   # code that compiles faster is not kept


def each_core(function: Callable[[Job], Result], jobs: Sequence[Job], code: Hashable) -> list[Result]:
    """Return the results in the order of the jobs.

    code: what a job compiles; if that is not compiled yet, the first job runs alone, and the others reuse the code.
    """
    alone = 0 if code in _compiled else 1
    first = [function(job) for job in jobs[:alone]]
    _compiled.add(code)
    rest = jobs[alone:]
    return first + list(_pool().map(function, rest) if len(rest) > 1 else map(function, rest))


def usable_cores() -> int:
    """Return the number of cores that this process may use; the machine's if the system does not say (Windows,
    macOS)."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(usable_cores(), thread_name_prefix="each-core")


if hasattr(os, "register_at_fork"):   # threads do not survive it
    os.register_at_fork(after_in_child=_pool.cache_clear)


def keep_compiled() -> None:
    """Keep compiled code in the user's cache; do nothing if that is not writable.

    A location that the user has chosen (JAX_COMPILATION_CACHE_DIR) is respected. The folder is named after the machine,
    because compiled code does not run on another.
    """
    if jax.config.values["jax_compilation_cache_dir"]:
        return
    try:
        folder = Path.home() / ".cache" / "truearc" / f"xla-{platform.node() or 'here'}"
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, RuntimeError):
        return
    if os.access(folder, os.W_OK):
        jax.config.update("jax_compilation_cache_dir", str(folder))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", MIN_COMPILE_S)
