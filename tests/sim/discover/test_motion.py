"""Flights with small extra accelerations, against DOP853 on equations written for the tests."""

import numpy as np
import pytest

from sim.discover.motion import Release, axes, believe, plane_heights, plane_slopes, track_positions, track_pushes
from sim.physics.catalogue import flight_terms
from sim.physics.vector import Vec
from tests.sim.discover.worlds import FACTS, World, fly
from tests.sim.discover.worlds import plane_heights as true_heights

SIMPLE = believe(FACTS, flight_terms(["gravity", "drag"]))
FULL = believe(FACTS, flight_terms(["gravity", "drag", "magnus"]))
START = np.array([0.3, 0.1, 1.0, 5.0, 0.4, 6.0])
TIME_S = np.linspace(0.0, 0.9, 19)


def release(start: np.ndarray) -> Release:
    return Release(start[None, :3], start[None, 3:], np.zeros((1, 3)))


def test_positions_agree_with_dop853() -> None:
    ours = track_positions(SIMPLE, release(START), np.array([0.6]), TIME_S[None], 3)[0][0]
    assert np.abs(np.asarray(ours) - fly(START, TIME_S, (0.6, 0.0, 0.0, 0.0, 0.0))).max() < 1e-6


def test_an_upward_push_moves_the_ball_as_dop853_says() -> None:
    pushes = track_pushes(SIMPLE, release(START), np.array([0.6]), TIME_S[None], np.array([0.3, 0.6]), 7.0, 3)[0]
    small = 1e-3
    flat = START.copy()
    flat[[1, 4]] = 0.0                                     # the reference pushes in the plane of flight
    ours = track_pushes(SIMPLE, release(flat), np.array([0.6]), TIME_S[None], np.array([0.3, 0.6]), 7.0, 3)[0]
    moved = (fly(flat, TIME_S, (0.6, 0.0, 0.0, 0.0, small)) - fly(flat, TIME_S, (0.6, 0.0, 0.0, 0.0, -small))) / 2e-3
    assert np.abs(np.asarray(ours)[:, :, 5] - moved).max() < 1e-4
    # throughout = the sum of its bands, in every direction
    whole = np.asarray(pushes).reshape(19, 3, 3, 5)
    assert np.abs(whole[..., 0] - whole[..., 1:4].sum(-1)).max() < 1e-9


def test_a_push_in_the_last_band_does_nothing_before_it() -> None:
    pushes = np.asarray(track_pushes(SIMPLE, release(START), np.array([0.6]), TIME_S[None], np.array([0.3, 0.6]), 7.0,
                                     3)[0]).reshape(19, 3, 3, 5)
    assert np.abs(pushes[TIME_S <= 0.6 - 1e-9, :, :, 3]).max() == 0.0
    assert np.abs(pushes[-1, :, :, 3]).max() > 0.01


@pytest.mark.parametrize("velocity", [(5.0, 0.0, 3.0), (4.0, -2.0, -1.0), (1.0, 1.0, 6.0)])
def test_axes_are_a_right_handed_frame_with_left_level_and_up_up(velocity: tuple[float, float, float]) -> None:
    along, up, left = (np.array([float(part) for part in axis]) for axis in axes(Vec(*velocity)))
    assert np.allclose(np.cross(along, left), up, atol=1e-5)
    assert np.allclose([along @ along, up @ up, left @ left], 1.0, atol=1e-4)
    assert abs(left[2]) < 1e-12
    assert up[2] > 0.0
    assert left @ np.cross([0.0, 0.0, 1.0], velocity) > 0.0


def launches(ratio: np.ndarray, hood_deg: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The paper's Eq. 11 and 12 for the test rig."""
    lower, upper = ratio * 594.0 * 0.0508, ratio * 594.0 * 0.5625 * 0.0349
    spin = np.zeros((len(ratio), 3))
    spin[:, 1] = -(lower - upper) / (2.0 * np.pi * 0.0889)
    launch = np.zeros((len(ratio), 6))
    launch[:, 0], launch[:, 1], launch[:, 2] = np.log((lower + upper) / 2.0), np.radians(hood_deg), 0.75
    return launch, spin


def test_heights_at_the_plane_agree_with_dop853() -> None:
    ratio, hood, distance = np.array([0.45, 0.55, 0.7]), np.array([40.0, 50.0, 60.0]), np.array([2.5, 4.0, 7.0])
    launch, spin = launches(ratio, hood)
    ours, near = plane_heights(FULL, launch, spin, distance, np.array([0.5, 0.06]))
    assert np.asarray(near).all()
    assert np.abs(np.asarray(ours) - true_heights(World(), ratio, hood, distance, np.ones(3))).max() < 1e-4


def test_slopes_of_heights_agree_with_differences() -> None:
    ratio, hood, distance = np.array([0.5, 0.6]), np.array([45.0, 55.0]), np.array([3.0, 5.0])
    launch, spin = launches(ratio, hood)
    slopes = plane_slopes(FULL, launch, spin, distance, np.array([0.5, 0.06]))
    by_launch, by_shared = (np.asarray(part) for part in slopes)

    def height(**change: float) -> np.ndarray:
        world = World(cd=0.5 + change.get("cd", 0.0))
        return true_heights(world, ratio, hood + np.degrees(change.get("angle", 0.0)),
                            distance + change.get("distance", 0.0), np.exp(np.full(2, change.get("speed", 0.0))))

    # the reference turns the spin with the speed only where the world says so: here it keeps it
    for name, column in (("speed", by_launch[:, 0]), ("angle", by_launch[:, 1]), ("distance", by_launch[:, 3]),
                         ("cd", by_shared[:, 0])):
        slope = (height(**{name: 1e-4}) - height(**{name: -1e-4})) / 2e-4
        assert np.allclose(column, slope, rtol=2e-3, atol=2e-3), name
    assert np.allclose(by_launch[:, 2], 1.0, atol=1e-6)     # a higher exit raises all by as much


def test_a_ball_that_never_arrives_is_said_not_to() -> None:
    launch, spin = launches(np.array([0.1]), np.array([80.0]))
    assert not np.asarray(plane_heights(FULL, launch, spin, np.array([9.0]), np.array([0.5, 0.06]))[1]).any()
