"""The world as a plant: deterministic, one pulse one ball; its options are read strictly, each has its effect."""

import math
from pathlib import Path

import numpy as np
import pytest

from tests.sim.world.calm import CALM, calm, fire
from truearc.errors import InputError
from truearc.sim.world.options import Options, load_options
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


def test_two_balls_may_be_in_the_air_at_once() -> None:
    bench = Bench(World(1, CALM, 8.0))
    for tick in range(900):
        bench.tick(500.0, 60.0, 0.2 if tick >= 500 and (tick - 500) % 150 < 50 else 0.0)
    for _ in range(600):
        bench.tick(500.0, 60.0)
    shots = bench.world.results
    assert [shot.shot for shot in shots] == [0, 1, 2]
    assert shots[1].exit_t_ns < shots[0].arrival_t_ns


def test_what_the_file_says_is_read_and_the_rest_is_default(tmp_path: Path) -> None:
    assert load_options(None) == Options()
    path = tmp_path / "world.toml"
    path.write_text("wind_x_m_s = 2\nrelease_arc = true\n", encoding="utf-8")
    assert load_options(path) == Options(wind_x_m_s=2.0, release_arc=True)


@pytest.mark.parametrize(("text", "line", "key"), [
    ("wind_x_m_s = 1.0\nwind_q = 2.0\n", 2, "wind_q"),
    ("\n\nball_mass_scale = -1.0\n", 3, "ball_mass_scale"),
    ("drag_coefficient = nan\n", 1, "drag_coefficient"),
    ("temperature_c = 'warm'\n", 1, "temperature_c"),
    ("wind_y_m_s = inf\n", 1, "wind_y_m_s")])
def test_a_wrong_line_is_named(tmp_path: Path, text: str, line: int, key: str) -> None:
    path = tmp_path / "world.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as error:
        load_options(path)
    assert f"{path}:{line}:" in str(error.value)
    assert key in str(error.value)


def _height(options: Options, **kwargs: float) -> float:
    height = fire(options, **kwargs)[0].results[-1].z_m
    return height


@pytest.mark.parametrize(("change", "sign", "least_m"), [
    ({"wind_z_m_s": 2.0}, 1, 0.05),
    ({"drag_coefficient": 0.6}, -1, 0.03),
    ({"magnus_coefficient": 0.2}, -1, 0.05),
    ({"spin_drag_coefficient": 10.0}, -1, 0.01),
    ({"ball_mass_scale": 1.1}, -1, 0.05),
    ({"ball_radius_scale": 1.03}, 1, 0.005),
    ({"ball_stiffness_scale": 0.7}, -1, 0.03),
    ({"ball_friction_scale": 0.8}, -1, 0.1),
    ({"flywheel_inertia_scale": 0.6}, -1, 0.03),
    ({"release_height_error_m": 0.1}, 1, 0.09),
    ({"temperature_c": 40.0}, -1, 0.01),              # softer foam
])
def test_an_option_moves_the_crossing_the_way_it_should(change: dict[str, float], sign: int, least_m: float) -> None:
    moved = _height(calm(**change)) - _height(CALM)
    assert moved * sign > least_m


@pytest.mark.parametrize(("change", "sign"), [
    ({"wind_x_m_s": 2.0}, 1), ({"wind_x_m_s": -2.0}, -1), ({"air_density_kg_m3": 1.0}, 1),
    ({"temperature_c": 40.0, "stiffness_per_c": 0.0}, 1), ({"drag_coefficient": 0.3}, 1)])
def test_without_lift_less_air_resistance_carries_higher(change: dict[str, float], sign: int) -> None:
    moved = _height(calm(magnus_coefficient=0.0, **change)) - _height(calm(magnus_coefficient=0.0))
    assert moved * sign > 0.01


def test_wind_aloft_is_the_whole_wind_from_the_floor_and_none_above_the_flight() -> None:
    """Between the two it moves the ball by less the higher it begins."""
    still = _height(calm(magnus_coefficient=0.0))
    moved = [_height(calm(magnus_coefficient=0.0, wind_x_m_s=1.0, wind_above_m=above)) - still
             for above in (1e-6, 1.5, 2.0, 50.0)]
    assert moved[3] == 0.0
    assert moved[0] > moved[1] > moved[2] > 0.0
    # from the floor on it lacks only what blows between the wheels
    assert moved[0] == pytest.approx(_height(calm(magnus_coefficient=0.0, wind_x_m_s=1.0)) - still, abs=0.01)


