"""How far a ball drifts to the side on its way, for the lead that a believed wind across needs."""

from functools import partial
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from truearc.robot.config.rig_spec import Rig
from truearc.sim.data.dataset import Shots
from truearc.sim.infer.belief import Belief
from truearc.sim.infer.curve import before_the_shot
from truearc.sim.infer.likelihood.heights import Values, configured
from truearc.sim.infer.likelihood.launch_inputs import Given, given_of
from truearc.sim.physics.catalogue import Catalogue, flight_terms
from truearc.sim.physics.flight import make_law
from truearc.sim.physics.flight_over_x import reach_plane


def lead_deg(rig: Rig, belief: Belief, distance_m: Float[np.ndarray, " n"], hood_deg: Float[np.ndarray, " n"],
             motor_ratio: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Angle by which to turn the launcher to the left [n], in degrees, against the drift; NaN: does not come there."""
    shots = Shots(tuple(map(str, range(len(distance_m)))),
                  {"distance_m": distance_m, "hood_deg": hood_deg, "motor_ratio": motor_ratio}, {})
    given = given_of(rig, shots, before_the_shot(belief.curves, rig, shots))
    side_m = np.asarray(_drift(rig, belief.coefficients, given, belief.catalogue))
    return np.asarray(np.degrees(np.arctan2(-side_m, distance_m)) + 0.0)


@partial(jax.jit, static_argnames=("rig", "among"))
def _drift(rig: Rig, values: Values, given: Given, among: Catalogue) -> Any:
    at, exit, distance_m = configured(rig, values, given, among)
    plane = reach_plane(rig, make_law(rig, flight_terms({"gravity", *values}, among), at), exit, distance_m)
    return jax.numpy.where(plane.near, plane.side_m, jax.numpy.nan)
