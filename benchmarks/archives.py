"""Paths of stored results, as options of the benchmarks take them."""

import argparse
from pathlib import Path

ADVICE = "archives of published runs are in the tree of tag proof-1; benchmarks/results/MANIFEST.md has the command"


def stored_file(text: str) -> Path:
    """Return the path of a file of results; ArgumentTypeError, with where the archives are, if there is none."""
    path = Path(text)
    if not path.is_file():
        raise argparse.ArgumentTypeError(f"{text}: no such file; {ADVICE}")
    return path
