"""Conversion between a Dataset and its tables of shots, tracks, traces and times. Errors name every bad row.

The tables are either a directory that contains rig.toml and CSV or Parquet files, or tables in memory: pandas, polars,
NumPy or plain columns.
"""

import hashlib
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import msgspec
import numpy as np
from msgspec import UnsetType

from truearc.errors import InputError, load_text, make_toml, near_key, parse_struct, parse_table, reworded, unknown_keys
from truearc.robot.config.rig_spec import Rig, as_table, rig_errors
from truearc.robot.config.targets import misplaced
from truearc.sim.data import table as cols
from truearc.sim.data.dataset import Dataset, Film, NoisyTracks, Shots, Times, Traces, Tracks, Written
from truearc.sim.data.table import Cell, Problems, RawTable, as_cell, find_table, gathered, load_table

TRACK_COLUMNS = ("shot_id", "t_s", "x_m", "y_m", "z_m")
TRACK_NOISE = ("sigma_x_m", "sigma_z_m")
TIME_COLUMNS = ("shot_id", "height_m", "t_s", "sigma_s")
SAMPLES = ("tracks", "traces", "times")
THREES = ("three", "3", "3.0")
LEFT_OUT, IMPORTED, FILM = "left_out.txt", "imported.toml", "film.json"
Column = Sequence[str] | np.ndarray
FIRST = ("shot_id", "distance_m", "hood_deg", "motor_ratio", "outcome", "side")
RIG = "rig.toml"
MOST_FIRED = 100                      # balls of a salvo; more are rows put together


