"""Each hidden effect of the sensing, launch and arrival stages against its closed form, shot by shot."""

import numpy as np
import pytest

from tests.proof.test_truth_flight import quiet
from truearc_proof.truth.effects import find_effect
from truearc_proof.truth.generate import play
from truearc_proof.truth.launch import leave, no_luck, wheel_dip, wheel_speeds
from truearc_proof.truth.plan import plan_shots
from truearc_proof.truth.sensors import see_places
from truearc_proof.truth.world import make_world

N = 40
RATIO = np.linspace(0.4, 0.7, N)
UP, LOW = RATIO * 594.0 * 0.5625 * 0.0349, RATIO * 594.0 * 0.0508


def both(name, amount=None):
    """(launch without, launch with, plan) of the same shots by the same wheels."""
    size = find_effect(name).typical if amount is None else amount
    plain, hidden = (quiet(make_world(effects, "L1", N, 21)) for effects in ({}, {name: size}))
    plan = plan_shots(plain)
    return *(leave(one, plan, wheel_speeds(one, RATIO), no_luck(N)) for one in (plain, hidden)), plan, size


def test_the_ball_rolls_between_its_wheels_less_what_is_lost():
    launch, _, plan, _ = both("ball_wear")
    world = make_world(level="L1", shots=N, seed=21)
    np.testing.assert_allclose(launch.speed_m_s, world.efficiency * (UP + LOW) / 2.0, rtol=1e-12)
    np.testing.assert_allclose(launch.backspin_rad_s, (LOW - UP) / (2.0 * 0.0889), rtol=1e-12)
    # surface speed of a rolling ball at either wheel is that wheel's
    middle = launch.speed_m_s / world.efficiency
    np.testing.assert_allclose(middle + 0.0889 * launch.backspin_rad_s, LOW)
    np.testing.assert_allclose(middle - 0.0889 * launch.backspin_rad_s, UP)
    assert np.array_equal(launch.elevation_deg, plan.hood_deg) and np.all(launch.height_m == 0.75)


SPEED = {
    "ball_wear": lambda plan, size, dip: 1.0 - size * plan.used,
    "ball_spread": lambda plan, size, dip: 1.0 + size * plan.fresh_ball,
    "battery_sag": lambda plan, size, dip: 1.0 + size * (plan.battery_v / np.median(plan.battery_v) - 1.0),
    "rapid_fire": lambda plan, size, dip: 1.0 - size * np.where(np.isnan(plan.since_last_s), 0.0,
                                                                np.exp(-np.nan_to_num(plan.since_last_s))),
    "wheel_droop": lambda plan, size, dip: 1.0 - size * dip / dip.mean(),
    "far_kick": lambda plan, size, dip: 1.0 + size * (plan.distance_m - 4.5) / 2.5,
    "cold_rubber": lambda plan, size, dip: 1.0 + size * (plan.temperature_c - 20.0) / 10.0,
}


@pytest.mark.parametrize("name", SPEED)
def test_effects_that_change_the_speed_change_nothing_else(name):
    plain, hidden, plan, size = both(name)
    world = make_world(level="L1", shots=N, seed=21)
    dip = wheel_dip(world, plan, wheel_speeds(world, RATIO))
    np.testing.assert_allclose(hidden.speed_m_s / plain.speed_m_s, SPEED[name](plan, size, dip), rtol=1e-12)
    assert np.ptp(hidden.speed_m_s / plain.speed_m_s) > 0.005
    for part in ("elevation_deg", "azimuth_deg", "backspin_rad_s", "height_m"):
        assert np.array_equal(getattr(plain, part), getattr(hidden, part))


def test_slip_encoder_squeeze_height_and_flex():
    plain, slipping, _, size = both("wheel_slip")
    efficiency = make_world(level="L1", shots=N, seed=21).efficiency
    middle = (UP + LOW) / 2.0
    np.testing.assert_allclose(slipping.speed_m_s, efficiency * middle / (1.0 + size * middle))
    plain, scaled, _, size = both("encoder_scale")
    np.testing.assert_allclose(scaled.speed_m_s, (1.0 + size) * plain.speed_m_s)
    np.testing.assert_allclose(scaled.backspin_rad_s, (1.0 + size) * plain.backspin_rad_s)
    plain, worn, _, size = both("worn_wheel")
    np.testing.assert_allclose(worn.speed_m_s - plain.speed_m_s, efficiency * size * LOW / 2.0)
    np.testing.assert_allclose(worn.backspin_rad_s - plain.backspin_rad_s, size * LOW / (2.0 * 0.0889))
    plain, squeezed, _, size = both("ball_compression")
    np.testing.assert_allclose(squeezed.backspin_rad_s * (1.0 - size), plain.backspin_rad_s)
    assert np.array_equal(squeezed.speed_m_s, plain.speed_m_s)
    plain, raised, _, size = both("release_height")
    np.testing.assert_allclose(raised.height_m - plain.height_m, size)
    plain, bent, _, size = both("hood_flex")
    np.testing.assert_allclose(bent.elevation_deg - plain.elevation_deg, size * (RATIO * 594.0 - 250.0) / 100.0)


