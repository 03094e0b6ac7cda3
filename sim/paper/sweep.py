"""The paper's training, many networks at once: recorded minibatches paired with simulated ones (III-D, Eq. 15).

Choices that the paper leaves open are made here. Features are standardised with the mean and standard deviation of the
recorded training rows; the two outputs' cross-entropies are summed and averaged over the ten rows. Length is counted
in steps (minibatches, Adam updates), not epochs: an epoch is once through the simulated rows, so equal epochs would
give a network with 1250 simulated rows two and a half times the updates of one with 500, and the sweep over sizes
would measure the length of training. With validation rows the weights kept are those with the least cross-entropy on
them, and a network stops once `patience` steps have brought none better. The lengths were chosen on one session of
the emulated robot (seed 11, 119 shots, 900 simulated, 32 splits; a fifth held out, a quarter of the rest to validate):
held-out cross-entropy 0.857 +- 0.026 with these, 0.869 with half the patience. Without stopping, what the validation
rows say is 0.90 after 200 000 steps and 1.23 after 2 million: the network learns its hundred shots by heart.
"""

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from truearc.errors import InputError
from truearc.sim.compute import usable_cores
from truearc.sim.paper.network import SHAPES, Layers, Network, initial_layers, standardisation
from truearc.sim.paper.settings import DEFAULT_RECIPE, Recipe
from truearc.sim.paper.sweep_kernel import BATCH, COLUMNS, LANES, PARAMETERS, Decks, Real, advance, mean_losses
from truearc.sim.paper.training import Rows
from truearc.sim.printed import Progress

SPANS = 3                             # recorded, simulated and validation rows, in this order



class Job(NamedTuple):
    """One network to train; `validation` rows decide when to stop and which weights to keep."""

    real: Rows
    simulated: Rows | None = None
    validation: Rows | None = None
    simulated_weight: float = 0.01    # the paper's lambda
    seed: int = 0                     # of first weights and minibatches


class CurvePoint(NamedTuple):
    """Mean cross-entropy a row (summed over the two outputs) after `step` steps; NaN where there are no rows."""

    step: int
    real: float
    simulated: float
    validation: float


@dataclass(frozen=True)
class Trained:
    """A network with the weights of `step`, `epoch` times through its rows; `curve` goes on to where training ended."""

    network: Network
    step: int
    epoch: int
    curve: tuple[CurvePoint, ...]


def check_job(job: Job) -> None:
    """InputError names what is wrong with one network's rows, lambda or seed."""
    if job.seed < 0:
        raise InputError(f"--seed is {job.seed}; it cannot be negative")
    if not 0.0 <= job.simulated_weight < math.inf:
        raise InputError(f"--lambda is {job.simulated_weight}; it must be 0 or more")
    if not len(job.real.features):
        raise InputError("no recorded shots to train on")


