"""Signals, or columns of a table, by their names, units and numbers; and outcomes by their texts."""

import re
from collections.abc import Iterable, Mapping, Set

import numpy as np

from truearc.errors import InputError
from truearc.robot.config.rig_spec import Rig
from truearc.robot.config.shot_map import MARKS, MOTOR, NOT_MARKED, factor_of, own_unit, unit_in
from truearc.sim.data.columns import RANGES, SAID_OF_SHOTS, SPELLINGS
from truearc.sim.data.importers.logged_shots import times
from truearc.sim.data.importers.series import Series, Signals

WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
WANTED = {"set", "setpoint", "target", "goal", "desired", "reference", "ref", "command", "commanded", "requested",
          "wanted", "tgt", "cmd"}
ODD = {"error", "current", "temp", "temperature", "voltage", "volts", "amps", "position", "sigma", "stddev", "std",
       "rate", "accel", "acceleration", "torque", "raw", "offset", "limit", "tolerance", "spread", "kp", "ki", "kd",
       "count"}
SPIN = {"flywheel", "flywheels", "shooter", "wheel", "wheels", "launcher", "top", "bottom", "upper", "lower", "motor"}
SPEED = {"velocity", "speed", "rpm", "rps", "rad", "rads"}
ANGLE = {"angle", "position", "deg", "degrees", "rad", "radians", "elevation", "pitch", "hood"}
OUTCOME = {"outcome", "outcomes", "result", "results", "score", "scored", "hit", "made", "success", "successful"}
FILLERS = {"miss", "missed", "too", ""}                # beside a word that says more
PLAUSIBLE_RAD_S = (20.0, 3000.0)      # of a wheel that throws, at its fastest
MOST_LISTED = 40                      # signals of a message
MOST_WORDS = 12                       # different texts of a signal of outcomes
GEARED = ("motor_rad_s: taken to be the speed of the motors; where it is that of the wheels, divide by the gear: "
          "times = 1 / gear")


def not_recognised(name: str, missing: list[str], found: list[str], moving: Signals, kind: str = "signal",
                   more: str = "") -> InputError:
    """Columns that are missing, those that were recognised, and the signals to choose from, those that change first."""
    def told(series: Series) -> str:
        values = np.asarray(series.values, dtype=float)
        values = values[np.isfinite(values)]
        return (f"  {series.name}: {values.min():.4g} to {values.max():.4g} {unit_said(series, '')}".rstrip()
                if len(values) else f"  {series.name}: no numbers")
    steady = {key: len(np.unique(series.values[:2000])) <= 2 for key, series in moving.items()}
    keys = sorted(moving, key=lambda key: (steady[key], key))
    rest = [f"  and {len(keys) - MOST_LISTED} more"] if len(keys) > MOST_LISTED else []
    first = (f"{name}: no {kind}'s name, unit and numbers look like {', '.join(missing)}; write a map by hand: "
             f"docs/how-to/importing.md{more}")
    return InputError("\n".join([first, *(f"recognised: {line}" for line in found), f"{kind}s with numbers:",
                                 *(told(moving[key]) for key in keys[:MOST_LISTED]), *rest]))


def words_of(key: str) -> list[str]:
    """The words of a key, in small letters: FlywheelRPM has two."""
    return [word.lower() for word in WORD.findall(key)]


def wheel_column(rig: Rig) -> str:
    """The column of a map that a speed is read as."""
    wheels = rig.launcher.wheel
    return MOTOR if rig.launcher.free_speed_rad_s or not wheels else f"wheel_{wheels[0].name}_rad_s"


def unit_said(series: Series, default: str) -> str:
    """The unit that the log states, or that the key ends in; readers of the map do not see the log's metadata."""
    return series.unit or unit_in(series.name) or default


def unit_note(series: Series, column: str) -> str:
    """How a line ends that says which signal a column is."""
    unit = unit_said(series, "")
    return f", in {unit}" if unit else f", whose unit is not stated: taken as {own_unit(column)}"


def best(moving: Signals, column: str, nouns: Set[str], kinds: Set[str], never: Set[str] = WANTED) -> str | None:
    """The signal whose name has one of the nouns, and of the kinds where there are some, whose numbers can be so."""
    scored = [(score, key) for key, series in moving.items()
              if (score := _score(series, words_of(key), column, nouns, kinds, never)) > 0.0]
    return max(scored, key=lambda one: (one[0], -len(one[1])))[1] if scored else None


def _score(series: Series, said: list[str], column: str, nouns: Set[str], kinds: Set[str], never: Set[str]) -> float:
    unit = unit_said(series, "")
    factor = factor_of(column, unit) if unit else None
    of_kind = bool(kinds & set(said)) or factor is not None
    if not nouns & set(said) or (kinds and not of_kind) or never & set(said) or (ODD - kinds - nouns) & set(said):
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


def meanings(texts: Iterable[str]) -> dict[str, str]:
    """{text: word of a map} of texts that are known to say how a shot ended; in small letters, without ""."""
    return {text: word for text in texts if text and (word := _meaning_of(text)) is not None}


def _meaning_of(text: str) -> str | None:
    if text in MARKS or text in NOT_MARKED:
        return text
    if text in SPELLINGS:
        return SPELLINGS[text] or NOT_MARKED[0]
    rest = " ".join(word for word in re.split(r"[^\w/]+", text) if word not in FILLERS)
    word = SAID_OF_SHOTS.get(rest, "")
    return SAID_OF_SHOTS.get(text) or (word if word.startswith("miss") else None)


def outcome_lines(key: str, values: Mapping[str, str], counts: Mapping[str, int]) -> list[str]:
    """Which signal says the outcome and what its texts are taken to mean; then those that are not known."""
    meant = [f"{text} = {word}" for text, word in values.items() if text not in ("", word)]
    lines = [f"outcome: {key}" + (f": {', '.join(meant)}" if meant else "")]
    if "" in values:
        lines.append(f"outcome: {key}: empty ({times(counts[''])}): left out")
    odd = [f"{text!r} ({times(counts[text])})" for text in counts if text and text not in values]
    if odd:
        lines.append(f"outcome: {key}: not known: {', '.join(odd)}; add {'them' if odd[1:] else 'it'} to "
                     "outcome.values in shots.toml")
    return lines
