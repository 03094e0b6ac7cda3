"""Adam on many 3-8-2 networks side by side: the compiled inner loop of `truearc.sim.paper.sweep`.

LANES networks advance together, the network always the last and contiguous axis, so that one vector instruction serves
several of them. Each lane does exactly the arithmetic that it would do alone: what shares its batch changes no bit.
The gradient is written out; the tests hold it against NumPy and JAX. Rows of the parameters [50]: hidden_w (feature
by feature, 8 nodes each), hidden_b, out_w (node by node, 2 outputs each), out_b.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit

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
