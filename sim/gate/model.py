"""The physics-informed gate and its fit: height at the plane = physics + a small learned residual + noise.

    y = h(x) - centre + r(x) + sigma(x) e,   e standard normal
    r(x) = height_width b . q(z) + speed_width (dh / dlog v)(x) c . q(z),   q = 1, z, z z' (10 functions)
    sigma(x)^2 = scale^2 propagated(x)^2 + floor^2
    three where |y| < three half-height, two where |y| < two half-height; a lapse gives any outcome

At an opening that faces up, y is where the ball comes down, from the middle of the places where it goes in (see
_descents_of). The second part of r is a deviation of the exit speed from that of the launch terms; the first part is
everything else.
All fitted numbers are standard normal a priori: b and c directly, and the others as logarithms standardised by PRIORS.
The evidence determines the prior width of the residual. A weights directory holds the gate in physics.json, which
determines its probabilities, and training.json.

Novelty is the distance of a configuration from the recorded ones. It defines a domain of validity that follows the
recorded cloud, because the box around the cloud has empty corners, where nothing is known. Novelty is computed as the
distance to the NEIGHBOUR-th nearest recorded configuration, with each feature in its standard deviations, divided by
the largest distance that counts as known. That distance is the LARGEST_QUANTILE of the recorded configurations' own
distances, each computed without the configuration itself.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import msgspec
import numpy as np
from jax.scipy.stats import norm
from msgspec import UnsetType, structs
from scipy.optimize import minimize
from scipy.spatial import cKDTree

import truearc.sim.physics  # noqa: F401 - the house's one switch to double precision
from truearc.errors import InputError
from truearc.robot.config.rig_spec import Rig, Target
from truearc.robot.gate import FEATURES
from truearc.sim.data.dataset import Shots
from truearc.sim.infer.belief import Belief, as_table, from_table
from truearc.sim.infer.forecast import forecast
from truearc.sim.infer.likelihood.noise import FLOOR_M, GATE_LAPSE, GATE_LAPSE_CELLS, GATE_SLIP_M, HEIGHT_M
from truearc.sim.paper import network
from truearc.sim.physics.simulate import opening_of

FUNCTIONS = 10                        # definition: of basis
RESIDUAL = 2 * FUNCTIONS
# (median, standard deviation of the log). The scale is of the propagated spread, which configurations labelled by
# repeatability have next to nothing of; half-heights are those of rig.toml, which such labels make effectively smaller.
# Chosen: the scale within a factor of two, a floor of 2 cm within three, half heights that a tape knows to a tenth,
# of the small one to three
PRIORS = {"scale": (1.0, 0.7), "floor_m": (0.02, 1.0), "two": (1.0, 0.1), "three": (1.0, 0.3), "lapse": GATE_LAPSE}
SIZE = RESIDUAL + len(PRIORS)
LAPSE_CELLS = np.array(GATE_LAPSE_CELLS)
# Tried in this order, the first with the least of the second: what the emulated robot asked for lies in the middle.
SPEED_WIDTHS = (0.01, 0.015, 0.02, 0.03, 0.05, 0.08, 0.15)
HEIGHT_WIDTHS_M = (0.001, 0.01, 0.03, 0.1)
PAD = 64                              # rows are filled up to multiples of this: each size is compiled
MAX_STEPS = 300                       # of Newton's method at most


class GateData(NamedTuple):
    """Rows [n] that the model is fitted to, or predicts; `weight` 0 leaves a row out."""

    z: Any                            # [n, 3] standardised features
    deviation_m: Any
    sigma_m: Any
    by_speed_m: Any
    cells: Any                        # [n, 5]
    miss_m: Any
    weight: Any


class Widths(NamedTuple):
    """A priori standard deviations of the residual's coefficients: m, and share of the exit speed."""

    height_m: Any
    speed: Any


class GateShape(NamedTuple):
    """What theta contains besides the residual."""

    scale: Any
    floor_m: Any
    two_m: Any
    three_m: Any
    lapse: Any


def basis(z: Any) -> Any:
    """Return constant, linear and quadratic functions [n, 10] of standardised features [n, 3], each of about unit
    size."""
    x, y, w = z[:, 0], z[:, 1], z[:, 2]
    return jnp.stack([jnp.ones_like(x), x, y, w, 0.7 * (x * x - 1.0), 0.7 * (y * y - 1.0), 0.7 * (w * w - 1.0),
                      x * y, x * w, y * w], axis=1)


