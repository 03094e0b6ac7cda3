"""Clean copies of sources, to build a wheel from: an old `build/` would leak deleted modules into it."""

import shutil
from pathlib import Path

PARTS = ("pyproject.toml", "README.md", "LICENSE", "MANIFEST.in", "truearc", "hw", "robot", "sim", "model_export")
IGNORE = shutil.ignore_patterns("__pycache__", "*.pyc", "*.egg-info", "build", "dist", ".*")


def copy_source(checkout: Path, to: Path) -> Path:
    """Copy what a wheel of truearc is built from into the new folder `to`; returns `to`."""
    def ignore(folder: str, names: list[str]) -> set[str]:
        others = set(names) - set(PARTS) if Path(folder) == checkout else set()
        return others | IGNORE(folder, names)

    return shutil.copytree(checkout, to, ignore=ignore)


def copy_folder(folder: Path, to: Path) -> Path:
    """Copy a folder without what was built in it; returns `to`."""
    return shutil.copytree(folder, to, ignore=IGNORE)
