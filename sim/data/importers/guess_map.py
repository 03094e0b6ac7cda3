"""A map proposed from a log's entry names, their units and their numbers."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from msgspec import structs

from truearc.robot.config.rig_spec import Rig
from truearc.robot.config.schema import InputError
from truearc.robot.config.shot_map import (
    MARKS,
    NOT_MARKED,
    SCHEMA,
    Detection,
    OutcomeKeys,
    ShotMap,
    Signal,
    as_signal,
    load_map,
)
from truearc.robot.config.toml_text import make_toml
from truearc.robot.config.unit_table import MOTOR, factor_of, own_unit, unit_in
from truearc.sim.data.columns import RANGES
from truearc.sim.data.importers.logged_shots import Reading
from truearc.sim.data.importers.series import Log, Series
from truearc.sim.data.model import Floats

WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
WANTED = {"set", "setpoint", "target", "goal", "desired", "reference", "ref", "command", "commanded", "requested",
          "wanted", "tgt", "cmd"}
ODD = {"error", "current", "temp", "temperature", "voltage", "volts", "amps", "position", "sigma", "stddev", "std",
       "rate", "accel", "acceleration", "torque", "raw", "offset", "limit", "tolerance", "spread", "kp", "ki", "kd",
       "count"}
SPIN = {"flywheel", "flywheels", "shooter", "wheel", "wheels", "launcher", "top", "bottom", "upper", "lower", "motor"}
SPEED = {"velocity", "speed", "rpm", "rps", "rad", "rads"}
ANGLE = {"angle", "position", "deg", "degrees", "rad", "radians", "elevation", "pitch", "hood"}
PLAUSIBLE_RAD_S = (20.0, 3000.0)      # of a wheel that throws, at its fastest
PULSE_S = 0.2, 2.0                    # a fall sooner after a shot is none of its outcome's; a pulse is shorter
FALLS = 2                             # of a state, at least
OWN = "truearc"                       # a map that comes with truearc
MOST_LISTED = 40                      # signals of a message
MOST_WORDS = 12                       # different texts of a signal of outcomes


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
        table = {"schema": SCHEMA, "columns": columns, **({"shots": shots} if shots else {}),
                 **({"outcome": outcome} if outcome else {})}
        return "".join(f"# {line}\n" for line in self.lines) + make_toml(table)


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
    words = {key: _words(key) for key in log}
    moving = {key: series for key, series in log.items() if series.numeric and len(series.t_s) > 1}
    lines: list[str] = []
    missing: list[str] = []
    columns: dict[str, Signal] = {}
    speed = _best(moving, words, "motor_rad_s", SPIN, SPEED)
    column = _wheel_column(rig)
    for wanted, key in (("distance_m", _best(moving, words, "distance_m", {"distance", "dist", "range"}, set())),
                        ("hood_deg", _best(moving, words, "hood_deg", {"hood", "pivot", "elevation", "pitch"}, ANGLE)),
                        (column, speed)):
        if key is None:
            missing.append(wanted)
            continue
        columns[wanted] = Signal(key, unit=_unit(log[key], own_unit(wanted)))
        lines.append(f"{wanted}: {key}{_unit_note(log[key], wanted)}")
    if missing:
        raise InputError(_not_recognised(name, missing, lines, moving))
    if column == MOTOR:
        lines.append("motor_rad_s: taken to be the speed of the motors; where it is that of the wheels, divide by the "
                     "gear: times = 1 / gear")
    battery = _best(moving, words, "battery_v", {"battery", "bus"}, {"voltage", "volts", "v"})
    if battery is not None:
        columns["battery_v"] = Signal(battery, unit=_unit(log[battery], own_unit("battery_v")))
        lines.append(f"battery_v: {battery}")
    set_point = _set_point(log, words, log[columns[column].key], columns[column].unit)
    feed = _feed(log, words)
    shot_map = ShotMap(SCHEMA, columns={**columns}, shots=Detection(set_point=set_point, feed=feed))
    outcome, marked_by = _outcome(log, words, Reading(Path(name), log, shot_map, rig))
    wanted = set_point.key if set_point else "none found: spinning down may look like a ball"
    lines += [f"set point of the speed: {wanted}",
              f"feeder: {feed or 'none found: every dip of the speed is a shot'}", marked_by]
    return Guess(structs.replace(shot_map, outcome=outcome), tuple(lines))


def _not_recognised(name: str, missing: list[str], found: list[str], moving: Log) -> str:
    """Columns that are missing, those that were recognised, and the signals to choose from, those that change first."""
    def told(series: Series) -> str:
        values = np.asarray(series.values, dtype=float)
        values = values[np.isfinite(values)]
        return (f"  {series.name}: {values.min():.4g} to {values.max():.4g} {_unit(series, '')}".rstrip()
                if len(values) else f"  {series.name}: no numbers")
    steady = {key: len(np.unique(series.values[:2000])) <= 2 for key, series in moving.items()}
    keys = sorted(moving, key=lambda key: (steady[key], key))
    more = [f"  and {len(keys) - MOST_LISTED} more"] if len(keys) > MOST_LISTED else []
    first = (f"{name}: no signal's name, unit and numbers look like {', '.join(missing)}; write a map by hand: "
             "docs/how-to/importing.md")
    return "\n".join([first, *(f"recognised: {line}" for line in found), "signals with numbers:",
                      *(told(moving[key]) for key in keys[:MOST_LISTED]), *more])


def _words(key: str) -> list[str]:
    return [word.lower() for word in WORD.findall(key)]


def _wheel_column(rig: Rig) -> str:
    wheels = rig.launcher.wheel
    return MOTOR if rig.launcher.free_speed_rad_s or not wheels else f"wheel_{wheels[0].name}_rad_s"


def _unit(series: Series, default: str) -> str:
    """The unit that the log states, or that the key ends in; readers of the map do not see the log's metadata."""
    return series.unit or unit_in(series.name) or default