def residual_basis(widths: Widths, z: Any, by_speed_m: Any) -> Any:
    """Return [n, 20] in m: the residual is this times the first RESIDUAL numbers of theta."""
    functions = basis(z)
    return jnp.concatenate([widths.height_m * functions, widths.speed * by_speed_m[:, None] * functions], axis=1)


def shape_of(theta: Any, halves_m: Any) -> GateShape:
    """Return scale, floor, half-heights and lapse of theta; halves_m: (two, three) of rig.toml."""
    scale, floor_m, two, three, lapse = (median * jnp.exp(spread * theta[RESIDUAL + k])
                                         for k, (median, spread) in enumerate(PRIORS.values()))
    two_m = two * halves_m[0]
    return GateShape(scale, floor_m, two_m, jnp.minimum(three * halves_m[1], two_m), jnp.minimum(lapse, 0.5))


def spread_m(shape: GateShape, propagated_m: Any, doubt_m: Any = 0.0) -> Any:
    """Return the standard deviation of the height; `doubt_m`: of the residual itself."""
    return jnp.sqrt((shape.scale * propagated_m) ** 2 + shape.floor_m**2 + doubt_m**2)


def cell_probabilities(shape: GateShape, mean_m: Any, sigma_m: Any) -> Any:
    """Return [n, 5]: miss low, two low, three, two high, miss high; rows sum to 1."""
    below = [norm.cdf((edge - mean_m) / sigma_m) for edge in (-shape.two_m, -shape.three_m, shape.three_m)]
    above = norm.cdf((mean_m - shape.two_m) / sigma_m)
    cells = jnp.stack([below[0], below[1] - below[0], below[2] - below[1],
                       norm.cdf((mean_m - shape.three_m) / sigma_m) - above, above], axis=1)
    return (1.0 - shape.lapse) * cells + shape.lapse * LAPSE_CELLS


def log_likelihoods(theta: Any, widths: Widths, data: GateData, halves_m: Any) -> Any:
    """Return the log probability [n] of each row's data (a log density in 1/m if the height was measured)."""
    shape = shape_of(theta, halves_m)
    mean_m = data.deviation_m + residual_basis(widths, data.z, data.by_speed_m) @ theta[:RESIDUAL]
    sigma_m = spread_m(shape, data.sigma_m)
    seen = jnp.sum(cell_probabilities(shape, mean_m, sigma_m) * data.cells, axis=1)
    measured = ~jnp.isnan(data.miss_m)
    density = norm.pdf(jnp.where(measured, data.miss_m, 0.0) - mean_m, scale=jnp.sqrt(sigma_m**2 + HEIGHT_M**2))
    anywhere = shape.lapse / (2.0 * GATE_SLIP_M)
    return jnp.log(jnp.where(measured, (1.0 - shape.lapse) * density + anywhere, jnp.maximum(seen, 1e-300)))


def loss(theta: Any, widths: Widths, data: GateData, halves_m: Any) -> Any:
    """Return minus the log posterior, up to a constant."""
    return 0.5 * theta @ theta - jnp.dot(data.weight, log_likelihoods(theta, widths, data, halves_m))


value_and_slope = jax.jit(jax.value_and_grad(loss))
curvature = jax.jit(jax.jacfwd(jax.grad(loss)))               # Hessian [SIZE, SIZE] of the loss


class GateFit(NamedTuple):
    """theta [SIZE] at the maximum, covariance [SIZE, SIZE] around it, and the log evidence (Laplace), nats."""

    widths: Widths
    theta: np.ndarray
    covariance: np.ndarray
    evidence: float


def fit_widest(data: GateData, halves_m: tuple[float, float]) -> GateFit:
    """Return the fit with the widths of largest evidence: the speed's is chosen first, then the height's;
    deterministic."""
    data = padded(data)
    best = _best(data, halves_m, [Widths(HEIGHT_WIDTHS_M[0], speed) for speed in SPEED_WIDTHS], None)
    return _best(data, halves_m, [Widths(height_m, best.widths.speed) for height_m in HEIGHT_WIDTHS_M[1:]], best)


