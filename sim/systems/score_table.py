"""A system as the model of a fit: its columns, and the table of scores of its runs; System is simulated by it.

Each row (a run, or a block of one) has a start of its own, integrated out where it is likeliest. The noise of an output
is white plus a first-order autoregression (Kalman 1960, for the two together), whose time constant is at most a tenth
of the longest row: a slower one would swallow missing physics.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from truearc.errors import InputError
from truearc.sim.infer.launcher import CREDIBLE_SD
from truearc.sim.infer.likelihood.score_table import Array, Column, ScoreTable, make_evidence
from truearc.sim.infer.model import Carrying, Shapes
from truearc.sim.systems import candidates as what
from truearc.sim.systems.candidates import Candidate
from truearc.sim.systems.flight import CLOSE, MOST_SUBSTEPS, NO_PUSHES, Stepper
from truearc.sim.systems.noise import Gains, noise_gains, whiten
from truearc.sim.systems.sensitivity import STEPS, Entry, Flights, Flown, SystemLayout, SystemPoint, SystemShape
from truearc.sim.systems.system import Recording, Runs, SystemSpec, record

SLOWEST = 0.1                         # of the longest row: the noise's time constant at most (the design)
# Chosen: the logs of a noise's sizes are known to a factor of three, its time constant to two
SIZE_SD, TIME_SD = 1.1, 0.7
USUAL_SLOW = 0.3                      # of white noise: the autoregression's usual size; chosen
LEAST = 1e-3                          # of white noise, that an autoregression counts as
DIFFERENCE = 1e-3                     # of a log, by which noise is moved for a slope
START = 3.0                           # noise standard deviations within which a run starts at its first sample; chosen
NOTHING = 1e-6                        # information at a prior's standard deviation, below which nothing depends on it
NOISE = ("", " slow", " time")
PIECES = 10                           # of a row, whose signs a test flips: as long as the slowest noise fades in


@dataclass(frozen=True, eq=False)
class SystemModel(Flights):
    """Rows of a system, and the columns that are fitted to and tested on them (truearc.sim.infer.model.Tested).

    members: names that the runs cannot tell from a candidate, by its name.
    """

    first_noise: Float[Array, "O 3"]
    labels: Mapping[str, Candidate]
    sessions: Mapping[str, Sequence[str]]
    members: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    sampled: bool = True
    has_one_top: bool = True

    @staticmethod
    def of(system: SystemSpec, runs: Runs, rows: int = 0, testing: bool = True, blind: bool = False) -> "SystemModel":
        """Lay out a system's runs.

        rows: wanted, by cutting few runs into blocks; 0: as a test needs. testing: whether candidates are generated.
        blind: the outputs need not be recorded.

        Raises:
            InputError: bad data, or a simulator that fails, ignores a parameter, or returns what was not asked for.
        """
        recording = record(system, runs, rows, blind) if rows else record(system, runs, blind=blind)
        names = (*runs.inputs, *runs.conditions)
        system.compiled["names"] = names
        sessions = {} if runs.session is None else {"session": [
            str(runs.columns[runs.session][place[0]]) for place in recording.place]}
        begin, begin_sd = starts_of(system, recording)
        shared = [Candidate(name, name, "1" if one.log else "unit", one.sd, what.PARAMETER, ("parameter", k))
                  for k, (name, one) in enumerate(system.believed.items())]
        noise = first_noise(system, recording)
        empty = SystemLayout((), np.zeros(0, dtype=int), np.zeros((0, 0)), np.zeros(0))
        bare = SystemModel(system, recording, (), (), empty, begin, begin_sd, 1, names, np.zeros((0, 2)), noise, {},
                           sessions)
        found = [one for one, _ in system.found]
        bare = bare._laid_out(shared, found, [])
        bare = replace(bare, substeps=bare._enough_steps())
        if blind and not np.isfinite(recording.seen).any():
            seen = np.where(recording.real[:, :, None], bare.flights(bare.starts()[0]), np.nan)
            bare = replace(bare, recording=replace(recording, seen=seen))
        bare._check()
        if not testing:
            return bare
        return bare._laid_out(shared, found, [one for one in bare._candidates(runs.inputs) if one.name not in {
            other.name for other in found}])

    def _candidates(self, inputs: Sequence[str]) -> list[Candidate]:
        system, recording = self.system, self.recording
        found = [*what.parameter_candidates(system, self.covariates),
                 *what.signal_candidates(system, recording, inputs)]
        if system.rate is None:
            return found
        states = self._states(self.starts()[0])[0]
        values = self.sources(states)
        stepper = self._stepper(())
        flat = [one.reshape(-1) for one in values]
        s = states.shape[2]
        p = np.array([one.centre for one in system.believed.values()])
        params = np.repeat(p[:, None], len(flat[0]), axis=1)

        def rates(own: Any, at: Stepper) -> Array:
            many = at.rates(np, np.stack(flat[:s]), flat[s:], params, np.zeros(s), np.zeros(0), own, NO_PUSHES)
            return np.asarray(many).T.reshape(*recording.real.shape, s)

        with np.errstate(all="ignore"):
            try:
                believed = what.Believed(tuple([*system.state, *self.names]), values, rates((), stepper))
            except (TypeError, ValueError):
                believed = what.Believed(tuple([*system.state, *self.names]), values,
                                         np.gradient(states, axis=1) / np.median(recording.step_s))
        found += what.push_candidates(system, recording, believed)
        usual = []
        for one in system.effects:
            size = rates((1.0,), replace(stepper, own=(one,))) - believed.rates
            real = recording.real
            ratio = [np.sqrt(np.mean(believed.rates[:, :, k][real]**2) / np.mean(size[:, :, k][real]**2))
                     for k in range(s) if np.mean(size[:, :, k][real]**2) > 0.0]
            usual.append(one.usual or what.USUAL_PUSH * float(min(ratio, default=1.0)))
        return [*found, *what.effect_candidates(system, usual)]

    @cached_property
    def covariates(self) -> dict[str, Float[Array, " R"]]:
        """{covariate: values of the rows}."""
        moving = self.recording.inputs.shape[2]
        return what.covariates_of(self.recording, self.system, self.names[moving:], self.names[:moving])

    def _laid_out(self, shared: Sequence[Candidate], found: Sequence[Candidate],
                  tested: Sequence[Candidate]) -> "SystemModel":
        """The model with these columns: free ones, terms, then shared ones, effects found before, and the noise."""
        every = [*sorted(tested, key=lambda one: one.kind == "term"), *shared, *found]
        slots: dict[Any, int] = {}
        first: list[Candidate] = []
        entries = []
        for one in every:
            key = (one.slot, one.shape, one.push if one.push is None else id(one.push))
            number = slots.setdefault(key, len(slots))
            first += [one] if number == len(first) else []
            weight = (np.ones(len(self.recording.run)) if one.along is None
                      else one.along.weight(self.recording, self.covariates))
            column = one.column if one in tested else replace(one.column, kind="shared")
            entries.append(Entry(column, number, weight))
        priors = [*self.system.believed.values(), *(prior for _, prior in self.system.found)]
        columns, source = [one.column for one in entries], list(range(len(entries)))
        centre, sd = [one.place for one in priors], [one.sd for one in priors]
        for o, (name, stated) in enumerate(self.system.outputs.items()):
            for k in range(1 if stated is not None else 0, 3):
                columns.append(Column(f"scatter.{name}{NOISE[k]}", "shared", what.OUTPUT, "", "1", SIZE_SD))
                source.append(-1 - 3 * o - k)
                centre.append(float(self.first_noise[o, k]))
                sd.append(TIME_SD if k == 2 else SIZE_SD)
        layout = SystemLayout(tuple(columns), np.array(source), np.diag(np.array(sd)**-2.0), np.array(centre))
        return replace(self, slots=tuple(first), entries=tuple(entries), layout=layout,
                       labels={one.name: one for one in every}, places=np.zeros((len(first), 2)))

    def placed(self, place: float) -> Float[Array, "V 2"]:
        """Return the last free shape number of each slot at a place, the others at their centres."""
        found = np.zeros((len(self.slots), 2))
        for k, one in enumerate(self.slots):
            if one.shape and len(one.shape[-1].values) > 1:
                found[k, len(one.shape) - 1] = place
        return found

    def with_places(self, places: Float[Array, "V 2"], usual: Mapping[str, float]) -> "SystemModel":
        """Return the model with shape numbers looked for there, where effects of the columns have these usual sizes."""
        columns = tuple(replace(one, usual=usual.get(one.name, one.usual)) for one in self.layout.columns)
        return replace(self, places=places, layout=replace(self.layout, columns=columns))

    def reweighted(self) -> "SystemModel":
        """Return the model with the weights of rows as its recording now has them."""
        entries = [one if (candidate := self.labels.get(one.column.name)) is None or candidate.along is None else
                   replace(one, weight=candidate.along.weight(self.recording, self.covariates)) for one in self.entries]
        return replace(self, entries=tuple(entries))

    def _enough_steps(self) -> int:
        """Substeps of a sample by which flights agree with those of half the step."""
        if self.system.rate is None:
            return 1
        count, point = 1, self.starts()[0]
        spread = np.array([_spread(self.recording.seen[:, :, k]) for k in range(len(self.first_noise))])
        scale = np.maximum(np.exp(self.first_noise[:, 0]), 1e-3 * spread)
        before = replace(self, substeps=1).flights(point)
        while count < MOST_SUBSTEPS:
            after = replace(self, substeps=2 * count).flights(point)
            if (np.abs(after - before)[self.recording.real] <= CLOSE * scale).all():
                return count
            count, before = 2 * count, after
        return count

    def _check(self) -> None:
        """InputError for a simulator that fails at the believed numbers, or ignores one of them."""
        system, point = self.system, self.starts()[0]
        if system.rate is not None:
            states = self._states(point)[0]
            wrong = ~np.isfinite(states) & self.recording.real[:, :, None]
            if wrong.any():
                row, n, k = np.argwhere(wrong)[0].tolist()
                k = self._failing(row, max(n - 1, 0), states, k)
                near = ", ".join(f"{name} {states[row, max(n - 1, 0), j]:.4g}" for j, name in enumerate(system.state))
                raise InputError(f"rate: returned a number that is not finite for {system.state[k]} in run "
                                 f"{self.recording.labels[row]} at t {self.recording.time_s[row, max(n - 1, 0)]:g} s, "
                                 f"with the parameters as believed and {near}")
        elif not np.isfinite(self._program(point, self.slot_values(point))[self.recording.real]).all():
            raise InputError("simulate: returned a number that is not finite, with the parameters as believed")
        table = self.linearise(point)[0]
        for k, (name, one) in enumerate(system.believed.items()):
            if table.information[k, k] * one.sd**2 < NOTHING:
                raise InputError(f"believed: {name} changes nothing that is observed; leave it out, or observe "
                                 "something that it moves")

    # --- the protocol of a fit

    def linearise(self, point: SystemPoint, flown: Flown | None = None,
                  pieces: int = 1) -> tuple[ScoreTable, SystemPoint]:
        """pieces: rows of the table that each row of the recording is cut into; they still have one start."""
        flown = self.fly(point) if flown is None else flown
        recording, columns = self.recording, self.layout.columns
        rows, samples, outputs = recording.seen.shape
        moved = (self.slot_values(point) - self.slot_values(flown.at))[:, flown.slots]
        off = recording.seen - flown.seen - np.einsum("rtok,rk->rto", flown.slopes, moved)
        off += np.einsum("rtos,rs->rto", flown.by_start, flown.at.start)
        known = np.isfinite(off)
        off = np.where(known, off, 0.0)
        gains = noise_gains(point.noise, recording.step_s, known)
        parts = np.concatenate([flown.slopes, flown.by_start, off[..., None]], axis=3)
        white = whiten(np.where(known[..., None], parts, 0.0), *gains).reshape(rows, samples * outputs, -1)
        k, s = len(flown.slots), flown.by_start.shape[3]
        by_start = white[:, :, k:k + s]
        lift = np.swapaxes(by_start, 1, 2) @ white
        inner = np.eye(s) + lift[:, :, k:k + s]
        lift = np.linalg.solve(inner, lift)
        start = lift[:, :, -1]
        # What is left at the likeliest start; the start's prior is as further samples, which belong to the first piece
        white = np.concatenate([lift, white - by_start @ lift], axis=1)
        piece = np.zeros(white.shape[:2], dtype=int)
        piece[:, s:] = np.repeat(self._pieces(pieces), outputs, axis=1)
        left = np.stack([np.swapaxes(part, 1, 2) @ part for part in (
            np.where((piece == number)[:, :, None], white, 0.0) if pieces > 1 else white for number in range(pieces))],
            axis=1).reshape(rows * pieces, white.shape[2], -1)
        own = np.flatnonzero(self.layout.source >= 0)
        entries = [self.entries[n] for n in self.layout.source[own]]
        place = [flown.slots.index(one.slot) for one in entries]
        weight = np.stack([one.weight for one in entries], axis=1) if entries else np.zeros((rows, 0))
        weight = np.repeat(weight, pieces, axis=0)
        linear, bend = np.zeros((rows, len(columns))), np.zeros((rows, len(columns), len(columns)))
        log = -0.5 * (np.einsum("rnn->r", left[:, -1:, -1:]).reshape(rows, pieces).sum(1)
                      + np.linalg.slogdet(inner)[1] + _log_volume(gains, known))
        self._by_noise(point, off - np.einsum("rtos,rs->rto", flown.by_start, start), known, linear, bend)
        linear, bend, log = (np.repeat(one, pieces, axis=0) / pieces for one in (linear, bend, log))
        linear[:, own] = left[:, place, -1] * weight
        both = weight[:, :, None] * weight[:, None, :]
        bend[np.ix_(np.arange(len(left)), own, own)] = left[:, place][:, :, place] * both
        layout, p = self.layout, self.layout.first_shared
        at = np.array([point.values[n] if n >= 0 else point.noise.ravel()[-1 - n] for n in layout.source])
        pull = layout.precision @ (layout.centre - at[p:])
        table = make_evidence(np.arange(len(left)), columns, at, linear, bend, None, layout.precision, pull, log)
        return table, replace(point, start=start)

    def _pieces(self, count: int) -> Int[Array, "R T"]:
        """The piece that each sample belongs to."""
        real = self.recording.real
        return np.asarray(np.minimum(np.arange(real.shape[1]) * count // real.sum(1, keepdims=True), count - 1))

    def _by_noise(self, point: SystemPoint, off: Float[Array, "R T O"], known: Bool[Array, "R T O"],
                  linear: Array, bend: Array) -> None:
        """Fill in slopes and information of the noise's logs, by differences."""
        places = [(k, *divmod(-1 - n, 3)) for k, n in enumerate(self.layout.source) if n < 0]
        by: dict[int, tuple[Array, Array]] = {}
        for column, o, number in places:
            ends = []
            for sign in (1.0, -1.0):
                noise = point.noise[[o]].copy()
                noise[0, number] += sign * DIFFERENCE
                one = known[:, :, [o]]
                gain, variance, fade = noise_gains(noise, self.recording.step_s, one)
                white = whiten(np.where(one, off[:, :, [o]], 0.0)[..., None], gain, variance, fade)[..., 0, 0]
                ends.append((white, np.where(one[..., 0], np.log(variance[..., 0]), 0.0)))
            w, logs = ((ends[0][k] - ends[1][k]) / (2.0 * DIFFERENCE) for k in range(2))
            middle = 0.5 * (ends[0][0] + ends[1][0])
            linear[:, column] = -(middle * w).sum(1) - 0.5 * logs.sum(1)
            by[column] = w, logs
        for a, oa, _ in places:
            for b, ob, _ in places:
                if oa == ob:
                    bend[:, a, b] = (by[a][0] * by[b][0] + 0.5 * by[a][1] * by[b][1]).sum(1)

    def forecast(self, point: SystemPoint) -> ScoreTable:
        return self.linearise(replace(point, start=np.zeros_like(point.start)))[0]

    def about(self, point: SystemPoint) -> SystemPoint:
        return self.linearise(point)[1]

    def moved(self, point: SystemPoint, change: Float[Array, " P"]) -> SystemPoint:
        values, noise, source = point.values.copy(), point.noise.ravel().copy(), self.layout.source
        values[source[source >= 0]] += change[source >= 0]
        noise[-1 - source[source < 0]] += np.clip(change[source < 0], -1.0, 1.0)
        return replace(point, values=values, noise=np.clip(noise.reshape(point.noise.shape), *self.noise_ends))

    @cached_property
    def noise_ends(self) -> tuple[Float[Array, "O 3"], Float[Array, "O 3"]]:
        """Lowest and highest logs of the noise."""
        longest = float((self.recording.time_s - self.recording.time_s[:, [0]]).max())
        step = float(np.median(self.recording.step_s[self.recording.step_s > 0.0]))
        low, high = self.first_noise - 8.0, self.first_noise + 12.0
        low[:, 1] = self.first_noise[:, 0] + np.log(LEAST)
        low[:, 2], high[:, 2] = np.log(0.5 * step), np.log(max(SLOWEST * longest, step))
        return low, high

    def leads_out(self, point: SystemPoint, step: Float[Array, " P"]) -> Bool[Array, " P"]:
        out, own = np.full(len(step), False), self.layout.source < 0
        now, low, high = (one.ravel()[-1 - self.layout.source[own]] for one in (point.noise, *self.noise_ends))
        out[own] = (now <= low) & (step[own] < 0.0) | (now >= high) & (step[own] > 0.0)
        return out

    def is_lost(self, point: SystemPoint) -> bool:
        return False

    def starts(self) -> tuple[SystemPoint, ...]:
        """Return the priors' centres."""
        layout, values = self.layout, np.zeros(len(self.entries))
        own = layout.source[layout.first_shared:]
        values[own[own >= 0]] = layout.centre[own >= 0]
        return (SystemPoint(values, self.first_noise.copy(), np.zeros_like(self.begin),
                            self.places),)

    def easier(self) -> Iterable["SystemModel"]:
        return ()

    def afar(self, change: Float[Array, " P"]) -> tuple[SystemPoint, Iterable["SystemModel"]]:
        return self.moved(self.starts()[0], change), ()

    def shapes(self, names: tuple[str, ...]) -> list[SystemShape]:
        slots = {self.entries[k].column.name: self.entries[k].slot for k in self.layout.source if k >= 0}
        return [SystemShape(slots[name], k, step) for step in STEPS for name in names
                for k, one in enumerate(self.slots[slots[name]].shape) if len(one.values) > 1]

    def shared_only(self, names: Iterable[str] = ()) -> "SystemModel":
        return self._sharing({*names}, tested=False)

    def sharing(self, names: tuple[str, ...]) -> "SystemModel":
        return self._sharing({*names}, tested=True)

    def _sharing(self, names: set[str], tested: bool) -> "SystemModel":
        """The model with tested columns of these names among the shared ones, the first of them, the rest tested or
        not."""
        layout, first = self.layout, self.layout.first_shared
        promoted = [k for k in range(first) if layout.columns[k].name in names]
        left = [k for k in range(first) if tested and k not in promoted]
        columns = [*(layout.columns[k] for k in left), *(replace(layout.columns[k], kind="shared") for k in promoted),
                   *layout.columns[first:]]
        source = np.concatenate([layout.source[[*left, *promoted]], layout.source[first:]]).astype(int)
        precision = np.zeros((len(promoted) + len(layout.centre),) * 2)
        precision[len(promoted):, len(promoted):] = layout.precision
        for k, column in enumerate(promoted):
            precision[k, k] = layout.columns[column].usual**-2.0
        centre = np.concatenate([np.zeros(len(promoted)), layout.centre])
        return replace(self, layout=SystemLayout(tuple(columns), source, precision, centre))

    # --- what discovery asks

    def range_of(self, name: str) -> tuple[float, float]:
        return -np.inf, np.inf

    def law_of(self, name: str) -> tuple[float | None, float]:
        return None, 0.5

    def is_natural(self, name: str, amplitude: float) -> bool:
        return True

    def label_of(self, name: str) -> str:
        """Return the words of a candidate, and of those that the runs cannot tell from it."""
        one = self.labels.get(name)
        words = name if one is None else one.label
        return words + "".join(f"; or {self.labels[other].label}" for other in self.members.get(name, ()))

    def shape_of(self, name: str, point: SystemPoint) -> str:
        """Return the shape numbers of a candidate in words."""
        return "".join(f", {self.slots[one.slot].shape[one.number].word} "
                       f"{self.numbers(point, one.slot)[one.number]:.3g}" for one in self.shapes((name,))
                       if one.step == STEPS[0])

    def describe(self, name: str) -> tuple[str, str] | None:
        one = self.labels.get(name)
        return None if one is None else ("its size", "1" if one.unit == "unit" else one.unit)

    def stopped(self, scores: ScoreTable) -> dict[str, float]:
        return {}

    def strange(self, scores: ScoreTable, beside: Iterable[str], trackers: bool) -> dict[str, float]:
        """Return parameters more than CREDIBLE_SD standard deviations of the prior from its centre."""
        beside, first = {*beside}, scores.first_shared
        sd = np.diag(self.layout.precision)**-0.5
        return {column.name: self.shown(column.name, float(at))
                for column, at, centre, own in zip(scores.columns[first:], scores.point[first:], self.layout.centre, sd,
                                                   strict=True)
                if column.name in self.system.believed and column.name not in beside
                and abs(at - centre) > CREDIBLE_SD * own}

    def shown(self, name: str, place: float) -> float:
        """Return a shared column's number in its own unit."""
        if name.startswith("scatter."):
            return float(np.exp(place))
        one = self.system.believed.get(name)
        return place if one is None else float(one.value(place))

    def exchanged(self, name: str, best: Any, point: SystemPoint, start: SystemPoint) -> SystemPoint:
        values, places, own = point.values.copy(), point.places.copy(), best.layout.source[0]
        slot = self.entries[own].slot
        values[own], places[slot] = start.values[own], start.places[slot]
        return replace(point, values=values, places=places)

    def carrying(self, point: SystemPoint, lost: bool, part: Shapes) -> "Carrying[SystemModel] | None":
        """Return the model with an unexplained change, which starts from zero."""
        entries, columns = list(self.entries), []
        for k, column in enumerate(part.columns):
            if self.layout.source[column] < 0:
                return None
            of = self.entries[self.layout.source[column]]
            columns.append(replace(of.column, name=f"curve.{k}", usual=float(part.sd[k])))
            entries.append(Entry(columns[-1], of.slot, of.weight * part.shapes[:, k]))
        layout, first = self.layout, self.layout.first_shared
        new = np.arange(len(self.entries), len(entries))
        tested = SystemLayout((*columns, *layout.columns[first:]),
                              np.concatenate([new, layout.source[first:]]).astype(int), layout.precision, layout.centre)
        model = replace(self, entries=tuple(entries), layout=tested)
        begin = replace(point, values=np.concatenate([point.values, np.zeros(len(new))]))
        return Carrying(model.shared_only(column.name for column in columns), [begin])


