"""A system as the model of a fit: its columns, its flights, and the table of scores of its runs.

Each row (a run, or a block of one) has a start of its own, integrated out where it is likeliest. The noise of an output
is white plus a first-order autoregression (Kalman 1960, for the two together), whose time constant is at most a tenth
of the longest row: a slower one would swallow missing physics.
"""

from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from truearc.errors import InputError
from truearc.sim.compute import usable_cores
from truearc.sim.infer.launcher import CREDIBLE_SD
from truearc.sim.infer.likelihood.score_table import Array, Column, ScoreTable, make_evidence
from truearc.sim.infer.model import Carrying, Shapes
from truearc.sim.systems import candidates as what
from truearc.sim.systems.candidates import Candidate
from truearc.sim.systems.flight import CLOSE, MOST_SUBSTEPS, Pushes, Stepper, call_rate, carry
from truearc.sim.systems.noise import Gains, noise_gains, whiten
from truearc.sim.systems.system import Recording, Runs, SystemSpec, record

SLOWEST = 0.1                         # of the longest row: the noise's time constant at most (the design)
# Chosen: the logs of a noise's sizes are known to a factor of three, its time constant to two
SIZE_SD, TIME_SD = 1.1, 0.7
USUAL_SLOW = 0.3                      # of white noise: the autoregression's usual size; chosen
LEAST = 1e-3                          # of white noise, that an autoregression counts as
DIFFERENCE = 1e-3                     # of a log, by which noise is moved for a slope
FINITE = 1e-3                         # prior standard deviations by which a closed program's numbers are moved
START = 3.0                           # noise standard deviations within which a run starts at its first sample; chosen
NOTHING = 1e-6                        # information at a prior's standard deviation, below which nothing depends on it
FAR = 1e3                             # ranges that a flight which fails counts as off
NOISE = ("", " slow", " time")


@dataclass(frozen=True, eq=False)
class Entry:
    """One column: its slot of the simulator, and its weight in each row [R]."""

    column: Column
    slot: int
    weight: Float[Array, " R"]


@dataclass(frozen=True)
class SystemLayout:
    """columns: tested, then shared ones. source [P]: their entries; -1 - 3 o - k: number k of the noise of output o."""

    columns: tuple[Column, ...]
    source: Int[Array, " P"]
    precision: Float[Array, "p p"]
    centre: Float[Array, " p"]
    changes: Mapping[str, float] = field(default_factory=dict)
    measured: Mapping[str, Any] = field(default_factory=dict)

    @property
    def first_shared(self) -> int:
        return len(self.columns) - len(self.precision)

    @property
    def believed(self) -> dict[str, float]:
        """{shared column: centre of its prior}."""
        return dict(zip((column.name for column in self.columns[self.first_shared:]), self.centre.tolist(),
                        strict=True))


@dataclass(frozen=True)
class SystemPoint:
    """values of entries [E], logs of the noise [O, 3], and starts of rows [R, S] in their standard deviations."""

    values: Float[Array, " E"]
    noise: Float[Array, "O 3"]
    start: Float[Array, "R S"]


@dataclass(frozen=True, eq=False)
class Flown:
    """seen [R, T, O], its slopes by the slots in use [R, T, O, K], and by starts [R, T, O, S]; where it was flown."""

    seen: Float[Array, "R T O"]
    slopes: Float[Array, "R T O K"]
    by_start: Float[Array, "R T O S"]
    slots: tuple[int, ...]
    at: SystemPoint


