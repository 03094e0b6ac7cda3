"""Training of the physics-informed gate from shots and a belief, its value on unseen shots, and its polynomial form.

In the exported graph a polynomial replaces simulated flights: it gives the gate's mean and spread over its domain. Its
terms are products of Chebyshev polynomials T_i(u) T_j(v) T_k(w), i + j + k <= degree; u, v and w are the features
mapped from the domain's box to [-1, 1] and clipped. One set of coefficients gives the mean height minus the target's
centre in m, and another gives its variance in m2, which, unlike its logarithm or inverse, is a sum of smooth functions.
The least-squares fit on a Chebyshev grid favours points where the probabilities are sensitive (a shot three metres low
is a miss regardless of the third decimal) and points inside the domain, where novelty is at most 1. Heights far from
the target, and their spread, are compressed before the fit: no polynomial can follow the slopes of balls that stall or
turn back. At an opening that faces up, the place where a ball comes down is not smooth where it barely reaches the rim;
there, the polynomials give by how many standard deviations it passes the near and the far edge. If even the highest
degree is too inaccurate, the domain is narrowed; outside the domain, the robot holds its fire.
"""

import itertools
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.stats import norm

from truearc.errors import InputError
from truearc.robot.config.rig_spec import Rig, Target
from truearc.robot.config.targets import SIDES_UPRIGHT
from truearc.robot.gate import FEATURES, NOVELTY_LIMIT
from truearc.sim.data.dataset import Shots
from truearc.sim.gate import model
from truearc.sim.gate.model import GateData, Physics, PhysicsGate
from truearc.sim.infer.belief import Belief
from truearc.sim.infer.likelihood.score_table import FOLDS
from truearc.sim.paper.network import exact_in_float32, usable_rows
from truearc.sim.physics.simulate import MISS, THREE, TWO
from truearc.sim.printed import Progress
from truearc.sim.statistics import Figures, figures_of, log_scores

DEGREES = (9, 12, 15)                 # tried in this order until one is good enough
OVERSAMPLED = 1.2                     # grid points along each feature for each degree
NEAR_M = 0.8                          # where the weight of those beside the target's edges has fallen to a third
MIN_WEIGHT = 1e-4                     # of those beside the edges
BESIDE_EDGES = 1e-3                   # weight of a shot near the target whose probabilities hardly depend on its height
EDGE_M = 0.05                         # a slope of one probability per so much has weight 1
DRAWN_IN_M, BEYOND_M = 4.0, 2.0       # heights farther from the target than the first lie at most the second beyond it
REWEIGHTED = 3                        # times that weights are raised where p is off
OFF = 0.001                           # error of p at which a weight is doubled
CUT = 0.1                             # of the range of a feature that is left out at once
CUTS = 40                             # at most
RIDGE = 1e-12                         # of the normal equations, as a share of their mean diagonal
LEAST_APART = 1e-3                    # of an opening's edges, in standard deviations: far from it p is 0
MOST_RAISED = 3.0                     # times, of such a weight at once: no polynomial follows balls that turn back
DEGREE_UP = 12                        # measured: at 15 p is no closer
UNSURE = 0.05                         # p of a hit from which on, and to 1 less it, the place matters
PASSED = 3.0                          # times DRAWN_IN_M: standard deviations from an edge up to which they are as is
CHECKED = 30000                       # random configurations of the box; those inside the domain count
LEARNED = 20000                       # random configurations of the box; those inside the domain are fitted too: where
#                                       the recorded ones lie on a thin sheet, few points of the grid do
KNOWN_NOVELTY = 1.1                   # novelty up to which the fit cares
UNKNOWN_WEIGHT = 1e-3                 # ... and how much it cares beyond
NEAR_TARGET_M = 0.5                   # chosen: where hits are, and a little more
# Chosen: as FLOOR_M, and p to less than a page shows. Measured: 50 seasons stay within these (TRUEARC_SEASONS=1 pytest
# tests/model_export/test_doors.py)
MAX_MEAN_ERROR_M = 0.005              # at most this at the 99th percentile of configurations that near the target
# Measured likewise
MAX_P_ERROR = 0.003                   # at most this anywhere; float32 and a denser check stay within 0.005
SMALL_P_ERROR = 0.0006                # below it no higher degree is tried; chosen: a fifth of the limit
ON_FACES = 0.1                        # checks are drawn from a box so much wider on each side, and held to its faces


