"""The physics' forecast of configurations before any residual: height, its spread, and its slope by exit speed."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from truearc.robot.config.rig_spec import Rig
from truearc.robot.gate.contract import FEATURES
from truearc.sim.data.dataset import Shots
from truearc.sim.infer.belief import Belief
from truearc.sim.infer.forecast import forecast
from truearc.sim.physics.catalogue import effective
from truearc.sim.physics.simulate import ORDINARY, opening_of

# Of a launcher whose scatter has not been fitted; the gate fits one number that scales it.
TYPICAL_SCATTER = {"speed": 0.02, "elevation_deg": 0.5}
LOWEST_M = -40.0                      # where a ball that turns back before the plane is taken to pass
STEEPEST_M = 30.0                     # per unit of log speed: beyond it a shot is far too weak to matter
WIDEST_M = 1.5                        # first-order propagation of uncertainty does not hold for a larger spread


class Physics(NamedTuple):
    """[n] each: height at the plane minus the target's centre, its propagated standard deviation, and the change of
    the height by the log of the exit speed; all in m, all finite."""

    deviation_m: np.ndarray
    sigma_m: np.ndarray
    by_speed_m: np.ndarray


def physics_of(rig: Rig, belief: Belief, features: np.ndarray) -> Physics:
    """Forecast feature rows [n, 3] in the contract's order; InputError when the rig has no target."""
    centre_m = opening_of(rig, effective(belief.coefficients, ORDINARY, belief.catalogue), belief.catalogue).centre_m
    numbers = {feature.name: np.array(features[:, k], float) for k, feature in enumerate(FEATURES)}
    ahead = forecast(rig, with_scatter(belief), Shots(tuple(map(str, range(len(features)))), numbers, {}))
    back = np.isnan(ahead.height_m)
    deviation_m = np.where(back, LOWEST_M, np.maximum(ahead.height_m - centre_m, LOWEST_M))
    by_speed_m = np.where(back, STEEPEST_M, STEEPEST_M * np.tanh(ahead.by_launch[:, 0] / STEEPEST_M))
    return Physics(deviation_m, np.where(back, WIDEST_M, WIDEST_M * np.tanh(ahead.sigma_m / WIDEST_M)), by_speed_m)


def with_scatter(belief: Belief) -> Belief:
    """The belief, with a typical scatter where it has none."""
    return belief if belief.scatter else replace(belief, scatter=dict(TYPICAL_SCATTER))
