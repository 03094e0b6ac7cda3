"""The command line under test, in a process of its own: nothing of the package is imported here."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

# Every spelling that `make golden` uses, if not the name. When a command is renamed, change it here and nowhere else.
COMMANDS = {"replay": "session replay", "predict gate": "predict --gate", "fit ml": "fit", "fit grid": "paper fit",
            "synth": "paper synth", "train network": "paper train"}

# As tests/conftest.py has it: one thread, so that sums are taken in one order, and XLA's older code generator.
ENVIRONMENT = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1",
               "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.2", "JAX_PLATFORMS": "cpu",
               "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false --xla_cpu_use_fusion_emitters=false "
                            "intra_op_parallelism_threads=1"}


class CommandFailed(Exception):
    """A command ended with another exit code than 0."""


def run(scratch: Path, name: str, *args: str | Path) -> str:
    """Run a command in `scratch` and return its standard output; raise CommandFailed unless it exits 0.

    JAX's compiled code is shared by all commands of a run; Numba's is not, since two processes may give one name to
    code for different arguments.
    """
    with tempfile.TemporaryDirectory(prefix="numba-", dir=scratch) as numba:
        environment = {"JAX_COMPILATION_CACHE_DIR": str(scratch / "jax"), **ENVIRONMENT, **os.environ,
                       "NUMBA_CACHE_DIR": numba}
        argv = [sys.executable, "-m", "truearc", *COMMANDS.get(name, name).split(), *map(str, args)]
        done = subprocess.run(argv, env=environment, cwd=scratch, capture_output=True, text=True)
    if done.returncode:
        raise CommandFailed(f"{' '.join(argv[1:])}: exit {done.returncode}\n{done.stdout[-500:]}{done.stderr[-2000:]}")
    return done.stdout
