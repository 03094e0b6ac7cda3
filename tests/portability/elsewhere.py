"""Python programs run as on Windows: by an interpreter without what it lacks (blocks/sitecustomize.py)."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
BLOCKS = Path(__file__).with_name("blocks")
WRITES = "cp1252"                     # Windows' encoding of redirected output
BEFORE = "import multiprocessing; multiprocessing.set_start_method('spawn')\n"


def run_elsewhere(program: str, folder: Path) -> str:
    """Run a program in a folder and return what it printed; AssertionError with its errors where it fails."""
    places = os.pathsep.join(map(str, (BLOCKS, ROOT)))
    done = subprocess.run([sys.executable, "-c", BEFORE + program], cwd=folder, capture_output=True, check=False,
                          env={**os.environ, "PYTHONPATH": places, "PYTHONWARNDEFAULTENCODING": "1",
                               "PYTHONIOENCODING": f"{WRITES}:strict"})
    assert done.returncode == 0, done.stderr.decode(WRITES)[-4000:]
    return done.stdout.decode(WRITES)
