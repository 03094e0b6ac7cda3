"""The paper's simulator against DOP853 of the paper's equations, wheels to ball, and what it takes from columns."""

import msgspec
import numpy as np
import pytest

from tests.sim.physics import reference
from tests.sim.physics.rigs import GUPPY, with_wheels
from truearc.errors import InputError
from truearc.robot.config.rig_spec import Ball, LauncherFacts, Rig, Target
from truearc.sim.data.dataset import Circumstances, Shots
from truearc.sim.physics import simulate as sim
from truearc.sim.physics.catalogue import effective, flight_terms
from truearc.sim.physics.flight import fly
from truearc.sim.physics.term import Exit
from truearc_proof.reproduce.collect import exit_seed

SEED = flight_terms(("gravity", "drag", "magnus"))
RIG = Rig(ball=Ball(mass_kg=0.14, radius_m=0.09), launcher=LauncherFacts(release_height_m=0.75),
          target=Target(centre_height_m=2.44))


def _shots(**numbers) -> Shots:
    columns = {name: np.atleast_1d(np.asarray(column, dtype=float)) for name, column in numbers.items()}
    count = max(column.size for column in columns.values())
    return Shots(tuple(f"s{row}" for row in range(count)),
                 {name: np.broadcast_to(column, count) for name, column in columns.items()}, {})


def _compare(shots: Shots, cd: np.ndarray, cl: np.ndarray, height_m: np.ndarray) -> dict[str, int]:
    """Assert agreement with DOP853 to 1e-5 m, empty rows included; how often each end came."""
    rows = zip(shots.number("distance_m"), shots.number("motor_ratio"), shots.number("hood_deg"), cd, cl, strict=True)
    flights = [reference.integrate(*row) for row in rows]
    expected = np.array([flight.height_m for flight in flights])
    np.testing.assert_array_equal(np.isnan(height_m), np.isnan(expected))
    np.testing.assert_allclose(height_m, expected, atol=1e-5, rtol=0, equal_nan=True)
    ends = [flight.end for flight in flights]
    return {end: ends.count(end) for end in set(ends)}


def _random_shots(rng: np.random.Generator, count: int) -> Shots:
    return _shots(distance_m=rng.uniform(1, 16, count), motor_ratio=rng.uniform(0, 1, count),
                  hood_deg=rng.uniform(15, 75, count))


@pytest.mark.parametrize(("cd", "cl"), [(0.0, 0.0), (0.91, 0.06), (0.0, 5.0), (5.0, 0.0), (5.0, 5.0), (0.0, 0.3)])
def test_predict_agrees_with_dop853(cd, cl):
    shots = _random_shots(np.random.default_rng(12), 60)
    crossing = sim.predict(GUPPY, {"drag": {"cd": cd}, "magnus": {"cl": cl}}, shots)
    _compare(shots, np.full(60, cd), np.full(60, cl), crossing.height_m)
    np.testing.assert_array_equal(crossing.reached, ~np.isnan(crossing.height_m))


def test_rows_keep_their_order_in_blocks():
    shots = _random_shots(np.random.default_rng(14), 5000)
    whole = sim.predict(GUPPY, {"drag": {"cd": 0.91}, "magnus": {"cl": 0.06}}, shots)
    some = np.random.default_rng(15).permutation(5000)[:37]
    part = sim.predict(GUPPY, {"drag": {"cd": 0.91}, "magnus": {"cl": 0.06}}, shots.take(some))
    np.testing.assert_allclose(part.height_m, whole.height_m[some], rtol=0, atol=1e-12, equal_nan=True)


def test_classify_is_equations_13_and_14():
    centre = 2.44
    heights = centre + np.array([0.0, 0.0699, -0.0699, 0.0701, -0.3499, 0.3501, -2.0, np.nan])
    assert list(sim.classify(GUPPY, heights)) == ["three", "three", "three", "two", "two", "miss", "miss", "miss"]
    with pytest.raises(InputError, match="target"):
        sim.classify(msgspec.structs.replace(GUPPY, target=None), heights)


def test_measured_columns_take_precedence_row_by_row():
    nan = np.nan
    shots = _shots(hood_deg=50.0, motor_ratio=0.5, wheel_lower_rad_s=[nan, 400.0, 400.0, 400.0],
                   wheel_upper_rad_s=[nan, 200.0, 200.0, nan], exit_speed_m_s=[nan, nan, 9.0, nan],
                   exit_deg=[nan, nan, 48.0, nan], exit_spin_rev_s=[nan, nan, 3.0, nan])
    exit = sim.launch_of(GUPPY, shots)
    by_ratio = reference.exit_of(0.5)
    lower, upper = 400.0 * reference.LOWER_RADIUS_M, 200.0 * reference.UPPER_RADIUS_M
    mixed = 594.0 * 0.5 * reference.UPPER_GEAR * reference.UPPER_RADIUS_M
    np.testing.assert_allclose(exit.speed_m_s, [by_ratio[0], (lower + upper) / 2, 9.0, (lower + mixed) / 2])
    per_rev = 2 * np.pi * reference.RADIUS_M
    spins = [by_ratio[1], (lower - upper) / per_rev, 3.0, (lower - mixed) / per_rev]
    np.testing.assert_allclose(exit.spin_rev_s, spins)
    np.testing.assert_allclose(np.degrees(exit.elevation_rad), [50.0, 50.0, 48.0, 50.0])


