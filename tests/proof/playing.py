"""A small round as its tests play it."""

import subprocess
import sys
from pathlib import Path

ARGUMENTS = ["--worlds", "3", "--level", "L0", "--shots", "40", "--engines", "numpy", "--seed", "3", "--processes", "1"]


def quiet(done: float, note: str) -> None:
    pass


def prove(root: Path, *more: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "truearc", "prove", *more, "--out", str(root)], capture_output=True,
                          text=True, check=False)