class Imported(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What messages say of an imported dataset: the command, and the columns of the file that it was made of."""

    command: str = ""
    columns: dict[str, Written] = {}


def load_dataset(directory: str | Path) -> Dataset:
    """Read the dataset in a directory: rig.toml, shots, and tracks, traces and times if present.

    InputError lists every bad row with file, line (CSV) or row (Parquet) and column.
    """
    home = Path(directory)
    if not home.is_dir():
        raise InputError(f"{home}: there is no such directory")
    if not (home / RIG).exists():
        raise InputError(f"{home / RIG}: there is no such file; `truearc init {home}` writes a template")
    rig = load_rig(home / RIG)
    shots_path = find_table(home, "shots")
    if shots_path is None:
        raise InputError(f"{home}: has neither shots.csv nor shots.parquet")
    with gathered() as problems:
        tables = [None if path is None else load_table(path, problems)
                  for path in (find_table(home, name) for name in SAMPLES)]
        dataset = assemble(home.resolve().name, rig, problems, load_table(shots_path, problems), *tables,
                           has_three=states_three(home / RIG))
    said, made = home / LEFT_OUT, home / IMPORTED
    lines = said.read_text(encoding="utf-8", errors="replace").splitlines() if said.is_file() else ()
    imported = parse_struct(load_text(made), Imported, str(made)) if made.is_file() else Imported()
    shots = replace(dataset.shots, written=imported.columns | dataset.shots.written)
    return replace(dataset, shots=shots, left_out=tuple(lines), imported=imported.command, film=_film(home / FILM))


def _film(path: Path) -> Film | None:
    if not path.is_file():
        return None
    try:
        return msgspec.json.decode(path.read_bytes(), type=Film)
    except msgspec.DecodeError as error:
        raise InputError(f"{path}: {error}; `truearc track` writes it, and it may be deleted") from error


def assemble(name: str, rig: Rig, problems: Problems, shots: RawTable, tracks: RawTable | None = None,
             traces: RawTable | None = None, times: RawTable | None = None, *, has_three: bool = True) -> Dataset:
    """Check the cells of tables and return them as a dataset; all errors are added to `problems`.

    has_three: whether the rig's half-height of the three was stated; where it was not and shots are hits, every hit
    counts alike.

    Raises:
        InputError: a column that a table must have is missing, or there are both tracks and times.
    """
    if tracks and times:
        raise InputError(f"{times.path}: there are tracks, too: they tell when the ball was where; keep one of the two")
    shots = _one_by_one(cols.in_read_units(shots, cols.is_shot_column, problems), problems)
    shots = _with_angles(shots, rig, problems)
    shots, rig = _settle_hits(shots, rig, has_three, problems)
    checked = replace(_shots(shots, problems), written=shots.written)
    _check_sides(shots, checked.texts, rig, problems)
    if rig.target is not None and rig.target.faces_up and "miss_height_m" in shots.columns:
        shots.fault(problems, -1, "miss_height_m", "is of an upright opening; the one of rig.toml faces up: note the "
                    "side of misses instead, short, long, left or right")
    _check_wheels(shots, rig, problems)
    row_of = {name: row for row, name in enumerate(checked.shot_id)}
    tracks = tracks and cols.in_read_units(tracks, (*TRACK_COLUMNS, *TRACK_NOISE).__contains__, problems)
    return Dataset(name, rig, checked, _tracks(tracks, row_of, problems), _traces(traces, row_of, problems),
                   track_columns=tracks.written if tracks else {}, times=_times(times, row_of, problems))


def hash_dataset(dataset: Dataset) -> str:
    """Return the SHA-256 of a dataset's content, in CSV or Parquet, regardless of its name and the order of columns."""
    digest = hashlib.sha256(msgspec.json.encode(dataset.facts, order="deterministic"))
    shots = dataset.shots
    _feed(digest, "shots", {"shot_id": shots.shot_id, **shots.numbers, **shots.texts})
    for name, table in dataset.samples.items():
        _feed(digest, name, dict(vars(table)))
    digest.update(msgspec.json.encode(list(dataset.left_out)))
    return digest.hexdigest()


def _feed(digest: "hashlib._Hash", table: str, columns: dict[str, Sequence[str] | np.ndarray]) -> None:
    for name in sorted(columns):
        column = columns[name]
        # repr round-trips floats and writes every nan alike
        cells = [repr(float(cell)) for cell in column] if isinstance(column, np.ndarray) else list(column)
        digest.update(msgspec.json.encode([table, name, cells]))


def _shots(table: RawTable, problems: Problems) -> Shots:
    cols.need_columns(table, ("shot_id",))
    shot_id = _ids(table, problems)
    numbers, texts = {}, {}
    for name, cells in table.columns.items():
        if name == "shot_id":
            continue
        if cols.is_numeric(name, cells):
            numbers[name] = cols.number_column(table, name, problems, needed=False)
        else:
            texts[name] = cols.text_column(table, name, problems, needed=False)
    lacking = [name for name in cols.SPIN_VECTOR if name not in numbers]
    for name in cols.SPIN_VECTOR if 0 < len(lacking) < len(cols.SPIN_VECTOR) else ():
        if name in numbers:
            table.fault(problems, -1, name, f"stands without {' and '.join(lacking)}; a spin needs all three parts")
    return Shots(shot_id, numbers, texts, str(table.path))


def _one_by_one(table: RawTable, problems: Problems) -> RawTable:
    """Make a row of each ball of a salvo: `hits` of `fired` balls, in an order that nobody knows, are as likely as so
    many single ones, up to a factor."""
    if not set(cols.SALVO) & set(table.columns):
        return table
    cols.need_columns(table, cols.SALVO)
    fired, hits = (cols.number_column(table, name, problems, needed=False) for name in cols.SALVO)
    rows, outcome, names, words = list[int](), list[Cell](), list[Cell](), list[Cell]()
    told, ids = (table.columns.get(name, [None] * len(table.lines)) for name in ("outcome", "shot_id"))
    for row, (balls, scored) in enumerate(zip(fired, hits, strict=True)):
        if np.isnan(balls) and np.isnan(scored):
            balls, words = 1, [told[row]]
        elif balls not in range(1, MOST_FIRED + 1) or scored not in range(int(balls) + 1):
            table.fault(problems, row, "hits", f"{scored:g} of fired {balls:g}: both are whole numbers, hits at most "
                        f"fired, and fired from 1 to {MOST_FIRED}")
            continue
        elif told[row] is not None:
            table.fault(problems, row, "outcome", "stands beside fired and hits, which say it: leave one of them empty")
            continue
        else:
            words = [*[cols.HIT] * int(scored), *["miss"] * int(balls - scored)]
        rows += [row] * int(balls)
        outcome += words
        names += [ids[row]] if balls == 1 else [f"{cols.cell_text(ids[row])}.{ball + 1}" for ball in range(int(balls))]
    columns = {name: [cells[row] for row in rows] for name, cells in table.columns.items() if name not in cols.SALVO}
    columns |= {"outcome": outcome} | ({"shot_id": names} if "shot_id" in columns else {})
    return replace(table, columns=columns, lines=[table.lines[row] for row in rows])


def _with_angles(table: RawTable, rig: Rig, problems: Problems) -> RawTable:
    """Add hood_deg from hood_position and the rig's measured points; a problem is a position outside of them."""
    hood = rig.launcher.hood
    if isinstance(hood, UnsetType) or cols.SERVO not in table.columns or "hood_deg" in table.columns:
        return table
    at, deg = zip(*hood.map, strict=True)
    position = np.array([cols.parse_number(cell) for cell in table.columns[cols.SERVO]], dtype=float)
    for row in np.flatnonzero((position < at[0]) | (position > at[-1])):
        table.fault(problems, int(row), cols.SERVO, f"{position[row]:g} is outside the measured points of "
                    f"launcher.hood.map, {at[0]:g} to {at[-1]:g}: measure one more angle")
    cells: list[Cell] = [None if np.isnan(one) else float(np.interp(one, at, deg)) for one in position]
    return replace(table, columns=table.columns | {"hood_deg": cells})


def _check_wheels(table: RawTable, rig: Rig, problems: Problems) -> None:
    """A problem is the speed of a wheel that the rig lacks, while one that it has is without a column."""
    own = [f"wheel_{wheel.name}_rad_s" for wheel in rig.launcher.wheel]
    absent = [name for name in own if name not in table.columns]
    for name in table.columns if absent else ():
        if cols.WHEEL.fullmatch(name) and name not in own:
            table.fault(problems, -1, name, f"rig.toml has no such wheel; it has {', '.join(own)}: rename the "
                         "column, or the wheel")


def _settle_hits(table: RawTable, rig: Rig, has_three: bool, problems: Problems) -> tuple[RawTable, Rig]:
    """Hits as twos of a rig without a three; a problem are hits that could be twos or threes."""
    outcome = [cols.cell_text(cell).strip().lower() for cell in table.columns.get("outcome", ())]
    hits = [row for row, word in enumerate(outcome) if word == cols.HIT]
    threes = [row for row, word in enumerate(outcome) if word in THREES]
    if threes and rig.target is not None and rig.target.hit_or_miss:
        table.fault(problems, threes[0], "outcome", f"is three in {len(threes)} rows, but target.three_half_height_m = "
                    "0 of rig.toml says that every hit counts alike: write hit, or state the height of the three")
    if not hits or rig.target is None:
        return table, rig
    if rig.target.hit_or_miss or not (has_three or threes):
        rig = msgspec.structs.replace(rig, target=msgspec.structs.replace(rig.target, three_half_height_m=0.0))
    else:
        more = f", here and in {len(hits) - 1} more rows" if hits[1:] else ""
        table.fault(problems, hits[0], "outcome", f"'hit' may be a two or a three: write which{more}; where every hit "
                    "counts alike, write no three, and state target.three_half_height_m = 0 in rig.toml")
    cells = ["two" if word == cols.HIT else cell for word, cell in zip(outcome, table.columns["outcome"], strict=True)]
    return replace(table, columns=table.columns | {"outcome": cells}), rig


def _ids(table: RawTable, problems: Problems) -> tuple[str, ...]:
    first: dict[str, int] = {}
    ids = tuple(cols.cell_text(cell) for cell in table.columns["shot_id"])
    for row, name in enumerate(ids):
        if not name:
            table.fault(problems, row, "shot_id", "is missing")
        elif name in first:
            table.fault(problems, row, "shot_id", f"{name!r} stands already in {table.place(first[name])}")
        else:
            first[name] = row
    return ids


def _check_sides(table: RawTable, texts: dict[str, tuple[str, ...]], rig: Rig, problems: Problems) -> None:
    """A ball through the inner target passed on no side of it; one that came down beside an opening that faces up
    passed neither low nor high."""
    up = rig.target is not None and rig.target.faces_up
    others = {"low": "short", "high": "long"} if up else {"short": "low", "long": "high"}
    told: set[str] = set()
    for row, (outcome, side) in enumerate(zip(texts.get("outcome", ()), texts.get("side", ()), strict=False)):
        if outcome == "three" and side in cols.WORDS["side"]:
            table.fault(problems, row, "side", f"outcome three cannot have the miss side {side!r}")
        elif up and outcome and outcome != "miss" and side in cols.WORDS["side"]:
            table.fault(problems, row, "side", f"a ball that went in has no side, got {side!r}")
        elif side in others and rig.target is not None and side not in told:
            told.add(side)
            more = texts["side"].count(side) - 1
            faces = "up" if up else "the launcher"
            table.fault(problems, row, "side", f"is {side}, but the opening of rig.toml faces {faces}: write "
                        f"{others[side]}" + (f"; here and in {more} more rows" if more else ""))


def _tracks(table: RawTable | None, row_of: dict[str, int], problems: Problems) -> Tracks | None:
    if table is None:
        return None
    cols.need_columns(table, TRACK_COLUMNS)
    shot = _shot_rows(table, row_of, problems)
    is_flat = not any(map(cols.cell_text, table.columns["y_m"]))       # a camera from the side: discovery leaves y out
    t_s, x_m, z_m = (cols.number_column(table, name, problems) for name in ("t_s", "x_m", "z_m"))
    y_m = np.zeros(len(t_s)) if is_flat else cols.number_column(table, "y_m", problems)
    _check_order(table, shot, t_s, problems)
    if not set(TRACK_NOISE) <= table.columns.keys():
        return Tracks(shot, t_s, x_m, y_m, z_m)
    sigmas = [cols.number_column(table, name, problems) for name in TRACK_NOISE]
    for name, sigma in zip(TRACK_NOISE, sigmas, strict=True):
        for row in np.flatnonzero(sigma <= 0.0):
            table.fault(problems, int(row), name, f"{table.shown(name, sigma[row])} must be above 0")
    return NoisyTracks(shot, t_s, x_m, y_m, z_m, *sigmas)


def _times(table: RawTable | None, row_of: dict[str, int], problems: Problems) -> Times | None:
    if table is None:
        return None
    table = cols.in_read_units(table, TIME_COLUMNS.__contains__, problems)
    cols.need_columns(table, TIME_COLUMNS)
    shot = _shot_rows(table, row_of, problems)
    height_m, t_s, sigma_s = (cols.number_column(table, name, problems) for name in TIME_COLUMNS[1:])
    for name, column in (("t_s", t_s), ("sigma_s", sigma_s)):
        for row in np.flatnonzero(column <= 0.0):
            table.fault(problems, int(row), name, f"{table.shown(name, column[row])} must be above 0")
    _check_order(table, shot, t_s, problems)
    return Times(shot, t_s, height_m, sigma_s)


def _traces(table: RawTable | None, row_of: dict[str, int], problems: Problems) -> Traces | None:
    if table is None:
        return None
    cols.need_columns(table, ("shot_id", "t_s", "signal", "value"))
    signal = cols.text_column(table, "signal", problems)
    return Traces(_shot_rows(table, row_of, problems), cols.number_column(table, "t_s", problems), signal,
                  cols.number_column(table, "value", problems))


def _shot_rows(table: RawTable, row_of: dict[str, int], problems: Problems) -> np.ndarray:
    rows = np.full(len(table.lines), -1, dtype=np.int64)
    for row, cell in enumerate(table.columns["shot_id"]):
        name = cols.cell_text(cell)
        if name in row_of:
            rows[row] = row_of[name]
        else:
            table.fault(problems, row, "shot_id", f"{name!r} is not among the shots" if name else "is missing")
    return rows


def _check_order(table: RawTable, shot: np.ndarray, t_s: np.ndarray, problems: Problems) -> None:
    """Samples of one shot come in the order of time."""
    last: dict[int, float] = {}
    for row, (index, time_s) in enumerate(zip(shot.tolist(), t_s.tolist(), strict=True)):
        if index in last and time_s <= last[index]:
            table.fault(problems, row, "t_s", f"{table.shown('t_s', time_s)} does not follow "
                        f"{table.shown('t_s', last[index])} of the same shot")
        last[index] = time_s


def save_dataset(directory: str | Path, dataset: Dataset) -> None:
    """Write a dataset as rig.toml and CSV; floats by repr. The directory must be new or empty (`check_free`).

    ValueError if a number is infinite, which no reader accepts.
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
    if dataset.film is not None:
        (home / FILM).write_bytes(msgspec.json.encode(dataset.film))
    if dataset.imported:
        facts = Imported(dataset.imported, dataset.shots.written)
        (home / IMPORTED).write_text(make_toml(msgspec.to_builtins(facts)), encoding="utf-8")


def check_free(directory: str | Path) -> Path:
    """Return the directory as a path if a dataset can be saved there without touching existing files; else InputError.

    Commands call it before long work, since save_dataset would raise the error only afterwards.
    """
    home = Path(directory)
    if home.exists() and (not home.is_dir() or any(home.iterdir())):
        raise InputError(f"{home}: is not an empty directory; nothing is ever written over, name another")
    return home


def _shot_columns(shots: Shots) -> dict[str, Column]:
    columns: dict[str, Column] = {"shot_id": shots.shot_id, **shots.numbers, **shots.texts}
    order = [name for name in (*FIRST, *cols.RANGES) if name in columns]
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


def load_rig(path: str | Path) -> Rig:
    """Read rig.toml. Warns of unknown keys on stderr; InputError names file and key of an invalid one."""
    text = load_text(path)
    for key in unknown_keys(parse_table(text, str(path)), Rig):
        print(f"warning: {path}: key {key} is not known and has no effect{near_key(key, Rig, None)}", file=sys.stderr)
    rig = parse_struct(text, Rig, str(path))
    if wrong := [f"{path}: {key}: {what}" for key, what in misplaced(parse_table(text, str(path)))]:
        raise InputError("\n".join(wrong))
    return check_rig(rig, path)


def states_three(rig: Rig | str | Path | Mapping[str, Any]) -> bool:
    """Return whether a rig, a rig.toml or its contents say which part of the opening a three goes through."""
    if isinstance(rig, Rig):
        return True
    table = rig if isinstance(rig, Mapping) else parse_table(load_text(rig), str(rig))
    return not {"three_half_height_m", "ring"}.isdisjoint(table.get("target", {}))


def check_rig(rig: Rig, path: str | Path) -> Rig:
    """Return the rig if its numbers can be true.

    Raises:
        InputError: names `path` and the key of each number that is not finite, out of range, or contradicts another.
    """
    wrong = [f"{path}: {key}: {what}" for key, what in rig_errors(rig)]
    if wrong:
        raise InputError("\n".join(wrong))
    return rig


def save_rig(path: str | Path, rig: Rig) -> None:
    """Write rig.toml with every key stated, so that reading it gives the same rig."""
    Path(path).write_text(make_toml(as_table(rig)), encoding="utf-8")


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
        tracks: One row per sample: shot_id, t_s [s], x_m, y_m, z_m [m]; launcher frame, x toward the target, y left, z
            up. None: no tracks.
        traces: One row per sample: shot_id, t_s [s, 0 when the ball is fed], signal, value. None: no telemetry.
        times: One row per time at which the ball passed a height: shot_id, height_m [m above the floor], t_s [s after
            its release], sigma_s [s, standard deviation of that time]. None: no times.
        name: Name of the dataset in reports.

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