def test_the_dip_is_the_energy_that_the_ball_takes():
    world = make_world(level="L1", shots=N, seed=21)
    plan, wheels = plan_shots(world), wheel_speeds(world, RATIO)
    left = wheels[0] * (1.0 - wheel_dip(world, plan, wheels))
    given_j = 0.5 * 1.2e-3 * (wheels[0]**2 - left**2)
    speed, spin = world.efficiency * (UP + LOW) / 2.0, (LOW - UP) / (2.0 * 0.0889)
    flying_j = 0.5 * 0.14 * speed**2 + 0.5 * (0.4 * 0.14 * 0.0889**2) * spin**2
    np.testing.assert_allclose(given_j, flying_j * plan.squeeze, rtol=1e-9)


SENSED = {
    "distance_scale": lambda plan, seen, size: seen * (1.0 + size),
    "distance_bias": lambda plan, seen, size: seen + size,
    "vision_latency": lambda plan, seen, size: seen - size * plan.closing_m_s,
}


@pytest.mark.parametrize("name", SENSED)
def test_true_distances_from_measured_ones(name):
    size = find_effect(name).typical
    world = quiet(make_world({name: size}, "L1", N, 22))
    plan = plan_shots(world)
    distance, hood = see_places(world, plan)
    np.testing.assert_allclose(SENSED[name](plan, distance, size), plan.distance_m)
    assert np.abs(distance - plan.distance_m).max() > 0.02 and np.array_equal(hood, plan.hood_deg)


def test_true_elevations_from_measured_ones():
    world = quiet(make_world({"hood_offset": 0.8}, "L1", N, 22))
    plan = plan_shots(world)
    np.testing.assert_allclose(plan.hood_deg - see_places(world, plan)[1], 0.8)
    slack = quiet(make_world({"hood_backlash": 0.6}, "L1", N, 22))
    short = see_places(slack, plan)[1] - plan.hood_deg
    rising = np.diff(plan.hood_deg, prepend=plan.hood_deg[0])
    first = np.diff(plan.session, prepend=-1) > 0
    np.testing.assert_allclose(short[~first], 0.6 * np.sign(rising[~first]), atol=1e-12)
    assert np.all(short[first] == 0.0)


@pytest.mark.parametrize(("effects", "centre", "more"), [({}, 2.44, 0.0), ({"target_height": 0.05}, 2.49, 0.0),
                                                         ({"rim_catch": 0.03}, 2.44, 0.03)])
def test_outcomes_are_heights_against_the_true_opening(effects, centre, more):
    season = play(make_world(effects, shots=400, seed=23, side=True))
    off = np.abs(season.flown.arrival.height_m - centre)
    expected = np.where(off <= 0.07 + more, "three", np.where(off <= 0.35 + more, "two", "miss"))
    assert np.array_equal(np.array(season.dataset.shots.text("outcome")), expected)
    low = np.array(season.dataset.shots.text("side")) == "low"
    assert np.array_equal(low, (season.flown.arrival.height_m < centre) & (expected != "three"))


@pytest.mark.parametrize(("shots", "sessions"), [(100, 3), (300, 10), (1000, 33)])
def test_covariates_vary_as_in_life(shots, sessions):
    plan = plan_shots(make_world(level="L1", shots=shots, seed=24))
    assert len(set(plan.session)) == sessions and 12 <= len(set(plan.ball)) <= 20
    assert set(np.flatnonzero(np.isnan(plan.since_last_s))) == set(np.flatnonzero(np.diff(plan.session, prepend=-1)))
    apart = np.diff(plan.t_s)[np.diff(plan.session) == 0]
    np.testing.assert_allclose(apart, plan.since_last_s[~np.isnan(plan.since_last_s)])
    assert 0.5 <= apart.min() < 1.0 and 8.0 < apart.max() <= 10.0
    assert plan.used.min() == 0.0 and plan.used.max() == 1.0
    for k in range(3):
        mine = plan.used[plan.ball == k]
        np.testing.assert_allclose(np.diff(mine), mine[1])
    inside = plan.session == 0
    assert np.polyfit(plan.t_s[inside], plan.battery_v[inside], 1)[0] < 0.0
    assert plan.distance_m.min() >= 2.0 and plan.distance_m.max() <= 7.0 and plan.hood_deg.min() >= 30.0
