"""The fitted gate in float64: the physics' forecast of features, a learned residual, probabilities, and novelty.

In a weights directory it is physics.json, which its probabilities follow from, beside training.json.

Novelty is how far a configuration is from what was recorded: a domain of validity that follows the recorded cloud,
since the box around it has empty corners, where nothing is known. It is the distance to the NEIGHBOUR-th nearest
recorded configuration, each feature in its standard deviations, over the largest such distance that counts as known:
LARGEST_QUANTILE of the recorded configurations' own, each without itself.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import msgspec
import numpy as np

from truearc.errors import InputError
from truearc.robot.config.rig_spec import Rig
from truearc.robot.gate import FEATURES
from truearc.sim.data.dataset import Shots
from truearc.sim.gate import likelihood as chance
from truearc.sim.gate.likelihood import GateFit
from truearc.sim.infer.belief import Belief, as_table, from_table
from truearc.sim.infer.forecast import forecast
from truearc.sim.paper import network
from truearc.sim.physics.simulate import opening_of

NEIGHBOUR = 3                         # a single stray shot makes no domain; many would cut the cloud's edge off
LARGEST_QUANTILE = 0.99
SAME_DISTANCE = 0.05                  # standard deviations: nearer than this is the same configuration again
BLOCK = 4096                          # rows measured at once
MAX_LANDMARKS = 256                   # landmarks: what the exported graph measures from at every decision
# Of a launcher whose scatter has not been fitted; the gate fits one number that scales it.
TYPICAL_SCATTER = {"speed": 0.02, "elevation_deg": 0.5}
LOWEST_M = -40.0                      # where a ball that turns back before the plane is taken to pass
STEEPEST_M = 30.0                     # per unit of log speed: beyond it a shot is far too weak to matter
FAR = 1e3
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
        blocks = [self._kth(z[first:first + BLOCK]) for first in range(0, len(z), BLOCK)]
        return np.concatenate(blocks) / self.largest if blocks else np.zeros(0)

    def _kth(self, z: np.ndarray) -> np.ndarray:
        apart = np.linalg.norm(z[:, None, :] - self.landmarks, axis=2)
        return np.partition(apart, self.neighbour - 1, axis=1)[:, self.neighbour - 1]


def fit_novelty(features: np.ndarray) -> Novelty:
    """Landmarks and scale from recorded feature rows [n, 3]; the same rows in the same order give the same.

    Repeats of one configuration count once; with few different configurations the farthest neighbour is nearer.
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
    """Positions of points [n, d], ascending: the farthest from those chosen, again and again, first the middle one.

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
    """Plain values for a weights directory's record; `parse_novelty` reads them back exactly."""
    return {"mean": novelty.mean.tolist(), "scale": novelty.scale.tolist(), "landmarks": novelty.landmarks.tolist(),
            "largest": novelty.largest, "neighbour": novelty.neighbour}


def describe_novelty(novelty: Novelty) -> dict[str, Any]:
    """Describe the measure in an exported gate's metadata; its graph holds the recorded configurations."""
    return {"k": novelty.neighbour, "largest_distance": novelty.largest, "configurations": len(novelty.landmarks),
            "mean": novelty.mean.tolist(), "scale": novelty.scale.tolist()}


