import itertools
import math

import pytest

from truearc.sim.world.field import Chassis


def _drive(stand: Chassis, dt: float = 0.005) -> list[float]:
    places = [stand.distance_m]
    while stand.moving and len(places) < 5000:
        stand.step(dt)
        places.append(stand.distance_m)
    return places


@pytest.mark.parametrize("goal", [2.6, 3.99, 4.3, 8.0])
@pytest.mark.parametrize("dt", [0.005, 0.001])
def test_it_stops_where_it_was_sent_within_its_limits(goal: float, dt: float) -> None:
    stand = Chassis(1, 4.0, 1.0)
    stand.drive_to(goal)
    places = _drive(stand, dt)
    assert stand.distance_m == goal
    assert not stand.moving
    speeds = [(b - a) / dt for a, b in itertools.pairwise(places)]
    assert max(map(abs, speeds)) < 1.5 + 0.2
    assert min(places) >= min(4.0, goal) - 0.01
    assert max(places) <= max(4.0, goal) + 0.01
    ideal = abs(goal - 4.0) / 1.5
    assert len(places) * dt < ideal + 1.6


def test_it_parks_a_little_askew_and_points_at_the_target() -> None:
    stand = Chassis(3, 4.0, 1.0)
    seen = set()
    for goal in (3.0, 7.0, 5.0, 2.6, 8.0):
        stand.drive_to(goal)
        _drive(stand)
        pose = stand.pose()
        assert pose.x_m == -goal
        assert abs(pose.y_m) <= 0.3
        off = pose.heading_rad - math.atan2(-pose.y_m, goal)
        assert abs(math.degrees(off)) <= 0.3 + 1e-9
        seen.add(round(pose.y_m, 6))
    assert len(seen) == 5


def test_square_to_the_target_when_so_told() -> None:
    stand = Chassis(3, 4.0, 0.0)
    stand.drive_to(6.0)
    _drive(stand)
    assert stand.pose() == (-6.0, 0.0, 0.0)
