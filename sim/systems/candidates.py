"""The effects that a simulator may lack, generated from its states, inputs, outputs, parameters and conditions.

Each candidate is an amplitude on one slot of the simulator (a parameter, a push on a rate, a distortion of an input or
output), in some rows more than in others if it goes along a covariate. The usual size of a push is a tenth of the rms
of the believed rate.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.special import ndtr
from scipy.stats import norm

from truearc.sim.discover.detect.covariates import covariates_among
from truearc.sim.infer.likelihood.score_table import Array, Column
from truearc.sim.systems.system import Recording, SystemSpec

USUAL_PUSH = 0.1                      # of the rms of the believed rate (the design)
# Chosen: instruments are calibrated to a few per cent; a clip cuts half of what is beyond
USUAL_CHANGE, USUAL_SCALE, USUAL_OFFSET, USUAL_CLIP = 0.1, 0.05, 0.03, 0.5
USUAL_DELAY = 2.0                     # median time steps; chosen
# Centres of the priors of shape numbers. A factor of three either way holds 68 %, as does one standard deviation
# of the normal distribution that a level's share of the recorded values is read from. Measured (docs/measured/
# systems.md): with a fixed width dry friction was named Stribeck, with a fixed level an overflow a cubic push
SMOOTH = 0.01                         # of a speed's range over which a sign is smoothed (the design)
SLOW, SLOWEST = 0.1, 0.3              # of a speed's range in which Stribeck friction fades, and at most; chosen: what
                                      # has not faded at more than half of the highest speed is dry friction
BAND = 0.2                            # of an input's range in a dead band; chosen
HIGH = 0.85                           # share of the recorded values below an upper level; chosen
FACTOR, ENDS, GRID = 3.0, 3.0, 25     # of a width; deviations to the end of a search, and places in between
TRIED = (0.0, -1.6, -0.8, 0.8, 1.6)   # places of shape numbers that one step compares; chosen
BUMPS = 6                             # shapes of a smooth curve; chosen: two bends within the range
KNOTS, BEYOND, DENSE = 257, 3.0, 5.0  # of a table, which reaches this many ranges, and how much denser its middle is
OUTPUT, INPUT, PARAMETER, RATE = "output", "input", "parameter", "rate"
Shaped = tuple[str, str, Callable[..., Any], tuple["Number", ...]]      # word, label, law and shape numbers of a push


@dataclass(frozen=True)
class Number:
    """A shape number of a candidate, such as a level: its values at places from -ENDS to ENDS standard deviations from
    its prior's centre; a single value is fixed."""

    word: str
    values: tuple[float, ...]

    def at(self, place: float) -> float:
        """Return the number at a place."""
        return float(np.interp(place, np.linspace(-ENDS, ENDS, len(self.values)), self.values))


def scaled(word: str, centre: float, most: float = np.inf) -> Number:
    """Return a positive number that is known to a factor, and is at most so large."""
    return Number(word, tuple(np.minimum(centre * FACTOR**np.linspace(-ENDS, ENDS, GRID), most).tolist()))


def level(values: Float[Array, " m"], share: float) -> Number:
    """Return a level that about this share of the values is below."""
    places = np.linspace(-ENDS, ENDS, GRID) + norm.ppf(share)
    return Number("level", tuple(np.quantile(values, ndtr(places)).tolist()))


@dataclass(frozen=True, eq=False)
class Table:
    """A push on rate number `rate` (from the number of states on: on an input): a law of value `reads` and of shape
    numbers, which is tabled at the knots, times value `times` (-1: 1)."""

    rate: int
    reads: int
    times: int
    knots: Float[Array, " G"]
    law: Callable[..., Any]

    def at(self, numbers: Sequence[float]) -> tuple[Float[Array, " G"], Float[Array, " G"]]:
        """Return the table for shape numbers: knots, these among them, since a push may bend there, and the law."""
        more = [*numbers, *(0.5 * (self.knots[:2] + self.knots[1:3]))[len(numbers):]]
        knots = np.sort(np.concatenate([self.knots, more]))
        return knots, np.asarray(self.law(knots, *numbers), dtype=float)

    def drawn(self, values: Sequence[Float[Array, "..."]], numbers: Sequence[float]) -> Float[Array, "..."]:
        """Return the table along values."""
        return np.asarray(np.interp(values[self.reads], *self.at(numbers)))

    def of(self, values: Sequence[Float[Array, "..."]], numbers: Sequence[float]) -> Float[Array, "..."]:
        """Return the push of amplitude 1 along values."""
        return self.drawn(values, numbers) * (1.0 if self.times < 0 else values[self.times])


