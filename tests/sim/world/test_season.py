"""A season straight from the world: what is read is what happened, as far as the sensors are right."""

from pathlib import Path

import numpy as np
import pytest

from truearc import robot
from truearc.robot.config.schema import load_config
from truearc.sim.data.dataset import Dataset
from truearc.sim.data.files import load_dataset, save_dataset
from truearc.sim.world.field import CENTRE_HEIGHT_M
from truearc.sim.world.options import Options
from truearc.sim.world.world import ShotSetting
from truearc_proof.world.season import ASIDE, Sensors, plan_season, play_season, reach_m, reach_table

RIG = load_config(Path(robot.__file__).parent / "launcher.toml").rig
EXACT = Sensors(0.0, 0.0, 0.0, 0.0)
CALM = Options(scatter_scale=0.0, pose_scale=0.0)
SETTINGS = (ShotSetting(5.4, 45.0, 0.55), ShotSetting(5.7, 45.0, 0.55), ShotSetting(6.5, 40.0, 0.6))


def season(options: Options = CALM, level: str = "L2", sensors: Sensors = EXACT, seed: int = 3) -> Dataset:
    return play_season(RIG, options, seed, SETTINGS, level, sensors).dataset


def test_it_is_a_dataset_and_the_same_every_time(tmp_path: Path) -> None:
    first, again = (season(Options(), sensors=Sensors()) for _ in range(2))
    save_dataset(tmp_path / "season", first)
    back = load_dataset(tmp_path / "season")
    assert back.shots.text("outcome") == first.shots.text("outcome") and set(back.shots.text("outcome")) - {"miss"}
    np.testing.assert_array_equal(first.tracks.x_m, again.tracks.x_m)
    np.testing.assert_allclose(back.tracks.z_m, first.tracks.z_m, atol=1e-6)


def test_sensors_say_what_they_would() -> None:
    """A wrong encoder, hood magnet and lens: the robot shoots by what it reads, the numbers read are the settings."""
    wrong = Options(scatter_scale=0.0, pose_scale=0.0, encoder_scale=1.02, hood_offset_deg=1.0, camera_focal_scale=1.05)
    true, askew = season(), season(wrong)
    for name, wanted in (("hood_deg", [45.0, 45.0, 40.0]), ("motor_ratio", [0.55, 0.55, 0.6])):
        assert askew.shots.number(name) == pytest.approx(wanted, abs=0.05)
        assert true.shots.number(name) == pytest.approx(wanted, abs=0.05)
    assert true.shots.number("distance_m") == pytest.approx([5.4, 5.7, 6.5])
    assert askew.shots.number("distance_m") == pytest.approx((np.array([5.4, 5.7, 6.5]) + 0.2) / 1.05 - 0.2)
    assert true.tracks is not None and askew.tracks is not None
    # wheels that truly run 2 % slower and a hood that truly stands 1 degree lower throw shorter and lower
    ends = [float(np.hypot(np.diff(one.tracks.x_m[:2]), np.diff(one.tracks.z_m[:2]))[0]) for one in (true, askew)]
    assert ends[1] < ends[0]


def test_bad_sensors_do_what_they_say_and_leave_the_shots_alone() -> None:
    settings = [ShotSetting(5.4, 45.0, 0.55 + 0.001 * number) for number in range(40)]
    plain, bad = (play_season(RIG, Options(), 3, settings, "L2", sensors) for sensors in (
        EXACT, EXACT._replace(track_m=0.01, wrong_marks=0.5, track_tails=3, lost_frames=0.25)))
    assert bad.results == plain.results
    outcomes = [(one.dataset.shots.text("outcome"), one.dataset.shots.text("side")) for one in (plain, bad)]
    wrong = sum(one != other for one, other in zip(zip(*outcomes[0], strict=True), zip(*outcomes[1], strict=True),
                                                   strict=True))
    assert 10 <= wrong <= 30 and all((side == "") == (mark != "miss") for mark, side in zip(*outcomes[1], strict=True))
    whole, torn = plain.dataset.tracks, bad.dataset.tracks
    assert 0.70 < len(torn.t_s) / len(whole.t_s) < 0.80
    assert all(torn.t_s[torn.shot == shot][0] == 0.0 for shot in range(40))
    level = play_season(RIG, Options(), 3, settings, "L2", EXACT._replace(track_m=0.01, track_tails=3)).dataset.tracks
    off = (level.z_m - whole.z_m) / 0.01                     # Student's t of 3: 5.8 % beyond 3, of a normal .3 %
    assert 0.03 < np.mean(np.abs(off) > 3.0) < 0.09


