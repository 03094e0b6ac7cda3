"""Compiled, parallel training of many of the paper's networks on recorded and simulated minibatches (III-D, Eq. 15).

This module makes the choices that the paper leaves open. Features are standardised with the mean and standard deviation
of the recorded training rows; the cross-entropies of the two outputs are summed and averaged over the ten rows.
Training length is counted in steps (minibatches, Adam updates), not epochs: an epoch is one pass over the simulated
rows, so an equal number of epochs would give a network with 1250 simulated rows two and a half times the updates of one
with 500, and the sweep over sizes would measure the length of training. With validation rows, the weights with the
lowest cross-entropy on them are kept, and training stops after `patience` steps without improvement. The lengths were
chosen on one session of the emulated robot (seed 11, 119 shots, 900 simulated, 32 splits; a fifth held out, a quarter
of the rest for validation): held-out cross-entropy is 0.857 +- 0.026 with these lengths, 0.869 with half the patience.
Without stopping, validation cross-entropy is 0.90 after 200 000 steps and 1.23 after 2 million: the network memorises
its hundred shots.

One thread trains one network. The gradient is written out by hand; tests compare it with NumPy and JAX. The parameters
[50] are laid out as hidden_w (feature by feature, 8 nodes each), hidden_b, out_w (node by node, 2 outputs each), out_b.
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

BATCH = 10                            # recorded rows in a minibatch, and as many simulated ones
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


@njit(fastmath=_FAST, error_model="numpy", cache=True)
def sigmoid(x: np.float32) -> np.float32:
    """Return 1 / (1 + exp(-x)) within 1e-6: five terms of the series of exp(-x / 32), squared five times.

    The series is rough only where the sigmoid is flat. No branch and no table, which is what lets nodes share
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


class Deck(NamedTuple):
    """State from which a network's minibatches are dealt; changed in place.

    `dice` [1] uint64, not 0: generator. `cards` [rows] int32: permutation of the numbers of its recorded rows, then of
    its simulated ones. `sizes` [2]: number of each. `at` [3]: next card of either, and minibatches left in the epoch.
    """

    dice: Any
    cards: Any
    sizes: Any
    at: Any


