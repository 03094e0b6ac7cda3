import math
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hw.emulated.plant import Plant, View
from robot import config
from robot.config import load_config
from sim.world.bench import TICK_NS, Bench
from sim.world.options import Options
from sim.world.world import World

CALM = Options(scatter_scale=0.0, pose_scale=0.0)


def _calm(**changes: object) -> Options:
    return msgspec.structs.replace(CALM, **changes)


def _fire(options: Options = CALM, seed: int = 1, wheel: float = 400.0, hood: float = 45.0, shots: int = 1,
          distance: float = 5.0) -> tuple[World, Bench]:
    bench = Bench(World(seed, options, distance))
    bench.fire(wheel, hood, shots)
    return bench.world, bench


def test_it_is_a_plant() -> None:
    plant: Plant = World(1)
    assert plant.motors == ("flywheel_a", "flywheel_b", "hood", "feeder")
    with pytest.raises(KeyError):
        plant.motor("winch")
    with pytest.raises(KeyError, match="winch"):
        plant.advance(1, {"winch": 1.0})


def test_same_seed_same_bits() -> None:
    first, second, other = (_fire(Options(), seed, shots=3)[1] for seed in (5, 5, 6))
    assert first.world.results == second.world.results
    assert first.samples == second.samples
    assert first.world.results != other.world.results


def test_one_pulse_of_the_feeder_is_one_ball() -> None:
    world, bench = _fire(shots=4)
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
    shot = _fire(hood=hood)[0].results[0]
    assert shot.hood_deg == pytest.approx(hood, abs=0.1)
    assert -0.5 < shot.exit_deg - shot.hood_deg < 4.0


def test_the_wheels_droop_and_recover() -> None:
    world, bench = _fire(wheel=450.0)
    shot = world.results[0]
    assert 0.05 < 1.0 - shot.wheel_after_rad_s / shot.wheel_before_rad_s < 0.10
    assert min(s.wheel_rad_s for s in bench.samples[-300:]) < 0.95 * shot.wheel_before_rad_s
    for _ in range(200):
        bench.tick(450.0, 45.0)
    assert abs(bench.samples[-1].wheel_rad_s - 450.0) < 3.0


def test_wheels_left_alone_stop_in_a_few_seconds() -> None:
    world = World(1, CALM)
    t_ns = 0
    for _ in range(400):
        t_ns += TICK_NS
        world.advance(t_ns, {"flywheel_a": 0.8, "flywheel_b": 0.8})
    assert world.wheel_rad_s > 400.0
    stopped_s = 0.0
    while world.wheel_rad_s > 0.0 and stopped_s < 60.0:
        t_ns += TICK_NS
        world.advance(t_ns, {})
        stopped_s += TICK_NS * 1e-9
    assert 3.0 < stopped_s < 20.0
    assert world.wheel_rad_s == 0.0


def test_free_speed_is_that_of_the_supply() -> None:
    world = World(1, CALM)
    for tick in range(1, 1601):
        world.advance(tick * TICK_NS, {"flywheel_a": 1.2, "flywheel_b": 1.2})
    no_load = 594.0 * world.bus_v() / 12.0            # back-EMF equals the bus; friction takes a little of it
    assert 0.90 * no_load < world.wheel_rad_s < no_load


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
    world, bench = _fire(shots=2)
    travelled = math.fsum(0.5 * (a.wheel_rad_s + b.wheel_rad_s) * TICK_NS * 1e-9
                          for a, b in zip(bench.samples, bench.samples[1:], strict=False))
    assert world.motor("flywheel_a").position_rad == pytest.approx(travelled, rel=2e-3)
    assert world.motor("flywheel_b").velocity_rad_s == world.wheel_rad_s


def test_the_hood_starts_anywhere_so_that_homing_is_real() -> None:
    starts = {round(World(seed).hood_deg, 3) for seed in range(10)}
    assert len(starts) == 10
    assert all(World(seed).motor("hood").position_rad == 0.0 for seed in range(3))


def test_the_robot_may_drive_while_a_ball_flies() -> None:
    still, _ = _fire(distance=5.0)
    bench = Bench(World(1, CALM, 8.0))
    for _ in range(400):
        bench.tick(400.0, 45.0)
    bench.world.drive_to(2.6)
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
    assert fine.wheel_rad_s == pytest.approx(coarse.wheel_rad_s, rel=1e-2)
    assert fine.hood_deg == pytest.approx(coarse.hood_deg, abs=0.2)
    fine.advance(5, torques)                          # time never runs backwards
    assert fine.wheel_rad_s == pytest.approx(coarse.wheel_rad_s, rel=1e-2)


# --- what the camera sees


def _project(view: View, point: tuple[float, float, float]) -> np.ndarray:
    return (view.camera_from_target @ np.array([*point, 1.0]))[:3]