@dataclass(frozen=True)
class Along:
    """Weights of rows along a covariate: (value - middle) / width, a step at the middle, or a curve (knots, heights).
    """

    covariate: str
    middle: float
    width: float
    step: bool = False
    curve: tuple[tuple[float, ...], tuple[float, ...]] | None = None

    def weight(self, recording: Recording, covariates: dict[str, Float[Array, " R"]]) -> Float[Array, " R"]:
        values = covariates.get(self.covariate)
        if values is None:
            return np.zeros(len(recording.run))
        if self.curve is not None:
            return np.asarray(np.interp(values, *self.curve))
        return (values > self.middle) - 0.5 if self.step else (values - self.middle) / self.width


@dataclass(frozen=True, eq=False)
class Candidate:
    """slot: (kind, number of the parameter, output, input or effect). label: words. curve: of which it is one part.
    shape: numbers that are fitted besides the amplitude; usual_at: usual amplitudes with the last of them at TRIED."""

    name: str
    label: str
    unit: str
    usual: float
    stage: str
    slot: tuple[str, int]
    along: Along | None = None
    push: Table | None = None
    kind: str = "term"
    follows: str = ""
    curve: str = ""
    direction: str = ""
    shape: tuple[Number, ...] = ()
    usual_at: tuple[float, ...] = ()

    def numbers(self, places: Sequence[float] = ()) -> tuple[float, ...]:
        """Return the shape numbers at places; by default at their priors' centres."""
        return tuple(one.at(places[k] if len(places) else 0.0) for k, one in enumerate(self.shape))

    def fixed(self, places: Sequence[float]) -> "Candidate":
        """Return the candidate with its shape numbers fixed at places."""
        numbers = self.numbers(places)
        return replace(self, shape=tuple(Number(one.word, (at,)) for one, at in zip(self.shape, numbers, strict=True)))

    @property
    def column(self) -> Column:
        return Column(self.name, self.kind, self.stage, self.direction or f"{self.slot}", self.unit, self.usual,
                      ("is larger", "is smaller"), self.follows, curve=self.curve)


def covariates_of(recording: Recording, system: SystemSpec, names: Sequence[str], inputs: Sequence[str],
                  ) -> dict[str, Float[Array, " R"]]:
    """Return {covariate: values of the rows}: conditions, order of the runs, time of blocks, mean inputs."""
    found = {name: recording.conditions[:, k] for k, name in enumerate(names)}
    found["order of the runs"] = recording.run.astype(float)
    if np.ptp(recording.since_s) > 0.0:
        found["time in the run"] = recording.since_s
    count = recording.real.sum(1)
    for k, name in enumerate(inputs):
        found[f"mean {name}"] = np.where(recording.real, recording.inputs[:, :, k], 0.0).sum(1) / count
    return found


@dataclass(frozen=True, eq=False)
class Believed:
    """The believed simulation of a recording: values of states, inputs and conditions [R, T] each, rates [R, T, S]."""

    names: tuple[str, ...]
    values: list[Float[Array, "R T"]]
    rates: Float[Array, "R T S"]


def parameter_candidates(system: SystemSpec, values: dict[str, Float[Array, " R"]]) -> Iterator[Candidate]:
    """Every parameter along every covariate, and inside a run."""
    for k, (name, one) in enumerate(system.believed.items()):
        usual = USUAL_CHANGE if one.log else max(USUAL_CHANGE * abs(one.centre), 0.3 * one.sd)
        unit = "1" if one.log else "unit"
        yield Candidate(f"change of {name}", f"{name} changes", unit, usual, PARAMETER, ("parameter", k), kind="free")
        for covariate in covariates_among(values):
            along = Along(covariate.name, float(covariate.values.mean()), float(covariate.values.std()))
            word = _word(covariate.name)
            yield Candidate(f"{name}_with_{word}", f"{name} varies with {covariate.name}", unit, usual, PARAMETER,
                            ("parameter", k), along)
            if covariate.name == "order of the runs" and len(np.unique(covariate.values)) > 3:
                step = Along(covariate.name, float(np.median(covariate.values)), 1.0, step=True)
                yield Candidate(f"{name}_step", f"{name} changes between two runs, half-way", unit, usual, PARAMETER,
                                ("parameter", k), step)
        if system.rate is not None:
            yield Candidate(f"{name}_in_run", f"{name} drifts inside a run", unit, usual, PARAMETER, ("drift", k))


