"""Set points and exit speeds of FRC teams, and the parts that importers share."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

import truearc.cli.main as truearc
from truearc.errors import InputError
from truearc.sim.data.dataset import Shots
from truearc.sim.data.files import load_dataset
from truearc.sim.physics.simulate import launch_of
from truearc.sim.physics.term import Exit
from truearc_proof.importers import set_points
from truearc_proof.importers.set_points import import_254, import_971, import_2910, import_3476

HEADER = ("team", "table", "distance_m", "wheel_rpm", "hood_raw", "note")
ROWS = [("254", "laser_old_ball", 2.67, 4500, 45.73, ""), ("254", "laser_old_ball", 5.76, 4500, 56.78, "EXTRAPOLATED"),
        ("254", "laser_new_ball", 2.32, 4500, 45.76, ""), ("254", "lob", 4.37, 2500, 48.75, ""),
        ("2910", "west_valley", 2.2352, 3400, 45.0, ""), ("1678", "v_1", 3.0, "", "", "no hood")]
HISTORY = ("commit", "committed_at", "commit_message", "distance_m", "hood_eject_angle_deg", "flywheel_rpm")


def write(path: Path, header: tuple[str, ...], rows: list[tuple[object, ...]]) -> Path:
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([header, *rows])
    return path


def test_254s_balls_are_a_factor_and_flatter_is_larger(tmp_path: Path) -> None:
    dataset = import_254(write(tmp_path / "t.csv", HEADER, ROWS))
    shots = dataset.shots
    assert shots.text("ball_quality") == ("old", "new")
    assert shots.number("hood_deg") == pytest.approx([44.27, 44.24])
    assert shots.number("distance_m") == pytest.approx([2.67, 2.32])
    assert shots.number("miss_height_m").tolist() == [0.0, 0.0]
    assert len(dataset.left_out) == 1 and "t.csv:3" in dataset.left_out[0]


def test_a_ball_rolls_on_a_hood_that_stands_still_at_half_the_wheels_speed(tmp_path: Path) -> None:
    dataset = import_2910(write(tmp_path / "t.csv", HEADER, ROWS))
    leaving: Exit = launch_of(dataset.facts, dataset.shots)
    surface_m_s = 3400.0 * 2.0 * np.pi / 60.0 * 0.0508
    assert leaving.speed_m_s == pytest.approx([0.5 * surface_m_s])
    # two wheels: the seed's Eq. 12, which has twice the backspin of rolling
    assert leaving.spin_rev_s == pytest.approx([surface_m_s / (2.0 * np.pi * set_points.BALL.radius_m)])
    assert "ball_quality" not in dataset.shots.texts


def test_of_a_history_only_what_changed_is_a_shot(tmp_path: Path) -> None:
    first, later = "2021-11-01T00:00:00+00:00", "2021-11-02T00:00:00+00:00"
    rows: list[tuple[object, ...]] = [("b", later, "", 2.0, 30.0, 4400), ("b", later, "", 3.0, 25, 4500),
                                      ("a", first, "", 2.0, 30.0, 4500), ("a", first, "", 3.0, 25, 4500)]
    dataset = import_3476(write(tmp_path / "h.csv", HISTORY, rows))
    assert dataset.shots.text("version") == ("a", "a", "b")
    assert dataset.shots.number("t_s").tolist() == [0.0, 0.0, 86400.0]
    assert dataset.shots.number("wheel_main_rad_s")[2] == pytest.approx(4400.0 * np.pi / 30.0)
    assert dataset.left_out == ("1 set points that a version left as they were",)


def test_bad_rows_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bad = [*ROWS, ("254", "laser_new_ball", "far", 4500, 50.0, "")]
    with pytest.raises(InputError, match=r"t\.csv:8.*distance_m"):
        import_254(write(tmp_path / "t.csv", HEADER, bad))
    with pytest.raises(InputError, match="no set points of 2910"):
        import_2910(write(tmp_path / "u.csv", HEADER, ROWS[:2]))
    when = [("a", "yesterday", "", 2.0, 30.0, 4500)]
    with pytest.raises(InputError, match=r"h\.csv:2.*committed_at"):
        import_3476(write(tmp_path / "h.csv", HISTORY, when))
    assert truearc.main(["import", "frc-254", str(tmp_path / "missing.csv"), "-o", str(tmp_path / "out")]) == 2
    assert "missing.csv" in capsys.readouterr().err


JAVA = """
// kLaserOldHoodMap.put(new InterpolatingDouble(1.0), new InterpolatingDouble(1.0));
kLaserOldHoodMap.put(new InterpolatingDouble(100.0), new InterpolatingDouble(46.0));
kLaserOldHoodMap.put(new InterpolatingDouble(140.0), new InterpolatingDouble(50.0));
kLaserOldHoodMap.put(new InterpolatingDouble(140.0), new InterpolatingDouble(50.0));
kLaserOldHoodMap.put(new InterpolatingDouble(152.0), new InterpolatingDouble(51.2));
kLaserMediumHoodMap.put(new InterpolatingDouble(200.0), new InterpolatingDouble(55.0));
kLaserRPMMap.put(new InterpolatingDouble(0.0), new InterpolatingDouble(4500.0));
kLobHoodMap.put(new InterpolatingDouble(172.0), new InterpolatingDouble(48.75));
"""


def test_254s_own_file_is_read_without_what_is_no_shot(tmp_path: Path) -> None:
    path = tmp_path / "Constants.java"
    path.write_text(JAVA)
    dataset = import_254(path)
    shots = dataset.shots
    assert shots.text("ball_quality") == ("old", "old", "medium")
    assert shots.number("distance_m") == pytest.approx([2.54, 3.556, 5.08])
    assert shots.number("hood_deg") == pytest.approx([44.0, 40.0, 35.0])
    assert shots.number("wheel_main_rad_s") == pytest.approx([471.23889803846896] * 3)
    # 12 in further on the line of the two before
    assert dataset.left_out == (f"{path}:6: extrapolated by the team",)
    path.write_text(JAVA.replace("140.0", "far", 1))
    with pytest.raises(InputError, match=r"Constants\.java:4: distance_m: 'far' is not a finite number"):
        import_254(path)
    path.write_text(JAVA + "kLaserRPMMap.put(new InterpolatingDouble(9.0), new InterpolatingDouble(5000.0));")
    with pytest.raises(InputError, match="several speeds"):
        import_254(path)


TUNING = """
// SHOOTER_TUNING.put(new InterpolatingDouble(1.0), new Vector2(Math.toRadians(1.0), 1));
SHOOTER_TUNING.put(new InterpolatingDouble(5.0 * 8.0), new Vector2(Math.toRadians(61.5), 2000));
SHOOTER_TUNING.put(new InterpolatingDouble(90.0),new Vector2(Math.toRadians(55.2),2400.5));
SHOOTER_TUNING.put(new InterpolatingDouble(100.0),
        new Vector2(Math.toRadians(50.0), 2500));