class System(SystemSpec):
    __doc__ = SystemSpec.__doc__

    def simulate(self, runs: Runs) -> dict[str, Float[Array, " rows"]]:
        """Simulate each run with the parameters as believed, from its first sample.

        Returns:
            {output: values}, in the order of the rows of `runs`.
        """
        model = SystemModel.of(self, runs, rows=1, testing=False)
        seen, recording = model.flights(model.starts()[0]), model.recording
        found = {name: np.full(runs.rows, np.nan) for name in self.outputs}
        for row in range(len(recording.run)):
            there = recording.real[row]
            for k, name in enumerate(self.outputs):
                found[name][recording.place[row][there]] = seen[row, there, k]
        return found


def starts_of(system: SystemSpec, recording: Recording) -> tuple[Float[Array, "R S"], Float[Array, "R S"]]:
    """Return believed starts and their standard deviations: the first sample where it is observed, else `start`.

    Raises:
        InputError: neither is given for a state.
    """
    names, outputs = system.starts, list(system.outputs)
    begin, sd = np.zeros((len(recording.run), len(names))), np.zeros((len(recording.run), len(names)))
    for k, name in enumerate(names):
        if name in system.start:
            begin[:, k], sd[:, k] = system.start[name].centre, system.start[name].sd * (
                system.start[name].centre if system.start[name].log else 1.0)
        elif name in outputs:
            seen = recording.seen[:, :, outputs.index(name)]
            known = np.isfinite(seen)
            first = known.argmax(1)
            begin[:, k] = np.where(known.any(1), seen[np.arange(len(seen)), first], 0.0)
            sd[:, k] = START * (system.outputs[name] or _white(seen))
        else:
            raise InputError(f"System: start: {name} is not observed; give start={{\"{name}\": ta.normal(...)}}, where "
                             "runs begin")
    return begin, sd


