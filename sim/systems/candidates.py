"""The effects that a simulator may lack, generated from its states, inputs, outputs, parameters and conditions.

Each candidate is an amplitude on one slot of the simulator (a parameter, a push on a rate, a distortion of an input or
output), in some rows more than in others if it goes along a covariate. The usual size of a push is a tenth of the rms
of the believed rate.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float

from truearc.sim.discover.detect.covariates import Covariate, Factor, varies
from truearc.sim.infer.likelihood.score_table import Array, Column
from truearc.sim.systems.system import Recording, SystemSpec

USUAL_PUSH = 0.1                      # of the rms of the believed rate (the design)
# Chosen: instruments are calibrated to a few per cent; a clip cuts half of what is beyond
USUAL_CHANGE, USUAL_SCALE, USUAL_OFFSET, USUAL_CLIP = 0.1, 0.05, 0.03, 0.5
USUAL_DELAY = 2.0                     # median time steps; chosen
SMOOTH = 0.01                         # of a speed's range over which a sign is smoothed (the design)
SLOW = 0.1                            # of a speed's range within which Stribeck friction fades; chosen
HIGH, LOW = 85.0, 15.0                # percentiles of the levels above and below which a push begins; chosen
BAND = 0.2                            # of an input's range in a dead band; chosen
BUMPS = 6                             # shapes of a smooth curve; chosen: two bends within the range
KNOTS, BEYOND, DENSE = 257, 3.0, 5.0  # of a table, which reaches this many ranges, and how much denser its middle is
OUTPUT, INPUT, PARAMETER, RATE = "output", "input", "parameter", "rate"


@dataclass(frozen=True, eq=False)
class Table:
    """A push on rate number `rate` (from the number of states on: on an input): a table over value `reads`, times value
    `times` (-1: 1)."""

    rate: int
    reads: int
    times: int
    knots: Float[Array, " G"]
    table: Float[Array, " G"]

    def of(self, values: Sequence[Float[Array, "..."]]) -> Float[Array, "..."]:
        """Return the push of amplitude 1 along values."""
        found = self.drawn(values)
        return found if self.times < 0 else found * values[self.times]

    def drawn(self, values: Sequence[Float[Array, "..."]]) -> Float[Array, "..."]:
        """Return the table along values."""
        return np.asarray(np.interp(values[self.reads], self.knots, self.table))


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
    """slot: (kind, number of the parameter, output, input or effect). label: words. curve: of which it is one shape."""

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
    level: float = field(default=np.nan)

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


def engine_covariates(values: dict[str, Float[Array, " R"]]) -> tuple[Covariate, ...]:
    """Return the covariates that vary; those that vary alike are one with several names."""
    found: list[Covariate] = []
    for name, one in values.items():
        if not varies(one):
            continue
        twin = next((k for k, other in enumerate(found) if abs(np.corrcoef(other.values, one)[0, 1]) >= 0.98), None)
        if twin is None:
            found.append(Covariate(((name, one),)))
        else:
            found[twin] = Covariate((*found[twin].columns, (name, one)))
    return tuple(found)


def factors_of(session: Array | None, recording: Recording) -> tuple[Factor, ...]:
    """Return the sessions of the rows, if there are two to twenty."""
    if session is None:
        return ()
    texts = np.array([str(session[place[0]]) for place in recording.place])
    levels = tuple(sorted(set(texts.tolist())))
    return (Factor("session", levels, np.searchsorted(levels, texts)),) if 2 <= len(levels) <= 20 else ()


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
        for covariate in engine_covariates(values):
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
        low, high = np.percentile(known, [LOW, HIGH])
        own = [("scale", f"{name} is scaled (gain)", "1", USUAL_SCALE, np.nan),
               ("offset", f"{name} has an offset (bias)", "unit", USUAL_OFFSET * np.ptp(known), np.nan),
               ("delay", f"{name} is late (delay)", "s", delay, np.nan),
               ("clip_high", f"{name} is clipped above {high:.3g}", "1", USUAL_CLIP, float(high)),
               ("clip_low", f"{name} is clipped below {low:.3g}", "1", USUAL_CLIP, float(low))]
        for kind, label, unit, usual, level in own:
            yield Candidate(f"{name}_{side}put_{kind}", label, unit, float(usual), stage, (f"{side}_{kind}", k),
                            level=level)
        if side == "out":
            yield Candidate(f"offset of {name}", f"{name} is off", "unit", USUAL_OFFSET * float(np.ptp(known)), stage,
                            ("out_offset", k), kind="free")


def push_candidates(system: SystemSpec, recording: Recording, believed: Believed) -> Iterator[Candidate]:
    """Pushes on every rate that is not itself a state, by every state, input and condition."""
    s, real = len(system.state), recording.real
    kinematic = _kinematic(believed, real, s)
    speeds = sorted(set(kinematic.values())) or [j for j in range(s) if _both_signs(believed.values[j][real])]
    for i in (k for k in range(s) if k not in kinematic):
        size = USUAL_PUSH * float(np.sqrt(np.mean(believed.rates[:, :, i][real]**2)))
        if not size > 0.0:
            continue
        shapes = [(0, -1, "constant", "a constant push", np.ones_like)]
        for j, name in enumerate(believed.names):
            values = believed.values[j][real]
            if np.ptp(values) <= 1e-9 * (1e-9 + np.abs(values).max()):
                continue
            shapes += [(j, -1, *one) for one in _shapes(name, values, j < s, j in kinematic, j in speeds,
                                                        len(recording.inputs[0, 0]) + s > j)]
        shapes += _by_load(believed, real, speeds, s)
        rate = system.state[i]
        for j, times, word, label, law in shapes:
            table = _table(i, j, times, believed.values[j][real], law)
            rms = float(np.sqrt(np.mean(table.of(believed.values)[real]**2)))
            if rms > 0.0:
                yield Candidate(f"{rate}_{word}", f"{label}, on the rate of {rate}", "unit", size / rms, RATE,
                                ("push", 0), push=table, direction=rate)
        for j, name in enumerate(believed.names[:s + recording.inputs.shape[2]]):
            yield from _curve(i, j, rate, name, believed.values[j][real], size)
        yield Candidate(f"push on {rate}", f"{rate} is pushed", "unit", size, RATE, ("push", 0),
                        push=_table(i, 0, -1, believed.values[0][real], np.ones_like), kind="free", direction=rate)
    yield from _through_inputs(believed, recording, s)


def _through_inputs(believed: Believed, recording: Recording, s: int) -> Iterator[Candidate]:
    """Pushes by each state that come in where an input does: a friction or spring force beside a force. What they do to
    a rate depends on the run as the input's effect does, such as by its mass."""
    real = recording.real
    for k in range(recording.inputs.shape[2]):
        name, drive = believed.names[s + k], believed.values[s + k][real]
        size = USUAL_PUSH * (float(np.sqrt(np.mean(drive**2))) or 1.0)
        for j in range(s):
            values = believed.values[j][real]
            if np.ptp(values) <= 1e-9 * (1e-9 + np.abs(values).max()):
                continue
            shapes = [one for one in _shapes(believed.names[j], values, True, False, _both_signs(values), True)
                      if not one[0].startswith(("above", "below"))]
            for word, label, law in shapes:
                table = _table(s + k, j, -1, values, law)
                rms = float(np.sqrt(np.mean(table.of(believed.values)[real]**2)))
                if rms > 0.0:
                    yield Candidate(f"{name}_{word}", f"{label}, beside {name}", "unit", size / rms, INPUT, ("push", 0),
                                    push=table, direction=name)


