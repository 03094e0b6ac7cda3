"""A lab's own simulator (SystemSpec), its recordings (Runs), and both laid out for a fit (Recording).

A simulator is a rate function, which truearc integrates by the classical Runge-Kutta method, or a closed program that
returns whole runs. Units are the user's own; names should end with theirs.
"""

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from truearc.errors import InputError
from truearc.sim.infer.likelihood.score_table import Array

HOLDS = ("zero", "linear")
# Chosen: signs of 24 rows leave a p-value of 5 % of one in a hundred tests; blocks shorter than 40 samples hold little
FEW_RUNS, ROWS, SHORTEST = 12, 24, 40
LONGEST = 2000                        # samples of a row; bounds the memory
GAP = 5.0                             # median time steps that make a gap
UNEVEN = 0.01                         # share of the median step by which steps may differ without a note
SLIPS = {57.29578: "degrees and radians", 1000.0: "a unit and its thousandth", 100.0: "metres and centimetres",
         9.80665: "kilograms and newtons", 9.549297: "rad/s and rpm", 60.0: "seconds and minutes"}
# Chosen: a run's scale may miss the factor by 15 %, or by three times what the logs of the others' scales spread by;
# where these spread by more than a factor of 1.6 nothing can be told. Measured on 60 sound sets of 12 runs (those of
# tests/sim/systems, seeds 100 to 159): from four spreads on, one was refused; from six, none
SLIP, SPREAD, BEYOND = 0.15, 0.5, 6.0
MANY = 4                              # runs from which scales are compared


@dataclass(frozen=True)
class Believed:
    """A number as believed: normal about `centre` with standard deviation `sd`, or its logarithm is (`log`)."""

    centre: float
    sd: float
    log: bool = False

    @property
    def place(self) -> float:
        """The centre on the scale on which it is normal."""
        return float(np.log(self.centre)) if self.log else self.centre

    def value(self, place: Any) -> Any:
        """Return the number for a place on that scale."""
        return np.exp(place) if self.log else place


def positive(centre: float | int, *, factor: float | int = 2.0) -> Believed:
    """Return a belief about a positive number: 68 % within the factor of the centre, either way.

    Raises:
        InputError: the centre is not above 0, or the factor not above 1.
    """
    if not (np.isfinite(centre) and centre > 0.0 and np.isfinite(factor) and factor > 1.0):
        raise InputError(f"positive: got {centre}, factor {factor}; expected a number above 0 and a factor above 1")
    return Believed(float(centre), float(np.log(factor)), log=True)


def normal(centre: float | int, *, sd: float | int) -> Believed:
    """Return a belief about a number of either sign: normal, with this standard deviation.

    Raises:
        InputError: a number is not finite, or sd not above 0.
    """
    if not (np.isfinite(centre) and np.isfinite(sd) and sd > 0.0):
        raise InputError(f"normal: got {centre}, sd {sd}; expected finite numbers and sd above 0")
    return Believed(float(centre), float(sd))


@dataclass(frozen=True, eq=False)
class Effect:
    """An effect that the simulator may lack: `push(state, inputs, a)` is added to the rates; `usual`: the usual a."""

    name: str
    push: Callable[..., Any]
    usual: float | None = None


def effect(name: str, push: Callable[..., Any], *, usual: float | None = None) -> Effect:
    """Return an effect of the user's own, to test as a candidate.

    Args:
        name: Lower-case words joined by _.
        push: Function of state, inputs and amplitude a. Returns one number per state, which is added to its rate: zero
            at a = 0.
        usual: Usual size of a. None: the size at which the push is a tenth of the believed rates.

    Raises:
        InputError: the name is not an identifier, or usual is not above 0.
    """
    if not name.isidentifier():
        raise InputError(f"effect: name: got {name!r}; expected words joined by _")
    if usual is not None and not usual > 0.0:
        raise InputError(f"effect {name}: usual: got {usual}; expected a number above 0")
    return Effect(name, push, usual)


