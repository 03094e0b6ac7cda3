"""The flights of a system's rows, with their slopes by every way in which the simulator may differ, its slots.

The slopes of a rate function are those of its steps, carried along the flight. Those of a closed program are finite
differences.
"""

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from truearc.errors import InputError
from truearc.sim.compute import usable_cores
from truearc.sim.infer.likelihood.score_table import Array, Column
from truearc.sim.systems.candidates import Candidate
from truearc.sim.systems.flight import NO_PUSHES, Pushes, Stepper, call_rate, carry
from truearc.sim.systems.system import Recording, SystemSpec

DIFFERENCE = 1e-3                     # usual sizes of an effect of the user's own, by which it is moved for a slope
FINITE = 1e-3                         # prior standard deviations by which a closed program's numbers are moved
STEPS = (0.8, 0.2)                    # by which refits move a shape number, in turn; chosen: those of TRIED, a quarter
FAR = 1e3                             # ranges that a flight which fails counts as off


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
    """values of entries [E], logs of the noise [O, 3], starts of rows [R, S] and shape numbers of slots [V, 2], these
    two in standard deviations of their priors."""

    values: Float[Array, " E"]
    noise: Float[Array, "O 3"]
    start: Float[Array, "R S"]
    places: Float[Array, "V 2"]


@dataclass(frozen=True)
class SystemShape:
    """A shape number of a candidate, looked for about where it is (truearc.sim.infer.model.Shape)."""

    slot: int
    number: int
    step: float

    def put(self, point: SystemPoint, place: float) -> SystemPoint:
        places = point.places.copy()
        places[self.slot, self.number] += self.step * place
        return replace(point, places=places)


@dataclass(frozen=True, eq=False)
class Flown:
    """seen [R, T, O], its slopes by the slots in use [R, T, O, K], and by starts [R, T, O, S]; where it was flown."""

    seen: Float[Array, "R T O"]
    slopes: Float[Array, "R T O K"]
    by_start: Float[Array, "R T O S"]
    slots: tuple[int, ...]
    at: SystemPoint