def _unit_note(series: Series, column: str) -> str:
    unit = _unit(series, "")
    return f", in {unit}" if unit else f", whose unit is not stated: taken as {own_unit(column)}"


def _best(moving: Log, words: dict[str, list[str]], column: str, nouns: set[str], kinds: set[str]) -> str | None:
    """The signal whose name has one of the nouns, and of the kinds where there are some, whose numbers can be so."""
    scored = [(score, key) for key, series in moving.items()
              if (score := _score(series, words[key], column, nouns, kinds)) > 0.0]
    return max(scored, key=lambda one: (one[0], -len(one[1])))[1] if scored else None


def _score(series: Series, said: list[str], column: str, nouns: set[str], kinds: set[str]) -> float:
    unit = _unit(series, "")
    factor = factor_of(column, unit) if unit else None
    of_kind = bool(kinds & set(said)) or factor is not None
    if not nouns & set(said) or (kinds and not of_kind) or WANTED & set(said) or (ODD - kinds) & set(said):
        return 0.0
    if unit and factor is None:
        return 0.0
    scale, zero = factor or (1.0, 0.0)
    values = (np.asarray(series.values, dtype=float) - zero) * scale
    values = np.abs(values[np.isfinite(values)]) if column == MOTOR else values[np.isfinite(values)]
    low, high = PLAUSIBLE_RAD_S if column == MOTOR else RANGES[column]
    top = values.max(initial=-np.inf)
    if not (low <= top <= high) or (column != MOTOR and values.min() < low):
        return 0.0
    varies = len(np.unique(values[:2000])) > 3
    return (1.0 + (factor is not None) + varies + 0.5 * len(nouns & set(said)) + (said[-1] in nouns | kinds)
            + 0.5 * bool({"hub", "goal", "speaker", "target"} & set(said)))


def _set_point(log: Log, words: dict[str, list[str]], speed: Series, unit: str) -> Signal | None:
    """A signal of the same words, but wanted, that the speed follows; unit: of the speed, and of it if none is stated.
    """
    mine = set(_words(speed.name))
    found = []
    for key in log:
        said = set(words[key])
        series = log[key]
        if key == speed.name or not series.numeric or not WANTED & said or not (SPIN | SPEED) & said:
            continue
        if (ODD - {"rad"}) & said:
            continue
        own, theirs = factor_of(MOTOR, _unit(series, unit)), factor_of(MOTOR, unit)
        if own and theirs and 0.5 * (top := own[0] * _top(series)) < theirs[0] * _top(speed) < 2.0 * top:
            found.append((len(mine & said), -len(said), key))
    return Signal(max(found)[2], unit=_unit(log[max(found)[2]], unit)) if found else None


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


def _outcome(log: Log, words: dict[str, list[str]], reading: Reading) -> tuple[OutcomeKeys, str]:
    """A text of outcomes that are known here, or a boolean that names a hit and stands until the next outcome."""
    for key, series in log.items():
        if not series.numeric:
            texts = dict.fromkeys(str(value).strip().lower() for value in series.values)
            known = {text: text for text in texts if text in MARKS or text in NOT_MARKED}
            if len(texts) <= MOST_WORDS and len([text for text in known if text]) >= 2:
                values = {text: word for text, word in known.items() if text}
                return OutcomeKeys(key=key, values=values), f"outcome: {key}"
    nouns = {"scored", "successful", "success", "hit", "made"}
    for key in _booleans(log):
        if nouns & set(words[key]):
            values, said = _meaning(log[key], reading.shots().t_s)
            return OutcomeKeys(key=key, values=values) if values else OutcomeKeys(), f"outcome: {key}: {said}"
    return OutcomeKeys(), "outcome: none found: state outcome in the map, or shots have none"


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