@njit(fastmath=_FAST, error_model="numpy", nogil=True, cache=True)
def advance(rows: Any, deck: Deck, weights: Any, state: Any, first: int, steps: int, learning_rate: float) -> None:
    """Make Adam steps on a network, in place.

    rows [n, 5]; weights [2] of a recorded and of a simulated row in the loss; state [3, 50] parameters and Adam's two
    moments; `first` steps were made before.
    """
    p, m, v = state[0], state[1], state[2]
    slope, hidden, d = np.empty(PARAMETERS, Real), np.empty(_NODES, Real), np.empty(2, Real)
    picked = np.zeros(2 * BATCH, np.int32)
    for step in range(steps):
        deal(deck, picked)
        slope[:] = _ZERO
        for place in range(2 * BATCH):
            row = rows[picked[place]]
            for j in range(_NODES):
                hidden[j] = sigmoid(p[_B1 + j] + row[0] * p[j] + row[1] * p[_NODES + j] + row[2] * p[2 * _NODES + j])
            for k in range(2):
                total = p[_B2 + k]
                for j in range(_NODES):
                    total += hidden[j] * p[_W2 + 2 * j + k]
                d[k] = weights[place // BATCH] * (sigmoid(total) - row[3 + k])      # by the summed cross-entropy
                slope[_B2 + k] += d[k]
            for j in range(_NODES):
                h = hidden[j]
                back = (d[0] * p[_W2 + 2 * j] + d[1] * p[_W2 + 2 * j + 1]) * h * (_ONE - h)
                slope[_W2 + 2 * j] += h * d[0]
                slope[_W2 + 2 * j + 1] += h * d[1]
                for feature in range(3):
                    slope[feature * _NODES + j] += row[feature] * back
                slope[_B1 + j] += back
        time = float(first + step + 1)
        rate, unbias = Real(learning_rate / (1.0 - _KEPT_1**time)), Real(1.0 / (1.0 - _KEPT_2**time))
        for k in range(PARAMETERS):
            m[k] = _OLD_1 * m[k] + _NEW_1 * slope[k]
            v[k] = _OLD_2 * v[k] + _NEW_2 * slope[k] * slope[k]
            p[k] -= rate * m[k] / (np.sqrt(v[k] * unbias) + _EPSILON)


@njit(nogil=True, cache=True)
def deal(deck: Deck, picked: Any) -> None:
    """Write the row numbers of a network's next minibatch into picked [20]: ten recorded rows, then ten simulated
    ones.

    Both come from permutations: an epoch goes once through the simulated rows, the last minibatch filled up from the
    head of their permutation, while recorded rows are reshuffled as often as that takes. Without simulated rows an
    epoch goes once through the recorded ones, and the second half is row 0, to be weighed with nothing.
    """
    (real, simulated), cards, at = deck.sizes, deck.cards, deck.at
    if at[2] == 0:
        at[0], at[1] = 0, 0
        at[2] = ((simulated if simulated else real) + BATCH - 1) // BATCH
        _shuffle(deck.dice, cards[:real])
        _shuffle(deck.dice, cards[real:real + simulated])
    at[2] -= 1
    for place in range(BATCH):
        if at[0] == real:
            at[0] = 0
            if simulated:
                _shuffle(deck.dice, cards[:real])
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
def _shuffle(dice: Any, cards: Any) -> None:
    """Fisher and Yates's shuffle in place, on Vigna's xorshift64*; NumPy's own is ten times slower from in here."""
    x = dice[0]
    for last in range(len(cards) - 1, 0, -1):
        x ^= x >> np.uint64(12)
        x ^= x << np.uint64(25)
        x ^= x >> np.uint64(27)
        high = (x * np.uint64(0x2545F4914F6CDD1D)) >> np.uint64(32)
        other = np.int64((high * np.uint64(last + 1)) >> np.uint64(32))
        cards[last], cards[other] = cards[other], cards[last]
    dice[0] = x


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
    """Raise InputError naming what is wrong with one network's rows, lambda or seed."""
    if job.seed < 0:
        raise InputError(f"--seed is {job.seed}; it cannot be negative")
    if not 0.0 <= job.simulated_weight < math.inf:
        raise InputError(f"--lambda is {job.simulated_weight}; it must be 0 or more")
    if not len(job.real.features):
        raise InputError("no recorded shots to train on")


def batches_per_epoch(real: int, simulated: int) -> int:
    """Return the minibatches of one pass through the simulated rows, or the recorded ones without simulated ones."""
    return -(-(simulated or real) // BATCH)


def train_many(jobs: Sequence[Job], recipe: Recipe = DEFAULT_RECIPE, progress: Progress = lambda done, note: None,
               threads: int | None = None) -> list[Trained]:
    """Train every job's network, on `threads` (as many as cores), in float32; its numbers depend on job and recipe.

    InputError when a job has nothing to train on, job or recipe is nonsense, or a loss stops being a number.
    """
    for job in jobs:
        check_job(job)
    trained: list[Trained] = []
    with ThreadPoolExecutor(threads or usable_cores()) as pool:
        for one in pool.map(lambda job: _train(job, recipe, progress if len(jobs) == 1 else None), jobs):
            trained.append(one)
            progress(len(trained) / len(jobs), f"{len(trained)} trained")
    return trained


def _train(job: Job, recipe: Recipe, progress: Progress | None) -> Trained:
    """Train one network, and keep the weights that are the best on the validation rows; without any, the last."""
    rng, scaling = np.random.default_rng(job.seed), standardisation(job.real.features)
    parts = [np.zeros((0, 5)) if part is None or not len(part.features) else
             np.hstack([(part.features - scaling[0]) * scaling[1], part.labels])
             for part in (job.real, job.simulated, job.validation)]
    rows, sizes = np.concatenate(parts).astype(Real), [len(part) for part in parts]
    weights = np.array([1.0, job.simulated_weight if sizes[1] else 0.0]).astype(Real) / Real(BATCH)
    state = np.zeros((3, PARAMETERS), Real)
    state[0] = pack(initial_layers(rng))
    deck, curve = make_deck(rng, sizes[0], sizes[1]), list[CurvePoint]()
    best, best_loss, best_step = state[0].copy(), math.inf, 0
    for first in range(0, recipe.steps, recipe.check):
        step = min(first + recipe.check, recipe.steps)
        advance(rows, deck, weights, state, first, step - first, recipe.learning_rate)
        curve.append(CurvePoint(step, *_mean_losses(unpack(state[0]), rows.astype(float), sizes)))
        if not (math.isfinite(curve[-1].real) and np.isfinite(state[0]).all()):
            raise InputError(f"training diverged within {step} steps (seed {job.seed}): the loss is {curve[-1].real}; "
                             "lower --learning-rate")
        if not curve[-1].validation >= best_loss:                   # NaN without validation rows
            best, best_loss, best_step = state[0].copy(), curve[-1].validation, step
        if step - best_step >= recipe.patience:
            break
        if progress is not None:
            progress(step / recipe.steps, f"step {step}")
    return Trained(Network(*scaling, unpack(best)), best_step, round(best_step / batches_per_epoch(*sizes[:2])),
                   tuple(curve))


def _mean_losses(layers: Layers, rows: np.ndarray, sizes: Sequence[int]) -> list[float]:
    """Mean summed cross-entropy over each part of the rows [n, 5], in float64; NaN for an empty one."""
    with np.errstate(over="ignore", invalid="ignore"):
        hidden = 1.0 / (1.0 + np.exp(-(rows[:, :3] @ layers.hidden_w + layers.hidden_b)))
        out = hidden @ layers.out_w + layers.out_b
        lost = (np.logaddexp(0.0, out) - rows[:, 3:] * out).sum(axis=1)
    return [float(part.mean()) if len(part) else math.nan for part in np.split(lost, np.cumsum(sizes)[:-1])]


def make_deck(rng: np.random.Generator, real: int, simulated: int) -> Deck:
    """Return the deck of a network with so many rows; `rng` supplies one seed."""
    return Deck(rng.integers(1, 2**63, dtype=np.uint64, size=1), np.arange(real + simulated, dtype=np.int32),
                np.array([real, simulated]), np.zeros(3, np.int64))


def pack(layers: Layers) -> np.ndarray:
    """Return the parameters [50] in the kernel's order."""
    return np.concatenate([np.ravel(part) for part in layers])


def unpack(parameters: np.ndarray) -> Layers:
    """Return the layers of parameters [50]."""
    ends = np.cumsum([math.prod(shape) for shape in SHAPES])
    return Layers(*(part.reshape(shape).astype(float) for part, shape in
                    zip(np.split(np.asarray(parameters), ends[:-1]), SHAPES, strict=True)))
