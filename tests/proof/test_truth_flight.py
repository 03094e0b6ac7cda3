"""Launch and flight of the concealed truth: closed forms, DOP853, and the terms of the catalogue."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.worlds import Job, amount_of
from tests.proof.law import fly_to
from tests.sim.physics.tracker import watch
from truearc.robot.config.rig_spec import Noise
from truearc.sim.data.dataset import Circumstances, circumstances_of
from truearc.sim.physics.simulate import opening_of, predict
from truearc.sim.physics.term import Vec
from truearc_proof.rounds.marks import in_catalogue
from truearc_proof.rounds.worlds import PARAMETER
from truearc_proof.truth import flight
from truearc_proof.truth.generate import foreign_robot, play
from truearc_proof.truth.world import CATALOGUED, SMALL_ERRORS, Scatter, find_effect, make_world, plan_shots

IN_THE_AIR = {"wind_x": -0.9, "wind_y": 0.7, "wind_z": 0.4, "spin_decay": 0.8, "spin_drag": 0.2,
              "lift_saturation": 1.1, "drag_reynolds": -0.3, "buoyancy": 1.0, "added_mass": 1.0, "air_density": 1.0,
              "drag_wear": 0.2, "drag_crisis": -0.2, "drag_power": -0.15}
STILL = Scatter(0.0, 0.0, 0.0, 0.0, 0.0)
EXACT = Noise(0.0, 0.0, 0.0, 0.0)
N = 40
RATIO = np.linspace(0.4, 0.7, N)
UP, LOW = RATIO * 594.0 * 0.5625 * 0.0349, RATIO * 594.0 * 0.0508


def quiet(world):
    return replace(world, scatter=STILL, noise=EXACT)


@pytest.mark.parametrize("hidden", [{}, IN_THE_AIR, *({name: size} for name, size in IN_THE_AIR.items())],
                         ids=lambda hidden: "+".join(hidden) if len(hidden) < 2 else "all")
def test_flights_agree_with_dop853(hidden):
    world = make_world(hidden, shots=12, seed=7)
    plan = plan_shots(world)
    rng = np.random.default_rng(1)
    launch = flight.Launch(rng.uniform(9.0, 14.0, 12), rng.uniform(35.0, 60.0, 12), rng.normal(0.0, 3.0, 12),
                    rng.uniform(0.0, 60.0, 12), rng.uniform(0.7, 0.8, 12))
    position, velocity, spin = flight.start_of(launch)
    distance = rng.uniform(2.0, 4.5, 12)
    path = flight.fly(flight.make_law(world, plan, spin, np.full(12, np.inf)), position, velocity, distance)
    arrival = flight.arrive(path, distance)
    density = flight.air_density(world, plan)
    for k in range(12):
        height, time, solution = fly_to(distance[k], position[:, k], velocity[:, k], spin[:, k], world, density[k],
                                        plan.used[k])
        assert arrival.height_m[k] == pytest.approx(height, abs=3e-6)
        assert arrival.time_s[k] == pytest.approx(time, abs=1e-6)
        midway = flight.at(path, np.full(12, 0.37 * time))[0][:, k]
        np.testing.assert_allclose(midway, solution(0.37 * time)[:3], atol=3e-6)


def test_the_late_gust_blows_in_the_last_third_only():
    world = make_world({"late_gust": 3.0}, shots=10)
    plan, calm = plan_shots(world), make_world(shots=10)
    launch = flight.Launch(*(np.full(10, value) for value in (10.0, 50.0, 0.0, 20.0, 0.75)))
    position, velocity, spin = flight.start_of(launch)
    from_s = np.full(10, 0.4)
    paths = [flight.fly(flight.make_law(one, plan, spin, from_s), position, velocity, np.full(10, 4.5))
             for one in (world, calm)]
    same, apart = (np.subtract(*(flight.at(path, np.full(10, t))[0][0] for path in paths)) for t in (0.375, 0.7))
    assert np.abs(same).max() < 1e-12
    assert apart.min() > 0.01


def test_balls_that_turn_back_or_meet_the_floor_are_not_clear():
    world = make_world(shots=10)
    plan = plan_shots(world)
    speed = np.array([1.0, 3.0, 5.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0])
    launch = flight.Launch(speed, np.full(10, 45.0), np.zeros(10), np.zeros(10), np.full(10, 0.75))
    position, velocity, spin = flight.start_of(launch)
    distance = np.full(10, 4.0)
    path = flight.fly(flight.make_law(world, plan, spin, np.full(10, np.inf)), position, velocity, distance)
    arrival = flight.arrive(path, distance)
    expected = [fly_to(4.0, position[:, k], velocity[:, k], spin[:, k], world)[0] > 0.0 for k in range(1, 10)]
    assert arrival.clear.tolist()[1:] == expected
    assert not arrival.clear[0] and 0 < sum(expected) < 9


@pytest.mark.parametrize("believe", [("gravity", "drag", "magnus", "exit_efficiency"), ("gravity", "drag")])
def test_without_hidden_effects_the_truth_is_what_is_believed(believe):
    """The seed's spin (its Eq. 12) is twice that of rolling; its C_l is 3/32 of the lift slope on account of that."""
    world = quiet(make_world(level="L1", shots=60, seed=3, believe=believe))
    season = play(world)
    coefficients = {"drag": {"cd": world.cd}, "magnus": {"cl": world.lift_slope * 3.0 / 32.0},
                    "exit_efficiency": {"loss": 1.0 - world.efficiency}}
    told = predict(world.facts, coefficients, season.dataset.shots)
    np.testing.assert_allclose(told.height_m, season.flown.arrival.height_m, atol=2e-6)
    np.testing.assert_allclose(told.time_s, season.flown.arrival.time_s, atol=1e-6)


