"""The three wheels, built from clean copies of the checkout, as an installer would unpack them."""

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

from truearc.robot.deploy.source import copy_source

ROOT = Path(__file__).parents[2]


def build_wheels(folder: Path) -> Path:
    """Build all wheels and unpack them side by side; returns the folder that holds the packages."""
    source = copy_source(ROOT, folder / "source")
    ignore = shutil.ignore_patterns("__pycache__", "*.egg-info", "build")
    others = [shutil.copytree(ROOT / name, source / name, ignore=ignore) for name in ("proof", "frc")]
    done = subprocess.run([sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation",
                           "--wheel-dir", str(folder), str(source), *map(str, others)],
                          capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    site = folder / "site"
    for wheel in folder.glob("*.whl"):
        with zipfile.ZipFile(wheel) as archive:
            archive.extractall(site)
    return site