def fit_once(data: GateData, halves_m: tuple[float, float], widths: Widths, start: np.ndarray | None = None) -> GateFit:
    """Find the MAP estimate by Newton's method in a trust region, with exact first and second derivatives."""
    halves = jnp.asarray(halves_m)

    def slope(theta: np.ndarray) -> tuple[float, np.ndarray]:
        value, gradient = value_and_slope(theta, widths, data, halves)
        return float(value), np.asarray(gradient)

    def hessian(theta: np.ndarray) -> np.ndarray:
        return np.asarray(curvature(theta, widths, data, halves))

    done = minimize(slope, np.zeros(SIZE) if start is None else start, jac=True, hess=hessian, method="trust-exact",
                    options={"gtol": 1e-7, "maxiter": MAX_STEPS})
    eigenvalues, axes = np.linalg.eigh(hessian(done.x))
    if not np.isfinite(done.fun) or not np.isfinite(eigenvalues).all():
        raise InputError("the gate could not be fitted: the likelihood of these shots is not a number")
    eigenvalues = np.maximum(eigenvalues, 1e-3)   # the prior alone gives 1: less is only where the maximum is flat
    return GateFit(widths, done.x, (axes / eigenvalues) @ axes.T, float(-done.fun - 0.5 * np.log(eigenvalues).sum()))