def signal_candidates(system: SystemSpec, recording: Recording, inputs: Sequence[str]) -> Iterator[Candidate]:
    """Scale, offset, delay and clips of every output and input."""
    delay = USUAL_DELAY * float(np.median(recording.step_s[recording.step_s > 0.0]))
    signals = [(OUTPUT, "out", k, name, recording.seen[:, :, k]) for k, name in enumerate(system.outputs)]
    signals += [(INPUT, "in", k, name, recording.inputs[:, :, k]) for k, name in enumerate(inputs)]
    for stage, side, k, name, seen in signals:
        known = seen[recording.real & np.isfinite(seen)]
        if not len(known) or np.ptp(known) <= 0.0:
            continue
        own: list[tuple[str, str, str, float, tuple[Number, ...]]] = [
            ("scale", f"{name} is scaled (gain)", "1", USUAL_SCALE, ()),
            ("offset", f"{name} has an offset (bias)", "unit", USUAL_OFFSET * float(np.ptp(known)), ()),
            ("delay", f"{name} is late (delay)", "s", delay, ()),
            ("clip_high", f"{name} is clipped above a level", "1", USUAL_CLIP, (level(known, HIGH),)),
            ("clip_low", f"{name} is clipped below a level", "1", USUAL_CLIP, (level(known, 1.0 - HIGH),))]
        for kind, label, unit, usual, shape in own:
            yield Candidate(f"{name}_{side}put_{kind}", label, unit, usual, stage, (f"{side}_{kind}", k), shape=shape)
        if side == "out":
            yield Candidate(f"offset of {name}", f"{name} is off", "unit", USUAL_OFFSET * float(np.ptp(known)), stage,
                            ("out_offset", k), kind="free")


def push_candidates(system: SystemSpec, recording: Recording, believed: Believed) -> Iterator[Candidate]:
    """Pushes by every state, input and condition: on every rate that is not itself a state, and beside every input.

    What a push beside an input, such as a friction beside a force, does to a rate depends on the run as the input's
    effect does, such as by its mass.
    """
    s, real, moving = len(system.state), recording.real, recording.inputs.shape[2]
    kinematic = _kinematic(believed, real, s)
    values = [one[real] for one in believed.values]
    varying = [j for j in range(len(values)) if np.ptp(values[j]) > 1e-9 * (1e-9 + np.abs(values[j]).max())]
    speeds = sorted(set(kinematic.values())) or [j for j in range(s) if _both_signs(values[j])]
    rates = [(i, USUAL_PUSH * float(np.sqrt(np.mean(believed.rates[:, :, i][real]**2)))) for i in range(s)
             if i not in kinematic]
    inputs = [(s + k, USUAL_PUSH * (float(np.sqrt(np.mean(values[s + k]**2))) or 1.0)) for k in range(moving)]
    for i, size in (*((i, size) for i, size in rates if size > 0.0), *inputs):
        target, rate = believed.names[i], i < s
        shapes: list[tuple[int, int, Shaped]] = [] if not rate else [
            (0, -1, ("constant", "a constant push", np.ones_like, ()))]
        for j in varying if rate else [j for j in varying if j < s]:
            shapes += [(j, -1, one) for one in _shapes(believed.names[j], values[j], j < s, rate and j in kinematic,
                                                       j in speeds, j < s + moving)]
        for j in speeds if rate else ():
            shapes += [(j, k, (f"{believed.names[k]}_sign_{believed.names[j]}", f"friction against {believed.names[j]} "
                               f"that grows with {believed.names[k]}", _sign, (_width(values[j]),)))
                       for k in range(s, len(values)) if np.ptp(values[k]) > 0.0]
        for j, times, (word, label, law, shape) in shapes:
            push = Table(i, j, times, _knots(values[j]), law)
            rms = [float(np.sqrt(np.mean(push.of(values, [*(one.at(0.0) for one in shape[:-1]), *(
                one.at(place) for one in shape[-1:])])**2))) for place in (TRIED if shape else TRIED[:1])]
            if rms[0] > 0.0:
                yield Candidate(f"{target}_{word}", f"{label}, {'on the rate of' if rate else 'beside'} {target}",
                                "unit", size / rms[0], RATE if rate else INPUT, ("push", 0), push=push,
                                direction=target, shape=shape,
                                usual_at=tuple(size / (one or rms[0]) for one in rms) if shape else ())
        if rate:
            for j in range(s + moving):
                yield from _curve(i, j, target, believed.names[j], values[j], size)
            yield Candidate(f"push on {target}", f"{target} is pushed", "unit", size, RATE, ("push", 0), kind="free",
                            push=Table(i, 0, -1, _knots(values[0]), np.ones_like), direction=target)


