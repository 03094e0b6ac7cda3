"""How far a configuration is from what was recorded: a domain of validity that follows the recorded cloud.

The box around the recorded rows has empty corners, where nothing is known. Novelty is the distance to the NEIGHBOUR-th
nearest recorded configuration, each feature in its standard deviations, over the largest such distance that counts as
known: LARGEST_QUANTILE of the recorded configurations' own, each without itself.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from truearc.errors import InputError
from truearc.robot.gate.contract import FEATURES
from truearc.sim.paper.network import exact_in_float32, standardisation

NEIGHBOUR = 3                         # a single stray shot makes no domain; many would cut the cloud's edge off
LARGEST_QUANTILE = 0.99
SAME_DISTANCE = 0.05                  # standard deviations: nearer than this is the same configuration again
BLOCK = 4096                          # rows measured at once
MAX_LANDMARKS = 256                   # landmarks: what the exported graph measures from at every decision


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
    mean, scale = standardisation(features)
    z = exact_in_float32((features - mean) * scale)
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
