"""Trajectories are the parabola where there is no air, and end where the simulator has the ball at the target."""

import numpy as np
import pytest

from truearc.robot.config.rig_spec import Ball, LauncherFacts, Rig, Target
from truearc.sim.data.dataset import Shots
from truearc.sim.physics.simulate import POINT_S, predict, trajectories

RIG = Rig(ball=Ball(mass_kg=0.14, radius_m=0.09), launcher=LauncherFacts(release_height_m=0.75),
          target=Target(centre_height_m=2.44))


def launches(n: int, seed: int) -> Shots:
    rng = np.random.default_rng(seed)
    numbers = {"distance_m": rng.uniform(2.0, 7.0, n), "exit_speed_m_s": rng.uniform(3.0, 14.0, n),
               "exit_deg": rng.uniform(10.0, 75.0, n), "exit_spin_rev_s": rng.uniform(-10.0, 10.0, n)}
    return Shots(tuple(map(str, range(n))), numbers, {})


def test_without_air_a_trajectory_is_the_parabola() -> None:
    shots = launches(20, 1)
    for row, (places, distance_m) in enumerate(trajectories(RIG, {}, shots)):
        t_s = POINT_S * np.arange(len(places) - 1)        # the last point lies between two
        speed, tilt = shots.number("exit_speed_m_s")[row], np.radians(shots.number("exit_deg")[row])
        assert distance_m == shots.number("distance_m")[row]
        np.testing.assert_allclose(places[:-1, 0], speed * np.cos(tilt) * t_s, atol=1e-9)
        np.testing.assert_allclose(places[:-1, 2], 0.75 + speed * np.sin(tilt) * t_s - 9.81 / 2.0 * t_s**2, atol=1e-9)
        assert not places[:, 1].any()


def test_a_trajectory_ends_at_the_plane_or_the_floor_as_predicted() -> None:
    shots, belief = launches(300, 2), {"drag": {"cd": 0.5}, "magnus": {"cl": 0.1}}
    heights = np.asarray(predict(RIG, belief, shots).height_m)
    ends = np.array([places[-1] for places, _ in trajectories(RIG, belief, shots)])
    reached = np.isfinite(heights)
    assert 50 < reached.sum() < 280
    np.testing.assert_allclose(ends[reached, 0], shots.number("distance_m")[reached], atol=1e-9)
    np.testing.assert_allclose(ends[reached, 2], heights[reached], atol=1e-3)
    assert (ends[~reached, 0] <= shots.number("distance_m")[~reached]).all()
    assert ends[~reached, 2] == pytest.approx(0.0, abs=1e-9)
