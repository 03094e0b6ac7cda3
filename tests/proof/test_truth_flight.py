"""The concealed flight against DOP853, closed forms and, without hidden effects, the simulator it is hidden from."""

from dataclasses import replace

import numpy as np
import pytest

from tests.proof.law import fly_to
from truearc.robot.config.rig_spec import Noise
from truearc.sim.physics.simulate import predict
from truearc_proof.truth.air import make_law, start_of
from truearc_proof.truth.flight import arrive, at, fly
from truearc_proof.truth.generate import play
from truearc_proof.truth.launch import Launch, air_density
from truearc_proof.truth.plan import plan_shots
from truearc_proof.truth.world import Scatter, make_world

IN_THE_AIR = {"wind_x": -0.9, "wind_y": 0.7, "wind_z": 0.4, "spin_decay": 0.8, "spin_drag": 0.2,
              "lift_saturation": 1.1, "drag_reynolds": -0.3, "buoyancy": 1.0, "added_mass": 1.0, "air_density": 1.0,
              "drag_wear": 0.2, "drag_crisis": -0.2}
STILL = Scatter(0.0, 0.0, 0.0, 0.0, 0.0)
EXACT = Noise(0.0, 0.0, 0.0, 0.0)


def quiet(world):
    return replace(world, scatter=STILL, noise=EXACT)


@pytest.mark.parametrize("hidden", [{}, IN_THE_AIR, *({name: size} for name, size in IN_THE_AIR.items())],
                         ids=lambda hidden: "+".join(hidden) if len(hidden) < 2 else "all")
def test_flights_agree_with_dop853(hidden):
    world = make_world(hidden, shots=12, seed=7)
    plan = plan_shots(world)
    rng = np.random.default_rng(1)
    launch = Launch(rng.uniform(9.0, 14.0, 12), rng.uniform(35.0, 60.0, 12), rng.normal(0.0, 3.0, 12),
                    rng.uniform(0.0, 60.0, 12), rng.uniform(0.7, 0.8, 12))
    position, velocity, spin = start_of(launch)
    distance = rng.uniform(2.0, 4.5, 12)
    path = fly(make_law(world, plan, spin, np.full(12, np.inf)), position, velocity, distance)
    arrival = arrive(path, distance)
    density = air_density(world, plan)
    for k in range(12):
        height, time, solution = fly_to(distance[k], position[:, k], velocity[:, k], spin[:, k], world, density[k],
                                        plan.used[k])
        assert arrival.height_m[k] == pytest.approx(height, abs=3e-6)
        assert arrival.time_s[k] == pytest.approx(time, abs=1e-6)
        midway = at(path, np.full(12, 0.37 * time))[0][:, k]
        np.testing.assert_allclose(midway, solution(0.37 * time)[:3], atol=3e-6)


def test_a_ball_in_a_vacuum_flies_a_parabola():
    world = replace(make_world(shots=10), cd=0.0, lift_slope=0.0)
    plan = plan_shots(world)
    speed, up = np.linspace(6.0, 15.0, 10), np.linspace(40.0, 65.0, 10)
    position, velocity, spin = start_of(Launch(speed, up, np.zeros(10), np.full(10, 30.0), np.full(10, 0.75)))
    distance = np.full(10, 2.5)
    arrival = arrive(fly(make_law(world, plan, spin, np.full(10, np.inf)), position, velocity, distance), distance)
    time = 2.5 / velocity[0]
    np.testing.assert_allclose(arrival.time_s, time, atol=1e-12)
    np.testing.assert_allclose(arrival.height_m, 0.75 + velocity[2] * time - 0.5 * 9.81 * time**2, atol=1e-12)


def test_the_late_gust_blows_in_the_last_third_only():
    world = make_world({"late_gust": 3.0}, shots=10)
    plan, calm = plan_shots(world), make_world(shots=10)
    launch = Launch(*(np.full(10, value) for value in (10.0, 50.0, 0.0, 20.0, 0.75)))
    position, velocity, spin = start_of(launch)
    from_s = np.full(10, 0.4)
    paths = [fly(make_law(one, plan, spin, from_s), position, velocity, np.full(10, 4.5)) for one in (world, calm)]
    same, apart = (at(paths[0], np.full(10, t))[0][0] - at(paths[1], np.full(10, t))[0][0] for t in (0.375, 0.7))
    assert np.abs(same).max() < 1e-12
    assert apart.min() > 0.01


def test_balls_that_turn_back_or_meet_the_floor_are_not_clear():
    world = make_world(shots=10)
    plan = plan_shots(world)
    speed = np.array([1.0, 3.0, 5.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0])
    launch = Launch(speed, np.full(10, 45.0), np.zeros(10), np.zeros(10), np.full(10, 0.75))
    position, velocity, spin = start_of(launch)
    distance = np.full(10, 4.0)
    arrival = arrive(fly(make_law(world, plan, spin, np.full(10, np.inf)), position, velocity, distance), distance)
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