def test_a_drag_step_is_all_drag_far_above_its_speed_and_none_far_below() -> None:
    fast, slow = ({"wheel": 520.0, "hood": 30.0, "distance": 2.0}, {"wheel": 250.0, "hood": 50.0, "distance": 2.0})
    for shot, like in ((fast, 0.75), (slow, 0.5)):
        step, same, none = (_height(calm(magnus_coefficient=0.0, **more), **shot) for more in (
            {"drag_step": 0.5}, {"drag_coefficient": like}, {}))
        assert step == pytest.approx(same, abs=5e-4)  # between the wheels there is no step
        assert (none - same > 0.005) == (like > 0.5)


def test_a_hood_that_gives_way_is_steeper_by_speed_and_its_encoder_does_not_see_it() -> None:
    for wheel, steeper_deg in ((450.0, 1.0), (250.0, 0.0)):
        flexed, stiff = (fire(calm(hood_flex_deg=flex), wheel=wheel, distance=3.0)[0] for flex in (0.5, 0.0))
        exits = [world.results[0].exit_deg for world in (flexed, stiff)]
        assert exits[0] - exits[1] == pytest.approx(steeper_deg, abs=0.03)
        assert flexed.hood_encoder_rad() == stiff.hood_encoder_rad()


def test_without_scatter_every_shot_is_the_same_and_with_it_they_spread() -> None:
    calm = [shot.z_m for shot in fire(CALM, shots=5)[0].results]
    assert np.std(np.array(calm, float)) < 0.004      # what is left is where in a control period the ball came
    spread = [shot.z_m for seed in range(2)
              for shot in fire(Options(), seed=seed, shots=24, wheel=345.0, hood=40.0)[0].results]
    assert 0.035 < np.std(np.array(spread, float)) < 0.09


def test_the_battery_options_say_what_the_bus_does() -> None:
    def idle_v(**changes: float) -> float:
        world = World(1, calm(**changes))
        world.advance(TICK_NS, {})
        return world.bus_v()

    assert idle_v(battery_resistance_ohm=0.0) == pytest.approx(12.6)
    assert idle_v(battery_resistance_ohm=0.0, battery_start_v=11.5) == pytest.approx(11.5)
    assert idle_v(battery_resistance_ohm=0.1) < idle_v()
    worn, fresh = fire(calm(battery_drop_v_per_shot=0.2), shots=3)[0], fire(CALM, shots=3)[0]
    for world in (worn, fresh):
        world.advance(60_000_000_000, {})
    assert fresh.bus_v() - worn.bus_v() == pytest.approx(0.6, abs=0.02)


def test_an_encoder_scale_changes_what_the_flywheels_say_and_nothing_else() -> None:
    true, scaled = fire()[0], fire(calm(encoder_scale=1.03))[0]
    assert scaled.results == true.results             # the bench controls on the truth
    for name in ("flywheel_a", "flywheel_b"):
        assert scaled.motor(name).velocity_rad_s == pytest.approx(1.03 * true.motor(name).velocity_rad_s)
        assert scaled.motor(name).position_rad == pytest.approx(1.03 * true.motor(name).position_rad)
    assert scaled.motor("hood") == true.motor("hood")


def test_the_exit_point_stays_put_unless_the_arc_is_asked_for() -> None:
    def gain(hood: float) -> float:
        return _height(calm(release_arc=True, air_density_kg_m3=0.0), hood=hood, wheel=450.0) \
            - _height(calm(air_density_kg_m3=0.0), hood=hood, wheel=450.0)

    arm = math.hypot(0.0889 - 0.023 + 0.0508, math.sqrt(0.1397**2 - (0.0889 - 0.023 + 0.0508)**2))
    assert arm == pytest.approx(0.1397)
    assert gain(45.0) == pytest.approx(0.0, abs=1e-3)
    # lower wheel's axle to exit point, turned from 45 to 30 degrees: up by dz, forward by dx along a rising path
    angle = math.atan2(0.0889 - 0.023 + 0.0508, math.sqrt(0.1397**2 - (0.0889 - 0.023 + 0.0508)**2))
    dx = 0.1397 * (math.cos(angle + math.radians(30.0)) - math.cos(angle + math.radians(45.0)))
    dz = 0.1397 * (math.sin(angle + math.radians(30.0)) - math.sin(angle + math.radians(45.0)))
    shot = fire(calm(air_density_kg_m3=0.0), hood=30.0, wheel=450.0)[0].results[0]
    across = shot.exit_speed_m_s * math.cos(math.radians(shot.exit_deg))
    slope = math.tan(math.radians(shot.exit_deg)) - 9.81 * 5.0 / across**2
    assert gain(30.0) == pytest.approx(dz - slope * dx, abs=5e-3)