"""


def test_2910s_own_file_is_read(tmp_path: Path) -> None:
    path = tmp_path / "TargetWithShooterCommand.java"
    path.write_text(TUNING)
    shots = import_2910(path).shots
    assert shots.text("table") == ("shooter_tuning",) * 3
    assert shots.number("distance_m") == pytest.approx([1.016, 2.286, 2.54])
    assert shots.number("hood_deg").tolist() == [61.5, 55.2, 50.0]
    assert shots.number("wheel_main_rad_s") == pytest.approx(np.array([2000.0, 2400.5, 2500.0]) * np.pi / 30.0)
    path.write_text(TUNING.replace("61.5", "STEEP").replace("90.0", "6.0 * FOOT"))
    with pytest.raises(InputError) as caught:
        import_2910(path)
    assert "Command.java:3: hood_raw: 'STEEP' is not a finite number" in str(caught.value)
    assert "Command.java:4: distance_m: '6.0 * FOOT' is not a finite number" in str(caught.value)


def config(angle: object, speed: float, distance: float) -> dict[str, object]:
    return {"hoodEjectAngle": angle, "flywheelSpeed": speed, "distance": distance}


def test_3476s_own_file_is_one_version_without_a_date(tmp_path: Path) -> None:
    path = tmp_path / "shooterconfig.json"
    path.write_text(json.dumps({"shooterConfigs": [config(29.0, 4500, 57), config(20, 4900.0, 135.0)]}, indent=1))
    dataset = import_3476(path)
    assert dataset.shots.number("distance_m") == pytest.approx([1.4478, 3.429])
    assert dataset.shots.number("hood_deg").tolist() == [29.0, 20.0]
    assert dataset.shots.number("t_s").tolist() == [0.0, 0.0]
    assert dataset.left_out == ()
    path.write_text(json.dumps({"shooterConfigs": [config(29.0, 4500, 57), config("steep", 1, 2)]}, indent=1))
    with pytest.raises(InputError, match=r"json:11: hood_eject_angle_deg: 'steep' is not a finite number"):
        import_3476(path)
    for text in ("{", "{}", '{"shooterConfigs": [{"distance": 1}]}', "[" * 100_000):
        path.write_text(text)
        with pytest.raises(InputError, match="has no list 'shooterConfigs'"):
            import_3476(path)


# --- import exit speeds

SPEEDS = ("ball_speed_mps", "accelerator_rad_s", "finisher_rad_s")
CONSTANTS = """
  // {{9.9, {200.0, kVelocityFinisher}}
  constexpr double kVelocityFinisher = 350.0;
  shots = Table({{1.0, {0.01, 10.7}}, {1.2, {0.01, 10.7}}});
  r->flywheel_shot_interpolation_table = Table({{10.6, {250.0, kVelocityFinisher}},
                  {17.0, {500.0,
                          kVelocityFinisher}}});