def first_noise(system: SystemSpec, recording: Recording) -> Float[Array, "O 3"]:
    """Return the logs of the noise to begin with: white, slow, time constant."""
    found = np.zeros((len(system.outputs), 3))
    longest = float((recording.time_s - recording.time_s[:, [0]]).max())
    step = float(np.median(recording.step_s[recording.step_s > 0.0]))
    for k, stated in enumerate(system.outputs.values()):
        white = stated or _white(recording.seen[:, :, k])
        found[k] = np.log(white), np.log(USUAL_SLOW * white), np.log(max(0.25 * SLOWEST * longest, step))
    return found


def _white(seen: Float[Array, "R T"]) -> float:
    """Noise of an output, by its second differences (their median, since inputs may jump)."""
    second = np.diff(seen, 2, axis=1)
    second = second[np.isfinite(second)]
    white = 1.4826 * float(np.median(np.abs(second))) / np.sqrt(6.0) if len(second) else 0.0
    return max(white, 1e-4 * _spread(seen), 1e-12)


def _spread(seen: Float[Array, "R T"]) -> float:
    """Standard deviation of what is known of an output; 1 before anything is recorded."""
    known = seen[np.isfinite(seen)]
    return float(known.std()) if len(known) else 1.0


def _log_volume(gains: Gains, known: Bool[Array, "R T O"]) -> Float[Array, " R"]:
    return np.asarray(np.where(known, np.log(2.0 * np.pi * gains[1]), 0.0).sum((1, 2)))
