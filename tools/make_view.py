"""Make `build/view`: links that show static tools and a bare checkout the import names `truearc` and
`truearc_proof`."""

import os
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
ROOMS = ("hw", "robot", "sim", "model_export")


def make_view(root: Path = ROOT) -> Path:
    """Replace the links in `build/view`; returns that folder."""
    view = root / "build" / "view"
    package = view / "truearc"
    package.mkdir(parents=True, exist_ok=True)
    for link in (*package.iterdir(), view / "truearc_proof"):
        link.unlink(missing_ok=True)
    for target in (*(root / "truearc").iterdir(), *(root / room for room in ROOMS)):
        if target.name != "__pycache__":
            _link(package / target.name, target)
    _link(view / "truearc_proof", root / "proof" / "truearc_proof")
    return view


def _link(link: Path, target: Path) -> None:
    link.symlink_to(os.path.relpath(target, link.parent), target_is_directory=target.is_dir())


if __name__ == "__main__":
    print(make_view(), file=sys.stderr)
