"""Walk of a reader through `truearc.discover`: the modules in the order of the first calls of their functions.

Neighbours in one module are one stay. A return is a stay in a module that was left before: stays less modules.

Usage: python tools/walk.py [DATASET]     (default: examples/tracks)
"""

import sys
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("truearc", "sim", "robot", "hw", "model_export")


class Walk:
    """The stays of a profiled call, each a module with the names of the functions that were first called there."""

    def __init__(self) -> None:
        self.stays: list[tuple[str, list[str]]] = []
        self._known: set[CodeType] = set()

    def hook(self, frame: FrameType, event: str, _: Any) -> None:
        """A hook for sys.setprofile."""
        code = frame.f_code
        if event != "call" or code in self._known:
            return
        self._known.add(code)
        if code.co_name.startswith("<") or (module := module_of(code.co_filename)) is None:
            return
        if not self.stays or self.stays[-1][0] != module:
            self.stays.append((module, []))
        self.stays[-1][1].append(code.co_qualname)

    @property
    def modules(self) -> int:
        return len({module for module, _ in self.stays})


def module_of(file: str) -> str | None:
    """Return the name of a module of truearc by its file, None for any other file."""
    path = Path(file).resolve()
    if not path.is_relative_to(ROOT) or path.relative_to(ROOT).parts[0] not in FOLDERS:
        return None
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts if parts[0] == "truearc" else ("truearc", *parts))


def main(argv: list[str]) -> int:
    """Print every stay, then the counts."""
    import truearc as ta

    dataset = ta.load_dataset(argv[0] if argv else ROOT / "examples" / "tracks")
    discover = ta.discover
    walk = Walk()
    sys.setprofile(walk.hook)
    try:
        finding = discover(dataset, believe=["gravity"], seed=0)
    finally:
        sys.setprofile(None)
    for module, names in walk.stays:
        print(f"{module:55s}{', '.join(names)}")
    print(f"{finding.verdict}: {len(walk.stays)} stays in {walk.modules} modules, "
          f"{len(walk.stays) - walk.modules} returns, {sum(len(names) for _, names in walk.stays)} functions")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