"""


def test_wheels_on_both_sides_drive_the_ball_at_surface_speed_without_spin(tmp_path: Path) -> None:
    dataset = import_971(write(tmp_path / "s.csv", SPEEDS, [(10.6, 250, 350), (17, 500, 350)]))
    shots = dataset.shots
    unmeasured = Shots(shots.shot_id, {k: v for k, v in shots.numbers.items() if k != "exit_speed_m_s"}, {})
    leaving = launch_of(dataset.facts, unmeasured)
    assert leaving.speed_m_s == pytest.approx([12.7, 25.4])       # 250 and 500 rad/s of a 4-inch wheel
    assert leaving.spin_rev_s == pytest.approx([0.0, 0.0], abs=1e-12)
    assert dataset.shots.number("exit_speed_m_s").tolist() == [10.6, 17.0]
    assert "distance_m" not in dataset.shots.numbers


def test_the_teams_own_file_says_the_same_as_the_table(tmp_path: Path) -> None:
    original = tmp_path / "constants.cc"
    original.write_text(CONSTANTS)
    shots = import_971(original).shots
    assert shots.number("exit_speed_m_s").tolist() == [10.6, 17.0]
    assert shots.number("wheel_left_rad_s").tolist() == [250.0, 500.0]
    original.write_text(CONSTANTS.replace("17.0", "kFast"))
    with pytest.raises(InputError, match=r"constants\.cc:6: ball_speed_mps: 'kFast' is not a finite number"):
        import_971(original)
    original.write_text("int main() {}")
    with pytest.raises(InputError, match=r"constants\.cc: holds no numbers"):
        import_971(original)


NEAR_M, LOWER_RIM_M = 1.5, 2.4956 - 0.381 - 0.75
STEEP_DEG = float(np.degrees(np.arctan2(LOWER_RIM_M, NEAR_M)))


def history(folder: Path, *near_deg: float) -> Path:
    """One version for each elevation of the nearest set point."""
    return write(folder / "history.csv", HISTORY, [("abc"[k], f"2021-11-0{k + 1}T00:00:00+00:00", "", NEAR_M, deg, 4500)
                                                   for k, deg in enumerate(near_deg)])


def test_an_elevation_below_the_line_of_sight_is_doubted_and_imported(tmp_path, capsys):
    flat = history(tmp_path, STEEP_DEG + 0.5, STEEP_DEG - 0.5, STEEP_DEG - 8.0)
    assert truearc.main(["import", "frc-3476", str(flat), "-o", str(tmp_path / "d")]) == 0
    said = capsys.readouterr().out
    assert "note: 2 of 3 shots leave flatter than a straight line to the opening's lower rim" in said
    assert f"c-002 at 1.50 m has {STEEP_DEG - 8.0:.1f} deg, where {STEEP_DEG:.1f} are the least" in said
    assert len(load_dataset(tmp_path / "d").shots) == 3
    assert import_3476(history(tmp_path, STEEP_DEG + 0.1)).notes() == ()


def test_only_some_of_the_shots(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, out = history(tmp_path, 50.0, 51.0, 52.0), tmp_path / "d"

    def imported(wanted: str) -> int:
        return truearc.main(["import", "frc-3476", str(path), "--only", wanted, "-o", str(out), "--force"])

    assert imported("version=a,c") == 0
    assert load_dataset(out).shots.number("hood_deg").tolist() == [50.0, 52.0]
    assert imported("version=d") == 2
    assert "no shot has 'd' as its version; there are 'a', 'b', 'c'" in capsys.readouterr().err
    for wanted in ("version", "hood_deg=50"):
        assert imported(wanted) == 2
        assert "is not COLUMN=TEXT with one of the columns version" in capsys.readouterr().err
