"""The world as a plant: deterministic, one pulse one ball, wheels that droop, a bus that sags."""

import math
from itertools import pairwise

import pytest

from tests.sim.world.calm import CALM, calm, fire
from truearc.hw.emulated.nodes import Plant
from truearc.sim.world.options import Options
from truearc.sim.world.world import TICK_NS, Bench, World


def test_it_is_a_plant() -> None:
    plant: Plant = World(1)
    assert plant.motors == ("flywheel_a", "flywheel_b", "hood", "feeder")
    with pytest.raises(KeyError):
        plant.motor("winch")
    with pytest.raises(KeyError, match="winch"):
        plant.advance(1, {"winch": 1.0})


def test_same_seed_same_bits() -> None:
    first, second, other = (fire(Options(), seed, shots=3)[1] for seed in (5, 5, 6))
    assert first.world.results == second.world.results
    assert first.samples == second.samples
    assert first.world.results != other.world.results


def test_one_pulse_of_the_feeder_is_one_ball() -> None:
    world, bench = fire(shots=4)
    assert [r.shot for r in world.results] == [0, 1, 2, 3]
    for _ in range(600):
        bench.tick(400.0, 45.0)
    assert len(world.results) == 4
    assert not world.ball_on_its_way


def test_no_ball_leaves_unless_it_is_fed() -> None:
    bench = Bench(World(1, CALM))
    for _ in range(1000):
        bench.tick(400.0, 45.0, feeder_nm=-0.2)
    assert bench.world.results == [] and not bench.world.ball_on_its_way


@pytest.mark.parametrize("hood", [20.0, 45.0, 70.0])
def test_the_launch_follows_the_hood(hood: float) -> None:
    shot = fire(hood=hood)[0].results[0]
    assert shot.hood_deg == pytest.approx(hood, abs=0.1)
    assert -0.5 < shot.exit_deg - shot.hood_deg < 4.0


def test_the_wheels_droop_and_recover() -> None:
    world, bench = fire(wheel=450.0)
    shot = world.results[0]
    assert 0.05 < 1.0 - shot.wheel_after_rad_s / shot.wheel_before_rad_s < 0.10
    assert min(s.wheel_rad_s for s in bench.samples[-300:]) < 0.95 * shot.wheel_before_rad_s
    for _ in range(200):
        bench.tick(450.0, 45.0)
    assert abs(bench.samples[-1].wheel_rad_s - 450.0) < 3.0


@pytest.mark.parametrize("inertia", [1.0, 0.4])
def test_the_wheels_are_back_long_before_the_next_ball_can_be_fed(inertia: float) -> None:
    """So that shots in quick succession leave no slower in a season: light wheels show in each shot alone."""
    world, bench = fire(calm(flywheel_inertia_scale=inertia), wheel=450.0, shots=3)
    fed_s = [shot.fed_t_ns * 1e-9 for shot in world.results]
    speeds = {round(sample.t_s / 5e-3): sample.wheel_rad_s for sample in bench.samples}
    assert min(after - before for before, after in pairwise(fed_s)) >= 0.8
    for at_s in fed_s:
        assert min(speeds[round((at_s + k * 5e-3) / 5e-3)] for k in range(1, 20)) < 430.0
        assert all(speeds[round((at_s + k * 5e-3) / 5e-3)] == pytest.approx(450.0, abs=4.0) for k in range(40, 160))


def test_wheels_left_alone_stop_in_a_few_seconds() -> None:
    world = World(1, CALM)
    t_ns = 0
    for _ in range(400):
        t_ns += TICK_NS
        world.advance(t_ns, {"flywheel_a": 0.8, "flywheel_b": 0.8})
    assert world.belt.speed_rad_s > 400.0
    stopped_s = 0.0
    while world.belt.speed_rad_s > 0.0 and stopped_s < 60.0:
        t_ns += TICK_NS
        world.advance(t_ns, {})
        stopped_s += TICK_NS * 1e-9
    assert 3.0 < stopped_s < 20.0
    assert world.belt.speed_rad_s == 0.0


def test_free_speed_is_that_of_the_supply() -> None:
    world = World(1, CALM)
    for tick in range(1, 1601):
        world.advance(tick * TICK_NS, {"flywheel_a": 1.2, "flywheel_b": 1.2})
    no_load = 594.0 * world.bus_v() / 12.0            # back-EMF equals the bus; friction takes a little of it
    assert 0.90 * no_load < world.belt.speed_rad_s < no_load