def both(name, amount=None):
    """(launch without, launch with, plan) of the same shots by the same wheels."""
    size = find_effect(name).typical if amount is None else amount
    plain, hidden = (quiet(make_world(effects, "L1", N, 21)) for effects in ({}, {name: size}))
    plan = plan_shots(plain)
    left = (flight.leave(one, plan, flight.wheel_speeds(one, RATIO), flight.no_luck(N)) for one in (plain, hidden))
    return *left, plan, size


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


# of those in no catalogue; the last tests here hold the others against the catalogue's terms
SPEED = {
    "far_kick": lambda plan, size: 1.0 + size * (plan.distance_m - 4.5) / 2.5,
    "cold_rubber": lambda plan, size: 1.0 + size * (plan.temperature_c - 20.0) / 10.0}


@pytest.mark.parametrize("name", SPEED)
def test_effects_that_change_the_speed_change_nothing_else(name):
    plain, hidden, plan, size = both(name)
    np.testing.assert_allclose(hidden.speed_m_s / plain.speed_m_s, SPEED[name](plan, size), rtol=1e-12)
    assert np.ptp(hidden.speed_m_s / plain.speed_m_s) > 0.005
    for part in ("elevation_deg", "azimuth_deg", "backspin_rad_s", "height_m"):
        assert np.array_equal(getattr(plain, part), getattr(hidden, part))


def test_a_worn_wheel_and_a_hood_that_bends():
    efficiency = make_world(level="L1", shots=N, seed=21).efficiency
    plain, worn, _, size = both("worn_wheel")
    np.testing.assert_allclose(worn.speed_m_s - plain.speed_m_s, efficiency * size * LOW / 2.0)
    np.testing.assert_allclose(worn.backspin_rad_s - plain.backspin_rad_s, size * LOW / (2.0 * 0.0889))
    plain, bent, _, size = both("hood_flex")
    np.testing.assert_allclose(bent.elevation_deg - plain.elevation_deg, size * (RATIO * 594.0 - 250.0) / 100.0)


