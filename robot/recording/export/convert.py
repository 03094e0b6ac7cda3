"""A session as one file that others open: CSV, or MCAP for viewers."""

import csv
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO

from truearc.robot.reasons import texts
from truearc.robot.recording import session as layout
from truearc.robot.recording.export.tabular import BOOL, FLOAT, FLOATS, INT, TEXT, TEXTS, Column, FlatTicks, Value
from truearc.robot.recording.export.viewer_mcap import NO_FLIGHTS, Flights, ViewerMessages
from truearc.robot.recording.files import TickFile
from truearc.robot.recording.reader import TickReader
from truearc.robot.types import Tick

TRIAL_COLUMNS = (
    Column("trial", INT, ""), Column("outcome_t_ns", INT, "ns"), Column("outcome", TEXT, ""),
    Column("reasons", TEXTS, ""), Column("shot_t_ns", INT, "ns"), Column("config_id", TEXT, ""),
    Column("distance_m", FLOAT, "m"), Column("distance_sigma_m", FLOAT, "m"), Column("hood_deg", FLOAT, "deg"),
    Column("motor_ratio", FLOAT, ""), Column("motor_rad_s", FLOAT, "rad/s"), Column("battery_v", FLOAT, "V"),
    Column("since_last_shot_s", FLOAT, "s"), Column("p_two", FLOAT, ""), Column("p_three", FLOAT, ""),
)


class ExportRows:
    """A session's ticks, flat, as `columns` says; afterwards `count` of them and the reader's `cut_short`.

    Trials that trials.jsonl lacks are taken from the ticks, and `missing` counts them; `unlike` those of which the two
    say different things, where trials.jsonl counts.
    """

    def __init__(self, session: Path, progress: Callable[[float, str], None]) -> None:
        self.session, self.header = session, layout.load_header(session)
        self.config = layout.load_session_config(session)
        self.flat = FlatTicks(len(self.config.axes.flywheels))
        self.columns = self.flat.columns
        self.trials = layout.load_trials(session)
        self.count = self.missing = self.unlike = 0
        self._filed = {trial.outcome.trial: trial for trial in self.trials}
        self._told: dict[int, layout.Trial] = {}         # what the ticks say
        self._due: deque[layout.Trial] = deque()
        self.reader = TickReader(session)
        self._progress = progress

    def __iter__(self) -> Iterator[list[Value]]:
        for tick, _ in self.ticks():
            yield self.flat.row(tick)

    def ticks(self) -> Iterator[tuple[Tick, bytes]]:
        for tick, data in self.reader:
            self.count += 1
            self._progress(min(self.reader.share, 0.99), f"{self.count} ticks")
            if tick.outcomes:
                self._compare(tick)
            yield tick, data
        missing = [trial for number, trial in self._told.items() if number not in self._filed]
        self.missing = len(missing)
        self.unlike = sum(trial != self._filed.get(number, trial) for number, trial in self._told.items())
        self.trials = sorted([*self.trials, *missing], key=lambda trial: trial.outcome.trial)

    def _compare(self, tick: Tick) -> None:
        for trial in layout.make_trials(tick):
            self._told[trial.outcome.trial] = trial
            if trial.outcome.trial not in self._filed:
                self._due.appendleft(trial)       # it was marked in this tick

    def trials_in_time(self) -> deque[layout.Trial]:
        """Trials that are still to be written, by when they were marked; ticks may add to it as they are read."""
        self._due = deque(sorted(self.trials, key=lambda trial: trial.outcome.t_ns))
        return self._due


def trial_row(trial: layout.Trial) -> list[Value]:
    """One marked trial under TRIAL_COLUMNS."""
    outcome, shot = trial.outcome, trial.shot
    row: list[Value] = [outcome.trial, outcome.t_ns, outcome.outcome, texts(outcome.reasons)]
    names = [column.name.removeprefix("shot_") for column in TRIAL_COLUMNS[len(row):]]
    return row + [None if shot is None else getattr(shot, name) for name in names]


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
    out, wall, trials = TickFile(file), layout.wall_time(rows.header), rows.trials_in_time()
    viewer = ViewerMessages(out.mcap, rows.session, rows.flat, rows.config.rig.target, rows.trials, wall, flights)

    def write_trials(t_ns: int | None) -> None:
        for trial in due(trials, t_ns):
            out.write_trial(trial.outcome.t_ns + wall.offset_ns, layout.encode_row(trial))

    for tick, data in rows.ticks():
        out.write(tick.inputs.t_ns + wall.offset_ns, data)
        viewer.write(tick)
        write_trials(tick.inputs.t_ns)
    write_trials(None)
    out.finish()
    return viewer.images_lost


def due(trials: deque[layout.Trial], t_ns: int | None = None) -> Iterator[layout.Trial]:
    """Take from the front the trials that were marked by a time; all without one."""
    while trials and (t_ns is None or trials[0].outcome.t_ns <= t_ns):
        yield trials.popleft()


def _cell(kind: str, value: Value) -> object:
    if kind == BOOL and value is not None:
        return "true" if value else "false"
    if kind in (TEXTS, FLOATS) and isinstance(value, list | tuple):
        return "; ".join(map(str, value))
    return value
