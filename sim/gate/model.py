"""The fitted gate in float64: features to the height's mean and spread, and to probabilities."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from truearc.robot.config.rig_spec import Rig
from truearc.sim.gate.fit import GateFit
from truearc.sim.gate.likelihood import RESIDUAL, GateShape, cell_probabilities, residual_basis, shape_of, spread_m
from truearc.sim.gate.novelty import Novelty
from truearc.sim.gate.physics import Physics, physics_of
from truearc.sim.infer.belief import Belief
from truearc.sim.physics.simulate import opening_of


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
        z: np.ndarray = np.clip((features - self.mean) / self.deviation, self.low, self.high)
        return z


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
        """Scale, floor_m, two_m, three_m and lapse, as plain numbers."""
        return GateShape(*(float(value) for value in shape_of(self.fit.theta, np.array(halves_of(self.rig)))))

    def latent(self, features: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean of the height at the plane minus the target's centre, and its standard deviation, [n] in m each.

        features [n, 3] in the contract's order and units.
        """
        features = np.asarray(features, np.float64)
        return self.correct(features, physics_of(self.rig, self.belief, features))

    def correct(self, features: np.ndarray, physics: Physics) -> tuple[np.ndarray, np.ndarray]:
        """As latent, where the physics has been asked already."""
        mean_m, doubt_m = residual(self.fit, self.scaling(features), physics)
        sigma_m = spread_m(self.shape, physics.sigma_m, doubt_m)
        return physics.deviation_m + mean_m, self.temperature * np.asarray(sigma_m)

    def probabilities(self, features: np.ndarray) -> np.ndarray:
        """p [n, 2] (two, three) of features [n, 3] in the contract's order and units; p_three <= p_two."""
        return self.judge(*self.latent(features))

    def judge(self, mean_m: np.ndarray, sigma_m: np.ndarray) -> np.ndarray:
        """p [n, 2] of a height's mean and spread."""
        cells = np.asarray(cell_probabilities(self.shape, jnp.asarray(mean_m), jnp.asarray(sigma_m)))
        return (1.0 - self.aside) * np.stack([cells[:, 1:4].sum(axis=1), cells[:, 2]], axis=1)


def halves_of(rig: Rig) -> tuple[float, float]:
    """(two, three) half-heights of rig.toml in m; InputError when it has no target."""
    opening = opening_of(rig, {})
    return opening.two_half_m, opening.three_half_m


_residual_basis = jax.jit(residual_basis)


def residual(fit: GateFit, z: np.ndarray, physics: Physics) -> tuple[np.ndarray, np.ndarray]:
    """The learned residual and its own standard deviation a posteriori, [n] in m each; z [n, 3] standardised."""
    rows = np.resize(np.arange(len(z)), _size(len(z)))
    functions = np.asarray(_residual_basis(fit.widths, z[rows], physics.by_speed_m[rows]))[:len(z)]
    doubt_m2 = np.einsum("ni,ij,nj->n", functions, fit.covariance[:RESIDUAL, :RESIDUAL], functions)
    return functions @ fit.theta[:RESIDUAL], np.sqrt(np.maximum(doubt_m2, 0.0))


def _size(count: int) -> int:
    return 1 << max(count - 1, 15).bit_length()