def _by_load(believed: Believed, real: Array, speeds: Sequence[int],
             s: int) -> Iterator[tuple[int, int, str, str, Any]]:
    """The sign of a speed times an input or condition."""
    for j in speeds:
        scale = SMOOTH * np.ptp(believed.values[j][real])
        for load in range(s, len(believed.names)):
            if np.ptp(believed.values[load][real]) > 0.0:
                name, speed = believed.names[load], believed.names[j]
                yield (j, load, f"{name}_sign_{speed}", f"friction against {speed} that grows with {name}",
                       lambda v, scale=scale: np.tanh(v / scale))


def _shapes(name: str, values: Float[Array, " m"], state: bool, position: bool, speed: bool,
            moving: bool) -> Iterator[tuple[str, str, Any]]:
    """(word, label, law) of the pushes by one value."""
    reach = float(np.ptp(values))
    yield f"prop_{name}", f"a push proportional to {name}", lambda v: v
    if not moving:
        return
    low, high = np.percentile(values, [LOW, HIGH])
    if state:
        yield f"square_{name}", f"a push by {name} x |{name}|", lambda v: v * np.abs(v)
    if position:
        yield f"cos_{name}", f"a push by the cosine of {name}", np.cos
        yield f"sin_{name}", f"a push by the sine of {name}", np.sin
    if state:
        yield f"cubic_{name}", f"a push by the cube of {name}", lambda v: v**3
    if speed:
        yield (f"sign_{name}", f"a push by the sign of {name} (dry friction)",
               lambda v: np.tanh(v / (SMOOTH * reach)))
        yield (f"stribeck_{name}", f"a push by the sign of {name} that fades with speed (Stribeck)",
               lambda v: np.tanh(v / (SMOOTH * reach)) * np.exp(-np.abs(v) / (SLOW * reach)))
    if not state and _both_signs(values):
        yield f"band_{name}", f"a dead band of {name}", lambda v: np.clip(v, -BAND * reach, BAND * reach)
    yield (f"above_{name}", f"a push where {name} is above {high:.3g} (overflow, end stop)",
           lambda v: np.maximum(v - high, 0.0))
    yield (f"below_{name}", f"a push where {name} is below {low:.3g} (end stop)", lambda v: np.minimum(v - low, 0.0))


def _curve(i: int, j: int, rate: str, name: str, values: Float[Array, " m"], size: float) -> Iterator[Candidate]:
    """The shapes of a smooth push along one value."""
    low, high = np.percentile(values, [2.0, 98.0])
    if high <= low:
        return
    width = (high - low) / (BUMPS - 1)
    for k, middle in enumerate(np.linspace(low, high, BUMPS)):
        push = _table(i, j, -1, values, lambda v, middle=middle: np.exp(-0.5 * ((v - middle) / width)**2))
        yield Candidate(f"push on {rate} along {name} {k}", f"a push on {rate} along {name}", "unit", size, RATE,
                        ("push", 0), push=push, kind="free", follows=name, curve=f"push on {rate} along {name}",
                        direction=rate)


def effect_candidates(system: SystemSpec, usual: Sequence[float]) -> Iterator[Candidate]:
    """The user's own."""
    for k, one in enumerate(system.effects):
        yield Candidate(one.name, one.name.replace("_", " "), "unit", usual[k], RATE, ("effect", k),
                        direction=one.name)


def _table(rate: int, reads: int, times: int, values: Float[Array, " m"], law: Any) -> Table:
    low, high = float(values.min()), float(values.max())
    reach, middle = max(high - low, 1e-12), 0.0 if low < 0.0 < high else 0.5 * (low + high)
    side = np.sinh(np.linspace(-DENSE, DENSE, KNOTS)) / np.sinh(DENSE)
    knots = middle + BEYOND * reach * side
    return Table(rate, reads, times, knots, np.asarray(law(knots), dtype=float))


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
