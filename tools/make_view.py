"""Generator of `build/view`, whose links give a bare checkout its import names, for static tools.

The names are `truearc`, `truearc_proof` and `truearc_frc`.
"""

import os
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
ROOMS = ("hw", "robot", "sim", "model_export")
OTHERS = ("proof", "frc")             # folders of distributions of their own


def make_view(root: Path = ROOT) -> Path:
    """Replace the links in `build/view`; returns that folder."""
    view = root / "build" / "view"
    package = view / "truearc"
    package.mkdir(parents=True, exist_ok=True)
    for link in (*package.iterdir(), *(view / f"truearc_{name}" for name in OTHERS)):
        link.unlink(missing_ok=True)
    for target in (*(root / "truearc").iterdir(), *(root / room for room in ROOMS)):
        if target.name != "__pycache__":
            _link(package / target.name, target)
    for name in OTHERS:
        _link(view / f"truearc_{name}", root / name / f"truearc_{name}")
    return view


def _link(link: Path, target: Path) -> None:
    link.symlink_to(os.path.relpath(target, link.parent), target_is_directory=target.is_dir())


if __name__ == "__main__":
    print(make_view(), file=sys.stderr)
