"""Loaders of a system and its runs from files, for the command line."""

import csv
import sys
import traceback
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from truearc.errors import InputError, load_text
from truearc.sim.systems.score_table import System
from truearc.sim.systems.system import Runs

COLUMNS = ("run", "time", "inputs", "conditions", "session")


def load_system(path: str | Path) -> tuple[System, dict[str, Any]]:
    """Run a Python file that defines `system` and `columns`; return both.

    Raises:
        InputError: the file fails, with the line, or does not define them.
    """
    if Path(path).suffix != ".py":
        raise InputError(f"{path}: is not a Python file; expected one that defines system and columns")
    text, module = load_text(path), ModuleType("truearc_system")
    module.__file__ = str(path)
    sys.modules[module.__name__] = module
    try:
        exec(compile(text, str(path), "exec"), vars(module))
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    except Exception as error:
        rows = [row.lineno for row in traceback.extract_tb(error.__traceback__) if row.filename == str(path)]
        at = getattr(error, "lineno", None) if isinstance(error, SyntaxError) else rows[-1] if rows else None
        raise InputError(f"{path}{f':{at}' if at else ''}: {type(error).__name__}: {error}") from error
    system, columns = getattr(module, "system", None), getattr(module, "columns", None)
    if not isinstance(system, System):
        raise InputError(f"{path}: system: got {type(system).__name__}; expected system = truearc.System(...)")
    if not isinstance(columns, Mapping) or not {*columns} <= {*COLUMNS}:
        raise InputError(f"{path}: columns: got {columns!r}; expected a dict with {', '.join(COLUMNS)}")
    return system, dict(columns)


def load_runs(path: str | Path, columns: Mapping[str, Any]) -> Runs:
    """Read a CSV table as runs; an empty cell is missing.

    Raises:
        InputError: the file cannot be read, or the table is not usable; with the file.
    """
    rows = list(csv.reader(load_text(path).splitlines()))
    if len(rows) < 2:
        raise InputError(f"{path}: has no rows below its header")
    header = [name.strip() for name in rows[0]]
    for number, row in enumerate(rows[1:], 2):
        if len(row) != len(header):
            raise InputError(f"{path}:{number}: has {len(row)} cells; expected {len(header)}")
    labels = (columns.get("run"), columns.get("session"))
    frame = {name: _column(path, name, [row[k].strip() for row in rows[1:]], name in labels)
             for k, name in enumerate(header)}
    try:
        return Runs(frame, **columns)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _column(path: str | Path, name: str, cells: list[str], label: bool) -> np.ndarray:
    """Numbers; text, where no cell is a number or a label may be anything."""
    numbers = [_number(cell) for cell in cells]
    wrong = [number for number, one in enumerate(numbers) if one is None]
    if wrong and not label and len(wrong) < len(cells):
        raise InputError(f"{path}:{wrong[0] + 2}: {name}: got {cells[wrong[0]]!r}; expected a number")
    return np.array(cells) if wrong else np.array(numbers, dtype=float)


def _number(cell: str) -> float | None:
    try:
        return float(cell) if cell else np.nan
    except ValueError:
        return None