def _shapes(name: str, values: Float[Array, " m"], state: bool, position: bool, speed: bool,
            moving: bool) -> Iterator[Shaped]:
    """The pushes by one value."""
    yield f"prop_{name}", f"a push proportional to {name}", lambda v: v, ()
    if not moving:
        return
    if state:
        yield f"square_{name}", f"a push by {name} x |{name}|", lambda v: v * np.abs(v), ()
        yield f"cubic_{name}", f"a push by the cube of {name}", lambda v: v**3, ()
    if position:
        yield f"cos_{name}", f"a push by the cosine of {name}", np.cos, ()
        yield f"sin_{name}", f"a push by the sine of {name}", np.sin, ()
    if speed:
        width = _width(values)
        yield f"sign_{name}", f"a push by the sign of {name} (dry friction)", _sign, (width,)
        yield (f"stribeck_{name}", f"a push by the sign of {name} that fades with speed (Stribeck)",
               lambda v, width, slow: np.tanh(v / width) * np.exp(-np.abs(v) / slow),
               (width, scaled("fading speed", SLOW * float(np.ptp(values)), SLOWEST * float(np.ptp(values)))))
    if not state and _both_signs(values):
        yield (f"band_{name}", f"a dead band of {name}", lambda v, band: np.clip(v, -band, band),
               (scaled("band", BAND * float(np.ptp(values))),))
    yield (f"above_{name}", f"a push where {name} is above a level (overflow, end stop)",
           lambda v, at: np.maximum(v - at, 0.0), (level(values, HIGH),))
    yield (f"below_{name}", f"a push where {name} is below a level (end stop)",
           lambda v, at: np.minimum(v - at, 0.0), (level(values, 1.0 - HIGH),))


def _sign(v: Any, width: float) -> Any:
    return np.tanh(v / width)


def _width(values: Float[Array, " m"]) -> Number:
    return scaled("width", SMOOTH * float(np.ptp(values)))


def _curve(i: int, j: int, rate: str, name: str, values: Float[Array, " m"], size: float) -> Iterator[Candidate]:
    """The parts of a smooth push along one value."""
    low, high = np.percentile(values, [2.0, 98.0])
    if high <= low:
        return
    width = (high - low) / (BUMPS - 1)
    for k, middle in enumerate(np.linspace(low, high, BUMPS)):
        push = Table(i, j, -1, _knots(values), lambda v, middle=middle: np.exp(-0.5 * ((v - middle) / width)**2))
        yield Candidate(f"push on {rate} along {name} {k}", f"a push on {rate} along {name}", "unit", size, RATE,
                        ("push", 0), push=push, kind="free", follows=name, curve=f"push on {rate} along {name}",
                        direction=rate)


def effect_candidates(system: SystemSpec, usual: Sequence[float]) -> Iterator[Candidate]:
    """The user's own."""
    for k, one in enumerate(system.effects):
        yield Candidate(one.name, one.name.replace("_", " "), "unit", usual[k], RATE, ("effect", k),
                        direction=one.name)


def _knots(values: Float[Array, " m"]) -> Float[Array, " G"]:
    """Knots of a table, denser in its middle."""
    low, high = float(values.min()), float(values.max())
    middle = 0.0 if low < 0.0 < high else 0.5 * (low + high)
    side = np.sinh(np.linspace(-DENSE, DENSE, KNOTS)) / np.sinh(DENSE)
    return np.asarray(middle + BEYOND * max(high - low, 1e-12) * side)


def _kinematic(believed: Believed, real: Array, s: int) -> dict[int, int]:
    """{state: the state that is its rate}."""
    found = {}
    for i in range(s):
        for j in range(s):
            rate, value = believed.rates[:, :, i][real], believed.values[j][real]
            if i != j and np.abs(rate - value).max() <= 1e-9 * (1e-9 + np.abs(value).max()):
                found[i] = j
    return found


def _both_signs(values: Float[Array, " m"]) -> bool:
    return bool(values.min() < -0.05 * np.ptp(values) and values.max() > 0.05 * np.ptp(values))


def _word(name: str) -> str:
    return name.replace(" ", "_")
