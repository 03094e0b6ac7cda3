"""A session as one file that others open: WPILOG, CSV, or MCAP with ticks and trials together."""

import csv
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO

import msgspec

from truearc.robot.reasons import texts
from truearc.robot.recording.export.tabular import BOOL, FLOAT, FLOATS, INT, TEXT, TEXTS, Column, FlatTicks, Value
from truearc.robot.recording.export.wpilog import WpilogWriter, make_payload
from truearc.robot.recording.files import TickFile
from truearc.robot.recording.reader import TickReader
from truearc.robot.recording.rows import Trial
from truearc.robot.recording.session import load_session_config, load_trials
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
        self.flat = FlatTicks(len(load_session_config(session).axes.flywheels))
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


def write_wpilog(rows: ExportRows, file: IO[bytes]) -> None:
    """Every signal when it changes, under /estimate/hood_deg and the like, and each trial as JSON under /trial."""
    log = WpilogWriter(file, "truearc")
    numbers: list[int] = []
    trial_number = 0
    said: list[bytes | None] = [None] * len(rows.columns)
    trials = sorted(rows.trials, key=lambda trial: trial.outcome.t_ns)
    for tick, _ in rows.ticks():
        t_us = tick.inputs.t_ns // 1000
        if not numbers:
            numbers = [_start(log, column, t_us) for column in rows.columns]
            trial_number = log.start("/trial", "json", "", t_us)
        while trials and trials[0].outcome.t_ns <= tick.inputs.t_ns:
            _log_trial(log, trial_number, trials.pop(0))
        for at, (column, value) in enumerate(zip(rows.columns, rows.flat.row(tick), strict=True)):
            payload = make_payload(column.kind, value)
            if payload is not None and payload != said[at]:
                said[at] = payload
                log.append(numbers[at], t_us, payload)
    for trial in trials:
        _log_trial(log, trial_number, trial)


def write_mcap(rows: ExportRows, file: IO[bytes]) -> None:
    """The recording's ticks and trials in one whole file, also where it is cut short or lacks /trial."""
    out = TickFile(file, rows.reader.rows)
    for tick, data in rows.ticks():
        out.write(tick.inputs.t_ns, data)
    for trial in rows.trials:
        out.write_trial(trial.outcome.t_ns, rows.reader.rows.encode_trial(trial))
    out.finish()


def _start(log: WpilogWriter, column: Column, t_us: int) -> int:
    metadata = json.dumps({"unit": column.unit}) if column.unit else ""
    return log.start("/" + column.name.replace(".", "/"), column.kind, metadata, t_us)


def _log_trial(log: WpilogWriter, signal: int, trial: Trial) -> None:
    log.append(signal, trial.outcome.t_ns // 1000, msgspec.json.encode(trial))


def _cell(kind: str, value: Value) -> object:
    if kind == BOOL and value is not None:
        return "true" if value else "false"
    if kind in (TEXTS, FLOATS) and isinstance(value, list | tuple):
        return "; ".join(map(str, value))
    return value
