"""Compiled JAX code on disk, so that only the first run on a machine compiles."""

import os
import platform
from pathlib import Path

import jax

MIN_COMPILE_S = 0.3                   # code that compiles faster is not kept


def keep_compiled() -> None:
    """Keep compiled code among the user's caches; do nothing where that place cannot be written.

    Where the user has chosen a place (JAX_COMPILATION_CACHE_DIR), that one is used. The folder carries the name of the
    machine, because code of one machine does not run on another.
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