@given(seed=st.integers(0, 1000), distance=st.floats(2.6, 8.0))
@settings(max_examples=30, deadline=None)
def test_the_view_is_rigid_and_the_lens_is_where_the_mounting_says(seed: int, distance: float) -> None:
    world = World(seed, Options(), distance)
    told = load_config(Path(config.__file__).with_name("launcher.toml")).camera
    transform = world.view().camera_from_target
    assert transform[:3, :3] @ transform[:3, :3].T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(transform[:3, :3]) == pytest.approx(1.0)
    lens = -transform[:3, :3].T @ transform[:3, 3]    # in target axes: right, up, towards the viewer
    pose = world._stand.pose()
    assert lens[1] == pytest.approx(told.height_m - 2.27965)
    assert lens[2] == pytest.approx(distance + told.behind_exit_m * math.cos(pose.heading_rad))
    assert lens[0] == pytest.approx(-pose.y_m + told.behind_exit_m * math.sin(pose.heading_rad))


def test_a_robot_square_to_the_target_sees_it_upright_ahead_and_above() -> None:
    view = World(1, CALM, 5.0).view()
    centre, right, top = _project(view, (0, 0, 0)), _project(view, (0.3, 0, 0)), _project(view, (0, 0.2, 0))
    assert centre[0] == pytest.approx(0.0, abs=1e-12)
    assert centre[2] > 0.0
    assert right[0] - centre[0] == pytest.approx(0.3)
    assert top[1] < centre[1]                         # y is down in the image
    pitch = math.degrees(math.atan2(-centre[1], centre[2])) + 24.0
    assert math.tan(math.radians(pitch)) == pytest.approx((2.27965 - 0.60) / 5.2)


# --- options


def _height(options: Options, **kwargs: float) -> float:
    height = _fire(options, **kwargs)[0].results[-1].z_m
    assert height is not None
    return height


def test_writing_the_defaults_down_changes_nothing() -> None:
    default = _fire(Options(), shots=2)[0].results
    written = _fire(Options(**{name: getattr(Options(), name) for name in Options.__struct_fields__}), shots=2)[0]
    assert written.results == default


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
    moved = _height(_calm(**change)) - _height(CALM)
    assert moved * sign > least_m


@pytest.mark.parametrize(("change", "sign"), [
    ({"wind_x_m_s": 2.0}, 1), ({"wind_x_m_s": -2.0}, -1), ({"air_density_kg_m3": 1.0}, 1),
    ({"temperature_c": 40.0, "stiffness_per_c": 0.0}, 1), ({"drag_coefficient": 0.3}, 1)])
def test_without_lift_less_air_resistance_carries_higher(change: dict[str, float], sign: int) -> None:
    moved = _height(_calm(magnus_coefficient=0.0, **change)) - _height(_calm(magnus_coefficient=0.0))
    assert moved * sign > 0.01


def test_a_side_wind_moves_the_ball_to_its_side() -> None:
    left = _fire(_calm(wind_y_m_s=2.0))[0].results[0].y_m
    right = _fire(_calm(wind_y_m_s=-2.0))[0].results[0].y_m
    still = _fire()[0].results[0].y_m
    assert left is not None and right is not None and still is not None
    assert left > 0.03
    assert right == pytest.approx(-left, abs=1e-6)
    assert still == pytest.approx(0.0, abs=1e-9)


def test_wear_shows_when_a_ball_comes_again() -> None:
    world, _ = _fire(_calm(wear_stiffness_per_shot=0.05), shots=14)
    ids = [shot.ball_id for shot in world.results]
    fresh, worn = world.results[ids.index(ids[12])], world.results[12]
    assert worn.z_m is not None and fresh.z_m is not None
    assert worn.z_m < fresh.z_m - 0.005


def test_without_scatter_every_shot_is_the_same_and_with_it_they_spread() -> None:
    calm = [shot.z_m for shot in _fire(CALM, shots=5)[0].results]
    assert np.std(np.array(calm, float)) < 0.004      # what is left is where in a control period the ball came
    spread = [shot.z_m for seed in range(2)
              for shot in _fire(Options(), seed=seed, shots=24, wheel=345.0, hood=40.0)[0].results]
    assert 0.035 < np.std(np.array(spread, float)) < 0.09


def test_the_battery_options_say_what_the_bus_does() -> None:
    def idle_v(**changes: float) -> float:
        world = World(1, _calm(**changes))
        world.advance(TICK_NS, {})
        return world.bus_v()

    assert idle_v(battery_resistance_ohm=0.0) == pytest.approx(12.6)
    assert idle_v(battery_resistance_ohm=0.0, battery_start_v=11.5) == pytest.approx(11.5)
    assert idle_v(battery_resistance_ohm=0.1) < idle_v()
    worn, fresh = _fire(_calm(battery_drop_v_per_shot=0.2), shots=3)[0], _fire(CALM, shots=3)[0]
    for world in (worn, fresh):
        world.advance(60_000_000_000, {})
    assert fresh.bus_v() - worn.bus_v() == pytest.approx(0.6, abs=0.02)


