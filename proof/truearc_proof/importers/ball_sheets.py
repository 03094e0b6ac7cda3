"""`Ball_drops_data.xls`, a sheet a ball, and `balls.txt`, their weights and girths -> the tables of ball_drops."""

import io
import math
from pathlib import Path
from typing import Any

from truearc.errors import InputError
from truearc.sim.data.columns import parse_number
from truearc.sim.data.table import Cell, Problems, RawTable, text_of
from truearc_proof.importers.originals import needed, part

COLUMNS = {"drop": "Drop #", "t_s": "Time (s)", "height_m": "Height (m)"}     # ours -> theirs
OUNCE_KG = 0.0283495
CM_M = 0.01
UNKNOWN = "??"                        # not measured
# sheets whose ball has another name in the list; else it is the sheet's in one word, with "wiffle" for "whiffle"
LISTED_AS = {"Yellow Whiffle Ball": "yellowWiffle", "Orange Whiffle Ball": "orangeWiffle"}
Body = tuple[Cell, Cell]              # mass_kg, diameter_m


def load_sheets(workbook: Path, balls: Path, problems: Problems) -> list[RawTable]:
    """A table a ball; lines are the sheet's rows, from 1. InputError names the file, sheet or line that is no such."""
    bodies = _bodies(balls, problems)
    problems.close()
    return [_sheet(part(workbook, f"sheet {sheet.title}"), sheet, bodies, balls)
            for sheet in _opened(workbook).worksheets]


def _opened(workbook: Path) -> Any:
    """The public file is named .xls and holds a workbook of the newer kind: its content decides, not its name."""
    openpyxl = needed("openpyxl", workbook)
    try:
        return openpyxl.load_workbook(io.BytesIO(workbook.read_bytes()), data_only=True)
    except OSError as error:
        raise InputError(f"{workbook}: {error.strerror or error}") from error
    except Exception as error:        # what openpyxl meets in a damaged workbook is of many kinds
        raise InputError(f"{workbook}: not a readable Excel workbook (.xlsx by content): {error}") from error


def _sheet(here: Path, sheet: Any, bodies: dict[str, Body], balls: Path) -> RawTable:
    ball = LISTED_AS.get(sheet.title, sheet.title.lower().replace(" ", "").replace("whiffle", "wiffle"))
    if ball not in bodies:
        raise InputError(f"{here}: its ball, {ball}, is not in {balls}")
    header, *rows = list(sheet.iter_rows()) or [()]
    names = [str(cell.value).strip() for cell in header]
    for name in COLUMNS.values():
        if names.count(name) != 1:
            raise InputError(f"{here}:1: column {name!r} " + ("stands twice" if name in names else "is missing"))
    place = {ours: names.index(theirs) for ours, theirs in COLUMNS.items()}
    read = {line: {ours: _cell(row[at]) for ours, at in place.items()} for line, row in enumerate(rows, start=2)}
    kept = [line for line, cells in read.items() if any(cell is not None for cell in cells.values())]
    columns: dict[str, list[Cell]] = {ours: [read[line][ours] for line in kept] for ours in COLUMNS}
    mass_kg, diameter_m = bodies[ball]
    columns |= {"ball": [ball] * len(kept), "mass_kg": [mass_kg] * len(kept), "diameter_m": [diameter_m] * len(kept)}
    columns["drop"] = [f"{cell:g}" if isinstance(cell, float) else cell for cell in columns["drop"]]
    return RawTable(here, columns, kept)


def _cell(cell: Any) -> Cell:
    """A number, or the text of what is none; an empty cell is missing."""
    if cell.data_type == "n" and cell.value is not None:
        return float(cell.value)
    odd = {"e": "an error", "b": "a yes or no", "d": "a date"}
    return odd.get(cell.data_type, str(cell.value or "").strip()) or None


def _bodies(path: Path, problems: Problems) -> dict[str, Body]:
    """Mass and diameter of each ball, out of lines `name ounces girth_cm` under a header."""
    bodies: dict[str, Body] = {}
    for line, text in enumerate(text_of(path).splitlines(), start=1):
        words = text.split()
        if line == 1 or not words:
            continue
        if len(words) != 3:
            problems.add(f"{path}:{line}", "", "is not a ball's name, weight (oz) and circumference (cm)")
        elif words[0] in bodies:
            problems.add(f"{path}:{line}", "", f"{words[0]!r} stands twice")
        else:
            bodies[words[0]] = (_scaled(words[1], OUNCE_KG, f"{path}:{line}", problems),
                                _scaled(words[2], CM_M / math.pi, f"{path}:{line}", problems))
    return bodies


def _scaled(word: str, factor: float, place: str, problems: Problems) -> Cell:
    number = None if word == UNKNOWN else parse_number(word)
    if word != UNKNOWN and (number is None or not math.isfinite(number)):
        problems.add(place, "", f"{word!r} is not a finite number, nor {UNKNOWN!r} for unknown")
    return None if number is None else number * factor