Domain = dict[str, list[float]]


class Errors(NamedTuple):
    """Errors of a surrogate against its gate: 99th percentile of |mean error| near the target, and largest |p
    error|."""

    mean_m: float
    p: float

    @property
    def acceptable(self) -> bool:
        return self.mean_m <= MAX_MEAN_ERROR_M and self.p <= MAX_P_ERROR


@dataclass(frozen=True, eq=False)
class Surrogate:
    """`middle` and `per_half` [3] map features to [-1, 1]; `orders` [M, 3] are the i, j, k of each product.

    `coefficients` [2, M]: of the mean in m and of the variance in m2; `degree` the largest i + j + k. Of an opening
    that faces up: of the passages of its near and its far edge, half_m from its middle, in standard deviations.

    `least_m2`: below it the variance is not let, whatever the polynomial does far from the target.
    """

    middle: np.ndarray
    per_half: np.ndarray
    orders: np.ndarray
    coefficients: np.ndarray
    least_m2: float
    half_m: float = 0.0

    @property
    def degree(self) -> int:
        return int(self.orders.sum(axis=1).max())

    def latent(self, features: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return mean and standard deviation of the height minus the target's centre, [n] in m, of features [n, 3]."""
        u = np.clip((np.asarray(features, np.float64) - self.middle) * self.per_half, -1.0, 1.0)
        mean_m, square_m2 = (products(u, self.orders) @ self.coefficients.T).T
        if self.half_m:
            near, far = mean_m, square_m2
            apart = np.maximum(near - far, LEAST_APART)
            return self.half_m * (near + far) / apart, 2.0 * self.half_m / apart
        return mean_m, np.sqrt(np.maximum(square_m2, self.least_m2))


def make_surrogate(gate: PhysicsGate, domain: Domain) -> tuple[Surrogate, Errors, Domain]:
    """Return the smallest surrogate that is accurate enough over `domain`, else the best, and the domain where it is
    good.

    domain: {feature: [low, high]}. It comes back narrowed where no polynomial follows the physics over all of it.

    Raises:
        InputError: none does over any part of it.
    """
    box = np.array([domain[feature.name] for feature in FEATURES])
    up = gate.rig.target is not None and gate.rig.target.faces_up
    for cut in range(CUTS):
        checks, learned = inside(gate, box, CHECKED, 0), inside(gate, box, LEARNED, 1)
        wanted, known = gate.latent(checks), gate.latent(learned)
        found: list[tuple[Surrogate, Errors]] = []
        for degree in (DEGREE_UP,) if up else DEGREES if cut == 0 else DEGREES[-1:]:
            surrogate = fit_surrogate(gate, box, degree, learned, known)
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
    """Return those of `count` random configurations of the box, many of them on its faces, that lie inside the
    domain."""
    margin = ON_FACES * (box[:, 1] - box[:, 0])
    drawn = np.random.default_rng(seed).uniform(box[:, 0] - margin, box[:, 1] + margin, (count, len(box)))
    held = np.clip(drawn, box[:, 0], box[:, 1])
    return held[gate.novelty(held) <= NOVELTY_LIMIT]


def fit_surrogate(gate: PhysicsGate, box: np.ndarray, degree: int, learned: np.ndarray,
                  known: tuple[np.ndarray, np.ndarray]) -> Surrogate:
    """Fit by least squares on a Chebyshev grid over box [3, 2] (low, high), and on more points inside the domain.

    learned: those points [n, 3]; known: the gate's latent there, which flies each of them and costs most of a fit.
    """
    half = np.maximum(0.5 * (box[:, 1] - box[:, 0]), 1e-6)
    middle = 0.5 * (box[:, 0] + box[:, 1])
    points = int(np.ceil(OVERSAMPLED * (degree + 1)))
    nodes = np.cos(np.pi * np.arange(points) / (points - 1))           # the faces included: nothing is extrapolated
    grid = np.stack(np.meshgrid(nodes, nodes, nodes, indexing="ij"), axis=-1).reshape(-1, 3)
    features = np.concatenate([middle + half * grid, learned])
    orders = np.array([order for order in itertools.product(range(degree + 1), repeat=3) if sum(order) <= degree])
    on_grid = gate.latent(middle + half * grid)
    latent = np.concatenate([on_grid[0], known[0]]), np.concatenate([on_grid[1], known[1]])
    wanted, novelty = gate.judge(*latent), gate.novelty(features)
    columns = products(np.clip((features - middle) / half, -1.0, 1.0), orders)
    if gate.rig.target is not None and gate.rig.target.faces_up:
        return _fit_edges(gate, Surrogate(exact_in_float32(middle), exact_in_float32(1.0 / half), orders,
                                          np.zeros((2, len(orders))), 0.0, gate.shape.two_m), columns, latent, novelty)
    mean_m, sigma_m = drawn_in(*latent)
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


def _fit_edges(gate: PhysicsGate, surrogate: Surrogate, columns: np.ndarray, latent: tuple[np.ndarray, np.ndarray],
               novelty: np.ndarray) -> Surrogate:
    """Return the surrogate with polynomials of the passages of both edges: they are smooth where the place is not,
    since a ball that barely reaches the rim comes down anywhere.

    columns: products at the points; latent, novelty: the gate's there.
    """
    wanted = gate.judge(*latent)[:, 0]
    edges = [PASSED * drawn_in((latent[0] + side * surrogate.half_m) / latent[1] / PASSED, latent[1])[0]
             for side in (1.0, -1.0)]
    weights = [np.maximum(norm.pdf(edge)**2, MIN_WEIGHT * np.exp(-((edge / PASSED / DRAWN_IN_M)**2)))
               * np.where(novelty <= KNOWN_NOVELTY, 1.0, UNKNOWN_WEIGHT) for edge in edges]
    for _ in range(REWEIGHTED + 1):
        solved = np.stack([_solve(columns, *one) for one in zip(weights, edges, strict=True)])
        near, far = (columns @ solved.T).T
        apart = np.maximum(near - far, LEAST_APART)
        given = gate.judge(surrogate.half_m * (near + far) / apart, 2.0 * surrogate.half_m / apart)[:, 0]
        more = np.where(novelty <= NOVELTY_LIMIT, np.minimum(1.0 + np.abs(given - wanted) / OFF, MOST_RAISED), 1.0)
        weights = [weight * more for weight in weights]
    return replace(surrogate, coefficients=solved)


def drawn_in(mean_m: np.ndarray, sigma_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return heights [n] limited to DRAWN_IN_M + BEYOND_M from the target, and spreads [n] in proportion.

    p hardly changes, since such a shot is a miss.
    """
    far_m = np.abs(mean_m)
    held_m = DRAWN_IN_M + BEYOND_M * np.tanh((far_m - DRAWN_IN_M) / BEYOND_M)
    share = np.where(far_m > DRAWN_IN_M, held_m / np.maximum(far_m, DRAWN_IN_M), 1.0)
    return mean_m * share, sigma_m * share


def steepest(gate: PhysicsGate, mean_m: np.ndarray, sigma_m: np.ndarray) -> np.ndarray:
    """Return the largest derivative [n] of a probability by the height, per m: at the nearest edge of the two or the
    three."""
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
    """Return the errors on feature rows [n, 3]; `wanted` is the gate's own latent there, if already known."""
    mean_m, sigma_m = wanted or gate.latent(features)
    given_m, spread_m = surrogate.latent(features)
    p = gate.judge(mean_m, sigma_m)
    near = np.abs(mean_m) < NEAR_TARGET_M
    if surrogate.half_m:              # well inside the opening, or with a wider spread, p hardly depends on it
        near = (np.abs(p[:, 0] - 0.5) < 0.5 - UNSURE) & (sigma_m < surrogate.half_m)
    worst_m = float(np.quantile(np.abs(given_m - mean_m)[near], 0.99)) if near.any() else 0.0
    return Errors(worst_m, float(np.abs(gate.judge(given_m, spread_m) - p).max()))


def products(u: np.ndarray, orders: np.ndarray) -> np.ndarray:
    """Return T_i T_j T_k at u [n, 3] in [-1, 1] for orders [M, 3]: [n, M]."""
    single = np.cos(np.arccos(u)[:, :, None] * np.arange(orders.max() + 1))
    return np.asarray(single[:, 0, orders[:, 0]] * single[:, 1, orders[:, 1]] * single[:, 2, orders[:, 2]])


def as_cosines(surrogate: Surrogate) -> tuple[np.ndarray, np.ndarray]:
    """Return the polynomials as sums of cosines: frequencies [F, 3] and amplitudes [2, F] of cos(f . arccos u).

    A product of three cosines is a quarter of the sum of four, with angles i a +- j b +- k c; equal ones are merged.
    """
    signs = np.array([(1, 1, 1), (1, 1, -1), (1, -1, 1), (1, -1, -1)])
    turns = (surrogate.orders[:, None, :] * signs).reshape(-1, 3)
    first = turns[np.arange(len(turns)), (turns != 0).argmax(axis=1)]
    turns = np.where(first[:, None] < 0, -turns, turns)               # cos is even
    frequencies, which = np.unique(turns, axis=0, return_inverse=True)
    amplitudes = np.zeros((2, len(frequencies)))
    np.add.at(amplitudes.T, which.ravel(), 0.25 * np.repeat(surrogate.coefficients.T, len(signs), axis=0))
    return frequencies, amplitudes


# The plane from below to above: miss low, two low, three, two high, miss high.
CELLS = 5                             # definition
UNKNOWN = (1,) * CELLS
CELLS_OF = {(MISS, ""): (1, 0, 0, 0, 1), (TWO, ""): (0, 1, 0, 1, 0), (THREE, ""): (0, 0, 1, 0, 0),
            (MISS, "low"): (1, 0, 0, 0, 0), (MISS, "high"): (0, 0, 0, 0, 1),
            (TWO, "low"): (0, 1, 0, 0, 0), (TWO, "high"): (0, 0, 0, 1, 0),
            # beside the centre: of the height it says no more than that it was within the two
            (TWO, "left"): (0, 1, 1, 1, 0), (TWO, "right"): (0, 1, 1, 1, 0),
            (MISS, "left"): UNKNOWN, (MISS, "right"): UNKNOWN}
ASIDE = ("left", "right")
LEVEL = {MISS: 0, TWO: 1, THREE: 2}
MIN_CONFIGURATIONS = 15               # chosen: three a fold
TEMPERATURES = np.exp(np.linspace(np.log(0.6), np.log(1.8), 23))  # steps of 5 %
# Derived: as 22 shots tell a spread, 1 / sqrt(2 n)
TEMPERATURE_SPREAD = 0.15             # of its log, a priori: chance in a few shots does not move it far
BEYOND = 0.1                          # of the recorded range: where z stops on either side; chosen: a tenth of it
SILENT_M = 0.02                       # a residual smaller than this is not worth a sentence; derived: as HEIGHT_M


class OutcomeClasses(NamedTuple):
    """Informative shots, one per row.

    features [n, 3] in the contract's order; cells [n, 5]: 1 where the height may have been, by the outcome and side;
    miss_m [n]: measured height minus the target's centre, nan where not measured (it then overrides the cells);
    level [n]: 0 miss, 1 two, 2 three, -1 not judged; aside [n]: a miss to the left or right, whose cells are all 1;
    group [n]: rows of one configuration share a number; shot_id [n].
    """

    features: np.ndarray
    cells: np.ndarray
    miss_m: np.ndarray
    level: np.ndarray
    aside: np.ndarray
    group: np.ndarray
    shot_id: np.ndarray

    def take(self, rows: np.ndarray) -> "OutcomeClasses":
        return OutcomeClasses(*(column[rows] for column in self))


def outcome_classes_of(shots: Shots, name: str, target: Target | None = None) -> tuple[OutcomeClasses, list[str]]:
    """Return the outcome classes of shots, and a sentence for each kind of shot of `name` left out.

    target: of the rig; where every hit counts alike, a hit is a three. InputError when no shot is left.
    """
    outcome, side, miss_m = shots.text("outcome"), shots.text("side"), shots.number("miss_height_m")
    if target is not None and target.faces_up:
        side = tuple(SIDES_UPRIGHT.get(one, one) for one in side)
    if target is not None and target.hit_or_miss:
        outcome = tuple(THREE if one == TWO else one for one in outcome)
    silent = np.array([one not in LEVEL for one in outcome], bool) & np.isnan(miss_m)
    features, kept, left_out = usable_rows(shots, name, silent, "no outcome or miss_height_m")
    cells = np.array([CELLS_OF.get((outcome[row], side[row]), CELLS_OF.get((outcome[row], ""), UNKNOWN))
                      for row in kept], float)
    level = np.array([LEVEL.get(outcome[row], -1) for row in kept])
    aside = np.array([outcome[row] == MISS and side[row] in ASIDE for row in kept])
    return OutcomeClasses(features, cells, miss_m[kept], level, aside, _groups(shots, kept),
                          np.array(shots.shot_id)[kept]), left_out


def _groups(shots: Shots, kept: np.ndarray) -> np.ndarray:
    """Shots of one session with one config_id are a group; a shot without a config_id is one by itself. Their numbers
    do not depend on the order of rows."""
    session, config = shots.text("session"), shots.text("config_id")
    keys = [(session[row], config[row]) if config[row] else ("", shots.shot_id[row]) for row in kept]
    numbers = {key: number for number, key in enumerate(sorted(set(keys)))}
    return np.array([numbers[key] for key in keys])


@dataclass(frozen=True, eq=False)
class Heldout:
    """Shots rated by gates that had not seen their configuration; the belief had.

    p [n, 2] and level [n] of the judged rows; `plain`: the same before calibration; `physics`: by the forecast alone,
    as the belief has it. The temperature of each fold is chosen on the others.
    """

    p: np.ndarray
    level: np.ndarray
    plain: Figures
    calibrated: Figures
    physics: Figures


def train_physics_gate(rig: Rig, belief: Belief, shots: Shots, seed: int = 0, name: str = "shots",
                       progress: Progress = lambda done, note: None) -> tuple[PhysicsGate, Heldout | None]:
    """Fit the gate to these shots, and rate it out of fold (None with too few judged configurations).

    The same arguments give the same gate. InputError when nothing can be learned.

    Folds are of configurations, drawn by seed. The temperature is kept only when it adds to the log score of folds
    that it was not chosen on.
    """
    marks, _ = outcome_classes_of(shots, name, rig.target)
    physics = model.physics_of(rig, belief, marks.features)
    progress(0.3, "forecasts made")
    gate = _fit(rig, belief, marks, physics, np.ones(len(marks.level)))
    progress(0.5, "fitted")
    fold = folds(marks.group, seed)
    if fold is None or (marks.level >= 0).sum() < MIN_CONFIGURATIONS:
        return gate, None
    heldout = []
    for number in range(FOLDS):
        fitted = _fit(rig, belief, marks, physics, (fold != number).astype(float))
        rows = np.flatnonzero((fold == number) & (marks.level >= 0))
        latent = fitted.correct(marks.features[rows], Physics(*(column[rows] for column in physics)))
        heldout.append(_Fold(fitted, *latent, marks.level[rows]))
        progress(0.5 + 0.5 * (number + 1) / FOLDS, f"fold {number + 1} of {FOLDS}")
    return _calibrate(gate, heldout, _alone(gate, physics, marks))


def folds(group: np.ndarray, seed: int) -> np.ndarray | None:
    """Return the fold [n] of each row: groups spread evenly in an order drawn by seed; None if there are too few."""
    names = np.unique(group)
    if len(names) < MIN_CONFIGURATIONS:
        return None
    deal = np.empty(len(names), np.int64)
    deal[np.random.default_rng([seed, 5]).permutation(len(names))] = np.arange(len(names)) % FOLDS
    return deal[np.searchsorted(names, group)]


@dataclass(frozen=True, eq=False)
class _Fold:
    gate: PhysicsGate
    mean_m: np.ndarray
    sigma_m: np.ndarray
    level: np.ndarray

    def p(self, temperature: float) -> np.ndarray:
        return self.gate.judge(self.mean_m, temperature * self.sigma_m)


def _fit(rig: Rig, belief: Belief, marks: OutcomeClasses, physics: Physics, weight: np.ndarray) -> PhysicsGate:
    seen = marks.features[weight > 0.0]
    scaling = scaling_of(seen)
    data = GateData(scaling(marks.features), *physics, marks.cells, marks.miss_m, weight * ~marks.aside)
    aside = float((marks.aside * weight).sum() / weight.sum())
    fit = model.fit_widest(data, model.halves_of(rig))
    return PhysicsGate(rig, belief, scaling, fit, 1.0, aside, model.fit_novelty(seen))


def scaling_of(features: np.ndarray) -> model.Scaling:
    """Return the standardisation by these rows [n, 3]; a feature that never varies has deviation 1."""
    mean, deviation = features.mean(axis=0), features.std(axis=0)
    deviation = np.where(deviation > 1e-9, deviation, 1.0)
    low, high = ((edge - mean) / deviation for edge in (features.min(axis=0), features.max(axis=0)))
    margin = BEYOND * (high - low)
    return model.Scaling(mean, deviation, low - margin, high + margin)


def _calibrate(gate: PhysicsGate, parts: list[_Fold], alone: Figures) -> tuple[PhysicsGate, Heldout]:
    """The gate with the temperature of all folds, if temperatures chosen on the other folds did better than none."""
    table = np.array([[log_scores(part.p(t), part.level).sum() for t in TEMPERATURES] for part in parts])
    prior = -0.5 * (np.log(TEMPERATURES) / TEMPERATURE_SPREAD) ** 2
    chosen = [float(TEMPERATURES[np.argmax(prior + table.sum(axis=0) - row)]) for row in table]
    level = np.concatenate([part.level for part in parts])
    plain = np.concatenate([part.p(1.0) for part in parts])
    warmed = np.concatenate([part.p(t) for part, t in zip(parts, chosen, strict=True)])
    kept = log_scores(warmed, level).sum() > log_scores(plain, level).sum()
    best = float(TEMPERATURES[np.argmax(prior + table.sum(axis=0))]) if kept else 1.0
    p = warmed if kept else plain
    return replace(gate, temperature=best), Heldout(p, level, figures_of(plain, level), figures_of(p, level), alone)


def _alone(gate: PhysicsGate, physics: Physics, marks: OutcomeClasses) -> Figures:
    """The forecast with nothing learned here: spread as the belief has it, half-heights of rig.toml, judged rows."""
    two_m, three_m = model.halves_of(gate.rig)
    shape = model.GateShape(1.0, model.PRIORS["floor_m"][0], two_m, min(three_m, two_m), model.PRIORS["lapse"][0])
    judged = marks.level >= 0
    spread_m = model.spread_m(shape, physics.sigma_m)
    cells = np.asarray(model.cell_probabilities(shape, physics.deviation_m, spread_m))[judged]
    return figures_of(np.stack([cells[:, 1:4].sum(axis=1), cells[:, 2]], axis=1), marks.level[judged])


def tell_residual(gate: PhysicsGate, features: np.ndarray, physics: Physics) -> list[str]:
    """Report the error of the physics alone, and the scatter of shots, at near, middle and far recorded shots [n,
    3]."""
    learned_m, _ = model.residual(gate.fit, gate.scaling(features), physics)
    _, sigma_m = gate.correct(features, physics)
    order = np.array_split(np.argsort(features[:, 0], kind="stable"), 3)
    lines, target = [], gate.rig.target
    up = target is not None and target.faces_up
    high, low, comes = ("long", "short", "comes down") if up else ("high", "low", "passes")
    for rows in (rows for rows in order if rows.size):
        at_m, off_m = float(np.median(features[rows, 0])), -float(np.median(learned_m[rows]))
        side = high if off_m > 0.0 else low
        said = "the shots move the physics by less than 2 cm" if abs(off_m) < SILENT_M else (
            f"the physics alone is {100.0 * abs(off_m):.0f} cm {side}")
        lines.append(f"at {at_m:.1f} m {said}; "
                     f"a shot {comes} within {100.0 * float(np.median(sigma_m[rows])):.0f} cm of what the gate expects "
                     "two times in three")
    return lines


def tell_heldout(heldout: Heldout, temperature: float, target: Target | None = None) -> list[str]:
    """Report hold-out figures on configurations that the gate was not fitted to, though the belief may have been."""
    lines = ["on configurations that the correction had not learned from, each fifth in turn (the coefficients may "
             "have been fitted to them):",
             _figures("  the gate", heldout.plain), *_beside_commonest(heldout, target)]
    if temperature == 1.0:
        return [*lines, "calibration: the spread is as fitted; stretching it made unseen configurations no likelier"]
    how = "wider" if temperature > 1.0 else "narrower"
    return [*lines, _figures("  and calibrated", heldout.calibrated),
            f"calibration: the spread is made {abs(temperature - 1.0):.0%} {how}, as unseen configurations ask for"]


def _beside_commonest(heldout: Heldout, target: Target | None) -> list[str]:
    """Compare with what needs no gate: the commonest outcome for every shot, and the plain shares of outcomes."""
    shares, commonest = _commonest(heldout.level, target)
    by_shares = float((shares[shares > 0.0] * np.log(shares[shares > 0.0])).sum())
    lines = [f"  always naming the commonest, {commonest}: outcome right {shares.max():.1%}; by the plain shares of "
             f"outcomes: log score {by_shares:.3f}"]
    if heldout.calibrated.log_score <= by_shares:
        lines.append("warning: on shots that it had not seen the gate says no more than the plain shares of outcomes")
    return lines


def tell_too_few(group: np.ndarray, level: np.ndarray, target: Target | None) -> str:
    """Report that there are too few configurations [n] to hold any out, and what needs no gate. level [n]: -1 is not
    judged."""
    shares, commonest = _commonest(level[level >= 0], target)
    return (f"warning: {len(np.unique(group[level >= 0]))} configurations with an outcome are too few to say whether "
            f"the gate is better than always naming the commonest, {commonest}, which is right for {shares.max():.1%} "
            f"of them; at least {MIN_CONFIGURATIONS} are needed")


def _commonest(level: np.ndarray, target: Target | None) -> tuple[np.ndarray, str]:
    """(shares of the outcomes, the word for the commonest)."""
    shares = np.bincount(level, minlength=len(LEVEL)) / max(len(level), 1)
    commonest = list(LEVEL)[int(np.argmax(shares))]
    return shares, commonest if target is None else target.word(commonest)


def _figures(name: str, figures: Figures) -> str:
    return (f"{name}: {figures.shots} shots, outcome right {figures.accuracy:.1%}, log score {figures.log_score:.3f}, "
            f"Brier {figures.brier:.4f}, stated and true shares differ by {figures.ece:.3f}")
