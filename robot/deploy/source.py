"""Clean copies of sources, to build a wheel from: an old `build/` would leak deleted modules into it."""

import shutil
from pathlib import Path

PARTS = ("pyproject.toml", "README.md", "LICENSE", "MANIFEST.in", "truearc", "hw", "robot", "sim", "model_export")
IGNORE = shutil.ignore_patterns("__pycache__", "*.pyc", "*.egg-info", "build", "dist", ".*")


def copy_source(checkout: Path, to: Path) -> Path:
    """Copy what a wheel of truearc is built from into the new folder `to`; returns `to`."""
    to.mkdir(parents=True)
    for name in PARTS:
        path = checkout / name
        if path.is_dir():
            copy_folder(path, to / name)
        elif path.exists():
            shutil.copyfile(path, to / name)
    return to


def copy_folder(folder: Path, to: Path) -> Path:
    """Copy a folder without what was built in it; returns `to`."""
    return shutil.copytree(folder, to, ignore=IGNORE)
