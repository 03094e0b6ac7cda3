"""The flight over x against DOP853 of other code and closed forms."""

import jax
import jax.numpy as jnp
import numpy as np

from tests.sim.infer import independent
from tests.sim.infer.independent import Truth
from tests.sim.physics import reference
from tests.sim.physics.rigs import GUPPY, weightless
from truearc.sim.data.dataset import Shots
from truearc.sim.physics.catalogue import flight_terms
from truearc.sim.physics.flight import make_law, reach_plane
from truearc.sim.physics.launch import Exit
from truearc.sim.physics.simulate import leave, predict
from truearc.sim.physics.vector import Vec

SEED = flight_terms(("gravity", "drag", "magnus"))
TRUTH = Truth(cd=0.6, cl=0.05, loss=0.0)
PARAMS = {"drag": {"cd": TRUTH.cd}, "magnus": {"cl": TRUTH.cl}}


def _launches(n: int, seed: int):
    rng = np.random.default_rng(seed)
    exit = Exit(rng.uniform(6, 12, n), np.radians(rng.uniform(15, 60, n)), rng.uniform(-5, 10, n))
    return exit, rng.uniform(1, 7, n)


def test_the_flight_over_x_goes_through_the_floor_as_dop853():
    exit, distance_m = _launches(200, 1)
    expected = independent.heights(distance_m, *exit[:3], TRUTH)
    sane = expected > -5.0                             # deeper, balls fall so steeply that the reference gives up
    assert sane.sum() > 190
    over = reach_plane(GUPPY, make_law(GUPPY, SEED, PARAMS), exit, jnp.asarray(distance_m))
    assert np.asarray(over.near)[sane].all()
    np.testing.assert_allclose(np.asarray(over.height_m)[sane], expected[sane], atol=2e-3)
    above = expected > 0.0
    assert 40 < above.sum() < 190
    np.testing.assert_allclose(np.asarray(over.height_m)[above], expected[above], atol=5e-5)


def test_the_climb_is_the_slope_of_the_height():
    exit, distance_m = _launches(50, 3)
    law = make_law(GUPPY, SEED, PARAMS)
    climb = reach_plane(GUPPY, law, exit, jnp.asarray(distance_m)).climb
    ends = [independent.heights(distance_m + step, *exit[:3], TRUTH) for step in (1e-3, -1e-3)]
    np.testing.assert_allclose(climb, (ends[0] - ends[1]) / 2e-3, rtol=1e-3, atol=1e-3)


def test_derivatives_to_the_third_are_those_of_the_parabola():
    """Without air: height = h + d tan a - g d^2 / (2 v^2 cos^2 a), differentiated by v."""
    speed, angle, distance = 9.0, 0.8, 4.0

    def height(v):
        law = make_law(GUPPY, SEED, {})
        return reach_plane(GUPPY, law, Exit(v, angle, 0.0), jnp.array([distance])).height_m[0]

    drop = reference.GRAVITY_M_S2 * distance**2 / (2 * np.cos(angle)**2)
    def first(v):
        return (jax.jacfwd(height)(v),)

    def upto(lower):
        return lambda v: (jax.jacfwd(lambda at: lower(at)[0])(v), *lower(v))

    third, second, slope = jax.jit(upto(upto(first)))(speed)
    np.testing.assert_allclose(slope, 2 * drop / speed**3, rtol=1e-9)
    np.testing.assert_allclose(second, -6 * drop / speed**4, rtol=1e-9)
    np.testing.assert_allclose(third, 24 * drop / speed**5, rtol=1e-8)


def test_a_sideways_push_moves_no_height():
    def law(ball):
        zero = jnp.zeros_like(ball.position_m.z)
        return Vec(0.0, zero + 3.0, zero - reference.GRAVITY_M_S2)

    there = reach_plane(GUPPY, law, Exit(jnp.array([9.0]), 0.8, 0.0), jnp.array([4.0]))
    drop = reference.GRAVITY_M_S2 * 16.0 / (2 * (9.0 * np.cos(0.8))**2)
    np.testing.assert_allclose(there.height_m, reference.RELEASE_M + 4.0 * np.tan(0.8) - drop, rtol=1e-12)


def test_turning_back_is_told():
    rig = weightless(1.0)
    strong = {"magnus": {"cl": 5.0}}
    law = make_law(rig, flight_terms(("magnus",)), strong)
    there = reach_plane(rig, law, Exit(jnp.array([5.0, 5.0]), 0.3, jnp.array([0.0, 20.0])), jnp.array([3.0, 3.0]))
    assert list(np.asarray(there.near)) == [True, False]
    np.testing.assert_allclose(there.height_m[0], 1.0 + 3.0 * np.tan(0.3), rtol=1e-12)


def test_launch_terms_slow_what_the_wheels_send_and_nothing_measured():
    rng = np.random.default_rng(4)
    n = 40
    distance_m, hood_deg, ratio = independent.configurations(rng, Truth(), n)
    measured = np.where(np.arange(n) < 10, 8.0, np.nan)
    shots = Shots(tuple(map(str, range(n))), {"distance_m": distance_m, "hood_deg": hood_deg, "motor_ratio": ratio,
                                              "exit_speed_m_s": measured}, {})
    terms = {**PARAMS, "exit_efficiency": {"loss": 0.25}, "wheel_slip": {"loss_per_m_s": 0.004}}
    got = predict(GUPPY, terms, shots).height_m
    speed, spin = reference.exit_of(ratio)
    slowed = np.where(np.isnan(measured), speed / (1 + 0.004 * speed) * 0.75, measured)
    expected = independent.heights(distance_m, slowed, np.radians(hood_deg), spin, TRUTH)
    reached = np.isfinite(got)
    assert reached.sum() > 25
    np.testing.assert_allclose(got[reached], expected[reached], atol=1e-5)
    assert (expected[~reached] < 0.0).all()


def test_without_launch_terms_the_launch_is_the_same_object():
    exit = Exit(np.ones(3), np.ones(3), np.ones(3))
    assert leave(GUPPY, PARAMS, exit) is exit