class SystemSpec:
    """A simulator with what is believed of it.

    outputs: {output: standard deviation of its noise, or None}; found: effects that were found missing, with what is
    known of them; compiled: code, kept for as long as the system.

    Args:
        rate: Function of state, inputs and parameters that returns the derivative of each state. Written with
            jax.numpy it is compiled; anything else is differenced.
        simulate: Instead of `rate`, a closed program: simulate(inputs, parameters, start) -> {output: array}.
        state: Names of the states; of a closed program, of the numbers in `start`.
        believed: Parameters, as `positive` or `normal`.
        observe: Standard deviation of the noise of each output; None: fitted. Default: all states, fitted.
        hold: Inputs between samples: "zero" (held) or "linear".
        start: Beliefs about the states at the start of a run that are not observed.
        effects: Effects of the user's own.
    """

    def __init__(self, rate: Callable[..., Any] | None = None, *, simulate: Callable[..., Any] | None = None,
                 state: Sequence[str] = (), believed: Mapping[str, Believed],
                 observe: Mapping[str, float | None] | None = None, hold: str = "zero",
                 start: Mapping[str, Believed] | None = None, effects: Sequence[Effect] = ()) -> None:
        self.rate, self.simulate_run, self.hold = rate, simulate, hold
        self.state, self.believed, self.start = tuple(state), dict(believed), dict(start or {})
        self.outputs: dict[str, float | None] = dict.fromkeys(state, None) if observe is None else dict(observe)
        self.effects = tuple(effects)
        self.found: tuple[tuple[Any, Believed], ...] = ()
        self.compiled: dict[Any, Any] = {}
        self._check()

    def _check(self) -> None:
        if (self.rate is None) == (self.simulate_run is None):
            raise InputError("System: give either rate or simulate")
        if self.rate is not None and not self.state:
            raise InputError("System: state: name the states, such as state=[\"angle_rad\", \"speed_rad_s\"]")
        if not self.believed:
            raise InputError("System: believed: is empty; expected a prior for at least one parameter")
        for name, one in (*self.believed.items(), *self.start.items()):
            if not isinstance(one, Believed):
                raise InputError(f"System: {name}: got {one!r}; expected ta.positive(...) or ta.normal(...)")
        if self.hold not in HOLDS:
            raise InputError(f"System: hold: got {self.hold!r}; expected zero or linear")
        self._check_outputs()

    def _check_outputs(self) -> None:
        for name, sd in self.outputs.items():
            if self.rate is not None and name not in self.state:
                raise InputError(f"System: observe: {name} is none of the states ({', '.join(self.state)})")
            if sd is not None and not (np.isfinite(sd) and sd > 0.0):
                raise InputError(f"System: observe: {name}: got {sd}; expected a standard deviation above 0, or None")
        if not self.outputs:
            raise InputError("System: observe: name at least one output")

    @property
    def starts(self) -> tuple[str, ...]:
        """Names of the numbers that a run starts from."""
        return self.state or tuple(self.outputs)

    def with_beliefs(self, believed: Mapping[str, Believed],
                     found: tuple[tuple[Any, Believed], ...] | None = None) -> "SystemSpec":
        """Return the system with other beliefs, and with these effects in it."""
        new = copy(self)
        new.believed, new.found = {**self.believed, **believed}, self.found if found is None else found
        return new

    def parameters(self, values: Sequence[Any]) -> Any:
        """Return the parameters as the rate function takes them."""
        return SimpleNamespace(**dict(zip(self.believed, values, strict=True)))


