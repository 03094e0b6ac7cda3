"""A hidden effect and the catalogue's term of its name are one hypothesis: two codes, one flight, no luck or noise.

What a grader compares intervals with (truearc_proof.rounds.worlds) is thereby tested too.
"""

import numpy as np
import pytest

from benchmarks.worlds import Job, amount_of
from tests.proof.test_truth_flight import quiet
from tests.sim.physics.tracker import watch
from truearc.sim.data.dataset import Circumstances, circumstances_of
from truearc.sim.physics.simulate import opening_of, predict
from truearc.sim.physics.term import Vec
from truearc_proof.rounds.marks import in_catalogue
from truearc_proof.rounds.worlds import PARAMETER
from truearc_proof.truth.flight import CELSIUS_K, RAPID_FIRE_S, at, wheel_dip
from truearc_proof.truth.generate import play
from truearc_proof.truth.world import CATALOGUED, make_world

OF_TRACKER = ("track_scale", "track_tilt", "track_clock")
OF_TARGET = ("target_height", "rim_catch")
OF_FLIGHT = [effect.name for effect in CATALOGUED if effect.name not in OF_TRACKER + OF_TARGET]


def play_quietly(name):
    """(season, coefficients of its believed terms and the hidden one, world)."""
    job = Job("effects", name, "L2", 40, 1.0, 31, 0)
    world = quiet(make_world({name: amount_of(job)}, "L2", 40, 31))
    parameter, value = in_catalogue(job.name, amount_of(job))
    hidden = {parameter: value} | ({"time_constant_s": RAPID_FIRE_S} if name == "rapid_fire" else {})
    return play(world), {"drag": {"cd": world.cd}, "magnus": {"cl": world.lift_slope * 3.0 / 32.0},
                         "exit_efficiency": {"loss": 1.0 - world.efficiency}, name: hidden}, world


def true_circumstances(season, world):
    plan, dip = season.plan, wheel_dip(world, season.plan, season.wheels_rad_s)
    gas = plan.pressure_pa / (plan.temperature_c + CELSIUS_K)
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
        place, speed = zip(*(at(clean.flown.path, np.full(40, t)) for t in time_s), strict=True)
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