def padded(data: GateData) -> GateData:
    """Pad rows to a multiple of PAD with copies of weight 0."""
    have = len(data.weight)
    rows = np.resize(np.arange(have), -(-have // PAD) * PAD)
    weight = np.where(np.arange(rows.size) < have, data.weight[rows], 0.0)
    return GateData(*(np.asarray(column)[rows] for column in data))._replace(weight=weight)


def _best(data: GateData, halves_m: tuple[float, float], tried: list[Widths], best: GateFit | None) -> GateFit:
    start = None if best is None else best.theta
    for widths in tried:
        fit = fit_once(data, halves_m, widths, start)
        start = fit.theta
        if best is None or fit.evidence > best.evidence:
            best = fit
    assert best is not None
    return best


NEIGHBOUR = 3                         # a single stray shot makes no domain; many would cut the cloud's edge off; chosen
LARGEST_QUANTILE = 0.99               # chosen: one recorded shot in a hundred may be a slip
# Chosen: below what sensors tell apart
SAME_DISTANCE = 0.05                  # standard deviations: nearer than this is the same configuration again
# Measured: so a decision takes under 50 us (python -m benchmarks.gate)
MAX_LANDMARKS = 256                   # landmarks: what the exported graph measures from at every decision
# Of a launcher whose scatter has not been fitted; the gate fits one number that scales it.
TYPICAL_SCATTER = {"speed": 0.02, "elevation_deg": 0.5}  # chosen: as SCATTER_PRIOR has it, and a third more
LOWEST_M = -40.0                      # where a ball that turns back before the plane is taken to pass
STEEPEST_M = 30.0                     # per unit of log speed: beyond it a shot is far too weak to matter
FAR = 1e3                             # stands for no bound
NEAREST_M = 0.1                       # chosen: of an edge; nearer ones are below the launcher
LEAST_APART = 0.35                    # chosen: standard deviations between an opening's edges; bounds 1 / them
# Chosen: over more a flight bends
WIDEST_M = 1.5                        # first-order propagation of uncertainty does not hold for a larger spread
MODEL_FILE = "physics.json"
MODEL_SCHEMA = "truearc.physics-gate/1"
KIND = "physics"


@dataclass(frozen=True)
class Novelty:
    """`mean` and `scale` [3] standardise: z = (features - mean) * scale. `landmarks` [m, 3] are recorded z.

    `largest`: the distance, in standard deviations, that has novelty 1. All numbers are exact in float32.
    """

    mean: np.ndarray
    scale: np.ndarray
    landmarks: np.ndarray
    largest: float
    neighbour: int = NEIGHBOUR

    def __call__(self, features: np.ndarray) -> np.ndarray:
        """Novelty [n] of feature rows [n, 3] in the contract's order and units; float64."""
        z = (np.asarray(features, np.float64) - self.mean) * self.scale
        return np.asarray(cKDTree(self.landmarks).query(z, [self.neighbour])[0])[:, 0] / self.largest


def fit_novelty(features: np.ndarray) -> Novelty:
    """Return landmarks and scale from recorded feature rows [n, 3]; the same rows in the same order give the same.

    Repeats of one configuration count once; with few different configurations a nearer neighbour is used.
    """
    features = np.asarray(features, np.float64)
    mean, scale = network.standardisation(features)
    z = network.exact_in_float32((features - mean) * scale)
    landmarks = z[farthest_points(z, SAME_DISTANCE, MAX_LANDMARKS)]
    neighbour = min(NEIGHBOUR, max(len(landmarks) - 1, 1))
    apart = np.sort(np.linalg.norm(landmarks[:, None, :] - landmarks, axis=2), axis=1)
    largest = float(np.quantile(apart[:, min(neighbour, len(landmarks) - 1)], LARGEST_QUANTILE))
    return Novelty(mean, scale, landmarks, float(np.float32(max(largest, SAME_DISTANCE))), neighbour)


def farthest_points(points: np.ndarray, nearest: float, most: int) -> np.ndarray:
    """Return positions of points [n, d], ascending: the middle one, then repeatedly the farthest from those chosen.

    Stops when all others are within `nearest` of a chosen one, or when `most` are chosen.
    """
    if not len(points):
        return np.zeros(0, np.int64)
    first = int(np.argmin(np.linalg.norm(points - points.mean(axis=0), axis=1)))
    chosen = [first]
    apart = np.linalg.norm(points - points[first], axis=1)
    while len(chosen) < most and apart.max() > nearest:
        chosen.append(int(np.argmax(apart)))
        apart = np.minimum(apart, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return np.sort(np.array(chosen))


def novelty_record(novelty: Novelty) -> dict[str, Any]:
    """Return plain values for a weights directory's record; `parse_novelty` reads them back exactly."""
    return {"mean": novelty.mean.tolist(), "scale": novelty.scale.tolist(), "landmarks": novelty.landmarks.tolist(),
            "largest": novelty.largest, "neighbour": novelty.neighbour}


def describe_novelty(novelty: Novelty) -> dict[str, Any]:
    """Describe the measure in an exported gate's metadata; its graph holds the recorded configurations."""
    return {"k": novelty.neighbour, "largest_distance": novelty.largest, "configurations": len(novelty.landmarks),
            "mean": novelty.mean.tolist(), "scale": novelty.scale.tolist()}


def parse_novelty(record: Any, name: str) -> Novelty:
    """Parse the measure from a record; `name` is its source. InputError if there is none."""
    try:
        known = len(record["landmarks"])
        mean, scale = (finite_array(record[key], (len(FEATURES),)) for key in ("mean", "scale"))
        landmarks = finite_array(record["landmarks"], (known, len(FEATURES)))
        largest, neighbour = float(record["largest"]), int(record["neighbour"])
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{name}: key 'novelty' is missing or damaged; train again ({error!r})") from error
    if not 1 <= neighbour <= known or not largest > 0.0:
        raise InputError(f"{name}: key 'novelty' does not describe recorded configurations")
    return Novelty(mean, scale, landmarks, largest, neighbour)


def finite_array(values: Any, shape: tuple[int, ...]) -> np.ndarray:
    """Return float64 numbers of a shape; ValueError when they have another, or one of them is not finite."""
    array = np.array(values, np.float64)
    if array.shape != shape or not np.isfinite(array).all():
        raise ValueError(f"an array of shape {array.shape} where {shape} finite numbers belong")
    return array


class Physics(NamedTuple):
    """[n] each: height at the plane minus the target's centre (where it faces up, the place along), its propagated
    standard deviation, and its change by the log of the exit speed; all in m, all finite."""

    deviation_m: np.ndarray
    sigma_m: np.ndarray
    by_speed_m: np.ndarray


@dataclass(frozen=True)
class Scaling:
    """Standardisation of features: z = (features - mean) / deviation, [3] each; held within `low` to `high` [3].

    Quadratics grow without bound, and a shot that is further from the recorded ones than they from each other is not
    known twice as well for being twice as far: z stops at the recorded box, a little widened.
    """

    mean: np.ndarray
    deviation: np.ndarray
    low: np.ndarray
    high: np.ndarray

    def __call__(self, features: np.ndarray) -> np.ndarray:
        return np.asarray(np.clip((features - self.mean) / self.deviation, self.low, self.high))


@dataclass(frozen=True, eq=False)
class PhysicsGate:
    """An ordinal model of the height at the plane: forecast + residual, with its spread.

    `temperature` stretches the spread (calibration; 1 = as fitted); `aside`: share of shots that pass beside the target
    whatever their height.
    """

    rig: Rig
    belief: Belief
    scaling: Scaling
    fit: GateFit
    temperature: float
    aside: float
    novelty: Novelty

    @property
    def shape(self) -> GateShape:
        """Return scale, floor_m, two_m, three_m and lapse as plain numbers."""
        return GateShape(*map(float, shape_of(self.fit.theta, np.array(halves_of(self.rig)))))

    def latent(self, features: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return mean and standard deviation of the height at the plane minus the target's centre, [n] in m each.

        features [n, 3] in the contract's order and units.
        """
        features = np.asarray(features, np.float64)
        return self.correct(features, physics_of(self.rig, self.belief, features))

    def correct(self, features: np.ndarray, physics: Physics) -> tuple[np.ndarray, np.ndarray]:
        """Return latent values from physics that is already computed."""
        mean_m, doubt_m = residual(self.fit, self.scaling(features), physics)
        sigma_m = spread_m(self.shape, physics.sigma_m, doubt_m)
        return physics.deviation_m + mean_m, self.temperature * np.asarray(sigma_m)

    def probabilities(self, features: np.ndarray) -> np.ndarray:
        """Return p [n, 2] (two, three) of features [n, 3] in the contract's order and units; p_three <= p_two."""
        return self.judge(*self.latent(features))

    def judge(self, mean_m: np.ndarray, sigma_m: np.ndarray) -> np.ndarray:
        """Return p [n, 2] from a height's mean and spread."""
        cells = np.asarray(cell_probabilities(self.shape, jnp.asarray(mean_m), jnp.asarray(sigma_m)))
        return (1.0 - self.aside) * np.stack([cells[:, 1:4].sum(axis=1), cells[:, 2]], axis=1)


def physics_of(rig: Rig, belief: Belief, features: np.ndarray) -> Physics:
    """Forecast feature rows [n, 3] in the contract's order, with a typical scatter if the belief has none.

    InputError if the rig has no target.
    """
    centre_m = opening_of(rig, belief.coefficients, belief.catalogue).centre_m
    shots = Shots.of_settings(**{feature.name: np.array(features[:, k], float) for k, feature in enumerate(FEATURES)})
    belief = belief if belief.scatter else replace(belief, scatter=dict(TYPICAL_SCATTER))
    if rig.target is not None and rig.target.faces_up:
        return _descents_of(rig, belief, shots)
    ahead = forecast(rig, belief, shots)
    back = np.isnan(ahead.height_m)
    deviation_m = np.where(back, LOWEST_M, np.maximum(ahead.height_m - centre_m, LOWEST_M))
    by_speed_m = np.where(back, STEEPEST_M, STEEPEST_M * np.tanh(ahead.by_launch[:, 0] / STEEPEST_M))
    return Physics(deviation_m, np.where(back, WIDEST_M, WIDEST_M * np.tanh(ahead.sigma_m / WIDEST_M)), by_speed_m)


def _descents_of(rig: Rig, belief: Belief, shots: Shots) -> Physics:
    """Return the same at an opening that faces up: where a ball comes down, from the middle of the places where it goes
    in, in such units that these end at half the opening's length.

    A ball goes in if it is above the near edge by its radius, and below the far edge, or the upper edge of a backboard.
    Both heights are as smooth as at an upright opening, and the place and its spread are those with the same chances of
    passing either edge. Balls that come back from a backboard over the near edge are not modelled.
    """
    target, opening = rig.target, opening_of(rig, belief.coefficients, belief.catalogue)
    assert target is not None
    tilt_rad, lip_m = (0.0 if isinstance(one, UnsetType) else one for one in (target.tilt_deg, target.lip_m))
    tilt_rad, radius_m = np.radians(tilt_rad), rig.ball.radius_m
    along_m, up_m = opening.two_half_m * np.cos(tilt_rad), opening.two_half_m * np.sin(tilt_rad)
    far = (along_m, up_m) if isinstance(target.backboard, UnsetType) else (
        target.backboard.behind_m - radius_m, target.backboard.height_m)
    passes, by_speed = [], []
    for place_m, edge_m, around_m in ((-along_m, lip_m - up_m, radius_m), (*far, 0.0)):
        there = replace(shots, numbers={**shots.numbers, "distance_m": np.maximum(
            shots.number("distance_m") + place_m, NEAREST_M)})
        ahead = forecast(structs.replace(rig, target=Target(opening.centre_m)), belief, there)
        sigma_m = np.hypot(np.nan_to_num(ahead.sigma_m, nan=WIDEST_M), FLOOR_M)
        above_m = ahead.height_m - opening.centre_m - edge_m - around_m * np.hypot(1.0, ahead.by_launch[:, 3])
        passes.append(np.maximum(np.nan_to_num(above_m, nan=LOWEST_M), LOWEST_M) / sigma_m)
        by_speed.append(np.nan_to_num(ahead.by_launch[:, 0], nan=STEEPEST_M) / sigma_m)
    (near, beyond), half_m = passes, halves_of(rig)[0]
    apart = LEAST_APART * (1.0 + 0.5 * np.logaddexp(0.0, 2.0 * (near - beyond) / LEAST_APART - 2.0))
    sigma_m = 2.0 * half_m / apart
    by_speed_m = 0.5 * sigma_m * (by_speed[0] + by_speed[1])
    return Physics(half_m * (near + beyond) / apart, sigma_m, STEEPEST_M * np.tanh(by_speed_m / STEEPEST_M))


def halves_of(rig: Rig) -> tuple[float, float]:
    """Return (two, three) half-heights of rig.toml in m; InputError if it has no target.

    If every hit counts the same, hits are threes here, so that the robot's limit on p_three applies to them; the
    three's half-height is then too large to matter.
    """
    opening = opening_of(rig, {})
    return opening.two_half_m, opening.three_half_m or FAR * opening.two_half_m


_residual_basis = jax.jit(residual_basis)


def residual(fit: GateFit, z: np.ndarray, physics: Physics) -> tuple[np.ndarray, np.ndarray]:
    """Return the learned residual and its posterior standard deviation, [n] in m each; z [n, 3] standardised."""
    if not len(z):
        return np.zeros(0), np.zeros(0)
    rows = np.resize(np.arange(len(z)), 1 << max(len(z) - 1, 15).bit_length())
    functions = np.asarray(_residual_basis(fit.widths, z[rows], physics.by_speed_m[rows]))[:len(z)]
    doubt_m2 = np.einsum("ni,ij,nj->n", functions, fit.covariance[:RESIDUAL, :RESIDUAL], functions)
    return functions @ fit.theta[:RESIDUAL], np.sqrt(np.maximum(doubt_m2, 0.0))


def save_physics_gate(directory: str | Path, gate: PhysicsGate, record: dict[str, Any]) -> None:
    """Write physics.json and training.json; the same gate and record give the same bytes.

    InputError when the directory cannot be written.
    """
    text = network.as_json(MODEL_SCHEMA, _plain(gate))
    network.save_with_record(directory, {**record, "kind": KIND, "novelty": novelty_record(gate.novelty)},
                     lambda folder: (folder / MODEL_FILE).write_text(text, encoding="utf-8"))


def load_physics_gate(directory: str | Path) -> tuple[PhysicsGate, dict[str, Any]]:
    """Read what save_physics_gate wrote; InputError names the file and what is wrong with it."""
    path = Path(directory) / MODEL_FILE
    record = network.load_record(Path(directory) / network.RECORD_FILE)
    table = network.load_json(path, MODEL_SCHEMA)
    novelty = parse_novelty(record.get("novelty"), str(Path(directory) / network.RECORD_FILE))
    try:
        gate = PhysicsGate(msgspec.convert(table["facts"], Rig), from_table(table["belief"], str(path)),
                           Scaling(*(finite_array(table["scaling"][name], (3,)) for name in
                                     ("mean", "deviation", "low", "high"))), _fit(table["fit"]),
                           float(table["temperature"]), float(table["aside"]), novelty)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"{path}: not a gate ({error!r})") from error
    return gate, record


def _plain(gate: PhysicsGate) -> dict[str, Any]:
    fit = gate.fit
    return {
        "facts": msgspec.to_builtins(gate.rig),
        "belief": as_table(gate.belief),
        "scaling": {name: getattr(gate.scaling, name).tolist() for name in ("mean", "deviation", "low", "high")},
        "fit": {"height_m": float(fit.widths.height_m), "speed": float(fit.widths.speed), "theta": fit.theta.tolist(),
                "covariance": fit.covariance.tolist(), "evidence": fit.evidence},
        "temperature": gate.temperature, "aside": gate.aside}


def _fit(table: dict[str, Any]) -> GateFit:
    size = SIZE
    return GateFit(Widths(float(table["height_m"]), float(table["speed"])),
                   finite_array(table["theta"], (size,)), finite_array(table["covariance"], (size, size)),
                   float(table["evidence"]))