class Runs:
    """Recordings: samples of inputs and outputs, run by run.

    Args:
        frame: Columns by name: a pandas or polars frame, or {name: values}.
        run: Column that tells runs apart; None: one run.
        time: Column of the time in s, which grows within a run.
        inputs: Columns that vary within a run and drive the simulator.
        conditions: Columns that are constant within a run.
        session: Column of the session that a run belongs to.

    Raises:
        InputError: a column is missing or not numeric; time goes back; an input is missing; runs differ by a unit.
    """

    def __init__(self, frame: Any, *, run: str | None = "run", time: str = "t_s", inputs: Sequence[str] = (),
                 conditions: Sequence[str] = (), session: str | None = None) -> None:
        self.names = tuple(str(name) for name in (frame.columns if hasattr(frame, "columns") else frame))
        self.columns = {name: np.asarray(frame[name]) for name in self.names}
        self.inputs, self.conditions, self.time, self.session = tuple(inputs), tuple(conditions), time, session
        self.notes: list[str] = []
        for name in (*([run] if run else []), time, *inputs, *conditions, *([session] if session else [])):
            if name not in self.columns:
                raise InputError(f"runs: there is no column {name!r}; expected one of {', '.join(self.names)}")
        self.rows = len(self.columns[time])
        if not self.rows:
            raise InputError("runs: there are no rows")
        label = np.zeros(self.rows, dtype=int) if run is None else self.columns[run]
        _, first, whose = np.unique(label, return_index=True, return_inverse=True)
        order = np.argsort(first)
        self.labels = [str(label[first[k]]) for k in order]
        self.places = [np.flatnonzero(whose == k) for k in order]
        self._check()

    def __len__(self) -> int:
        return len(self.labels)

    def number(self, name: str) -> Float[Array, " rows"]:
        """Return a column as floats.

        Raises:
            InputError: it is missing or not numeric.
        """
        if name not in self.columns:
            raise InputError(f"runs: there is no column {name!r}; expected one of {', '.join(self.names)}")
        try:
            return np.asarray(self.columns[name], dtype=float)
        except (TypeError, ValueError) as error:
            raise InputError(f"runs: {name}: is not numeric ({error})") from error

    def take(self, runs: Sequence[int]) -> "Runs":
        """Return some of the runs, by number."""
        rows = np.concatenate([self.places[k] for k in runs])
        frame = {name: values[rows] for name, values in self.columns.items()}
        frame["run"] = np.concatenate([np.full(len(self.places[k]), k) for k in runs])
        return Runs(frame, run="run", time=self.time, inputs=self.inputs, conditions=self.conditions,
                    session=self.session)

    def _check(self) -> None:
        time, steps = self.number(self.time), []
        for label, rows in zip(self.labels, self.places, strict=True):
            step = np.diff(time[rows])
            if not np.isfinite(time[rows]).all():
                raise InputError(f"runs: run {label}: {self.time} is missing in a row")
            if (step <= 0.0).any():
                at = int(np.argmax(step <= 0.0))
                raise InputError(f"runs: run {label}: {self.time} goes back or stands still, from "
                                 f"{time[rows[at]]:g} to {time[rows[at + 1]]:g} s; sort the rows, or tell runs apart")
            if len(rows) < 3:
                raise InputError(f"runs: run {label}: has {len(rows)} samples; expected at least 3")
            steps.append(step / np.median(step))
            if (uneven := float(np.abs(steps[-1][steps[-1] < GAP] - 1.0).max(initial=0.0))) > UNEVEN:
                self.notes.append(f"run {label}: time steps differ by up to {uneven:.0%}; each is taken as it is")
        for name in (*self.inputs, *self.conditions):
            values = self.number(name)
            for label, rows in zip(self.labels, self.places, strict=True):
                if not np.isfinite(values[rows]).all():
                    raise InputError(f"runs: run {label}: {name} is missing in a row: every input must be known")
                if name in self.conditions and np.ptp(values[rows]) > 1e-9 * (1e-9 + np.abs(values[rows]).max()):
                    raise InputError(f"runs: run {label}: {name} varies within the run; a condition is constant: list "
                                     "it among the inputs")

    def check_units(self, names: Sequence[str]) -> None:
        """Reject a run in which a column's scale differs from the other runs' by the factor of a unit slip."""
        for name in names:
            values = self.number(name)
            scale = np.array([np.nanpercentile(np.abs(values[rows]), 90) for rows in self.places])
            for k, label in enumerate(self.labels if len(scale) >= MANY else ()):
                others = np.delete(scale, k)
                middle = float(np.median(others))
                if middle <= 0.0 or scale[k] <= 0.0:
                    continue
                ratio = abs(float(np.log(scale[k] / middle)))
                spread = float(np.std(np.log(np.maximum(others, 1e-300) / middle)))
                factor = min(SLIPS, key=lambda one: abs(ratio - np.log(one)))
                if spread < SPREAD and abs(ratio - np.log(factor)) < max(SLIP, 3.0 * spread) and (
                        ratio > BEYOND * spread):
                    raise InputError(f"runs: run {label}: {name} is {scale[k] / middle:.3g} times as large as in the "
                                     f"other runs: {SLIPS[factor]} may have been mixed")