def test_small_errors_of_a_foreign_launcher():
    efficiency = make_world(level="L1", shots=N, seed=21).efficiency
    plain, soft, _, size = both("soft_ball")
    np.testing.assert_allclose(soft.speed_m_s / plain.speed_m_s, 1.0 - size * ((UP + LOW) / 20.0)**2, rtol=1e-12)
    assert np.array_equal(soft.backspin_rad_s, plain.backspin_rad_s)
    plain, geared, _, size = both("wheel_gear")
    np.testing.assert_allclose(geared.speed_m_s - plain.speed_m_s, efficiency * size * UP / 2.0)
    np.testing.assert_allclose(plain.backspin_rad_s - geared.backspin_rad_s, size * UP / (2.0 * 0.0889))
    plain, geared, plan, size = both("hood_gear")
    np.testing.assert_allclose(geared.elevation_deg - plain.elevation_deg, size * (plan.hood_deg - 45.0))
    plain, tilted, _, size = both("slow_tilt")
    np.testing.assert_allclose(tilted.elevation_deg - plain.elevation_deg,
                               size * ((250.0 / (RATIO * 594.0))**2 - 1.0))
    assert np.array_equal(tilted.speed_m_s, plain.speed_m_s)


@pytest.mark.parametrize("seed", range(20000, 20040))
def test_errors_of_a_foreign_robot_are_small_and_the_same_before_and_after_the_change(seed):
    home, event = foreign_robot(seed, "L1", 30, 12, {"wind_x": 1.5})
    assert dict(event.effects) == {**home.effects, "wind_x": 1.5} and (home.shots, event.shots) == (30, 12)
    assert (home.cd, home.lift_slope, home.efficiency) == (event.cd, event.lift_slope, event.efficiency)
    assert home.seed != event.seed and home.facts == event.facts
    typical = {error.name: abs(error.typical) for error in SMALL_ERRORS}
    assert 3 <= len(home.effects) <= len(SMALL_ERRORS) and set(home.effects) <= set(typical)
    assert all(0.5 * typical[name] <= abs(size) <= 1.5 * typical[name] for name, size in home.effects.items())
    assert all(home.effects.get(error.name, 1.0) > 0.0 for error in SMALL_ERRORS if not error.signed)


def test_the_dip_is_the_energy_that_the_ball_takes():
    world = make_world(level="L1", shots=N, seed=21)
    plan, wheels = plan_shots(world), flight.wheel_speeds(world, RATIO)
    left = wheels[0] * (1.0 - flight.wheel_dip(world, plan, wheels))
    given_j = 0.5 * 1.2e-3 * (wheels[0]**2 - left**2)
    speed, spin = world.efficiency * (UP + LOW) / 2.0, (LOW - UP) / (2.0 * 0.0889)
    flying_j = 0.5 * 0.14 * speed**2 + 0.5 * (0.4 * 0.14 * 0.0889**2) * spin**2
    np.testing.assert_allclose(given_j, flying_j * plan.squeeze, rtol=1e-9)


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
    mine = plan.used[plan.ball == 0]
    np.testing.assert_allclose(np.diff(mine), mine[1])
    inside = plan.session == 0
    assert np.polyfit(plan.t_s[inside], plan.battery_v[inside], 1)[0] < 0.0
    assert plan.distance_m.min() >= 2.0 and plan.distance_m.max() <= 7.0 and plan.hood_deg.min() >= 30.0


# --- effects and terms: two codes, one flight, no luck or noise

OF_TRACKER = ("track_scale", "track_tilt", "track_clock")
OF_TARGET = ("target_height", "rim_catch")
OF_FLIGHT = [effect.name for effect in CATALOGUED if effect.name not in OF_TRACKER + OF_TARGET]


def play_quietly(name):
    """(season, coefficients of its believed terms and the hidden one, world)."""
    job = Job("effects", name, "L2", 40, 1.0, 31, 0)
    world = quiet(make_world({name: amount_of(job)}, "L2", 40, 31))
    parameter, value = in_catalogue(job.name, amount_of(job))
    hidden = {parameter: value} | ({"time_constant_s": flight.RAPID_FIRE_S} if name == "rapid_fire" else {})
    return play(world), {"drag": {"cd": world.cd}, "magnus": {"cl": world.lift_slope * 3.0 / 32.0},
                         "exit_efficiency": {"loss": 1.0 - world.efficiency}, name: hidden}, world