@pytest.mark.parametrize(("lacking", "named"), [("motor_ratio", "motor_ratio"), ("hood_deg", "hood_deg"),
                                                ("distance_m", "distance_m")])
def test_shots_without_a_launch_are_named(lacking, named):
    columns = {"distance_m": [3.0, 3.0], "motor_ratio": [0.5, 0.5], "hood_deg": [50.0, 50.0]}
    columns[lacking] = [columns[lacking][0], np.nan]
    with pytest.raises(InputError, match=f"shots s1: {named}"):
        sim.predict(GUPPY, {}, _shots(**columns))


def test_predictions_take_circumstances_shot_by_shot():
    """A battery that halves the speed of one shot in three, and a launch term, a wind and a hood for all of them."""
    shots = _shots(hood_deg=50.0, motor_ratio=[0.5, 0.55, 0.6], distance_m=[1.0, 2.0, 3.0])
    base = {"drag": {"cd": 0.5}, "magnus": {"cl": 0.05}, "gravity": {"scale": 1.0}}
    more = {"battery_sag": {"sensitivity": 0.5}, "hood_offset": {"angle_deg": 2.0}, "wind_x": {"speed_m_s": 1.0}}
    around = Circumstances(battery=np.array([0.0, -0.2, 0.1]))
    said = sim.predict(GUPPY, base | more, shots, circumstances=around)
    speed = sim.launch_of(GUPPY, shots).speed_m_s * (1.0 + 0.5 * around.battery)
    by_hand = _shots(exit_deg=52.0, exit_speed_m_s=speed, exit_spin_rev_s=sim.launch_of(GUPPY, shots).spin_rev_s,
                     distance_m=[1.0, 2.0, 3.0])
    wanted = sim.predict(GUPPY, base | {"wind_x": {"speed_m_s": 1.0}}, by_hand)
    np.testing.assert_allclose(said.height_m, wanted.height_m, atol=1e-12)
    ordinary = sim.predict(GUPPY, base | more, shots)
    assert said.height_m[0] == pytest.approx(ordinary.height_m[0], abs=1e-12)
    assert np.abs(said.height_m - ordinary.height_m)[1:].min() > 0.02


def test_blocks_keep_each_shots_own_air():
    """Age and density differ from row to row, through the sorting into blocks."""
    shots = _random_shots(np.random.default_rng(17), 40)
    around = Circumstances(age=np.linspace(0.0, 1.0, 40), density=np.linspace(0.1, -0.1, 40))
    params = {"drag": {"cd": 0.9}, "magnus": {"cl": 0.05}}
    said = sim.predict(GUPPY, params | {"drag_wear": {"share": 0.3}, "air_density": {"share": 1.0}}, shots,
                   circumstances=around)
    factor = 1.0 + around.density
    params = {"drag": {"cd": 0.9 * (1.0 + 0.3 * around.age) * factor}, "magnus": {"cl": 0.05 * factor}}
    wanted = fly(GUPPY, SEED, params, sim.launch_of(GUPPY, shots), shots.number("distance_m")).height_m
    np.testing.assert_allclose(said.height_m, wanted, atol=1e-9, equal_nan=True)


def launches(n: int, seed: int) -> Shots:
    rng = np.random.default_rng(seed)
    numbers = {"distance_m": rng.uniform(2.0, 7.0, n), "exit_speed_m_s": rng.uniform(3.0, 14.0, n),
               "exit_deg": rng.uniform(10.0, 75.0, n), "exit_spin_rev_s": rng.uniform(-10.0, 10.0, n)}
    return Shots(tuple(map(str, range(n))), numbers, {})


def test_without_air_a_trajectory_is_the_parabola() -> None:
    shots = launches(20, 1)
    for row, (places, distance_m) in enumerate(sim.trajectories(RIG, {}, shots)):
        t_s = sim.POINT_S * np.arange(len(places) - 1)        # the last point lies between two
        speed, tilt = shots.number("exit_speed_m_s")[row], np.radians(shots.number("exit_deg")[row])
        assert distance_m == shots.number("distance_m")[row]
        np.testing.assert_allclose(places[:-1, 0], speed * np.cos(tilt) * t_s, atol=1e-9)
        np.testing.assert_allclose(places[:-1, 2], 0.75 + speed * np.sin(tilt) * t_s - 9.81 / 2.0 * t_s**2, atol=1e-9)
        assert not places[:, 1].any()


