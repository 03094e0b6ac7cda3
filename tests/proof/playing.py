"""A small round as its tests play it."""

import contextlib
import io
import subprocess
import sys
from pathlib import Path
from unittest.mock import patch

from truearc.cli.main import main
from truearc_proof.rounds import solver

ARGUMENTS = ["--worlds", "3", "--level", "L0", "--shots", "40", "--engines", "numpy", "--seed", "3", "--processes", "1"]


def quiet(done: float, note: str) -> None:
    pass


def prove_apart(root: Path, *more: str) -> subprocess.CompletedProcess[str]:
    """Run `truearc prove` in a process of its own."""
    return subprocess.run([sys.executable, "-m", "truearc", "prove", *more, "--out", str(root)], capture_output=True,
                          text=True, check=False)


def prove(root: Path, *more: str) -> subprocess.CompletedProcess[str]:
    """Run `truearc prove` in this process, which has imported and compiled most of what it needs. Here the solver does
    not refuse the seals, as it would to the end of the process; a round of all roles has it in one of its own."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), patch.object(solver, "forbid"):
        code = main(["prove", *more, "--out", str(root)])
    return subprocess.CompletedProcess([*more], code, out.getvalue(), err.getvalue())