def true_circumstances(season, world):
    plan, dip = season.plan, flight.wheel_dip(world, season.plan, season.wheels_rad_s)
    gas = plan.pressure_pa / (plan.temperature_c + flight.CELSIUS_K)
    return Circumstances(plan.battery_v / np.median(plan.battery_v) - 1.0, np.nan_to_num(plan.since_last_s, nan=1e9),
                         plan.used, dip / dip.mean(), gas / np.median(gas) - 1.0, plan.hood_came, plan.closing_m_s,
                         plan.fresh_ball)


def test_every_catalogued_effect_has_its_parameter():
    assert set(PARAMETER) == {effect.name for effect in CATALOGUED}


@pytest.mark.parametrize("name", OF_FLIGHT)
def test_the_terms_flight_is_the_effects_flight(name):
    season, coefficients, world = play_quietly(name)
    shots, circumstances = season.dataset.shots, true_circumstances(season, world)
    told = predict(world.facts, coefficients, shots, circumstances=circumstances)
    without = predict(world.facts, {key: coefficients[key] for key in coefficients if key != name}, shots)
    truth = season.flown.arrival.height_m
    np.testing.assert_allclose(told.height_m, truth, atol=5e-6)
    assert np.abs(without.height_m - truth).max() > (1e-4 if name == "wind_y" else 0.004)


@pytest.mark.parametrize("name", OF_TARGET)
def test_the_terms_opening_is_the_effects_opening(name):
    season, coefficients, world = play_quietly(name)
    opening = opening_of(world.facts, coefficients)
    off = np.abs(season.flown.arrival.height_m - opening.centre_m)
    told = np.where(off <= opening.three_half_m, "three", np.where(off <= opening.two_half_m, "two", "miss"))
    assert np.array_equal(told, np.array(season.dataset.shots.text("outcome")))


@pytest.mark.parametrize("name", OF_TRACKER)
def test_the_terms_tracker_is_the_effects_tracker(name):
    season, coefficients, _ = play_quietly(name)
    clean = play(quiet(make_world({}, "L2", 40, 31)))
    seen, tracks = season.dataset.tracks, clean.dataset.tracks
    for k in range(10):
        rows = np.flatnonzero(seen.shot == k)[:20]
        first_s = tracks.x_m[np.flatnonzero(tracks.shot == k)[0]] / clean.flown.path.velocity_m_s[0, 0, k]
        time_s = first_s + seen.t_s[rows]
        place, speed = zip(*(flight.at(clean.flown.path, np.full(40, t)) for t in time_s), strict=True)
        ball = [Vec(*(np.array([one[axis, k] for one in part]) for axis in range(3))) for part in (place, speed)]
        told = watch(coefficients, *ball, time_s)
        # the term's clock is a first-order one, and starts at release: 2 mm
        np.testing.assert_allclose(np.stack([seen.x_m[rows], seen.y_m[rows], seen.z_m[rows]]), np.stack(told),
                                   atol=6e-3 if name == "track_clock" else 2e-3)
        moved = np.abs(np.stack([seen.x_m[rows], seen.z_m[rows]]) - np.stack([ball[0].x, ball[0].z]))
        assert moved.max() > 0.02


def test_what_the_solver_gathers_is_what_was():
    world = make_world(level="L1", shots=200, seed=32)
    season = play(world)
    told, true = circumstances_of(season.dataset), true_circumstances(season, world)
    assert np.array_equal(told.age, true.age)
    np.testing.assert_allclose(told.since_last_shot_s, true.since_last_shot_s)
    for name, error in (("battery", 0.004), ("density", 0.002), ("closing_speed_m_s", 0.05), ("droop", 0.12)):
        off = getattr(told, name) - getattr(true, name)
        assert np.sqrt(np.mean(off**2)) < error, name
    assert np.mean(told.hood_change == true.hood_change) > 0.97
