"""The world as a plant: deterministic, one pulse one ball, wheels that droop, a bus that sags."""


import pytest

from tests.sim.world.calm import CALM, fire
from truearc.sim.world.options import Options
from truearc.sim.world.world import TICK_NS, Bench, World


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


def test_free_speed_is_that_of_the_supply() -> None:
    world = World(1, CALM)
    for tick in range(1, 1601):
        world.advance(tick * TICK_NS, {"flywheel_a": 1.2, "flywheel_b": 1.2})
    no_load = 594.0 * world.bus_v() / 12.0            # back-EMF equals the bus; friction takes a little of it
    assert 0.90 * no_load < world.belt.speed_rad_s < no_load


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
