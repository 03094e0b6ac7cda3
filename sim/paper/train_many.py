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

In the compiled inner loop LANES networks advance together, the network always the last and contiguous axis, so that one
vector instruction serves several of them. Each lane does exactly the arithmetic that it would do alone: what shares its
batch changes no bit. The gradient is written out; the tests hold it against NumPy and JAX. Rows of the parameters [50]:
hidden_w (feature by feature, 8 nodes each), hidden_b, out_w (node by node, 2 outputs each), out_b.
"""

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from truearc.errors import InputError
from truearc.sim.compute import usable_cores
from truearc.sim.paper import DEFAULT_RECIPE, Recipe
from truearc.sim.paper.network import SHAPES, Layers, Network, Rows, initial_layers, standardisation
from truearc.sim.printed import Progress

LANES = 24                            # of 8 to 48, as fast a lane as any; a network alone pays for all
BATCH = 10                            # recorded rows in a minibatch, and as many simulated ones
COLUMNS = 5                           # of a training row: three standardised features, two labels
PARAMETERS = 50
Real = np.float32                     # as Keras trains, and as the exported gate computes
_NODES, _B1, _W2, _B2 = 8, 24, 32, 48
_KEPT_1, _KEPT_2 = 0.9, 0.999         # Adam's, as its authors give them
_OLD_1, _NEW_1, _OLD_2, _NEW_2 = Real(_KEPT_1), Real(1.0 - _KEPT_1), Real(_KEPT_2), Real(1.0 - _KEPT_2)
_EPSILON, _ZERO, _ONE = Real(1e-8), Real(0.0), Real(1.0)
_STEEPEST, _SCALE = Real(-1.5), Real(1.0 / 32.0)
_SERIES = tuple(Real(1.0 / math.factorial(k)) for k in range(5))
# Free to contract and reorder sums, but not to assume that no number is NaN.
_FAST = {"contract", "reassoc", "arcp", "nsz"}
SPANS = 3                             # recorded, simulated and validation rows, in this order


@njit(fastmath=_FAST, error_model="numpy", cache=True)
def sigmoid(x: np.float32) -> np.float32:
    """1 / (1 + exp(-x)) within 1e-6: five terms of the series of exp(-x / 32), squared five times.

    The series is rough only where the sigmoid is flat. No branch and no table, which is what lets the lanes share
    vector instructions. Beyond x = 48 the series would rise again, hence the bound.
    """
    z = max(-x * _SCALE, _STEEPEST)
    e = _SERIES[4]
    e = e * z + _SERIES[3]
    e = e * z + _SERIES[2]
    e = e * z + _SERIES[1]
    e = e * z + _SERIES[0]
    e = e * e
    e = e * e
    e = e * e
    e = e * e
    e = e * e
    return _ONE / (_ONE + e)


class Decks(NamedTuple):
    """What deals the minibatches of n networks; changed in place.

    `dice` [n] uint64, none of them 0: generators. `cards` [n, rows] int32: each network's permutation of its recorded
    rows' numbers, then of its simulated ones'. `sizes` [n, 2]: how many of each. `at` [n, 3]: the next card of either,
    and minibatches left in the epoch.
    """

    dice: Any
    cards: Any
    sizes: Any
    at: Any


@njit(fastmath=_FAST, error_model="numpy", nogil=True, cache=True)
def advance(rows: Any, table: Any, decks: Decks, lanes: Any, real: int, weights: Any, state: Any, first: int,
            steps: int, learning_rate: float) -> None:
    """Adam steps on LANES networks, in place; lanes from `real` on are there to fill up and get no minibatches.

    rows [tables, n, 5]; table [LANES] which of them is whose; lanes [LANES] which networks; weights [2, LANES] of a
    recorded and of a simulated row in the loss; state [3, 50, LANES] parameters and Adam's two moments; `first` steps
    were made before.
    """
    batch = np.zeros((2 * BATCH, COLUMNS, LANES), Real)
    slope = np.empty((PARAMETERS, LANES), Real)
    hidden, out = np.empty((_NODES, LANES), Real), np.empty((2, LANES), Real)
    picked = np.zeros(2 * BATCH, np.int32)
    p, m, v = state[0].copy(), state[1].copy(), state[2].copy()
    for step in range(steps):
        for lane in range(real):
            deal(decks, lanes[lane], picked)
            _gather(rows[table[lane]], picked, lane, batch)
        slope[:] = _ZERO
        for row in range(2 * BATCH):
            _forward(p, batch, row, hidden, out)
            _backward(p, batch, row, weights, hidden, out, slope)
        time = float(first + step + 1)
        rate, unbias = learning_rate / (1.0 - _KEPT_1**time), 1.0 / (1.0 - _KEPT_2**time)
        _adam(p, m, v, slope, Real(rate), Real(unbias))
    state[0], state[1], state[2] = p, m, v


@njit(inline="always")
def _gather(rows: Any, picked: Any, lane: int, batch: Any) -> None:
    for row in range(2 * BATCH):
        for column in range(COLUMNS):
            batch[row, column, lane] = rows[picked[row], column]


@njit(fastmath=_FAST, error_model="numpy", inline="always")
def _forward(p: Any, batch: Any, row: int, hidden: Any, out: Any) -> None:
    for j in range(_NODES):
        for lane in range(LANES):
            hidden[j, lane] = sigmoid(p[_B1 + j, lane] + batch[row, 0, lane] * p[j, lane]
                                      + batch[row, 1, lane] * p[_NODES + j, lane]
                                      + batch[row, 2, lane] * p[2 * _NODES + j, lane])
    for k in range(2):
        for lane in range(LANES):
            total = p[_B2 + k, lane]
            for j in range(_NODES):
                total += hidden[j, lane] * p[_W2 + 2 * j + k, lane]
            out[k, lane] = total


@njit(fastmath=_FAST, error_model="numpy", inline="always")
def _backward(p: Any, batch: Any, row: int, weights: Any, hidden: Any, out: Any, slope: Any) -> None:
    """Adds the gradient of weight x summed binary cross-entropy; `out` is overwritten."""
    for k in range(2):
        for lane in range(LANES):
            d = weights[row // BATCH, lane] * (sigmoid(out[k, lane]) - batch[row, 3 + k, lane])
            out[k, lane] = d
            slope[_B2 + k, lane] += d
    for j in range(_NODES):
        for lane in range(LANES):
            h, d0, d1 = hidden[j, lane], out[0, lane], out[1, lane]
            back = (d0 * p[_W2 + 2 * j, lane] + d1 * p[_W2 + 2 * j + 1, lane]) * h * (_ONE - h)
            slope[_W2 + 2 * j, lane] += h * d0
            slope[_W2 + 2 * j + 1, lane] += h * d1
            slope[j, lane] += batch[row, 0, lane] * back
            slope[_NODES + j, lane] += batch[row, 1, lane] * back
            slope[2 * _NODES + j, lane] += batch[row, 2, lane] * back
            slope[_B1 + j, lane] += back


@njit(fastmath=_FAST, error_model="numpy", inline="always")
def _adam(p: Any, m: Any, v: Any, slope: Any, rate: np.float32, unbias: np.float32) -> None:
    for k in range(PARAMETERS):
        for lane in range(LANES):
            g = slope[k, lane]
            m[k, lane] = _OLD_1 * m[k, lane] + _NEW_1 * g
            v[k, lane] = _OLD_2 * v[k, lane] + _NEW_2 * g * g
            p[k, lane] -= rate * m[k, lane] / (np.sqrt(v[k, lane] * unbias) + _EPSILON)


@njit(error_model="numpy", nogil=True, cache=True)
def mean_losses(p: Any, rows: Any, ends: Any, losses: Any) -> None:
    """Mean summed cross-entropy of one network p [50] over each span of rows [n, 5]; NaN for an empty one.

    In float64, whatever the parameters were trained in. Span k goes from ends[k] to ends[k + 1]; the results go to
    losses [spans].
    """
    for span in range(len(losses)):
        total = 0.0
        for n in range(ends[span], ends[span + 1]):
            out0, out1 = p[_B2], p[_B2 + 1]
            for j in range(_NODES):
                a = p[_B1 + j] + rows[n, 0] * p[j] + rows[n, 1] * p[_NODES + j] + rows[n, 2] * p[2 * _NODES + j]
                h = 1.0 / (1.0 + math.exp(-a))
                out0 += h * p[_W2 + 2 * j]
                out1 += h * p[_W2 + 2 * j + 1]
            total += _softplus(out0) - rows[n, 3] * out0 + _softplus(out1) - rows[n, 4] * out1
        losses[span] = total / (ends[span + 1] - ends[span])


@njit(cache=True)
def _softplus(x: float) -> float:
    return max(x, 0.0) + math.log1p(math.exp(-abs(x)))


@njit(nogil=True, cache=True)
def deal(decks: Decks, network: int, picked: Any) -> None:
    """Row numbers of a network's next minibatch into picked [20]: ten recorded rows, then ten simulated ones.

    Both come from permutations: an epoch goes once through the simulated rows, the last minibatch filled up from the
    head of their permutation, while recorded rows are reshuffled as often as that takes. Without simulated rows an
    epoch goes once through the recorded ones, and the second half is row 0, to be weighed with nothing.
    """
    real, simulated = decks.sizes[network]
    cards, at = decks.cards[network], decks.at[network]
    if at[2] == 0:
        at[0], at[1] = 0, 0
        at[2] = ((simulated if simulated else real) + BATCH - 1) // BATCH
        _shuffle(decks.dice, network, cards[:real])
        _shuffle(decks.dice, network, cards[real:real + simulated])
    at[2] -= 1
    for place in range(BATCH):
        if at[0] == real:
            at[0] = 0
            if simulated:
                _shuffle(decks.dice, network, cards[:real])
        picked[place] = cards[at[0]]
        at[0] += 1
    for place in range(BATCH, 2 * BATCH if simulated else 0):
        if at[1] == simulated:
            at[1] = 0
        picked[place] = cards[real + at[1]]
        at[1] += 1
    if not simulated:
        picked[BATCH:] = 0


@njit(nogil=True, cache=True)
def _shuffle(dice: Any, network: int, deck: Any) -> None:
    """Fisher and Yates's shuffle in place, on Vigna's xorshift64*; NumPy's own is ten times slower from in here."""
    x = dice[network]
    for last in range(len(deck) - 1, 0, -1):
        x ^= x >> np.uint64(12)
        x ^= x << np.uint64(25)
        x ^= x >> np.uint64(27)
        high = (x * np.uint64(0x2545F4914F6CDD1D)) >> np.uint64(32)
        other = np.int64((high * np.uint64(last + 1)) >> np.uint64(32))
        deck[last], deck[other] = deck[other], deck[last]
    dice[network] = x


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
