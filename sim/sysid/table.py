"""A CSV (or Parquet) file of anybody's step test -> Record: time, one effort, one speed, each named with its unit."""

from pathlib import Path

import numpy as np

from truearc.errors import InputError
from truearc.sim.data.columns import need_columns, number_column
from truearc.sim.data.table import RawTable, gathered, load_table
from truearc.sim.sysid.motion import Record

EFFORTS = ("nm", "v")


def load_steps(path: Path) -> Record:
    """Columns t_s, one that ends in _V or _Nm (the effort, held until the next row), one in _rad_s; others are ignored.

    InputError names file, line and column.
    """
    with gathered() as problems:
        table = load_table(path, problems)
        need_columns(table, ["t_s"])
        effort, speed = _only(table, EFFORTS, "voltage or torque"), _only(table, ("rad_s",), "speed")
        t_s, efforts, speeds = (number_column(table, name, problems) for name in ("t_s", effort, speed))
    if len(t_s) < 2:
        raise InputError(f"{path}: {len(t_s)} rows; expected at least 2")
    backwards = np.flatnonzero(np.diff(t_s) <= 0.0)
    if len(backwards):
        raise InputError(f"{table.place(int(backwards[0]) + 1)}: column t_s: time does not go on")
    t_s = t_s - t_s[0]
    return Record(str(path), effort.lower().rpartition("_")[2], t_s, efforts, t_s, speeds)


def _only(table: RawTable, units: tuple[str, ...], what: str) -> str:
    """The one column in one of these units."""
    found = [name for name in table.columns if name.lower().endswith(tuple(f"_{unit}" for unit in units))]
    if len(found) != 1:
        ends = " or ".join(f"_{unit}" for unit in units)
        raise InputError(f"{table.place(-1)}: {len(found)} columns end in {ends} ({', '.join(found) or 'none'}); "
                       f"exactly one, the {what}, is needed")
    return found[0]
