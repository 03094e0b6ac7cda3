"""A map proposed from a log's entry names, their units and their numbers."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from msgspec import structs

from truearc.errors import make_toml
from truearc.robot.config.rig_spec import Rig
from truearc.robot.config.shot_map import (
    MARKS,
    MOTOR,
    NOT_MARKED,
    SCHEMA,
    Detection,
    OutcomeKeys,
    ShotMap,
    Signal,
    as_signal,
    factor_of,
    load_map,
    own_unit,
)
from truearc.sim.data.dataset import Floats
from truearc.sim.data.importers.logged_shots import Reading
from truearc.sim.data.importers.recognise import (
    ANGLE,
    GEARED,
    MOST_WORDS,
    ODD,
    OUTCOME,
    SPEED,
    SPIN,
    WANTED,
    best,
    meanings,
    not_recognised,
    outcome_lines,
    unit_note,
    unit_said,
    wheel_column,
    words_of,
)
from truearc.sim.data.importers.series import Log, Series

PULSE_S = 0.2, 2.0                    # a fall sooner after a shot is none of its outcome's; a pulse is shorter
FALLS = 2                             # of a state, at least
OWN = "truearc"                       # a map that comes with truearc
NO_OUTCOME = "outcome: none found: state outcome in the map, or shots have none"


@dataclass(frozen=True)
class Guess:
    """A map, and a line for each column of how sure it is."""

    map: ShotMap
    lines: tuple[str, ...]

    def to_toml(self) -> str:
        """The map as a shots.toml, with those lines as comments."""
        columns = {name: _plain(said) for name, said in self.map.columns.items()}
        shots = {name: _plain(said) for name in ("wheel", "set_point", "feed")
                 if (said := getattr(self.map.shots, name))}
        outcome = {name: said for name in ("key", "values", "buttons") if (said := getattr(self.map.outcome, name))}
        rows = {} if self.map.rows == "time" else {"rows": self.map.rows}
        table = {"schema": SCHEMA, **rows, "columns": columns, **({"shots": shots} if shots else {}),
                 **({"outcome": outcome} if outcome else {})}
        lines = ("".join(mark if mark.isprintable() else " " for mark in line) for line in self.lines)
        return "".join(f"# {line}\n" for line in lines) + make_toml(table)


def _plain(said: str | Signal) -> str | dict[str, object]:
    return said if isinstance(said, str) else {name: value for name in ("key", "unit", "times", "plus")
                                               if (value := getattr(said, name)) != getattr(Signal(""), name)}


def guess_map(log: Log, rig: Rig, name: str) -> Guess:
    """Propose a map for a log.

    Raises:
        InputError: no signal looks like the speed of a wheel, or like a distance, or like a hood's angle; it lists what
            was recognised and the signals that there are.
    """
    own = load_map(OWN)
    if all(as_signal(said).key in log for said in own.columns.values()):
        return Guess(own, (f"a session of truearc: the map {OWN}",))
    words = {key: words_of(key) for key in log}
    moving = {key: series for key, series in log.items() if series.numeric and len(series.t_s) > 1}
    lines: list[str] = []
    missing: list[str] = []
    columns: dict[str, Signal] = {}
    speed = best(moving, "motor_rad_s", SPIN, SPEED)
    column = wheel_column(rig)
    for wanted, key in (("distance_m", best(moving, "distance_m", {"distance", "dist", "range"}, set())),
                        ("hood_deg", best(moving, "hood_deg", {"hood", "pivot", "elevation", "pitch"}, ANGLE)),
                        (column, speed)):
        if key is None:
            missing.append(wanted)
            continue
        columns[wanted] = Signal(key, unit=unit_said(log[key], own_unit(wanted)))
        lines.append(f"{wanted}: {key}{unit_note(log[key], wanted)}")
    if missing:
        raise not_recognised(name, missing, lines, moving)
    if column == MOTOR:
        lines.append(GEARED)
    battery = best(moving, "battery_v", {"battery", "bus"}, {"voltage", "volts", "v"})
    if battery is not None:
        columns["battery_v"] = Signal(battery, unit=unit_said(log[battery], own_unit("battery_v")))
        lines.append(f"battery_v: {battery}")
    set_point = _set_point(log, words, log[columns[column].key], columns[column].unit)
    feed = _feed(log, words)
    shot_map = ShotMap(SCHEMA, columns={**columns}, shots=Detection(set_point=set_point, feed=feed))
    outcome, marked_by = _outcome(log, words, Reading(Path(name), log, shot_map, rig))
    wanted = set_point.key if set_point else "none found: spinning down may look like a ball"
    lines += [f"set point of the speed: {wanted}",
              f"feeder: {feed or 'none found: every dip of the speed is a shot'}", *marked_by]
    return Guess(structs.replace(shot_map, outcome=outcome), tuple(lines))


def _set_point(log: Log, words: dict[str, list[str]], speed: Series, unit: str) -> Signal | None:
    """A signal of the same words, but wanted, that the speed follows; unit: of the speed, and of it if none is stated.
    """
    mine = set(words_of(speed.name))
    found = []
    for key in log:
        said = set(words[key])
        series = log[key]
        if key == speed.name or not series.numeric or not WANTED & said or not (SPIN | SPEED) & said:
            continue
        if (ODD - {"rad"}) & said:
            continue
        own, theirs = factor_of(MOTOR, unit_said(series, unit)), factor_of(MOTOR, unit)
        if own and theirs and 0.5 * (top := own[0] * _top(series)) < theirs[0] * _top(speed) < 2.0 * top:
            found.append((len(mine & said), -len(said), key))
    return Signal(max(found)[2], unit=unit_said(log[max(found)[2]], unit)) if found else None


def _top(series: Series) -> float:
    values = np.abs(np.asarray(series.values, dtype=float))
    return float(values[np.isfinite(values)].max(initial=0.0))


def _feed(log: Log, words: dict[str, list[str]]) -> str | None:
    """A boolean that names the feeder."""
    nouns = {"feed", "feeder", "feeding", "kicker", "indexer", "trigger", "fire", "firing", "shoot", "shooting"}
    found = [(len(nouns & set(words[key])), -len(words[key]), key) for key, series in log.items()
             if nouns & set(words[key]) and series.numeric and len(series.t_s) > 1
             and set(np.unique(series.values).tolist()) == {0.0, 1.0}]
    return max(found)[2] if found else None


def _outcome(log: Log, words: dict[str, list[str]], reading: Reading) -> tuple[OutcomeKeys, list[str]]:
    """A text of outcomes that are known here, or a boolean that names a hit and stands until the next outcome."""
    found = list[tuple[bool, int, str, dict[str, str], Counter[str]]]()
    for key, series in log.items():
        if not series.numeric and len(set(series.values)) <= MOST_WORDS:
            counts = Counter(str(value).strip().lower() for value in series.changes().values)
            values = meanings(counts)
            named = bool(OUTCOME & set(words[key]))
            # of another name, only the words of maps: that something is in or out is said of more than balls
            if len(values if named else [text for text in values if text in MARKS or text in NOT_MARKED]) >= 2:
                found.append((named, -len(found), key, values, counts))
    if found:
        *_, key, values, counts = max(found, key=lambda one: one[:2])
        return OutcomeKeys(key=key, values=values), outcome_lines(key, values, counts)
    nouns = {"scored", "successful", "success", "hit", "made"}
    for key in _booleans(log):
        if nouns & set(words[key]):
            values, said = _meaning(log[key], reading.shots().t_s)
            return OutcomeKeys(key=key, values=values) if values else OutcomeKeys(), [f"outcome: {key}: {said}"]
    return OutcomeKeys(), [NO_OUTCOME]


def _meaning(scored: Series, shots_s: Floats) -> tuple[dict[str, str], str]:
    """(values of an outcome's boolean, what they are taken to mean); no values where the log leaves that open.

    A state falls by the outcome of a later shot. A pulse falls by itself, whatever comes next.
    """
    edges = scored.changes()
    rose, fell = _edges(edges)
    state = [bool(((shots_s > up) & (shots_s < down - PULSE_S[0])).any()) for up, down in zip(rose, fell, strict=True)]
    if len(state) >= FALLS and all(state) and (fell - rose > PULSE_S[1]).all():
        return {"true": "hit", "false": "miss"}, "true is a hit, false a miss"
    if state and not any(state) and (fell - rose < PULSE_S[1]).all():
        return {"true": "hit"}, ("is true for a moment after a hit; shots without it are left out. If they missed, "
                                 "state outcome.otherwise = \"miss\"")
    return {}, "left out: it may be a state or a pulse; state outcome in the map, or shots have none"


def _edges(boolean: Series) -> tuple[Floats, Floats]:
    """(when a boolean without repeats rose, when it fell again); of the last rise without a fall neither."""
    up = np.flatnonzero(np.asarray(boolean.values[:-1]) > 0.5)
    return boolean.t_s[up], boolean.t_s[up + 1]


def _booleans(log: Log) -> Iterable[str]:
    return (key for key, series in log.items() if series.numeric and len(series.t_s)
            and set(np.unique(series.values).tolist()) <= {0.0, 1.0})