def test_levels_carry_what_they_should() -> None:
    bare, told, tracked = (season(level=level) for level in ("L0", "L1", "L2"))
    assert set(bare.shots.numbers) == {"distance_m", "hood_deg", "motor_ratio"} and bare.traces is None
    assert {"battery_v", "since_last_shot_s", "t_s"} <= set(told.shots.numbers) and told.tracks is None
    signals = {"wheel_lower_rad_s", "wheel_upper_rad_s", "battery_v"}
    assert told.traces is not None and set(told.traces.signal) == signals
    assert tracked.tracks is not None and bare.shots.text("outcome") == tracked.shots.text("outcome")
    with pytest.raises(ValueError, match="L7"):
        season(level="L7")


def test_tracks_begin_at_the_muzzle_and_fall_as_a_ball_does() -> None:
    """Without air: a parabola under 9.81 m/s2, through the exit point 0.75 m above the floor."""
    told = season(Options(scatter_scale=0.0, pose_scale=0.0, air_density_kg_m3=0.0))
    tracks = told.tracks
    for shot in range(3):
        t_s, z_m, x_m = (part[tracks.shot == shot] for part in (tracks.t_s, tracks.z_m, tracks.x_m))
        assert t_s[0] == 0.0 and t_s[-1] <= 0.75 + 0.02
        bend, _, start = np.polyfit(t_s, z_m, 2)
        assert 2.0 * bend == pytest.approx(-9.81, rel=0.002) and start == pytest.approx(0.75, abs=0.1)
        assert np.polyfit(t_s, x_m, 2)[0] == pytest.approx(0.0, abs=0.01)


def test_practice_says_where_balls_fall_through_the_goal() -> None:
    """Shot where the table says, a ball passes near the centre; the plan spreads about that."""
    setting = ShotSetting(reach_m(46.0, 0.57), 46.0, 0.57)
    tracks = play_season(RIG, CALM, 0, (setting,), "L2", EXACT._replace(track_s=5.0)).dataset.tracks
    assert tracks is not None and tracks.z_m[-1] == pytest.approx(CENTRE_HEIGHT_M, abs=0.15)
    assert np.isnan(reach_m(10.0, 0.5)) and np.isfinite(reach_table()).mean() > 0.8
    plan = plan_season(4, 60)
    off = np.array([one.distance_m / reach_m(one.hood_deg, one.motor_ratio) - 1.0 for one in plan])
    assert len(plan) == 60 and plan == plan_season(4, 60) and plan != plan_season(5, 60)
    assert 0.6 * ASIDE < off.std() < 1.4 * ASIDE


def test_a_shot_that_the_battery_has_no_speed_for_is_given_up_and_the_next_is_shot() -> None:
    slow, fast = ShotSetting(3.0, 50.0, 0.5), ShotSetting(3.0, 50.0, 0.8)
    empty = Options(battery_start_v=7.5)
    shots = play_season(RIG, empty, 1, [slow, fast, slow], "L0").dataset.shots
    assert len(shots) == 2
    assert shots.number("motor_ratio") == pytest.approx([0.5, 0.5], abs=0.01)
    with pytest.raises(TimeoutError, match="never got ready"):
        play_season(RIG, empty, 1, [fast], "L0")
