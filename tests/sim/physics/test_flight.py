"""Flights over time and over x, with every term of the air, against closed forms and DOP853 of other code."""

import jax
import jax.numpy as jnp
import msgspec
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.sim.infer import independent
from tests.sim.infer.independent import Truth
from tests.sim.physics import reference
from tests.sim.physics.rigs import GUPPY, weightless
from truearc.robot.config.rig_spec import WorldFacts
from truearc.sim.physics.catalogue import flight_terms
from truearc.sim.physics.flight import fly, make_law, path, reach_plane, rk4
from truearc.sim.physics.term import BallState, Exit, Vec

SEED = flight_terms(("gravity", "drag", "magnus"))
LIFT = flight_terms(("magnus",))
G = reference.GRAVITY_M_S2
# rotation of the velocity in rad/s for cl = 1 and one revolution a second: Eq. 2 / (m v)
LIFT_RAD_S = 16 / 3 * np.pi**2 * reference.RADIUS_M**3 * reference.DENSITY_KG_M3 / reference.MASS_KG
TRUTH = Truth(cd=0.6, cl=0.05, loss=0.0)
PARAMS = {"drag": {"cd": TRUTH.cd}, "magnus": {"cl": TRUTH.cl}}


def _circle(radius, elevation, distance, release):
    """Height where a counter-clockwise circle first meets x = distance before it turns back, else nan."""
    centre_x, centre_z = -radius * np.sin(elevation), release + radius * np.cos(elevation)
    sine = (distance - centre_x) / radius
    return np.where(sine <= 1, centre_z - radius * np.cos(np.arcsin(np.clip(sine, -1, 1))), np.nan)


def test_lift_alone_bends_a_circle():
    rng = np.random.default_rng(2)
    speed, elevation, spin = rng.uniform(2, 20, 400), np.radians(rng.uniform(0, 75, 400)), rng.uniform(1, 33, 400)
    cl = rng.uniform(0.1, 5, 400)
    radius = speed / (LIFT_RAD_S * cl * spin)
    distance = radius * rng.uniform(0.01, 1.2, 400)
    crossing = fly(weightless(1.0), LIFT, {"magnus": {"cl": cl}}, Exit(speed, elevation, spin), distance)
    height = _circle(radius, elevation, distance, 1.0)
    np.testing.assert_array_equal(np.asarray(crossing.reached), ~np.isnan(height))
    assert 50 < np.isnan(height).sum() < 350
    np.testing.assert_allclose(crossing.height_m, height, atol=1e-7, equal_nan=True)


@pytest.mark.parametrize(("beyond", "reached"), [(-1e-7, True), (1e-7, False)])
def test_a_plane_touched_at_the_turn(beyond, reached):
    """A circle of 1 m launched level has its foremost point 1 m ahead and 1 m up."""
    spin = 10.0 / LIFT_RAD_S
    crossing = fly(weightless(0.5), LIFT, {"magnus": {"cl": 1.0}}, Exit(10.0, 0.0, spin), 1.0 + beyond)
    assert bool(crossing.reached) is reached
    if reached:
        assert float(crossing.height_m) == pytest.approx(1.5 - np.sqrt(2e-7), abs=1e-6)


def test_a_ball_that_does_not_leave_never_arrives():
    crossing = fly(GUPPY, SEED, {}, Exit(np.array([0.0, 5.0, 5.0]), np.array([0.7, np.pi / 2 + 0.1, 0.7]), 0.0), 2.0)
    assert list(np.asarray(crossing.reached)) == [False, False, True]


def test_a_flight_without_end_is_given_up():
    """No weight, no lift, strong drag: x grows as the logarithm of time, and 50 m are never reached."""
    crossing = fly(weightless(1.0), flight_terms(("drag",)), {"drag": {"cd": 5.0}}, Exit(1.0, 0.0, 0.0), 50.0,
                   step_s=0.02, turn_rad=0.4, limit_s=5.0)
    assert not bool(crossing.reached)
    assert float(crossing.time_s) == pytest.approx(5.0, abs=0.05)


def test_derivatives_in_the_coefficients_are_those_of_dop853():
    ratio, deg, distance = 0.55, 52.0, 4.0
    speed, spin = reference.exit_of(ratio)

    def height(c):
        params = {"drag": {"cd": c[0]}, "magnus": {"cl": c[1]}}
        return fly(GUPPY, SEED, params, Exit(speed, np.radians(deg), spin), distance).height_m

    step = 1e-4
    expected = [(reference.integrate(distance, ratio, deg, 0.91 + dx, 0.06 + dy).height_m
                 - reference.integrate(distance, ratio, deg, 0.91 - dx, 0.06 - dy).height_m) / (2 * step)
                for dx, dy in ((step, 0.0), (0.0, step))]
    np.testing.assert_allclose(jax.jacfwd(height)(np.array([0.91, 0.06])), expected, rtol=1e-6)


def test_sideways_spin_is_flown_in_three_dimensions():
    """Weightless ball spinning about the vertical: the same circle, lying down."""
    spin = 10.0 / LIFT_RAD_S
    law = make_law(msgspec.structs.replace(GUPPY, world=WorldFacts(0.0)), SEED, {"magnus": {"cl": 1.0}})
    ball = BallState(Vec(0.0, 0.0, 1.0), Vec(10.0, 0.0, 0.0), Vec(0.0, 0.0, spin))
    for _ in range(100):
        ball = rk4(law, ball, 0.001)
    there = [float(part) for part in ball.position_m]
    np.testing.assert_allclose(there, [np.sin(1.0), 1 - np.cos(1.0), 1.0], atol=1e-9)


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


