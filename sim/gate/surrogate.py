"""The gate's mean and spread as a polynomial over its domain: what goes into the exported graph in place of flights.

Products of Chebyshev polynomials T_i(u) T_j(v) T_k(w), i + j + k <= degree, u, v, w the features mapped from the
domain's box to [-1, 1] and held there. One set of coefficients is the height's mean minus the target's centre in m, one
its variance in m2: a sum of smooth functions, which neither its logarithm nor its inverse is. Fitted in least squares
on a Chebyshev grid, with weights that ask for accuracy where the probabilities depend on it (a shot three metres low is
a miss whatever the third decimal) and inside the domain, where novelty is at most 1. Heights far from the target are
drawn in before the fit, and the spread with them: balls that stall or turn back give slopes that no polynomial follows.
Where even the highest degree is not good enough, the domain is narrowed until it is; outside it the robot holds.
"""

import itertools
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.stats import norm

from truearc.errors import InputError
from truearc.robot.gate import FEATURES, NOVELTY_LIMIT
from truearc.sim.gate.model import PhysicsGate
from truearc.sim.paper.network import exact_in_float32

DEGREES = (9, 12, 15)                 # tried in this order until one is good enough
OVERSAMPLED = 1.2                     # grid points along each feature for each degree
NEAR_M = 0.8                          # where the weight of those beside the target's edges has fallen to a third
MIN_WEIGHT = 1e-4
BESIDE_EDGES = 1e-3                   # weight of a shot near the target whose probabilities hardly depend on its height
EDGE_M = 0.05                         # a slope of one probability per so much has weight 1
DRAWN_IN_M, BEYOND_M = 4.0, 2.0       # heights farther from the target than the first lie at most the second beyond it
REWEIGHTED = 3                        # times that weights are raised where p is off
OFF = 0.001                           # error of p at which a weight is doubled
CUT = 0.1                             # of the range of a feature that is left out at once
CUTS = 40
RIDGE = 1e-12                         # of the normal equations, as a share of their mean diagonal
CHECKED = 30000                       # random configurations of the box; those inside the domain count
LEARNED = 20000                       # random configurations of the box; those inside the domain are fitted too: where
#                                       the recorded ones lie on a thin sheet, few points of the grid do
KNOWN_NOVELTY = 1.1                   # novelty up to which the fit cares
UNKNOWN_WEIGHT = 1e-3                 # ... and how much it cares beyond
NEAR_TARGET_M = 0.5
MAX_MEAN_ERROR_M = 0.005              # at most this at the 99th percentile of configurations that near the target
MAX_P_ERROR = 0.003                   # at most this anywhere; float32 and a denser check stay within 0.005
SMALL_P_ERROR = 0.0006                # below it no higher degree is tried
ON_FACES = 0.1                        # checks are drawn from a box so much wider on each side, and held to its faces


Domain = dict[str, list[float]]


class Errors(NamedTuple):
    """Of a surrogate against its gate: |mean error| at the 99th percentile near the target, |p error| at worst."""

    mean_m: float
    p: float

    @property
    def acceptable(self) -> bool:
        return self.mean_m <= MAX_MEAN_ERROR_M and self.p <= MAX_P_ERROR