def test_the_bus_sags_under_load_and_comes_back() -> None:
    world = World(1, CALM)
    world.advance(TICK_NS, {})
    rest = world.bus_v()
    for tick in range(2, 100):
        world.advance(tick * TICK_NS, {"flywheel_a": 0.8, "flywheel_b": 0.8})
    loaded = world.bus_v()
    world.advance(101 * TICK_NS, {})
    assert loaded < rest - 0.5
    assert world.bus_v() == pytest.approx(rest, abs=0.01)


def test_position_is_the_sum_of_speed() -> None:
    world, bench = fire(shots=2)
    travelled = math.fsum(0.5 * (a.wheel_rad_s + b.wheel_rad_s) * TICK_NS * 1e-9
                          for a, b in zip(bench.samples, bench.samples[1:], strict=False))
    assert world.motor("flywheel_a").position_rad == pytest.approx(travelled, rel=2e-3)
    assert world.motor("flywheel_b").velocity_rad_s == world.belt.speed_rad_s


def test_the_hood_starts_anywhere_so_that_homing_is_real() -> None:
    starts = {round(World(seed).hood.elevation_deg, 3) for seed in range(10)}
    assert len(starts) == 10
    assert all(World(seed).motor("hood").position_rad == 0.0 for seed in range(3))


def test_the_robot_may_drive_while_a_ball_flies() -> None:
    still, _ = fire(distance=5.0)
    bench = Bench(World(1, CALM, 8.0))
    for _ in range(400):
        bench.tick(400.0, 45.0)
    bench.world.chassis.drive_to(2.6)
    shot = bench.fire(400.0, 45.0, 1)[0]
    assert shot.z_m is not None and still.results[0].z_m is not None
    assert 2.6 <= shot.distance_m < 8.0
    assert shot.exit_speed_m_s == pytest.approx(still.results[0].exit_speed_m_s, rel=0.02)


def test_cutting_the_same_span_finer_changes_next_to_nothing() -> None:
    coarse, fine = World(1, CALM), World(1, CALM)
    torques = {"flywheel_a": 0.5, "flywheel_b": 0.5, "hood": 0.1, "feeder": 0.2}
    coarse.advance(1_200_000_000, torques)
    t_ns = 0
    for step in (1, 1_999_999, 3_000_000, 1_195_000_000 - 77, 77):
        t_ns += step
        fine.advance(t_ns, torques)
    t_ns = 1_200_000_000
    fine.advance(t_ns, torques)
    assert fine.belt.speed_rad_s == pytest.approx(coarse.belt.speed_rad_s, rel=1e-2)
    assert fine.hood.elevation_deg == pytest.approx(coarse.hood.elevation_deg, abs=0.2)
    fine.advance(5, torques)                          # time never runs backwards
    assert fine.belt.speed_rad_s == pytest.approx(coarse.belt.speed_rad_s, rel=1e-2)


def test_without_pose_errors_the_shot_is_straight() -> None:
    askew = fire(calm(pose_scale=1.0), seed=4)[0].results[0].y_m
    assert askew is not None and abs(askew) > 1e-4
    assert abs(askew) < 0.05                          # 0.3 degrees at 5 m, and the lateral place is aimed away


@pytest.mark.parametrize("seed", range(4))
def test_the_widest_scatter_still_shoots(seed: int) -> None:
    results = fire(Options(scatter_scale=3.0), seed=seed, shots=12)[0].results
    assert len({shot.ball_id for shot in results}) == 12
    assert all(5.0 < shot.exit_speed_m_s < 16.0 for shot in results)


def test_two_balls_may_be_in_the_air_at_once() -> None:
    bench = Bench(World(1, CALM, 8.0))
    for tick in range(900):
        bench.tick(500.0, 60.0, 0.2 if tick >= 500 and (tick - 500) % 150 < 50 else 0.0)
    for _ in range(600):
        bench.tick(500.0, 60.0)
    shots = bench.world.results
    assert [shot.shot for shot in shots] == [0, 1, 2]
    assert shots[1].exit_t_ns < shots[0].arrival_t_ns