@dataclass(frozen=True, eq=False)
class Flights:
    """Rows of a system, which can be flown.

    slots: every way in which the simulator may differ; entries: every column of it. begin, begin_sd [R, S]: believed
    starts. names: of inputs, then conditions. places: where shape numbers are looked for.
    """

    system: SystemSpec
    recording: Recording
    slots: tuple[Candidate, ...]
    entries: tuple[Entry, ...]
    layout: SystemLayout
    begin: Float[Array, "R S"]
    begin_sd: Float[Array, "R S"]
    substeps: int
    names: tuple[str, ...]
    places: Float[Array, "V 2"]

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
        seen, slopes = self._outputs(point, values, raw, slopes, slots)
        scale = np.nanmax(np.abs(self.recording.seen), axis=(0, 1), initial=1e-9) * FAR
        fine = np.isfinite(seen) & (np.abs(seen) < scale)
        return Flown(np.where(fine, seen, scale), np.where(fine[..., None], np.nan_to_num(slopes), 0.0),
                     np.where(fine[..., None], np.nan_to_num(by_start), 0.0), slots, point)

    def numbers(self, point: SystemPoint, slot: int) -> tuple[float, ...]:
        """Return a slot's shape numbers at a point."""
        return self.slots[slot].numbers(point.places[slot].tolist())

    def _inputs(self, point: SystemPoint, values: Float[Array, "R V"], slots: tuple[int, ...]) -> tuple[
            Array, dict[int, Array]]:
        """(inputs as distorted, {slot: slope of the input that it distorts [R, T]})."""
        inputs, slopes = self.recording.inputs.copy(), {}
        for number, slot in enumerate(self.slots):
            kind, k = slot.slot
            if kind.startswith("in_") and (np.any(values[:, number]) or number in slots):
                one, own = (kind.removeprefix("in_"), self.recording.inputs[:, :, k], self.recording), self.numbers(
                    point, number)
                slopes[number] = _distortion(*one, *own)
                inputs[:, :, k] += _distorted(*one, values[:, [number]], *own)
        return inputs, slopes

    def _outputs(self, point: SystemPoint, values: Float[Array, "R V"], raw: Float[Array, "R T O"],
                 slopes: Float[Array, "R T O K"], slots: tuple[int, ...]) -> tuple[Array, Array]:
        seen = raw.copy()
        for number, slot in enumerate(self.slots):
            kind, k = slot.slot
            if not kind.startswith("out_"):
                continue
            one, own = (kind.removeprefix("out_"), raw[:, :, k], self.recording), self.numbers(point, number)
            if number in slots:
                slopes[:, :, k, slots.index(number)] += _distortion(*one, *own)
            if np.any(values[:, number]):
                seen[:, :, k] += _distorted(*one, values[:, [number]], *own)
        return seen, slopes

    def _stepper(self, own: tuple[Any, ...]) -> Stepper:
        return Stepper(self.system, self.names, self.recording.inputs.shape[2], self.substeps, own)

    def _active(self, values: Float[Array, "R V"]) -> tuple[list[int], list[int]]:
        """(slots of pushes at work or fitted, slots of the user's effects that are)."""
        shared = {self.entries[k].slot for k in self.layout.source[self.layout.first_shared:] if k >= 0}
        active = [k for k in range(len(self.slots)) if k in shared or np.any(values[:, k])]
        return ([k for k in active if self.slots[k].slot[0] == "push"],
                [k for k in active if self.slots[k].slot[0] == "effect"])

    def _pushes(self, point: SystemPoint, active: list[int]) -> Pushes:
        """Padded to a power of two, so that compiled code is shared."""
        size, last = 0 if not active else 1 << (len(active) - 1).bit_length(), len(self.system.state) + len(self.names)
        kept = [(*push.at(self.numbers(point, k)), push.reads, last if push.times < 0 else push.times, push.rate)
                for k in active + active[:1] * (size - len(active)) if (push := self.slots[k].push) is not None]
        return Pushes(*map(np.stack, zip(*kept, strict=True))) if kept else NO_PUSHES

    def _drive(self, point: SystemPoint, values: Float[Array, "R V"], slots: tuple[int, ...]) -> Any:
        """(stepper, pushes, active, own, z without states [R, steps, Z], start [R, S], slopes of inputs)."""
        recording, system = self.recording, self.system
        active, own = self._active(values)
        pushes = self._pushes(point, active)
        inputs, by_input = self._inputs(point, values, slots)
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

    def sources(self, states: Float[Array, "R T S"]) -> list[Float[Array, "R T"]]:
        """Return the values that pushes read: states, inputs, conditions."""
        recording = self.recording
        held = np.broadcast_to(recording.conditions[:, None], (*recording.real.shape, recording.conditions.shape[1]))
        return list(np.moveaxis(np.concatenate([states, recording.inputs, held], axis=2), 2, 0))

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
        sources = self.sources(states)
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
                middle = self._middle(push.drawn(sources, self.numbers(point, slot)), push.reads)
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
        raw = self._program(point, values)
        slopes = np.zeros((*raw.shape, len(slots)))
        jobs: list[tuple[int, Array, SystemPoint, float]] = []
        for number, slot in enumerate(slots):
            kind = self.slots[slot].slot[0]
            if kind == "parameter" or kind.startswith("in_"):
                size = FINITE * self.slots[slot].usual
                moved = values.copy()
                moved[:, slot] += size
                jobs.append((number, moved, point, size))
        for k in range(s if slots else 0):
            start = point.start.copy()
            start[:, k] += FINITE
            jobs.append((len(slots) + k, values, replace(point, start=start), FINITE))
        by_start = np.zeros((*raw.shape, s if slots else 0))
        with ThreadPoolExecutor(usable_cores()) as pool:
            for (number, _, _, size), found in zip(jobs, pool.map(lambda job: self._program(job[2], job[1]), jobs),
                                                   strict=True):
                there = (found - raw) / size
                if number < len(slots):
                    slopes[..., number] = there
                else:
                    by_start[..., number - len(slots)] = there
        return raw, slopes, by_start

    def _program(self, point: SystemPoint, values: Float[Array, "R V"]) -> Float[Array, "R T O"]:
        recording, system = self.recording, self.system
        assert system.simulate_run is not None
        place = np.zeros((len(values), len(system.believed)))
        for number, slot in enumerate(self.slots):
            if slot.slot[0] == "parameter":
                place[:, slot.slot[1]] += values[:, number]
        inputs = self._inputs(point, values, ())[0]
        begin = self.begin + self.begin_sd * point.start
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

    def _failing(self, row: int, sample: int, states: Float[Array, "R T S"], state: int) -> int:
        """The state whose rate is not finite at a sample; `state` if none is there."""
        recording = self.recording
        u = [*recording.inputs[row, sample], *recording.conditions[row]]
        found = call_rate(self.system, self.names, states[row, sample], u,
                          [one.centre for one in self.system.believed.values()])
        return next((k for k, one in enumerate(found) if not np.isfinite(np.asarray(one, dtype=float))), state)


def _distorted(kind: str, values: Float[Array, "R T"], recording: Recording, amount: Float[Array, "R 1"],
               level: float = np.nan) -> Array:
    """What a distortion of this amount adds to a signal."""
    if kind != "delay":
        return np.asarray(amount * _distortion(kind, values, recording, level))
    late = np.stack([np.interp(t - one, t, v)
                     for t, one, v in zip(recording.time_s, amount[:, 0], values, strict=True)])
    return np.where(recording.real, late - values, 0.0)


def _distortion(kind: str, values: Float[Array, "R T"], recording: Recording, level: float = np.nan) -> Array:
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