def parse_novelty(record: Any, name: str) -> Novelty:
    """The measure in a record that came from somewhere called `name`; InputError when there is none to be had."""
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
    """[n] each: height at the plane minus the target's centre, its propagated standard deviation, and the change of
    the height by the log of the exit speed; all in m, all finite."""

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
    def shape(self) -> chance.GateShape:
        """Scale, floor_m, two_m, three_m and lapse, as plain numbers."""
        shape = chance.shape_of(self.fit.theta, np.array(halves_of(self.rig)))
        return chance.GateShape(*map(float, shape))

    def latent(self, features: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean of the height at the plane minus the target's centre, and its standard deviation, [n] in m each.

        features [n, 3] in the contract's order and units.
        """
        features = np.asarray(features, np.float64)
        return self.correct(features, physics_of(self.rig, self.belief, features))

    def correct(self, features: np.ndarray, physics: Physics) -> tuple[np.ndarray, np.ndarray]:
        """As latent, where the physics has been asked already."""
        mean_m, doubt_m = residual(self.fit, self.scaling(features), physics)
        sigma_m = chance.spread_m(self.shape, physics.sigma_m, doubt_m)
        return physics.deviation_m + mean_m, self.temperature * np.asarray(sigma_m)

    def probabilities(self, features: np.ndarray) -> np.ndarray:
        """p [n, 2] (two, three) of features [n, 3] in the contract's order and units; p_three <= p_two."""
        return self.judge(*self.latent(features))

    def judge(self, mean_m: np.ndarray, sigma_m: np.ndarray) -> np.ndarray:
        """p [n, 2] of a height's mean and spread."""
        cells = np.asarray(chance.cell_probabilities(self.shape, jnp.asarray(mean_m), jnp.asarray(sigma_m)))
        return (1.0 - self.aside) * np.stack([cells[:, 1:4].sum(axis=1), cells[:, 2]], axis=1)


def physics_of(rig: Rig, belief: Belief, features: np.ndarray) -> Physics:
    """Forecast feature rows [n, 3] in the contract's order, with a typical scatter where the belief has none.

    InputError when the rig has no target.
    """
    centre_m = opening_of(rig, belief.coefficients, belief.catalogue).centre_m
    numbers = {feature.name: np.array(features[:, k], float) for k, feature in enumerate(FEATURES)}
    scattered = belief if belief.scatter else replace(belief, scatter=dict(TYPICAL_SCATTER))
    ahead = forecast(rig, scattered, Shots(tuple(map(str, range(len(features)))), numbers, {}))
    back = np.isnan(ahead.height_m)
    deviation_m = np.where(back, LOWEST_M, np.maximum(ahead.height_m - centre_m, LOWEST_M))
    by_speed_m = np.where(back, STEEPEST_M, STEEPEST_M * np.tanh(ahead.by_launch[:, 0] / STEEPEST_M))
    return Physics(deviation_m, np.where(back, WIDEST_M, WIDEST_M * np.tanh(ahead.sigma_m / WIDEST_M)), by_speed_m)


def halves_of(rig: Rig) -> tuple[float, float]:
    """(two, three) half-heights of rig.toml in m; InputError when it has no target.

    Where every hit counts alike, hits are threes here, so that the robot's limit on p_three holds for them; three is
    then too large to matter beside two.
    """
    opening = opening_of(rig, {})
    return opening.two_half_m, opening.three_half_m or FAR * opening.two_half_m


_residual_basis = jax.jit(chance.residual_basis)


def residual(fit: GateFit, z: np.ndarray, physics: Physics) -> tuple[np.ndarray, np.ndarray]:
    """The learned residual and its own standard deviation a posteriori, [n] in m each; z [n, 3] standardised."""
    if not len(z):
        return np.zeros(0), np.zeros(0)
    rows = np.resize(np.arange(len(z)), 1 << max(len(z) - 1, 15).bit_length())
    functions = np.asarray(_residual_basis(fit.widths, z[rows], physics.by_speed_m[rows]))[:len(z)]
    doubt_m2 = np.einsum("ni,ij,nj->n", functions, fit.covariance[:chance.RESIDUAL, :chance.RESIDUAL], functions)
    return functions @ fit.theta[:chance.RESIDUAL], np.sqrt(np.maximum(doubt_m2, 0.0))


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
    size = chance.SIZE
    return GateFit(chance.Widths(float(table["height_m"]), float(table["speed"])),
                   finite_array(table["theta"], (size,)), finite_array(table["covariance"], (size, size)),
                   float(table["evidence"]))
