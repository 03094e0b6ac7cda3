"""Tables in memory (pandas, polars, NumPy, plain columns) -> Dataset, as strictly as files are read."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Protocol

import msgspec
import numpy as np

from truearc.errors import InputError, near_key, reworded, unknown_keys
from truearc.robot.config.rig_spec import Rig
from truearc.sim.data.dataset import Dataset
from truearc.sim.data.files import assemble, check_rig, load_rig, states_three
from truearc.sim.data.table import Cell, RawTable, as_cell, gathered


class Frame(Protocol):
    """The part of a pandas or polars DataFrame that is used: `columns` names them, `frame[name]` iterates over one."""

    @property
    def columns(self) -> Any:
        """Names of the columns."""

    def __getitem__(self, name: Any, /) -> Any:
        """One column."""


Columns = Frame | Mapping[str, Any] | np.ndarray


def dataset(shots: Columns, *, rig: Rig | str | Path | Mapping[str, Any], tracks: Columns | None = None,
            traces: Columns | None = None, times: Columns | None = None, name: str = "dataset") -> Dataset:
    """Make a dataset from tables in memory.

    Columns, units and checks are those of the dataset files. A missing cell is None, NaN or NA.

    Args:
        shots: One row per shot: a pandas or polars DataFrame, a structured NumPy array, or {column: n values}. The
            column shot_id is required; distance_m [m], hood_deg [deg], motor_ratio [1], outcome and others are known.
        rig: The rig: a Rig, the path of a rig.toml, or its contents as nested mappings.
        tracks: One row per sample: shot_id, t_s [s], x_m, y_m, z_m [m]; launcher frame, x toward the target, y left,
            z up. None: no tracks.
        traces: One row per sample: shot_id, t_s [s, 0 when the ball is fed], signal, value. None: no telemetry.
        times: One row per time that the ball came by a height: shot_id, height_m [m above the floor], t_s [s after its
            release], sigma_s [s, standard deviation of that time]. None: no such times.
        name: Of the dataset in reports.

    Raises:
        InputError: names table, row (from 1) and column of every bad cell, the missing column, or the rig's key.
    """
    with gathered() as problems:
        tables = [None if frame is None else _table(frame, which)
                  for which, frame in (("tracks", tracks), ("traces", traces), ("times", times))]
        return assemble(name, _rig(rig), problems, _table(shots, "shots"), *tables, has_three=states_three(rig))


def _rig(rig: Rig | str | Path | Mapping[str, Any]) -> Rig:
    if isinstance(rig, Rig):
        return check_rig(rig, "rig")
    if isinstance(rig, str | Path):
        return load_rig(rig)
    if not isinstance(rig, Mapping):
        raise InputError(f"rig: is of type {type(rig).__name__}; a Rig, the path of a rig.toml or its contents "
                         "is needed")
    for key in unknown_keys(dict(rig), Rig):
        raise InputError(f"rig: key {key} is not known{near_key(key, Rig, None)}")
    try:
        return check_rig(msgspec.convert(rig, Rig), "rig")
    except msgspec.ValidationError as error:
        raise InputError(f"rig: {reworded(str(error), rig)}") from error


def _table(frame: Columns, which: str) -> RawTable:
    """The cells of one table; InputError where its columns differ in length or name."""
    columns = {name: [_cell(value) for value in values] for name, values in _columns(frame, which)}
    lengths = {len(cells) for cells in columns.values()}
    if len(lengths) > 1:
        raise InputError(f"{which}: columns differ in length: "
                         + ", ".join(f"{name} {len(cells)}" for name, cells in columns.items()))
    return RawTable(Path(which), columns, list(range(1, max(lengths, default=0) + 1)), in_memory=True)


def _columns(frame: Columns, which: str) -> Iterable[tuple[str, Iterable[Any]]]:
    if isinstance(frame, np.ndarray):
        names: list[Any] = list(frame.dtype.names or ())
        if not names:
            raise InputError(f"{which}: an array without named columns; a structured array is needed, or a mapping")
    else:
        if not isinstance(frame, Mapping) and not hasattr(frame, "columns"):
            raise InputError(f"{which}: is of type {type(frame).__name__}; a DataFrame, a structured array or "
                             "{column: values} is needed")
        names = list(frame) if isinstance(frame, Mapping) else list(frame.columns)
    for name in names:
        if not isinstance(name, str) or not name.strip():
            raise InputError(f"{which}: column {name!r}: a name is needed")
        if names.count(name) > 1:
            raise InputError(f"{which}: column {name!r} stands twice")
        yield name, frame[name]


def _cell(value: Any) -> Cell:
    """A value as files give it: None where it is missing, which NaN and NA say by not being equal to themselves."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, str) or value is None:
        return as_cell(value)
    try:
        return as_cell(value) if value == value else None
    except TypeError:                 # pandas.NA has no truth
        return None
