"""A session as one file that others open: CSV, or MCAP for viewers."""

import csv
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO

from truearc.robot.reasons import texts
from truearc.robot.recording.export.tabular import BOOL, FLOAT, FLOATS, INT, TEXT, TEXTS, Column, FlatTicks, Value
from truearc.robot.recording.export.viewer_mcap import NO_FLIGHTS, Flights, ViewerMessages
from truearc.robot.recording.export.wall_time import wall_time
from truearc.robot.recording.files import TickFile
from truearc.robot.recording.reader import TickReader
from truearc.robot.recording.rows import Trial
from truearc.robot.recording.session import load_header, load_session_config, load_trials
from truearc.robot.types import Tick

TRIAL_COLUMNS = (
    Column("trial", INT, ""), Column("outcome_t_ns", INT, "ns"), Column("outcome", TEXT, ""),
    Column("reasons", TEXTS, ""), Column("shot_t_ns", INT, "ns"), Column("config_id", TEXT, ""),
    Column("distance_m", FLOAT, "m"), Column("distance_sigma_m", FLOAT, "m"), Column("hood_deg", FLOAT, "deg"),
    Column("motor_ratio", FLOAT, ""), Column("motor_rad_s", FLOAT, "rad/s"), Column("battery_v", FLOAT, "V"),
    Column("since_last_shot_s", FLOAT, "s"), Column("p_two", FLOAT, ""), Column("p_three", FLOAT, ""),
)


class ExportRows:
    """A session's ticks, flat, as `columns` says; afterwards `count` of them and the reader's `cut_short`."""

    def __init__(self, session: Path, progress: Callable[[float, str], None]) -> None:
        self.session, self.header, self.config = session, load_header(session), load_session_config(session)
        self.flat = FlatTicks(len(self.config.axes.flywheels))
        self.columns = self.flat.columns
        self.trials = load_trials(session)
        self.count = 0
        self.reader = TickReader(session)
        self._progress = progress

    def __iter__(self) -> Iterator[list[Value]]:
        for tick, _ in self.ticks():
            yield self.flat.row(tick)

    def ticks(self) -> Iterator[tuple[Tick, bytes]]:
        for tick, data in self.reader:
            self.count += 1
            self._progress(min(self.reader.share, 0.99), f"{self.count} ticks")
            yield tick, data

    def trials_in_time(self) -> deque[Trial]:
        return deque(sorted(self.trials, key=lambda trial: trial.outcome.t_ns))


def trial_row(trial: Trial) -> list[Value]:
    """One marked trial under TRIAL_COLUMNS."""
    outcome, shot = trial.outcome, trial.shot
    row: list[Value] = [outcome.trial, outcome.t_ns, outcome.outcome, texts(outcome.reasons)]
    if shot is None:
        return row + [None] * (len(TRIAL_COLUMNS) - len(row))
    return [*row, shot.t_ns, shot.config_id, shot.distance_m, shot.distance_sigma_m, shot.hood_deg, shot.motor_ratio,
            shot.motor_rad_s, shot.battery_v, shot.since_last_shot_s, shot.p_two, shot.p_three]


def write_csv(columns: tuple[Column, ...], rows: Iterator[list[Value]], path: Path) -> None:
    """A header of names, whose ends are the units, and a line a row; lists are joined by '; ', absent cells empty."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([column.name for column in columns])
        for row in rows:
            writer.writerow([_cell(column.kind, value) for column, value in zip(columns, row, strict=True)])


def write_mcap(rows: ExportRows, file: IO[bytes], flights: Flights = NO_FLIGHTS) -> int:
    """The recording's ticks and trials in one whole file, also where it is cut short or lacks /trial, with topics for
    viewers; times are the wall clock's. Returns how many images are missing."""
    out = TickFile(file, rows.reader.rows)
    viewer: ViewerMessages | None = None
    offset_ns = 0
    trials = rows.trials_in_time()
    for tick, data in rows.ticks():
        if viewer is None:
            wall = wall_time(rows.header, tick.inputs.t_ns)
            offset_ns = wall.offset_ns
            viewer = ViewerMessages(out.mcap, rows.session, rows.flat, rows.config.rig.target, rows.trials, wall,
                                    flights)
        out.write(tick.inputs.t_ns + offset_ns, data)
        viewer.write(tick)
        for trial in due(trials, tick.inputs.t_ns):
            out.write_trial(trial.outcome.t_ns + offset_ns, rows.reader.rows.encode_trial(trial))
    for trial in due(trials):
        out.write_trial(trial.outcome.t_ns + offset_ns, rows.reader.rows.encode_trial(trial))
    out.finish()
    return 0 if viewer is None else viewer.images_lost


def due(trials: deque[Trial], t_ns: int | None = None) -> Iterator[Trial]:
    """Take from the front the trials that were marked by a time; all without one."""
    while trials and (t_ns is None or trials[0].outcome.t_ns <= t_ns):
        yield trials.popleft()


def _cell(kind: str, value: Value) -> object:
    if kind == BOOL and value is not None:
        return "true" if value else "false"
    if kind in (TEXTS, FLOATS) and isinstance(value, list | tuple):
        return "; ".join(map(str, value))
    return value
