"""Every term in whole shots: from what the sensors say to what the target and the tracker see."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.sim.physics.rigs import GUPPY
from tests.sim.physics.tracker import watch
from truearc.sim.data.dataset import Circumstances
from truearc.sim.physics.catalogue import TERMS, effective, find_terms, flight_terms
from truearc.sim.physics.flight import make_law, path, reach_plane, rk4, start_of
from truearc.sim.physics.simulate import leave, opening_of, sense
from truearc.sim.physics.term import Exit

BELIEVED = {"gravity": {"scale": 1.0}, "drag": {"cd": 0.6}, "magnus": {"cl": 0.1}}
FLYING = flight_terms(term.name for term in TERMS)
ADDED = tuple(term for term in TERMS if term.name not in BELIEVED)
SD = np.array([term.parameters[0].prior.sd for term in ADDED])
EXIT = Exit(np.array([8.0, 9.5, 11.0]), np.array([0.7, 0.9, 1.0]), np.array([-4.0, 3.0, 7.0]))
DISTANCE_M = np.array([2.5, 3.5, 4.5])
AROUND = Circumstances(battery=np.array([-0.1, 0.0, 0.07]), since_last_shot_s=np.array([0.4, 1e9, 1.5]),
                       age=np.array([0.0, 0.5, 1.0]), droop=np.array([0.8, 1.0, 1.3]),
                       density=np.array([0.03, -0.04, 0.01]), hood_change=np.array([1.0, -1.0, 0.0]),
                       closing_speed_m_s=np.array([1.5, 0.0, -1.0]), ball=np.array([0.5, -1.0, 1.5]))
STEP_S, STEPS = 0.04, 12


def _values(amplitudes):
    given = {term.name: {term.parameters[0].name: size} for term, size in zip(ADDED, amplitudes, strict=True)}
    return effective(BELIEVED | given, AROUND)


def _shot(values, names):
    exit, distance_m = sense(GUPPY, values, EXIT, DISTANCE_M)
    return leave(GUPPY, values, exit), distance_m, make_law(GUPPY, flight_terms(names), values)


def _seen(amplitudes, terms=ADDED):
    """Heights at the plane over the opening's centre, its halves, and where a tracker sees the ball: [lanes, ...]."""
    values = _values(amplitudes)
    names = (*BELIEVED, *(term.name for term in terms if term in FLYING))
    exit, distance_m, law = _shot(values, names)
    opening = opening_of(GUPPY, values)
    height_m = reach_plane(GUPPY, law, exit, jnp.asarray(distance_m)).height_m - opening.centre_m
    flown = path(GUPPY, flight_terms(names), {name: values[name] for name in names}, exit, STEPS + 1, STEP_S)
    ball = jax.tree.map(lambda part: part[-1], flown)
    halves = [opening.three_half_m * jnp.ones(3), opening.two_half_m * jnp.ones(3)]
    tracked = watch(values, ball.position_m, ball.velocity_m_s, ball.time_s)
    return jnp.stack([height_m, *halves, *tracked], axis=1)


@pytest.fixture(scope="module")
def slopes():
    """By AD and by central differences: [terms, lanes, quantities] per standard deviation of each term's prior."""
    exact = jax.jit(jax.jacfwd(lambda share: _seen(share * SD)))(jnp.zeros(len(SD)))
    seen = jax.jit(lambda share: _seen(share * SD))
    step = 1e-3
    ways = [(seen(step * way) - seen(-step * way)) / (2 * step) for way in np.eye(len(SD))]
    return np.moveaxis(np.asarray(exact), -1, 0), np.stack(ways)


@pytest.mark.parametrize("number", range(len(ADDED)), ids=[term.name for term in ADDED])
def test_slopes_at_zero_are_those_of_whole_shots(slopes, number):
    exact, by_steps = (part[number] for part in slopes)
    assert np.abs(exact).max() > 1e-4                    # m per standard deviation: each is seen somewhere
    np.testing.assert_allclose(exact, by_steps, atol=1e-5 * max(1.0, np.abs(exact).max()), rtol=1e-4)


def test_together_at_zero_they_change_no_bit():
    """Step by step as written, and in one piece as XLA compiles it."""
    zero = _values(np.zeros(len(ADDED)))
    believed = effective(BELIEVED, AROUND)
    ends = []
    for values in (believed, zero):
        exit, distance_m, law = _shot(values, tuple(values))
        ball = start_of(GUPPY, exit, (3,))
        for _ in range(STEPS):
            ball = rk4(law, ball, STEP_S)
        place = watch(values, ball.position_m, ball.velocity_m_s, ball.time_s)
        ends.append(np.stack([np.broadcast_to(part, 3) for part in (
            *exit, distance_m, *place, *ball.velocity_m_s, *opening_of(GUPPY, values))]))
    np.testing.assert_array_equal(*ends)
    whole = np.asarray(jax.jit(_seen)(jnp.zeros(len(ADDED))))
    np.testing.assert_allclose(whole, _seen(np.zeros(len(ADDED)), ()), rtol=0, atol=1e-13)


@pytest.mark.parametrize(("name", "lane", "other"), [("rapid_fire", 0, 1), ("hood_backlash", 0, 2), ("ball_wear", 2, 0),
                                                     ("battery_sag", 0, 1), ("vision_latency", 0, 1)])
def test_shots_that_are_not_concerned_stay_as_they_are(slopes, name, lane, other):
    number = [term.name for term in ADDED].index(name)
    assert np.abs(slopes[0][number, lane]).max() > 1e-4
    np.testing.assert_array_equal(slopes[0][number, other], 0.0)


def test_a_sensing_term_leaves_alone_what_was_measured_on_the_ball():
    where = Exit(np.array([True, False, True]), np.array([False, True, True]), np.array([True, True, False]), True)
    params = {"hood_offset": {"angle_deg": 1.0}, "encoder_scale": {"share": 0.01}, "exit_efficiency": {"loss": 0.1},
              "ball_compression": {"share": 0.1}, "release_height": {"above_m": 0.02}}
    values = effective(params, Circumstances())
    exit, _ = sense(GUPPY, values, EXIT, DISTANCE_M, where)
    left = leave(GUPPY, values, exit, where)
    np.testing.assert_allclose(left.speed_m_s, EXIT.speed_m_s * np.where(where.speed_m_s, 1.01 * 0.9, 1.0))
    np.testing.assert_allclose(left.elevation_rad, EXIT.elevation_rad + np.radians(1.0) * where.elevation_rad)
    np.testing.assert_allclose(left.spin_rev_s, EXIT.spin_rev_s * np.where(where.spin_rev_s, 1.01 / 0.9, 1.0))
    np.testing.assert_allclose(left.above_m, 0.02)


def test_the_order_of_acting_is_the_catalogues():
    """Slip is of the wheels' own speed, whatever the order of asking."""
    assert [term.name for term in find_terms(["exit_efficiency", "wheel_slip"])] == ["wheel_slip", "exit_efficiency"]
    params = {"exit_efficiency": {"loss": 0.25}, "wheel_slip": {"loss_per_m_s": 0.02}}
    left = leave(GUPPY, effective(params, Circumstances()), Exit(12.5, 0.7, 3.0))
    assert float(left.speed_m_s) == pytest.approx(12.5 / 1.25 * 0.75)
