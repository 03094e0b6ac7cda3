"""Datasets made from recorded sessions, with one row per shot, or per configuration by the paper's labelling rule.

The rule (section IV-A) labels a configuration by its repeatability. R2 and R3 are the shares of its shots in the
2-point region (which contains the 3-point region) and in the 3-point region. With the choices made here where the paper
is silent, the rule is:

    R3 >= 80 %                              -> three
    R3 < 80 % and R2 > 90 %                 -> two
    R2 < 75 %                               -> removed; but a third of the paper's data are misses, which this rule
                                               would exclude, so a configuration that never scores is a miss
    75 % <= R2 <= 90 % and R3 < 80 %        -> unspecified: the line above does not remove it, so two
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from msgspec import UNSET

from truearc.errors import InputError
from truearc.hw.protocols import NS
from truearc.robot.config.rig_spec import Rig
from truearc.robot.config.schema import Config
from truearc.robot.config.shot_map import OUTCOMES
from truearc.robot.reasons import texts
from truearc.robot.recording.reader import TickReader
from truearc.robot.recording.session import TRIALS, Trial, load_session_config, load_trials, make_trials
from truearc.robot.types import Tick
from truearc.sim.data.dataset import Dataset, Shots, Traces

BEFORE_S, AFTER_S = 0.1, 0.7                      # telemetry kept around the feeding of each ball
NUMBERS = ("distance_m", "hood_deg", "motor_ratio", "battery_v", "since_last_shot_s")
THREE_AT, REMOVED_BELOW = 0.80, 0.75
AVERAGED = ("distance_m", "hood_deg", "motor_ratio", "battery_v", "t_s")


def shots_from_sessions(sessions: Sequence[str | Path], name: str, telemetry: bool = True) -> Dataset:
    """Return all marked shots of recorded sessions as a dataset; its `left_out` names rejected and held trials.

    Args:
        sessions: Session folders, of one rig.
        name: Name of the dataset.
        telemetry: Whether to include the traces around each shot.

    Raises:
        InputError: the sessions' rigs differ, two sessions have the same name, or there are no shots.
    """
    if isinstance(sessions, str | Path):
        raise InputError(f"sessions: a list of folders is expected: [{str(sessions)!r}]")
    folders = [Path(session) for session in sessions]
    names = [session.resolve().name for session in folders]
    if twice := next((one for one in names if names.count(one) > 1), None):
        raise InputError(f"two sessions are called {twice}: shot_id would not be unique")
    rows: list[tuple[str, Trial]] = []
    left_out: list[str] = []
    traces: list[tuple[int, float, str, float]] = []
    configs = [load_session_config(session) for session in folders]
    for session, config in zip(folders, configs, strict=True):
        if config.rig != configs[0].rig:
            raise InputError(f"{session}: recorded with another rig than {folders[0]} ([rig] differs); import "
                             "them one by one")
        marked = load_trials(session)
        kept, dropped = _split(session, marked)
        left_out += dropped
        if (session / TRIALS).is_file() and not (b"\n" + (session / TRIALS).read_bytes()).endswith(b"\n"):
            left_out.append(f"{session / TRIALS}: cut short: trials after that are missing; truearc session recover "
                            f"{session} puts back what the telemetry holds")
        reader, in_ticks = TickReader(session), dict[int, Trial]()
        if telemetry and not reader.path.exists():
            left_out.append(f"{reader.path}: missing, as [recording] of launcher.toml deletes it in time: traces of "
                            "its shots are left out")
        elif telemetry:
            traces += _traces(reader, kept, config, len(rows), in_ticks)
            left_out += _unlike(session, marked, in_ticks)
            if reader.cut_short:
                left_out.append(f"{reader.cut_short}: telemetry after that is missing")
        rows += [(session.resolve().name, trial) for trial in kept]
    if not rows:
        lost = [line for line in left_out if "truearc session recover" in line]
        raise InputError("; ".join([f"{', '.join(map(str, folders))}: no marked shots", *lost[:1],
                                    *([f"{len(lost) - 1} more like that"] if len(lost) > 1 else [])]))
    return Dataset(name, configs[0].rig, _shots(rows, configs[0].rig), None, Traces.of(traces), tuple(left_out))


def _unlike(session: Path, marked: list[Trial], in_ticks: dict[int, Trial]) -> list[str]:
    """A line for each trial of which trials.jsonl says something else than the ticks; in_ticks: what they say."""
    known = {trial.outcome.trial: trial for trial in marked}
    return [f"{session / TRIALS}: trial {number}: " + (
        f"is missing; truearc session recover {session} puts it back" if number not in known else
        "is not as the telemetry has it") for number, trial in in_ticks.items() if known.get(number) != trial]


def _split(session: Path, trials: list[Trial]) -> tuple[list[Trial], list[str]]:
    kept, dropped = [], []
    for trial in trials:
        outcome = trial.outcome
        if outcome.outcome in OUTCOMES and trial.shot is not None and trial.shot.speed_m_s is not UNSET:
            dropped.append(f"{session.name} trial {outcome.trial}: shot on the move, at {trial.shot.speed_m_s:.1f} m/s")
        elif outcome.outcome in OUTCOMES and trial.shot is not None:
            kept.append(trial)
        else:
            why = "; ".join(texts(outcome.reasons)) or "by the driver"
            dropped.append(f"{session.name} trial {outcome.trial}: {outcome.outcome} ({why})")
    return kept, dropped


def _shots(rows: list[tuple[str, Trial]], rig: Rig) -> Shots:
    shots = [trial.shot for _, trial in rows if trial.shot is not None]
    marks = [OUTCOMES[trial.outcome.outcome] for _, trial in rows]
    marks = marks if rig.target is None else [rig.target.noted(*mark) for mark in marks]
    numbers = {name: np.array([getattr(shot, name) for shot in shots], dtype=float) for name in NUMBERS}
    numbers["t_s"] = np.array([shot.t_ns * NS for shot in shots])
    texts = {"outcome": tuple(mark for mark, _ in marks), "side": tuple(side for _, side in marks),
             "session": tuple(session for session, _ in rows), "config_id": tuple(shot.config_id for shot in shots)}
    ids = tuple(f"{session}-{shot.trial:04d}" for (session, _), shot in zip(rows, shots, strict=True))
    return Shots(ids, {name: column for name, column in numbers.items() if np.isfinite(column).any()}, texts)


def _traces(reader: TickReader, trials: list[Trial], config: Config, first_row: int,
            in_ticks: dict[int, Trial]) -> list[tuple[int, float, str, float]]:
    """Signals around each shot, one sample for each new reading; `in_ticks` takes the trials of the ticks."""
    feeds = np.array([trial.shot.t_ns for trial in trials if trial.shot is not None], dtype=np.int64)
    rows: list[tuple[int, float, str, float]] = []
    newest: dict[str, int] = {}
    for tick, _ in reader:
        in_ticks |= {trial.outcome.trial: trial for trial in make_trials(tick)}
        # the one shot in whose window this tick lies, if any
        index = int(np.searchsorted(feeds, tick.inputs.t_ns + int(BEFORE_S / NS), side="right")) - 1
        if index < 0 or (tick.inputs.t_ns - feeds[index]) * NS > AFTER_S:
            continue
        for signal, t_ns, value in _signals(tick, config):
            if newest.get(signal) != t_ns:
                newest[signal] = t_ns
                rows.append((first_row + index, float(t_ns - feeds[index]) * NS, signal, value))
    return rows


def _signals(tick: Tick, config: Config) -> list[tuple[str, int, float]]:
    motors = tick.inputs.flywheels
    speed, t_ns = tick.estimate.motor_rad_s, min(motor.t_ns for motor in motors)
    signals = [(f"wheel_{wheel.name}_rad_s", t_ns, speed * wheel.gear) for wheel in config.rig.launcher.wheel]
    signals.append(("motor_current_a", min(motor.current_t_ns for motor in motors),
                    sum(motor.current_a for motor in motors)))
    signals.append(("battery_v", min(motor.bus_t_ns for motor in motors), tick.estimate.battery_v))
    return signals


def label_by_repeatability(dataset: Dataset, least_shots: int = 1) -> Dataset:
    """Group by session and config_id; numbers are means over the group; removed configurations go to `left_out`.

    So do configurations with fewer than `least_shots` marked shots (the others were held or rejected).
    """
    groups: dict[str, list[int]] = {}
    for row, key in enumerate(zip(dataset.shots.text("session"), dataset.shots.text("config_id"), strict=True)):
        groups.setdefault("-".join(key), []).append(row)
    outcomes = np.array(dataset.shots.text("outcome"))
    kept: dict[str, tuple[list[int], str]] = {}
    left_out = list(dataset.left_out)
    for name, rows in groups.items():
        r3 = float(np.mean(outcomes[rows] == "three"))
        r2 = r3 + float(np.mean(outcomes[rows] == "two"))
        outcome = rule(r2, r3)
        if len(rows) < least_shots:
            left_out.append(f"configuration {name}: {len(rows)} shots marked, {least_shots} needed")
        elif outcome is None:
            left_out.append(f"configuration {name}: R2 = {r2:.0%} of {len(rows)} shots, not repeatable")
        else:
            kept[name] = (rows, outcome)
    return Dataset(dataset.name, dataset.facts, _means(dataset.shots, kept), None, None, tuple(left_out))


def rule(r2: float, r3: float) -> str | None:
    """Return the label of a configuration with these shares; None if it is not repeatable."""
    if r2 == 0.0:
        return "miss"
    if r2 < REMOVED_BELOW:
        return None
    return "three" if r3 >= THREE_AT else "two"


def _means(shots: Shots, kept: dict[str, tuple[list[int], str]]) -> Shots:
    groups = [rows for rows, _ in kept.values()]
    numbers = {name: np.array([np.nanmean(shots.number(name)[rows]) for rows in groups]) for name in AVERAGED}
    numbers["repeats"] = np.array([float(len(rows)) for rows in groups])
    texts = {"outcome": tuple(outcome for _, outcome in kept.values()),
             "session": tuple(shots.text("session")[rows[0]] for rows in groups)}
    return Shots(tuple(kept), numbers, texts)