@dataclass(frozen=True, eq=False)
class SystemModel:
    """Rows of a system, and the columns that are fitted to and tested on them (truearc.sim.infer.model.Tested).

    slots: every way in which the simulator may differ; entries: every column of it. members: names that the runs cannot
    tell from a candidate, by its name. begin, begin_sd [R, S]: believed starts.
    """

    system: SystemSpec
    recording: Recording
    slots: tuple[Candidate, ...]
    entries: tuple[Entry, ...]
    layout: SystemLayout
    begin: Float[Array, "R S"]
    begin_sd: Float[Array, "R S"]
    substeps: int
    first_noise: Float[Array, "O 3"]
    labels: Mapping[str, Candidate]
    names: tuple[str, ...]
    session: Array | None
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
        session = None if runs.session is None else runs.columns[runs.session]
        begin, begin_sd = starts_of(system, recording)
        shared = [Candidate(name, name, "1" if one.log else "unit", one.sd, what.PARAMETER, ("parameter", k))
                  for k, (name, one) in enumerate(system.believed.items())]
        noise = first_noise(system, recording)
        empty = SystemLayout((), np.zeros(0, dtype=int), np.zeros((0, 0)), np.zeros(0))
        bare = SystemModel(system, recording, (), (), empty, begin, begin_sd, 1, noise, {}, names, session)
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
        u = [recording.inputs[:, :, k] for k in range(recording.inputs.shape[2])]
        u += [np.broadcast_to(recording.conditions[:, [k]], recording.real.shape)
              for k in range(recording.conditions.shape[1])]
        values = [*(states[:, :, k] for k in range(states.shape[2])), *u]
        stepper = replace(self._stepper(()))
        flat = [one.reshape(-1) for one in values]
        s = states.shape[2]
        p = np.array([one.centre for one in system.believed.values()])
        none = Pushes(*(np.zeros((0, 1)),) * 2, *(np.zeros(0, dtype=int),) * 3)
        params = np.repeat(p[:, None], len(flat[0]), axis=1)

        def rates(own: Any, at: Stepper) -> Array:
            many = at.rates(np, np.stack(flat[:s]), flat[s:], params, np.zeros(s), np.zeros(0), own, none)
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
        ordered = sorted(tested, key=lambda one: one.kind == "term")
        every = [*ordered, *shared, *found]
        slots: dict[Any, int] = {}
        entries = []
        for one in every:
            key = (one.slot, one.level, one.push if one.push is None else id(one.push))
            number = slots.setdefault(key, len(slots))
            weight = (np.ones(len(self.recording.run)) if one.along is None
                      else one.along.weight(self.recording, self.covariates))
            column = replace(one.column, kind="shared") if one in [*shared, *found] else one.column
            entries.append(Entry(column, number, weight))
        first = {number: one for one in reversed(every) for key, number in slots.items()
                 if key == (one.slot, one.level, one.push if one.push is None else id(one.push))}
        priors = [*self.system.believed.values(), *(prior for _, prior in self.system.found)]
        columns, source = [one.column for one in entries], list(range(len(entries)))
        centre, sd = [one.place for one in priors], [one.sd for one in priors]
        for o, (name, stated) in enumerate(self.system.outputs.items()):
            for k in range(1 if stated is not None else 0, 3):
                columns.append(Column(f"scatter.{name}{NOISE[k]}", "shared", what.OUTPUT, "", "1", SIZE_SD))
                source.append(-1 - 3 * o - k)
                centre.append(float(self.prior_noise[o, k]))
                sd.append(TIME_SD if k == 2 else SIZE_SD)
        layout = SystemLayout(tuple(columns), np.array(source), np.diag(np.array(sd)**-2.0), np.array(centre))
        return replace(self, slots=tuple(first[k] for k in range(len(first))), entries=tuple(entries), layout=layout,
                       labels={one.name: one for one in every})

    def reweighted(self) -> "SystemModel":
        """Return the model with the weights of rows as its recording now has them."""
        entries = [one if (candidate := self.labels.get(one.column.name)) is None or candidate.along is None else
                   replace(one, weight=candidate.along.weight(self.recording, self.covariates)) for one in self.entries]
        return replace(self, entries=tuple(entries))

    @cached_property
    def prior_noise(self) -> Float[Array, "O 3"]:
        """Centres of the noise's logs."""
        return self.first_noise

    # --- flights

    def slot_values(self, point: SystemPoint) -> Float[Array, "R V"]:
        """Return the value of every slot in every row."""
        found = np.zeros((len(self.recording.run), len(self.slots)))
        for entry, value in zip(self.entries, point.values, strict=True):
            if value != 0.0:
                found[:, entry.slot] += value * entry.weight
        return found

    def flights(self, point: SystemPoint) -> Float[Array, "R T O"]:
        """Return the outputs at a point."""
        return self._seen(point, ()).seen

    def fly(self, point: SystemPoint) -> Flown:
        slots = dict.fromkeys(self.entries[k].slot for k in self.layout.source if k >= 0)
        return self._seen(point, tuple(slots))

    def _seen(self, point: SystemPoint, slots: tuple[int, ...]) -> Flown:
        values = self.slot_values(point)
        raw, slopes, by_start = (self._by_rate(point, values, slots) if self.system.rate is not None
                                 else self._by_program(point, values, slots))
        seen, slopes = self._outputs(values, raw, slopes, slots)
        scale = np.nanmax(np.abs(self.recording.seen), axis=(0, 1), initial=1e-9) * FAR
        fine = np.isfinite(seen) & (np.abs(seen) < scale)
        return Flown(np.where(fine, seen, scale), np.where(fine[..., None], np.nan_to_num(slopes), 0.0),
                     np.where(fine[..., None], np.nan_to_num(by_start), 0.0), slots, point)

    def _inputs(self, values: Float[Array, "R V"], slots: tuple[int, ...]) -> tuple[Array, dict[int, Array]]:
        """(inputs as distorted, {slot: slope of the input that it distorts [R, T]})."""
        inputs, slopes = self.recording.inputs.copy(), {}
        for number, slot in enumerate(self.slots):
            kind, k = slot.slot
            if kind.startswith("in_") and (np.any(values[:, number]) or number in slots):
                slopes[number] = _distortion(kind.removeprefix("in_"), self.recording.inputs[:, :, k],
                                             self.recording, slot.level)
                inputs[:, :, k] += _distorted(kind.removeprefix("in_"), self.recording.inputs[:, :, k],
                                              self.recording, slot.level, values[:, [number]])
        return inputs, slopes

    def _outputs(self, values: Float[Array, "R V"], raw: Float[Array, "R T O"], slopes: Float[Array, "R T O K"],
                 slots: tuple[int, ...]) -> tuple[Array, Array]:
        seen = raw.copy()
        for number, slot in enumerate(self.slots):
            kind, k = slot.slot
            if not kind.startswith("out_"):
                continue
            kind = kind.removeprefix("out_")
            if number in slots:
                slopes[:, :, k, slots.index(number)] += _distortion(kind, raw[:, :, k], self.recording, slot.level)
            if np.any(values[:, number]):
                seen[:, :, k] += _distorted(kind, raw[:, :, k], self.recording, slot.level, values[:, [number]])
        return seen, slopes

    def _stepper(self, own: tuple[Any, ...]) -> Stepper:
        return Stepper(self.system, self.names, self.recording.inputs.shape[2], self.substeps, own)

    def _active(self, values: Float[Array, "R V"]) -> tuple[list[int], list[int]]:
        """(slots of pushes at work or fitted, slots of the user's effects that are)."""
        shared = {self.entries[k].slot for k in self.layout.source[self.layout.first_shared:] if k >= 0}
        active = [k for k in range(len(self.slots)) if k in shared or np.any(values[:, k])]
        return ([k for k in active if self.slots[k].slot[0] == "push"],
                [k for k in active if self.slots[k].slot[0] == "effect"])

    def _pushes(self, active: Sequence[int]) -> Pushes:
        """Padded to a power of two, so that compiled code is shared."""
        size = 0 if not active else 1 << (len(active) - 1).bit_length()
        one = self.slots[active[0]].push if active else None
        tables = [self.slots[k].push for k in active] + [one] * (size - len(active))
        last = len(self.system.state) + len(self.names)
        kept = [table for table in tables if table is not None]
        if not kept:
            return Pushes(*(np.zeros((0, 1)),) * 2, *(np.zeros(0, dtype=int),) * 3)
        return Pushes(np.stack([one.knots for one in kept]), np.stack([one.table for one in kept]),
                      np.array([one.reads for one in kept]),
                      np.array([last if one.times < 0 else one.times for one in kept]),
                      np.array([one.rate for one in kept]))

    def _drive(self, point: SystemPoint, values: Float[Array, "R V"], slots: tuple[int, ...]) -> Any:
        """(stepper, pushes, active, own, z without states [R, steps, Z], start [R, S], slopes of inputs)."""
        recording, system = self.recording, self.system
        active, own = self._active(values)
        pushes = self._pushes(active)
        inputs, by_input = self._inputs(values, slots)
        steps = recording.step_s.shape
        place = np.zeros((*steps, len(system.believed)))
        for number, slot in enumerate(self.slots):
            kind, k = slot.slot
            if kind == "parameter":
                place[:, :, k] += values[:, [number]]
            elif kind == "drift":
                place[:, :, k] += values[:, [number]] * self._within
        params = [one.value(place[:, :, k]) for k, one in enumerate(system.believed.values())]
        amps = np.zeros((*steps, len(pushes.rate)))
        amps[:, :, :len(active)] = values[:, None, active]
        z = np.concatenate([np.stack(params, axis=2), np.zeros((*steps, len(system.state))), amps,
                            np.broadcast_to(values[:, None, own], (*steps, len(own))), inputs[:, :-1], inputs[:, 1:]],
                           axis=2)
        stepper = self._stepper(tuple(system.effects[self.slots[k].slot[1]] for k in own))
        return stepper, pushes, active, own, z, self.begin + self.begin_sd * point.start, by_input

    @cached_property
    def _within(self) -> Float[Array, "R steps"]:
        """Place within the row, from -0.5 to 0.5."""
        span = np.maximum((self.recording.time_s - self.recording.time_s[:, [0]]).max(1, keepdims=True), 1e-12)
        return np.asarray((self.recording.time_s[:, :-1] - self.recording.time_s[:, [0]]) / span - 0.5)

    def _states(self, point: SystemPoint) -> tuple[Float[Array, "R T S"], Any]:
        drive = self._drive(point, self.slot_values(point), ())
        stepper, pushes, _, _, z, x0, _ = drive
        return stepper.path(x0, z, self.recording.conditions, self.recording.step_s, pushes), drive

    def _by_rate(self, point: SystemPoint, values: Float[Array, "R V"], slots: tuple[int, ...]) -> tuple[
            Array, Array, Array]:
        recording, s, p = self.recording, len(self.system.state), len(self.system.believed)
        stepper, pushes, active, own, z, x0, by_input = self._drive(point, values, slots)
        states = stepper.path(x0, z, recording.conditions, recording.step_s, pushes)
        out = [self.system.state.index(name) for name in self.system.outputs]
        rows, steps = recording.step_s.shape
        if not slots:
            empty = np.zeros((*recording.real.shape, len(out), 0))
            return states[:, :, out], empty, empty
        whole = np.concatenate([states[:, :-1], z], axis=2)
        by = stepper.slopes(whole.reshape(rows * steps, -1), np.repeat(recording.conditions, steps, axis=0),
                            recording.step_s.reshape(-1), pushes).reshape(rows, steps, s, -1)
        live = (recording.step_s > 0.0)[:, :, None, None]
        by = np.where(np.isfinite(by) & live, by, 0.0)
        phi = np.where(live, by[:, :, :, :s], np.eye(s))
        at = np.cumsum([0, s, p, s, len(pushes.rate), len(own), recording.inputs.shape[2]]).tolist()
        force = np.zeros((rows, steps, s, len(slots) + s))
        sources = [*(states[:, :, k] for k in range(s)), *(recording.inputs[:, :, k] for k in range(
            recording.inputs.shape[2])), *(np.broadcast_to(recording.conditions[:, [k]], recording.real.shape)
                                           for k in range(recording.conditions.shape[1]))]
        for number, slot in enumerate(slots):
            kind, k = self.slots[slot].slot
            push = self.slots[slot].push
            if kind in ("parameter", "drift"):
                one = list(self.system.believed.values())[k]
                scale = z[:, :, k] if one.log else np.ones((rows, steps))
                force[:, :, :, number] = (by[..., at[1] + k] * scale[..., None]
                                          * (self._within[..., None] if kind == "drift" else 1.0))
            elif kind == "push" and slot in active:
                force[:, :, :, number] = by[..., at[3] + active.index(slot)]
            elif kind == "push" and push is not None:
                middle = self._middle(push.drawn(sources), push.reads)
                if push.times >= 0:
                    middle = middle * self._middle(sources[push.times], push.times)
                by_push = (by[..., at[2] + push.rate] if push.rate < s else
                           by[..., at[5] + push.rate - s] + by[..., at[6] + push.rate - s])
                force[:, :, :, number] = by_push * middle[..., None]
            elif kind == "effect" and slot in own:
                force[:, :, :, number] = by[..., at[4] + own.index(slot)]
            elif kind == "effect":
                force[:, :, :, number] = self._own_effect(k, self.slots[slot].usual, sources, by[..., at[2]:at[3]])
            elif kind.startswith("in_"):
                begin, end = by_input[slot][:, :-1, None], by_input[slot][:, 1:, None]
                force[:, :, :, number] = by[..., at[5] + k] * begin + by[..., at[6] + k] * end
        begin = np.zeros((rows, s, len(slots) + s))
        begin[:, :, len(slots):] = np.eye(s) * self.begin_sd[:, :, None]
        moved = carry(phi, force, begin)[:, :, out]
        return states[:, :, out], moved[..., :len(slots)], moved[..., len(slots):]

    def _middle(self, values: Float[Array, "R T"], number: int) -> Float[Array, "R steps"]:
        """What value `number`, or a function of it, is during each step."""
        held = number >= len(self.system.state) and self.system.hold == "zero"
        return values[:, :-1] if held else 0.5 * (values[:, :-1] + values[:, 1:])

    def _own_effect(self, number: int, usual: float, sources: Sequence[Array], by_push: Array) -> Array:
        """The slope of steps by an effect of the user's own, of amplitude zero."""
        s, shape = len(self.system.state), sources[0].shape
        inputs = dict(zip(self.names, sources[s:], strict=True))
        size = DIFFERENCE * usual
        ends = []
        for sign in (1.0, -1.0):
            more = self.system.effects[number].push(tuple(sources[:s]), inputs, sign * size)
            more = list(more) if hasattr(more, "__len__") else [more]
            ends.append(np.stack([np.broadcast_to(np.asarray(one, dtype=float), shape) for one in more], axis=-1))
        slope = (ends[0] - ends[1]) / (2.0 * size)
        return np.asarray(np.einsum("rnij,rnj->rni", by_push, 0.5 * (slope[:, :-1] + slope[:, 1:])))

    def _by_program(self, point: SystemPoint, values: Float[Array, "R V"], slots: tuple[int, ...]) -> tuple[
            Array, Array, Array]:
        """A closed program, its numbers moved one at a time; runs in parallel."""
        s = len(self.system.starts)
        raw = self._program(values, point.start)
        slopes = np.zeros((*raw.shape, len(slots)))
        jobs: list[tuple[int, Array, Array, float]] = []
        for number, slot in enumerate(slots):
            kind = self.slots[slot].slot[0]
            if kind == "parameter" or kind.startswith("in_"):
                size = FINITE * self.slots[slot].usual
                moved = values.copy()
                moved[:, slot] += size
                jobs.append((number, moved, point.start, size))
        for k in range(s if slots else 0):
            start = point.start.copy()
            start[:, k] += FINITE
            jobs.append((len(slots) + k, values, start, FINITE))
        by_start = np.zeros((*raw.shape, s if slots else 0))
        with ThreadPoolExecutor(usable_cores()) as pool:
            for (number, _, _, size), found in zip(jobs, pool.map(lambda job: self._program(job[1], job[2]), jobs),
                                                   strict=True):
                there = (found - raw) / size
                if number < len(slots):
                    slopes[..., number] = there
                else:
                    by_start[..., number - len(slots)] = there
        return raw, slopes, by_start

    def _program(self, values: Float[Array, "R V"], start: Float[Array, "R S"]) -> Float[Array, "R T O"]:
        recording, system = self.recording, self.system
        assert system.simulate_run is not None
        place = np.zeros((len(values), len(system.believed)))
        for number, slot in enumerate(self.slots):
            if slot.slot[0] == "parameter":
                place[:, slot.slot[1]] += values[:, number]
        inputs = self._inputs(values, ())[0]
        begin = self.begin + self.begin_sd * start
        found = np.full((*recording.real.shape, len(system.outputs)), np.nan)
        moving = inputs.shape[2]
        for row in range(len(values)):
            count = int(recording.real[row].sum())
            given: dict[str, Any] = {name: inputs[row, :count, k] for k, name in enumerate(self.names[:moving])}
            given |= {name: float(recording.conditions[row, k]) for k, name in enumerate(self.names[moving:])}
            given["t_s"] = recording.time_s[row, :count] - recording.time_s[row, 0]
            params = {name: float(one.value(place[row, k])) for k, (name, one) in enumerate(system.believed.items())}
            answer = system.simulate_run(given, params, dict(zip(system.starts, begin[row].tolist(), strict=True)))
            for k, name in enumerate(system.outputs):
                if not isinstance(answer, Mapping) or name not in answer:
                    raise InputError(f"simulate: did not return {name!r}; expected {{name: array}} with "
                                     f"{', '.join(system.outputs)}")
                there = np.asarray(answer[name], dtype=float)
                if there.shape != (count,):
                    raise InputError(f"simulate: {name}: returned an array of shape {there.shape}; expected ({count},),"
                                     " one value per sample")
                found[row, :count, k] = there
        return found

    def _enough_steps(self) -> int:
        """Substeps of a sample by which flights agree with those of half the step."""
        if self.system.rate is None:
            return 1
        count, point = 1, self.starts()[0]
        scale = np.maximum(np.exp(self.first_noise[:, 0]), 1e-3 * np.nan_to_num(np.nanstd(
            self.recording.seen, axis=(0, 1)), nan=1.0))
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
        elif not np.isfinite(self._program(self.slot_values(point), point.start)[self.recording.real]).all():
            raise InputError("simulate: returned a number that is not finite, with the parameters as believed")
        table = self.linearise(point)[0]
        for k, (name, one) in enumerate(system.believed.items()):
            if table.information[k, k] * one.sd**2 < NOTHING:
                raise InputError(f"believed: {name} changes nothing that is observed; leave it out, or observe "
                                 "something that it moves")

    def _failing(self, row: int, sample: int, states: Float[Array, "R T S"], state: int) -> int:
        """The state whose rate is not finite at a sample; `state` if none is there."""
        recording = self.recording
        u = [*recording.inputs[row, sample], *recording.conditions[row]]
        found = call_rate(self.system, self.names, states[row, sample], u,
                          [one.centre for one in self.system.believed.values()])
        return next((k for k, one in enumerate(found) if not np.isfinite(np.asarray(one, dtype=float))), state)

    # --- the protocol of a fit

    def linearise(self, point: SystemPoint, flown: Flown | None = None) -> tuple[ScoreTable, SystemPoint]:
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
        gram = np.swapaxes(white, 1, 2) @ white
        inner = np.eye(s) + gram[:, k:k + s, k:k + s]
        lift = np.linalg.solve(inner, gram[:, k:k + s])
        left = gram - np.swapaxes(gram[:, k:k + s], 1, 2) @ lift
        start = lift[:, :, -1]
        own = np.flatnonzero(self.layout.source >= 0)
        entries = [self.entries[n] for n in self.layout.source[own]]
        place = [flown.slots.index(one.slot) for one in entries]
        weight = np.stack([one.weight for one in entries], axis=1) if entries else np.zeros((rows, 0))
        linear, bend = np.zeros((rows, len(columns))), np.zeros((rows, len(columns), len(columns)))
        linear[:, own] = left[:, place, -1] * weight
        both = weight[:, :, None] * weight[:, None, :]
        bend[np.ix_(np.arange(rows), own, own)] = left[:, place][:, :, place] * both
        log = -0.5 * (left[:, -1, -1] + np.linalg.slogdet(inner)[1] + _log_volume(gains, known))
        self._by_noise(point, off - np.einsum("rtos,rs->rto", flown.by_start, start), known, linear, bend)
        layout, p = self.layout, self.layout.first_shared
        at = np.array([point.values[n] if n >= 0 else point.noise[divmod(-1 - n, 3)] for n in layout.source])
        pull = layout.precision @ (layout.centre - at[p:])
        table = make_evidence(np.arange(rows), columns, at, linear, bend, None, layout.precision, pull, log)
        return table, replace(point, start=start)

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
        values, noise, source = point.values.copy(), point.noise.copy(), self.layout.source
        values[source[source >= 0]] += change[source >= 0]
        for k in np.flatnonzero(source < 0):
            o, number = divmod(-1 - source[k], 3)
            noise[o, number] += np.clip(change[k], -1.0, 1.0)
        low, high = self.noise_ends
        return replace(point, values=values, noise=np.clip(noise, low, high))

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
        out, (low, high) = np.full(len(step), False), self.noise_ends
        for k in np.flatnonzero(self.layout.source < 0):
            at = divmod(-1 - self.layout.source[k], 3)
            now = point.noise[at]
            out[k] = (now <= low[at] and step[k] < 0.0) or (now >= high[at] and step[k] > 0.0)
        return out

    def is_lost(self, point: SystemPoint) -> bool:
        return False

    def starts(self) -> tuple[SystemPoint, ...]:
        """Return the priors' centres."""
        layout, values = self.layout, np.zeros(len(self.entries))
        own = layout.source[layout.first_shared:]
        values[own[own >= 0]] = layout.centre[own >= 0]
        return (SystemPoint(values, self.first_noise.copy(), np.zeros_like(self.begin)),)

    def easier(self) -> Iterable["SystemModel"]:
        return ()

    def afar(self, change: Float[Array, " P"]) -> tuple[SystemPoint, Iterable["SystemModel"]]:
        return self.moved(self.starts()[0], change), ()

    def shapes(self, names: tuple[str, ...]) -> list[Any]:
        return []

    def shared_only(self, names: Iterable[str] = ()) -> "SystemModel":
        layout, wanted = self.layout, {*names}
        first = layout.first_shared
        promoted = [k for k in range(first) if layout.columns[k].name in wanted]
        return self._sharing(promoted, [])

    def sharing(self, names: tuple[str, ...]) -> "SystemModel":
        first, wanted = self.layout.first_shared, {*names}
        promoted = [k for k in range(first) if self.layout.columns[k].name in wanted]
        return self._sharing(promoted, [k for k in range(first) if k not in promoted])

    def _sharing(self, promoted: Sequence[int], tested: Sequence[int]) -> "SystemModel":
        """The model with some tested columns among the shared ones, the first of them, and with these tested."""
        layout, first = self.layout, self.layout.first_shared
        columns = [*(layout.columns[k] for k in tested), *(replace(layout.columns[k], kind="shared") for k in promoted),
                   *layout.columns[first:]]
        source = np.concatenate([layout.source[[*tested, *promoted]], layout.source[first:]]).astype(int)
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
        values, own = point.values.copy(), best.layout.source[0]
        values[own] = start.values[own]
        return replace(point, values=values)

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
        return Carrying(model._sharing(range(len(new)), []), [begin])


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
    spread = float(np.nanstd(seen)) if np.isfinite(seen).any() else 1.0
    white = 1.4826 * float(np.median(np.abs(second))) / np.sqrt(6.0) if len(second) else 0.0
    return max(white, 1e-4 * spread, 1e-12)