def test_turning_back_is_told():
    rig = weightless(1.0)
    strong = {"magnus": {"cl": 5.0}}
    law = make_law(rig, flight_terms(("magnus",)), strong)
    there = reach_plane(rig, law, Exit(jnp.array([5.0, 5.0]), 0.3, jnp.array([0.0, 20.0])), jnp.array([3.0, 3.0]))
    assert list(np.asarray(there.near)) == [True, False]
    np.testing.assert_allclose(there.height_m[0], 1.0 + 3.0 * np.tan(0.3), rtol=1e-12)


M, R, RHO, UP = 0.14, 0.0889, 1.2, 0.75
AREA, VOLUME = np.pi * R**2, 4 / 3 * np.pi * R**3
TERMS = flight_terms((
    "gravity", "drag", "magnus", "spin_decay", "wind_x", "wind_y", "wind_z", "spin_drag", "drag_reynolds",
    "lift_saturation", "drag_wear", "air_density", "buoyancy", "added_mass"))
# amplitude of each, and of all at once; drag_wear and air_density: age and density already multiplied in
AMPLITUDES = {"spin_decay": 0.8, "wind_x": 1.5, "wind_y": -2.0, "wind_z": 0.7, "spin_drag": 0.6, "drag_reynolds": -0.4,
              "lift_saturation": 1.3, "drag_wear": 0.12, "air_density": 0.07, "buoyancy": 1.0, "added_mass": 1.0}
CASES = {**{name: {name: size} for name, size in AMPLITUDES.items()}, "none": {}, "all": AMPLITUDES,
         "known": {"buoyancy": 1.0, "added_mass": 1.0}}
CD, CL, SPEED, ELEVATION, SPIN, STEP_S, STEPS = 0.6, 0.12, 11.0, 0.9, 6.0, 0.002, 450


def _rates(t, state, e):
    """The equations of motion; e: amplitudes."""
    velocity = state[3:]
    through = velocity - np.array([e("wind_x"), e("wind_y"), e("wind_z")])
    spin = np.array([0.0, -SPIN, 0.0]) * np.exp(-e("spin_decay") * t)
    v = np.linalg.norm(through)
    s = 2 * np.pi * R * np.linalg.norm(spin) / v
    cd = CD * (1 + e("drag_reynolds") * (v / 10.0 - 1) + e("drag_wear")) + e("spin_drag") * s**2
    lift = CL / (1 + e("lift_saturation") * s)
    rho = RHO * (1 + e("air_density"))
    force = (-0.5 * rho * AREA * cd * v * through + lift * 16 / 3 * np.pi**2 * R**3 * rho * np.cross(spin, through)
             + np.array([0, 0, -M * G + e("buoyancy") * RHO * VOLUME * G]))
    return np.concatenate([velocity, force / (M + e("added_mass") * RHO * VOLUME / 2)])


def _params(amplitudes):
    first = {term.name: term.parameters[0].name for term in TERMS}
    return {"gravity": {"scale": 1.0}, "drag": {"cd": CD}, "magnus": {"cl": CL},
            **{name: {first[name]: amplitudes.get(name, 0.0)} for name in AMPLITUDES}}


def _dop853(amplitudes, **more):
    start = [0.0, 0.0, UP, SPEED * np.cos(ELEVATION), 0.0, SPEED * np.sin(ELEVATION)]
    return solve_ivp(_rates, (0.0, STEP_S * STEPS), start, "DOP853", rtol=1e-11, atol=1e-12,
                     args=(lambda name: amplitudes.get(name, 0.0),), **more)


@pytest.mark.parametrize("case", CASES)
def test_paths_are_those_of_dop853(case):
    exit = Exit(SPEED, ELEVATION, SPIN)
    flown = path(GUPPY, TERMS, _params(CASES[case]), exit, points=STEPS + 1, step_s=STEP_S)
    times = np.arange(STEPS + 1) * STEP_S
    wanted = _dop853(CASES[case], t_eval=times[::50])
    ours = np.stack([np.asarray(part)[::50] for part in (*flown.position_m, *flown.velocity_m_s)])
    np.testing.assert_allclose(ours, wanted.y, atol=2e-8)
    np.testing.assert_allclose(flown.time_s, times, atol=1e-12)
    if case != "none":                                # each shows: none of the agreement is by absence
        assert np.abs(wanted.y - _dop853({}, t_eval=times[::50]).y).max() > 1e-3


@pytest.mark.parametrize("case", ["spin_decay", "wind_y", "all"])
def test_planes_are_met_where_dop853_meets_them(case):
    def plane(t, state, e):
        return state[0] - 3.0

    plane.terminal = True
    wanted = _dop853(CASES[case], events=plane).y_events[0][0]
    exit, params = Exit(np.array([SPEED]), ELEVATION, SPIN), _params(CASES[case])
    assert float(fly(GUPPY, TERMS, params, exit, 3.0).height_m[0]) == pytest.approx(wanted[2], abs=2e-8)
    over = reach_plane(GUPPY, make_law(GUPPY, TERMS, params), exit, np.array([3.0]))
    assert float(over.height_m[0]) == pytest.approx(wanted[2], abs=2e-6)
    assert float(over.climb[0]) == pytest.approx(wanted[5] / wanted[3], abs=1e-5)
