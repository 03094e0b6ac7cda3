"""The driver with the button box; a season straight from the world, read as far as the sensors are right."""

import itertools
from pathlib import Path

import numpy as np
import pytest

from truearc import robot
from truearc.cli.common import SHIPPED
from truearc.cli.main import main
from truearc.robot.config.schema import load_config
from truearc.sim.data.dataset import Dataset
from truearc.sim.data.files import load_dataset, save_dataset
from truearc.sim.world.emulated_robot import Driver
from truearc.sim.world.options import Options
from truearc.sim.world.world import TICK_NS, Bench, ShotSetting, World
from truearc_proof.world.season import Sensors, play_season

TEXT = SHIPPED.read_text(encoding="utf-8")
SECOND = '[[axes.flywheels]]\ndriver = "odrive"\nnode = 2'
THIRD = f"{SECOND.replace('2', '7')}\ndirection = 1\nendstop_endpoint = 0\n\n"


@pytest.mark.parametrize(("old", "new", "said"), [
    (SECOND, f"{THIRD}{SECOND}", "axes.flywheels: 3 motors; the emulated robot has 2, so state as many"),
    ("node = 2", "node = 1", "axes.flywheels[1].node: 1 is that of axes.flywheels[0], too")])
@pytest.mark.parametrize("words", [["emulate", "--trials", "1", "--out", "s"], ["sysid", "--emulate", "--out", "s"],
                                   ["emulate", "--trials", "1", "--bus", "slcan:auto"]])
def test_axes_that_cannot_be_emulated_leave_nothing(words, old, new, said, tmp_path, monkeypatch, capsys):
    assert old in TEXT
    (tmp_path / "mine.toml").write_text(TEXT.replace(old, new, 1))
    monkeypatch.chdir(tmp_path)
    assert main([*words, "--config", "mine.toml"]) == 2
    assert said in capsys.readouterr().err and [path.name for path in tmp_path.iterdir()] == ["mine.toml"]


class _Robot:
    """A launcher that shoots whenever fire is pressed, unless it has been told to refuse."""

    def __init__(self, refuse: bool = False, seed: int = 1, trials: int = 6, **how: object) -> None:
        self.world = World(seed, Options())
        self.bench = Bench(self.world)
        self.presses: list[tuple[int, str]] = []
        self.refuse = refuse
        self.stops: list[float] = []
        self.asked = False
        self.driver = Driver(self.world, self._press, trials, seed, **how)

    def _press(self, button: str) -> None:
        self.presses.append((self.bench.t_ns, button))
        if button == "fire":
            assert not self.world.chassis.moving
            self.asked = True
            self.stops.append(self.world.chassis.distance_m)

    def run(self, longest_s: float = 300.0) -> None:
        feeding = 0
        while not self.driver.done and self.bench.t_ns < longest_s * 1e9:
            self.driver.step(self.bench.t_ns)
            if self.asked and not self.refuse and abs(self.world.belt.speed_rad_s - 400.0) < 2.0:
                self.asked, feeding = False, 50
            self.bench.tick(400.0, 45.0, 0.2 if feeding > 0 else 0.0)
            feeding -= 1


@pytest.mark.parametrize("seed", [1, 2])
def test_every_shot_gets_the_outcome_that_was_seen(seed: int) -> None:
    robot = _Robot(seed=seed, trials=8)
    robot.run()
    assert robot.driver.done and robot.driver.trial == 8
    buttons = [button for _, button in robot.presses if button != "reject"]
    outcomes = [result.outcome for result in robot.world.results]
    assert buttons == ["arm", *(press for outcome in outcomes for press in ("fire", outcome))]
    for (pressed_ns, button), result in zip([p for p in robot.presses if p[1] not in ("arm", "fire", "reject")],
                                            robot.world.results, strict=True):
        assert button == result.outcome
        assert pressed_ns >= result.arrival_t_ns + 400_000_000 - TICK_NS


def test_a_refusal_is_waited_out_and_then_given_up() -> None:
    robot = _Robot(refuse=True, trials=3, patience_s=2.0)
    robot.run()
    assert robot.driver.done
    assert [button for _, button in robot.presses] == ["arm", "fire", "fire", "fire"]
    fires = [t_ns for t_ns, button in robot.presses if button == "fire"]
    assert all(2.0e9 < b - a < 12.0e9 for a, b in itertools.pairwise(fires))


def test_the_stops_cover_the_range_with_a_few_trials_at_each() -> None:
    robot = _Robot(refuse=True, trials=40, patience_s=0.0, distances=(2.6, 8.0))
    robot.run(1000.0)
    assert len(robot.stops) == 40
    assert min(robot.stops) >= 2.6 and max(robot.stops) <= 8.0
    places = sorted(set(robot.stops))
    assert 40 / 3 <= len(places) <= 40
    gaps = [b - a for a, b in zip([2.6, *places], [*places, 8.0], strict=True)]
    assert max(gaps) < 5.4 * 2.5 / len(places)        # no part of the range is left out


def test_a_spoilt_trial_is_rejected_after_its_outcome() -> None:
    robot = _Robot(trials=2, rejected_share=1.0)
    robot.run()
    buttons = [button for _, button in robot.presses]
    assert [b for b in buttons if b in ("fire", "reject")] == ["fire", "reject"] * 2


def test_prescribed_places_are_driven_to_one_after_the_other() -> None:
    robot = _Robot(refuse=True, trials=6, patience_s=0.0, repeats=2, places=(3.0, 7.5, 5.0))
    robot.run()
    assert robot.stops == [3.0, 3.0, 7.5, 7.5, 5.0, 5.0]


def test_a_ball_that_goes_in_and_never_comes_out_is_rejected(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(World, "ball_on_its_way", property(lambda world: True))
    robot = _Robot(refuse=True, trials=2, patience_s=0.5, jam_s=0.5)
    robot.run()
    assert robot.driver.done
    assert [button for _, button in robot.presses] == ["arm", "fire", "reject", "fire", "reject"]


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
