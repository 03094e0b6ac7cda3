"""Effect of a robot's own velocity on each set point: how far it carries the ball, and what that costs in height.

A ball that is thrown from a moving robot has the robot's velocity on top of the launcher's. In a vacuum it would be
carried along for the whole flight; the air takes part of that, unequally along and across. The set point for a target
at D is therefore that of a distance d from which the ball, carried, comes to D (d + carry_s * velocity = D), with a
speed corrected for the height that the air then takes or leaves (trim).
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Float

from truearc.robot.config.rig_spec import Rig
from truearc.sim.data.dataset import Shots
from truearc.sim.infer.belief import Belief, before_the_shot
from truearc.sim.infer.forecast import Values, configured
from truearc.sim.infer.likelihood.data import Given, given_of
from truearc.sim.physics.catalogue import Catalogue, flight_terms
from truearc.sim.physics.flight import make_law, reach_plane, rk4, start_of
from truearc.sim.physics.term import BallState, Exit
from truearc.sim.physics.vector import Vec, plus

PROBE_M_S = 1.5                       # velocities of the robot, to and fro, at which the corrections are exact
STEPS = 128                           # of a flight over time
SECANT = 6                            # steps to the speed that meets the height
FIRST_LOG = 0.02                      # of the first one
CLOSE_M = 1e-4                        # of the height, which it must meet

Rows = Float[np.ndarray, " n"]


class OnTheMove(NamedTuple):
    """Of set points, arrays [n]; NaN where the ball does not come there from a robot at PROBE_M_S.

    carry_s, sideways_s: how far the robot's velocity along, and across, carries the ball until the flight from rest
    would be over, m per m/s. trim_s_m, bend_s2_m2: log of the motor's speed by that velocity along, and by its square;
    sink_s2_m2: by the square of that across.
    """

    carry_s: Rows
    sideways_s: Rows
    trim_s_m: Rows
    bend_s2_m2: Rows
    sink_s2_m2: Rows


def on_the_move(rig: Rig, belief: Belief, distance_m: Rows, hood_deg: Rows, motor_ratio: Rows,
                flight_s: Rows) -> OnTheMove:
    """Fly each set point from a robot that drives at PROBE_M_S to the target, from it and across."""
    given = _given(rig, belief, distance_m, hood_deg, motor_ratio)
    among, values = belief.catalogue, belief.coefficients
    ahead, behind, left, rest = (np.asarray(_place(rig, values, given, flight_s, along, across, among))
                                 for along, across in ((PROBE_M_S, 0.0), (-PROBE_M_S, 0.0), (0.0, PROBE_M_S),
                                                       (0.0, 0.0)))
    carry_s = (ahead[0] - behind[0]) / (2.0 * PROBE_M_S)
    at_rest_m = np.asarray(_height(rig, values, given, distance_m, 0.0, among))

    def faster(log: Rows) -> Given:
        return _given(rig, belief, distance_m, hood_deg, motor_ratio * np.exp(np.clip(np.nan_to_num(log), -1.0, 1.0)))

    def along_m(log: Rows, along: float) -> Rows:
        height_m = _height(rig, values, faster(log), distance_m + carry_s * along, along, among)
        return np.asarray(height_m - at_rest_m)

    def across_m(log: Rows) -> Rows:
        flown = np.asarray(_place(rig, values, faster(log), flight_s, 0.0, PROBE_M_S, among))
        return np.asarray(_at_plane(flown, distance_m)[1] - at_rest_m)

    to, fro, sink = (_root(off_m, np.zeros(len(distance_m))) for off_m in (
        partial(along_m, along=PROBE_M_S), partial(along_m, along=-PROBE_M_S), across_m))
    sideways_m = _at_plane(left, distance_m)[0] - _at_plane(rest, distance_m)[0]
    return OnTheMove(carry_s, sideways_m / PROBE_M_S, (to - fro) / (2.0 * PROBE_M_S), (to + fro) / (2.0 * PROBE_M_S**2),
                     sink / PROBE_M_S**2)


def _at_plane(flown: Float[np.ndarray, "6 n"], distance_m: Rows) -> tuple[Rows, Rows]:
    """(y, z) where a ball that is near the plane meets it."""
    x, y, z, vx, vy, vz = flown
    left_s = (distance_m - x) / vx
    return y + vy * left_s, z + vz * left_s


def _given(rig: Rig, belief: Belief, distance_m: Rows, hood_deg: Rows, motor_ratio: Rows) -> Given:
    shots = Shots(tuple(map(str, range(len(distance_m)))),
                  {"distance_m": distance_m, "hood_deg": hood_deg, "motor_ratio": motor_ratio}, {})
    return given_of(rig, shots, before_the_shot(belief.curves, rig, shots))


def _root(off_m: Any, log: Rows) -> Rows:
    """Where heights meet, by the secant method."""
    before, new = log, log + FIRST_LOG
    off_before = off_m(before)
    for _ in range(SECANT):
        off = off_m(new)
        with np.errstate(divide="ignore", invalid="ignore"):
            step = np.where(off == off_before, 0.0, off * (new - before) / (off - off_before))
        before, off_before, new = new, off, new - step
    return np.asarray(np.where(np.abs(off_m(new)) < CLOSE_M, new, np.nan))


@partial(jax.jit, static_argnames=("rig", "among"))
def _height(rig: Rig, values: Values, given: Given, distance_m: Any, along: Any, among: Catalogue) -> Any:
    """Height [n] at a plane, NaN: does not come there; the velocity along only changes the launch."""
    at, exit, _ = configured(rig, values, given, among)
    forward, upward = exit.speed_m_s * jnp.cos(exit.elevation_rad) + along, exit.speed_m_s * jnp.sin(exit.elevation_rad)
    moved = Exit(jnp.hypot(forward, upward), jnp.arctan2(upward, forward), exit.spin_rev_s, exit.above_m)
    plane = reach_plane(rig, make_law(rig, flight_terms({"gravity", *values}, among), at), moved, distance_m)
    return jnp.where(plane.near, plane.height_m, jnp.nan)


@partial(jax.jit, static_argnames=("rig", "among"))
def _place(rig: Rig, values: Values, given: Given, flight_s: Any, along: Any, across: Any, among: Catalogue) -> Any:
    """Place and velocity [6, n] after so long."""
    at, exit, _ = configured(rig, values, given, among)
    law = make_law(rig, flight_terms({"gravity", *values}, among), at)
    ball = start_of(rig, exit, jnp.shape(flight_s))
    zero = jnp.zeros_like(ball.position_m.x)
    place, speed, spin = (Vec(*(plus(part, zero) for part in vec)) for vec in ball[:3])
    start = BallState(place, Vec(speed.x + along, speed.y + across, speed.z), spin, zero)
    end = lax.scan(lambda ball, _: (rk4(law, ball, flight_s / STEPS), None), start, None, length=STEPS)[0]
    return jnp.stack([*end.position_m, *end.velocity_m_s])
