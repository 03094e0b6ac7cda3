"""Dataset -> a directory of CSV files that read back exactly."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from truearc.errors import InputError
from truearc.sim.data.columns import RANGES
from truearc.sim.data.load import LEFT_OUT
from truearc.sim.data.model import Dataset, Shots
from truearc.sim.data.rig import RIG, save_rig

Column = Sequence[str] | np.ndarray
FIRST = ("shot_id", "distance_m", "hood_deg", "motor_ratio", "outcome", "side")


def save_dataset(directory: str | Path, dataset: Dataset) -> None:
    """Write a dataset as rig.toml and CSV; floats by repr. The directory must be new or empty (`check_free`).

    ValueError when a number is infinite, which no reader would take.
    """
    home = check_free(directory)
    home.mkdir(parents=True, exist_ok=True)
    save_rig(home / RIG, dataset.facts)
    _save_csv(home / "shots.csv", _shot_columns(dataset.shots))
    ids = dataset.shots.shot_id
    for stem, table in dataset.samples.items():
        columns = {name: column for name, column in vars(table).items() if name != "shot"}
        _save_csv(home / f"{stem}.csv", {"shot_id": [ids[row] for row in table.shot], **columns})
    if dataset.left_out:
        (home / LEFT_OUT).write_text("".join(line + "\n" for line in dataset.left_out), encoding="utf-8")


def check_free(directory: str | Path) -> Path:
    """The directory as a path, if a dataset can go there without touching anybody's files; else InputError.

    Commands ask before long work what save_dataset would only find out after it.
    """
    home = Path(directory)
    if home.exists() and (not home.is_dir() or any(home.iterdir())):
        raise InputError(f"{home}: is not an empty directory; nothing is ever written over, name another")
    return home


def _shot_columns(shots: Shots) -> dict[str, Column]:
    columns: dict[str, Column] = {"shot_id": shots.shot_id, **shots.numbers, **shots.texts}
    order = [name for name in (*FIRST, *RANGES) if name in columns]
    return {name: columns[name] for name in dict.fromkeys([*order, *columns])}


def _save_csv(path: Path, columns: dict[str, Column]) -> None:
    cells = [_cells(name, column) for name, column in columns.items()]
    with path.open("w", encoding="utf-8", newline="") as file:
        for row in (tuple(columns), *zip(*cells, strict=True)):
            file.write(",".join(map(_quoted, row)) + "\n")


def _quoted(cell: str) -> str:
    """By hand, because Python 3.11's csv.writer leaves a lone carriage return bare, which ends the row for a reader."""
    return '"' + cell.replace('"', '""') + '"' if any(mark in cell for mark in ',"\r\n') else cell


def _cells(name: str, column: Column) -> list[str]:
    if not isinstance(column, np.ndarray):
        return list(column)
    if np.isinf(column).any():
        raise ValueError(f"column {name} has an infinite number")
    return ["" if np.isnan(number) else repr(float(number)) for number in column]