@dataclass(frozen=True, eq=False)
class Surrogate:
    """`middle` and `per_half` [3] map features to [-1, 1]; `orders` [M, 3] are the i, j, k of each product.

    `coefficients` [2, M]: of the mean in m and of the variance in m2; `degree` the largest i + j + k.

    `least_m2`: below it the variance is not let, whatever the polynomial does far from the target.
    """

    middle: np.ndarray
    per_half: np.ndarray
    orders: np.ndarray
    coefficients: np.ndarray
    least_m2: float

    @property
    def degree(self) -> int:
        return int(self.orders.sum(axis=1).max())

    def latent(self, features: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard deviation of the height minus the target's centre, [n] in m, of features [n, 3]."""
        u = np.clip((np.asarray(features, np.float64) - self.middle) * self.per_half, -1.0, 1.0)
        mean_m, square_m2 = (products(u, self.orders) @ self.coefficients.T).T
        return mean_m, np.sqrt(np.maximum(square_m2, self.least_m2))


def make_surrogate(gate: PhysicsGate, domain: Domain) -> tuple[Surrogate, Errors, Domain]:
    """Return the least surrogate that is exact enough over `domain`, else the best; and the domain where it is good.

    domain: {feature: [low, high]}. It comes back narrowed where no polynomial follows the physics over all of it.

    Raises:
        InputError: none does over any part of it.
    """
    box = np.array([domain[feature.name] for feature in FEATURES])
    for cut in range(CUTS):
        checks = inside(gate, box, CHECKED, 0)
        wanted = gate.latent(checks)
        found: list[tuple[Surrogate, Errors]] = []
        for degree in DEGREES if cut == 0 else DEGREES[-1:]:
            surrogate = fit_surrogate(gate, box, degree)
            found.append((surrogate, compare(gate, surrogate, checks, wanted)))
            if found[-1][1].acceptable and found[-1][1].p <= SMALL_P_ERROR:
                break
        surrogate, errors = min(found, key=lambda one: (not one[1].acceptable, one[1].p))
        if errors.acceptable:
            return surrogate, errors, {one.name: list(edges) for one, edges in zip(FEATURES, box.tolist(), strict=True)}
        box = _narrowed(gate, surrogate, box, checks, wanted)
    raise InputError(f"no polynomial of degree {DEGREES[-1]} follows the physics anywhere: the mean is off by "
                     f"{errors.mean_m:.4f} m near the target, p by {errors.p:.4f}")


def _narrowed(gate: PhysicsGate, surrogate: Surrogate, box: np.ndarray, checks: np.ndarray,
              wanted: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """The box [3, 2] without the slice at one of its faces that has most of the wrong p and least of what was recorded.
    """
    p = np.abs(gate.judge(*surrogate.latent(checks)) - gate.judge(*wanted)).max(axis=1)
    bad = np.maximum(p - 0.5 * MAX_P_ERROR, 0.0)
    recorded = gate.novelty.landmarks / gate.novelty.scale + gate.novelty.mean
    step = CUT * (box[:, 1] - box[:, 0])

    def worth(feature: int, side: int) -> float:
        def cut_off(rows: np.ndarray) -> np.ndarray:
            return np.asarray(rows[:, feature] < box[feature, 0] + step[feature] if side == 0 else
                              rows[:, feature] > box[feature, 1] - step[feature])
        return float(bad[cut_off(checks)].sum() / max(bad.sum(), 1e-12) - cut_off(recorded).mean())

    feature, side = max(itertools.product(range(len(box)), (0, 1)), key=lambda face: worth(*face))
    narrowed = box.copy()
    narrowed[feature, side] += step[feature] if side == 0 else -step[feature]
    return narrowed


def inside(gate: PhysicsGate, box: np.ndarray, count: int, seed: int) -> np.ndarray:
    """Those of `count` random configurations of the box, many of them on its faces, that lie inside the domain."""
    margin = ON_FACES * (box[:, 1] - box[:, 0])
    drawn = np.random.default_rng(seed).uniform(box[:, 0] - margin, box[:, 1] + margin, (count, len(box)))
    held = np.clip(drawn, box[:, 0], box[:, 1])
    return held[gate.novelty(held) <= NOVELTY_LIMIT]


def fit_surrogate(gate: PhysicsGate, box: np.ndarray, degree: int) -> Surrogate:
    """Least squares on a Chebyshev grid over box [3, 2] (low, high), and on more points inside the domain."""
    half = np.maximum(0.5 * (box[:, 1] - box[:, 0]), 1e-6)
    middle = 0.5 * (box[:, 0] + box[:, 1])
    points = int(np.ceil(OVERSAMPLED * (degree + 1)))
    nodes = np.cos(np.pi * np.arange(points) / (points - 1))           # the faces included: nothing is extrapolated
    grid = np.stack(np.meshgrid(nodes, nodes, nodes, indexing="ij"), axis=-1).reshape(-1, 3)
    features = np.concatenate([middle + half * grid, inside(gate, box, LEARNED, 1)])
    orders = np.array([order for order in itertools.product(range(degree + 1), repeat=3) if sum(order) <= degree])
    wanted, novelty = gate.judge(*(latent := gate.latent(features))), gate.novelty(features)
    mean_m, sigma_m = drawn_in(*latent)
    columns = products(np.clip((features - middle) / half, -1.0, 1.0), orders)
    beside = BESIDE_EDGES * np.maximum(np.exp(-((mean_m / NEAR_M) ** 2)), MIN_WEIGHT)
    weight = np.maximum((EDGE_M * steepest(gate, mean_m, sigma_m)) ** 2, beside)
    weight *= np.where(novelty <= KNOWN_NOVELTY, 1.0, UNKNOWN_WEIGHT)
    least_m2 = float(np.float32(0.5 * np.min(sigma_m) ** 2))
    for _ in range(REWEIGHTED + 1):
        solved = np.stack([_solve(columns, weight, mean_m), _solve(columns, weight / sigma_m**2, sigma_m**2)])
        given_m, square_m2 = (columns @ solved.T).T
        off = np.abs(gate.judge(given_m, np.sqrt(np.maximum(square_m2, least_m2))) - wanted).max(axis=1)
        weight = weight * np.where(novelty <= NOVELTY_LIMIT, 1.0 + off / OFF, 1.0)
    return Surrogate(exact_in_float32(middle), exact_in_float32(1.0 / half), orders, solved, least_m2)


def drawn_in(mean_m: np.ndarray, sigma_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Heights [n] at most DRAWN_IN_M + BEYOND_M from the target, and spreads [n] in proportion: p hardly
    change, for such a shot is a miss."""
    far_m = np.abs(mean_m)
    held_m = DRAWN_IN_M + BEYOND_M * np.tanh((far_m - DRAWN_IN_M) / BEYOND_M)
    share = np.where(far_m > DRAWN_IN_M, held_m / np.maximum(far_m, DRAWN_IN_M), 1.0)
    return mean_m * share, sigma_m * share


def steepest(gate: PhysicsGate, mean_m: np.ndarray, sigma_m: np.ndarray) -> np.ndarray:
    """The largest change [n] of a probability by the height, per m: at the nearest edge of the two or the three."""
    edges_m = (gate.shape.two_m, gate.shape.three_m, -gate.shape.two_m, -gate.shape.three_m)
    return np.asarray(np.max([norm.pdf((edge_m - mean_m) / sigma_m) / sigma_m for edge_m in edges_m], axis=0))


def _solve(columns: np.ndarray, weight: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Weighted least squares by its normal equations: the columns are nearly orthogonal, and this is quick."""
    weighted = columns * weight[:, None]
    normal = columns.T @ weighted
    normal[np.diag_indices_from(normal)] += RIDGE * np.trace(normal) / len(normal)
    return np.linalg.solve(normal, weighted.T @ values)


def compare(gate: PhysicsGate, surrogate: Surrogate, features: np.ndarray,
            wanted: tuple[np.ndarray, np.ndarray] | None = None) -> Errors:
    """Errors on feature rows [n, 3]; `wanted` is the gate's own latent there, if it is known already."""
    mean_m, sigma_m = wanted or gate.latent(features)
    given_m, spread_m = surrogate.latent(features)
    near = np.abs(mean_m) < NEAR_TARGET_M
    worst_m = float(np.quantile(np.abs(given_m - mean_m)[near], 0.99)) if near.any() else 0.0
    return Errors(worst_m, float(np.abs(gate.judge(given_m, spread_m) - gate.judge(mean_m, sigma_m)).max()))


def products(u: np.ndarray, orders: np.ndarray) -> np.ndarray:
    """T_i T_j T_k at u [n, 3] in [-1, 1] for orders [M, 3]: [n, M]."""
    turn = np.arccos(u)
    single = np.cos(turn[:, :, None] * np.arange(orders.max() + 1))
    return np.asarray(single[:, 0, orders[:, 0]] * single[:, 1, orders[:, 1]] * single[:, 2, orders[:, 2]])


def as_cosines(surrogate: Surrogate) -> tuple[np.ndarray, np.ndarray]:
    """The same polynomials as sums of cosines: frequencies [F, 3] and amplitudes [2, F] of cos(f . arccos u).

    A product of three cosines is a quarter of the sum of four, of turns i a +- j b +- k c; equal ones are put together.
    """
    signs = np.array([(1, 1, 1), (1, 1, -1), (1, -1, 1), (1, -1, -1)])
    turns = (surrogate.orders[:, None, :] * signs).reshape(-1, 3)
    first = turns[np.arange(len(turns)), (turns != 0).argmax(axis=1)]
    turns = np.where(first[:, None] < 0, -turns, turns)               # cos is even
    frequencies, which = np.unique(turns, axis=0, return_inverse=True)
    amplitudes = np.zeros((2, len(frequencies)))
    np.add.at(amplitudes.T, which.ravel(), 0.25 * np.repeat(surrogate.coefficients.T, len(signs), axis=0))
    return frequencies, amplitudes