@dataclass(frozen=True, eq=False)
class Recording:
    """Rows (runs, or blocks of them) padded to T samples, of U inputs, C conditions and O outputs.

    real: which samples are recorded. place: row of the frame of each sample. run: number of the run of each row.
    since_s: start of each row, from the start of its run.
    """

    time_s: Float[Array, "R T"]
    real: Bool[Array, "R T"]
    place: Int[Array, "R T"]
    inputs: Float[Array, "R T U"]
    conditions: Float[Array, "R C"]
    seen: Float[Array, "R T O"]
    run: Int[Array, " R"]
    since_s: Float[Array, " R"]
    labels: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def step_s(self) -> Float[Array, "R steps"]:
        """Time steps; 0 beyond the last sample."""
        return np.where(self.real[:, 1:], np.diff(self.time_s, axis=1), 0.0)


def record(system: SystemSpec, runs: Runs, wanted: int = ROWS, blind: bool = False) -> Recording:
    """Lay out runs as rows: gaps end a row, and few runs are cut into blocks until there are `wanted` rows.

    blind: outputs need not be there.

    Raises:
        InputError: an output has no column, or no value in a run.
    """
    seen = [np.full(runs.rows, np.nan) if blind and name not in runs.columns else runs.number(name)
            for name in system.outputs]
    runs.check_units([*runs.inputs, *(name for name in system.outputs if name in runs.columns)])
    notes, pieces = list(runs.notes), []
    time = runs.number(runs.time)
    cuts = -(-wanted // len(runs)) if len(runs) < FEW_RUNS else 1
    for k, rows in enumerate(runs.places):
        step = np.diff(time[rows])
        gaps = np.flatnonzero(step > GAP * np.median(step)) + 1
        if len(gaps):
            notes.append(f"run {runs.labels[k]}: has {len(gaps)} gaps in {runs.time}, the first at "
                         f"{time[rows[gaps[0] - 1]]:g} s; it is cut there")
        for part in np.split(rows, gaps):
            parts = max(min(cuts, len(part) // SHORTEST), -(-len(part) // LONGEST), 1)
            pieces += [(k, block) for block in np.array_split(part, parts) if len(block) >= 3]
    if len(pieces) > len(runs) and cuts > 1:
        notes.append(f"{len(runs)} runs are cut into {len(pieces)} blocks, each with a start of its own")
    for name, values in zip(system.outputs, seen, strict=True):
        for k, block in pieces:
            if not blind and not np.isfinite(values[block]).any():
                raise InputError(f"runs: run {runs.labels[k]}: {name} has no value from {time[block[0]]:g} to "
                                 f"{time[block[-1]]:g} s")
    longest = max(len(block) for _, block in pieces)
    place = np.stack([np.concatenate([block, np.full(longest - len(block), block[-1])]) for _, block in pieces])
    real = np.stack([np.arange(longest) < len(block) for _, block in pieces])
    inputs = [runs.number(name)[place] for name in runs.inputs]
    first = np.array([runs.places[k][0] for k, _ in pieces])
    return Recording(
        time[place], real, place, np.stack(inputs, axis=2) if inputs else np.zeros((*place.shape, 0)),
        np.stack([runs.number(name)[place[:, 0]] for name in runs.conditions], axis=1) if runs.conditions
        else np.zeros((len(place), 0)),
        np.where(real[:, :, None], np.stack([one[place] for one in seen], axis=2), np.nan),
        np.array([k for k, _ in pieces]), time[place[:, 0]] - time[first],
        tuple(runs.labels[k] for k, _ in pieces), tuple(notes))