def test_the_driver_limit_is_a_current() -> None:
    world = World(1, _calm(driver_current_a=10.0))
    world.advance(TICK_NS, {"flywheel_a": 2.0})
    assert world.motor("flywheel_a").current_a == pytest.approx(10.0)
    assert world.motor("flywheel_a").torque_nm == pytest.approx(10.0 * 12.0 / 594.0)


def test_an_encoder_scale_changes_what_the_flywheels_say_and_nothing_else() -> None:
    true, scaled = _fire()[0], _fire(_calm(encoder_scale=1.03))[0]
    assert scaled.results == true.results             # the bench controls on the truth
    for name in ("flywheel_a", "flywheel_b"):
        assert scaled.motor(name).velocity_rad_s == pytest.approx(1.03 * true.motor(name).velocity_rad_s)
        assert scaled.motor(name).position_rad == pytest.approx(1.03 * true.motor(name).position_rad)
    assert scaled.motor("hood") == true.motor("hood")


def test_hood_options_reach_the_encoder_and_the_hood() -> None:
    assert (math.degrees(World(1, _calm(hood_offset_deg=2.0)).hood_encoder_rad())
            == pytest.approx(World(1, CALM).hood_deg + 2.0))
    loose, tight = (World(1, _calm(hood_backlash_deg=play)) for play in (1.0, 0.0))
    for world in (loose, tight):
        world.advance(200_000_000, {"hood": 0.1})
    assert tight.motor("hood") == loose.motor("hood")
    assert tight.hood_deg - loose.hood_deg == pytest.approx(0.5)


def test_camera_options_reach_the_view() -> None:
    usual = World(1, CALM).view()
    assert (usual.focal_scale, usual.brightness) == (1.0, 1.0)
    odd = World(1, _calm(camera_focal_scale=1.02, ring_light=0.4, camera_pitch_error_deg=1.0)).view()
    assert (odd.focal_scale, odd.brightness) == (1.02, 0.4)
    turned = odd.camera_from_target[:3, :3] @ usual.camera_from_target[:3, :3].T
    assert math.degrees(math.acos((np.trace(turned) - 1.0) / 2.0)) == pytest.approx(1.0, abs=1e-6)
    before, after = _project(usual, (0, 0, 0)), _project(odd, (0, 0, 0))
    assert after[1] / after[2] > before[1] / before[2]          # looking higher, the target sinks in the image
    lifted = World(1, _calm(camera_height_m=0.8, camera_behind_exit_m=0.1, camera_pitch_deg=30.0)).view()
    lens = -lifted.camera_from_target[:3, :3].T @ lifted.camera_from_target[:3, 3]
    assert lens == pytest.approx([0.0, 0.8 - 2.27965, 4.1])


def test_the_exit_point_stays_put_unless_the_arc_is_asked_for() -> None:
    def gain(hood: float) -> float:
        return _height(_calm(release_arc=True, air_density_kg_m3=0.0), hood=hood, wheel=450.0) \
            - _height(_calm(air_density_kg_m3=0.0), hood=hood, wheel=450.0)

    arm = math.hypot(0.0889 - 0.023 + 0.0508, math.sqrt(0.1397**2 - (0.0889 - 0.023 + 0.0508)**2))
    assert arm == pytest.approx(0.1397)
    assert gain(45.0) == pytest.approx(0.0, abs=1e-3)
    # lower wheel's axle to exit point, turned from 45 to 30 degrees: up by dz, forward by dx along a rising path
    angle = math.atan2(0.0889 - 0.023 + 0.0508, math.sqrt(0.1397**2 - (0.0889 - 0.023 + 0.0508)**2))
    dx = 0.1397 * (math.cos(angle + math.radians(30.0)) - math.cos(angle + math.radians(45.0)))
    dz = 0.1397 * (math.sin(angle + math.radians(30.0)) - math.sin(angle + math.radians(45.0)))
    shot = _fire(_calm(air_density_kg_m3=0.0), hood=30.0, wheel=450.0)[0].results[0]
    across = shot.exit_speed_m_s * math.cos(math.radians(shot.exit_deg))
    slope = math.tan(math.radians(shot.exit_deg)) - 9.81 * 5.0 / across**2
    assert gain(30.0) == pytest.approx(dz - slope * dx, abs=5e-3)


def test_without_pose_errors_the_shot_is_straight() -> None:
    askew = _fire(_calm(pose_scale=1.0), seed=4)[0].results[0].y_m
    assert askew is not None and abs(askew) > 1e-4
    assert abs(askew) < 0.05                          # 0.3 degrees at 5 m, and the lateral place is aimed away


@pytest.mark.parametrize("seed", range(4))
def test_the_widest_scatter_still_shoots(seed: int) -> None:
    results = _fire(Options(scatter_scale=3.0), seed=seed, shots=12)[0].results
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