def batches_per_epoch(real: int, simulated: int) -> int:
    """Minibatches of once through the simulated rows, or the recorded ones where there are no others."""
    return -(-(simulated or real) // BATCH)


def train_many(jobs: Sequence[Job], recipe: Recipe = DEFAULT_RECIPE, progress: Progress = lambda done, note: None,
               threads: int | None = None) -> list[Trained]:
    """Train every job's network, all in one batch; a network's numbers depend on its own job and recipe alone.

    Networks advance LANES at a time, groups of them on `threads` (as many as cores), in float32. InputError when
    a job has nothing to train on, job or recipe is nonsense, or a loss stops being a number.
    """
    for job in jobs:
        check_job(job)
    batch = _Batch(jobs)
    active = np.arange(len(jobs))
    with ThreadPoolExecutor(threads or usable_cores()) as pool:
        for first in range(0, recipe.steps, recipe.check):
            steps = min(recipe.check, recipe.steps - first)
            groups = [active[start:start + LANES] for start in range(0, len(active), LANES)]
            moves = [pool.submit(batch.advance, group, first, steps, recipe.learning_rate) for group in groups]
            for move in moves:
                move.result()
            active = batch.judge(active, first + steps, recipe.patience)
            if not len(active):
                break
            progress((first + steps) / recipe.steps, f"{len(active)} of {len(jobs)} still learning")
    progress(1.0, f"{len(jobs)} trained")
    return [batch.trained(number) for number in range(len(jobs))]


class _Batch:
    """All networks of one batch; the network is the last axis of what the kernel works on."""

    def __init__(self, jobs: Sequence[Job]) -> None:
        count = len(jobs)
        self.jobs = jobs
        self.scalings = [standardisation(job.real.features) for job in jobs]
        tables = [_table(job, *scaling) for job, scaling in zip(jobs, self.scalings, strict=True)]
        self.ends = np.array([ends for _, ends in tables])
        self.rows, self.table = _stack([rows.astype(Real) for rows, _ in tables])
        share = np.array([job.simulated_weight if _count(job.simulated) else 0.0 for job in jobs])
        self.weights = (np.stack([np.ones(count), share]) / BATCH).astype(Real)
        self.state = np.zeros((3, PARAMETERS, count), Real)
        generators = [np.random.default_rng(job.seed) for job in jobs]
        for number, rng in enumerate(generators):
            self.state[0, :, number] = pack(initial_layers(rng))
        self.decks = make_decks(generators, [(len(job.real.features), _count(job.simulated)) for job in jobs])
        self.losses = np.full((count, SPANS), np.nan)
        self.best_loss = np.full(count, np.inf)
        self.best = self.state[0].copy()
        self.best_step = np.zeros(count, np.int64)
        self.curves: list[list[CurvePoint]] = [[] for _ in jobs]

    def advance(self, group: np.ndarray, first: int, steps: int, learning_rate: float) -> None:
        """Steps of at most LANES networks, and their losses; spare lanes repeat networks and are discarded."""
        lanes = np.resize(group, LANES)
        state = np.ascontiguousarray(self.state[:, :, lanes])
        weights = np.ascontiguousarray(self.weights[:, lanes])
        advance(self.rows, self.table[lanes], self.decks, lanes, len(group), weights, state, first, steps,
                learning_rate)
        self.state[:, :, group] = state[:, :, :len(group)]
        for lane, number in enumerate(group):
            mean_losses(state[0, :, lane].astype(float), self.rows[self.table[number]], self.ends[number],
                        self.losses[number])

    def judge(self, active: np.ndarray, step: int, patience: int) -> np.ndarray:
        """Keep the weights that are the best so far; the networks that go on."""
        self._check_finite(active, step)
        for number in active:
            self.curves[number].append(CurvePoint(step, *self.losses[number].tolist()))
        watched = self.losses[active, -1]
        better = active[np.isnan(watched) | (watched < self.best_loss[active])]
        self.best_loss[better] = self.losses[better, -1]
        self.best[:, better] = self.state[0][:, better]
        self.best_step[better] = step
        return np.asarray(active[step - self.best_step[active] < patience])

    def _check_finite(self, active: np.ndarray, step: int) -> None:
        sound = np.isfinite(self.losses[active, 0]) & np.isfinite(self.state[0][:, active]).all(axis=0)
        for number in active[~sound][:1]:
            raise InputError(f"training diverged within {step} steps (seed {self.jobs[number].seed}): the loss is "
                           f"{self.losses[number, 0]}; lower --learning-rate")

    def trained(self, number: int) -> Trained:
        step = int(self.best_step[number])
        return Trained(Network(*self.scalings[number], unpack(self.best[:, number])), step,
                       round(step / batches_per_epoch(*self.decks.sizes[number].tolist())), tuple(self.curves[number]))


def make_decks(generators: Sequence[np.random.Generator], sizes: Sequence[tuple[int, int]]) -> Decks:
    """What deals the minibatches of networks with (recorded, simulated) rows; each generator gives one seed."""
    dice = np.array([rng.integers(1, 2**63, dtype=np.uint64) for rng in generators])
    cards = np.tile(np.arange(max(map(sum, sizes)), dtype=np.int32), (len(sizes), 1))
    return Decks(dice, cards, np.array(sizes, np.int64).reshape(-1, 2), np.zeros((len(sizes), 3), np.int64))


def pack(layers: Layers) -> np.ndarray:
    """The parameters [50] in the kernel's order."""
    return np.concatenate([np.ravel(part) for part in layers])


def unpack(parameters: np.ndarray) -> Layers:
    """Layers of parameters [50]."""
    ends = np.cumsum([math.prod(shape) for shape in SHAPES])
    return Layers(*(part.reshape(shape).astype(float) for part, shape in
                    zip(np.split(np.asarray(parameters), ends[:-1]), SHAPES, strict=True)))


def _table(job: Job, mean: np.ndarray, scale: np.ndarray) -> tuple[np.ndarray, list[int]]:
    """Standardised rows with labels [n, 5] of the three spans, and where each begins and ends [4]."""
    parts = [np.hstack([(rows.features - mean) * scale, rows.labels]) if rows is not None and len(rows.features)
             else np.zeros((0, COLUMNS))
             for rows in (job.real, job.simulated, job.validation)]
    return np.concatenate(parts), [0, *np.cumsum([len(part) for part in parts]).tolist()]


def _stack(tables: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """(different tables [tables, longest, 5], padded; which one each network has): a sweep's networks share a few, and
    rows that several of them have just read are near at hand."""
    different: dict[bytes, tuple[int, np.ndarray]] = {}
    which = [different.setdefault(table.tobytes(), (len(different), table))[0] for table in tables]
    stacked = np.zeros((len(different), max(map(len, tables)), COLUMNS), Real)
    for number, table in different.values():
        stacked[number, :len(table)] = table
    return stacked, np.array(which)


def _count(rows: Rows | None) -> int:
    return 0 if rows is None else len(rows.features)
