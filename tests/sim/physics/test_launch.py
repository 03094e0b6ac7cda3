"""Wheels to ball, against the paper's equations by hand and against a rigid ball that rolls."""

import numpy as np
import pytest

from tests.sim.physics import reference
from tests.sim.physics.rigs import GUPPY, with_wheels
from truearc.errors import InputError
from truearc.sim.physics.simulate import exit_no_slip
from truearc_proof.reproduce.collect import exit_seed


def test_seed_exit_is_equations_11_and_12():
    exit = exit_seed(GUPPY, np.array([0.0, 0.5, 1.0]), np.array([15.0, 45.0, 75.0]))
    expected = [reference.exit_of(ratio) for ratio in (0.0, 0.5, 1.0)]
    np.testing.assert_allclose(exit.speed_m_s, [speed for speed, _ in expected], rtol=1e-14)
    np.testing.assert_allclose(exit.spin_rev_s, [spin for _, spin in expected], rtol=1e-14)
    np.testing.assert_allclose(exit.elevation_rad, np.pi * np.array([1 / 12, 1 / 4, 5 / 12]))
    assert exit.spin_rev_s[2] > 0    # the lower wheel is the faster: backspin


def test_no_slip_gives_the_seeds_speed_and_half_its_spin():
    upper, lower = 9.0, 15.0
    speed, spin = exit_no_slip(with_wheels(180.0, 0.0), [[lower, upper]])
    assert speed[0] == pytest.approx((upper + lower) / 2)
    seed_rad_s = (lower - upper) / reference.RADIUS_M
    np.testing.assert_allclose(spin[0], [0.0, -seed_rad_s / 2, 0.0], atol=1e-12)


@pytest.mark.parametrize("clocks", [(0.0, 120.0, 240.0), (180.0, 60.0, -60.0), (10.0, 80.0, 200.0, 300.0)])
def test_no_slip_recovers_a_rolling_ball(clocks):
    """Surface speeds of a rigid ball by the cross product in space, exit direction x, left y, up z."""
    rng = np.random.default_rng(4)
    speed, spin = rng.uniform(5, 20, 50), np.column_stack([np.zeros(50), rng.normal(0, 60, (50, 2))])
    surface = np.empty((50, len(clocks)))
    for wheel, clock in enumerate(np.radians(clocks)):
        contact = reference.RADIUS_M * np.array([0.0, -np.sin(clock), np.cos(clock)])   # clockwise seen from behind
        surface[:, wheel] = speed + np.cross(spin, contact)[:, 0]
    got_speed, got_spin = exit_no_slip(with_wheels(*clocks), surface)
    np.testing.assert_allclose(got_speed, speed, rtol=1e-12)
    np.testing.assert_allclose(got_spin, spin, atol=1e-10)


def test_a_lone_wheel_rolls_the_ball_along_a_wall():
    speed, spin = exit_no_slip(with_wheels(180.0), [[10.0]])
    assert speed[0] == pytest.approx(5.0)
    np.testing.assert_allclose(spin[0], [0.0, -5.0 / reference.RADIUS_M, 0.0], atol=1e-12)


def test_the_seeds_exit_needs_opposed_wheels_and_a_free_speed():
    with pytest.raises(InputError, match="clock_deg 0 and 180"):
        exit_seed(with_wheels(0.0, 120.0, 240.0), 0.5, 45.0)