def _distorted(kind: str, values: Float[Array, "R T"], recording: Recording, level: float,
               amount: Float[Array, "R 1"]) -> Array:
    """What a distortion of this amount adds to a signal."""
    if kind != "delay":
        return np.asarray(amount * _distortion(kind, values, recording, level))
    late = np.stack([np.interp(t - one, t, v)
                     for t, one, v in zip(recording.time_s, amount[:, 0], values, strict=True)])
    return np.where(recording.real, late - values, 0.0)


def _distortion(kind: str, values: Float[Array, "R T"], recording: Recording, level: float) -> Array:
    """Slope of a signal by a distortion."""
    if kind == "scale":
        return values
    if kind == "offset":
        return np.ones_like(values)
    if kind == "delay":
        step = np.where(recording.step_s > 0.0, recording.step_s, np.inf)
        slope = np.diff(values, axis=1) / step
        both = np.concatenate([slope[:, :1], 0.5 * (slope[:, :-1] + slope[:, 1:]), slope[:, -1:]], axis=1)
        return -both
    return -np.maximum(values - level, 0.0) if kind == "clip_high" else np.maximum(level - values, 0.0)


def _log_volume(gains: Gains, known: Bool[Array, "R T O"]) -> Float[Array, " R"]:
    return np.asarray(np.where(known, np.log(2.0 * np.pi * gains[1]), 0.0).sum((1, 2)))