def test_a_trajectory_ends_at_the_plane_or_the_floor_as_predicted() -> None:
    shots, belief = launches(300, 2), {"drag": {"cd": 0.5}, "magnus": {"cl": 0.1}}
    heights = np.asarray(sim.predict(RIG, belief, shots).height_m)
    ends = np.array([places[-1] for places, _ in sim.trajectories(RIG, belief, shots)])
    reached = np.isfinite(heights)
    assert 50 < reached.sum() < 280
    np.testing.assert_allclose(ends[reached, 0], shots.number("distance_m")[reached], atol=1e-9)
    np.testing.assert_allclose(ends[reached, 2], heights[reached], atol=1e-3)
    assert (ends[~reached, 0] <= shots.number("distance_m")[~reached]).all()
    assert ends[~reached, 2] == pytest.approx(0.0, abs=1e-9)


def test_seed_exit_is_equations_11_and_12():
    exit = exit_seed(GUPPY, np.array([0.0, 0.5, 1.0]), np.array([15.0, 45.0, 75.0]))
    expected = [reference.exit_of(ratio) for ratio in (0.0, 0.5, 1.0)]
    np.testing.assert_allclose(exit.speed_m_s, [speed for speed, _ in expected], rtol=1e-14)
    np.testing.assert_allclose(exit.spin_rev_s, [spin for _, spin in expected], rtol=1e-14)
    np.testing.assert_allclose(exit.elevation_rad, np.pi * np.array([1 / 12, 1 / 4, 5 / 12]))
    assert exit.spin_rev_s[2] > 0    # the lower wheel is the faster: backspin


@pytest.mark.parametrize("clocks", [(0.0, 120.0, 240.0), (180.0, 60.0, -60.0), (10.0, 80.0, 200.0, 300.0)])
def test_no_slip_recovers_a_rolling_ball(clocks):
    """Surface speeds of a rigid ball by the cross product in space, exit direction x, left y, up z."""
    rng = np.random.default_rng(4)
    speed, spin = rng.uniform(5, 20, 50), np.column_stack([np.zeros(50), rng.normal(0, 60, (50, 2))])
    surface = np.empty((50, len(clocks)))
    for wheel, clock in enumerate(np.radians(clocks)):
        contact = reference.RADIUS_M * np.array([0.0, -np.sin(clock), np.cos(clock)])   # clockwise seen from behind
        surface[:, wheel] = speed + np.cross(spin, contact)[:, 0]
    got_speed, got_spin = sim.exit_no_slip(with_wheels(*clocks), surface)
    np.testing.assert_allclose(got_speed, speed, rtol=1e-12)
    np.testing.assert_allclose(got_spin, spin, atol=1e-10)


def test_a_lone_wheel_rolls_the_ball_along_a_wall():
    speed, spin = sim.exit_no_slip(with_wheels(180.0), [[10.0]])
    assert speed[0] == pytest.approx(5.0)
    np.testing.assert_allclose(spin[0], [0.0, -5.0 / reference.RADIUS_M, 0.0], atol=1e-12)


LEAVING = Exit(np.array([8.0, 9.5, 11.0]), np.array([0.7, 0.9, 1.0]), np.array([-4.0, 3.0, 7.0]))


def test_a_sensing_term_leaves_alone_what_was_measured_on_the_ball():
    where = Exit(np.array([True, False, True]), np.array([False, True, True]), np.array([True, True, False]), True)
    params = {"hood_offset": {"angle_deg": 1.0}, "encoder_scale": {"share": 0.01}, "exit_efficiency": {"loss": 0.1},
              "ball_compression": {"share": 0.1}, "release_height": {"above_m": 0.02}}
    values = effective(params, Circumstances())
    exit, _ = sim.sense(GUPPY, values, LEAVING, np.array([2.5, 3.5, 4.5]), where)
    left = sim.leave(GUPPY, values, exit, where)
    np.testing.assert_allclose(left.speed_m_s, LEAVING.speed_m_s * np.where(where.speed_m_s, 1.01 * 0.9, 1.0))
    np.testing.assert_allclose(left.elevation_rad, LEAVING.elevation_rad + np.radians(1.0) * where.elevation_rad)
    np.testing.assert_allclose(left.spin_rev_s, LEAVING.spin_rev_s * np.where(where.spin_rev_s, 1.01 / 0.9, 1.0))
    np.testing.assert_allclose(left.above_m, 0.02)
