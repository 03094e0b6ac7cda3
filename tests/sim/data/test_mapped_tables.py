"""Tables of other programs under the maps that come with truearc, and everything that a file lacks said at once."""

import math
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

import truearc as ta
import truearc.cli.main as truearc
from truearc.cli.common import SHIPPED
from truearc.robot.config.schema import load_config
from truearc.robot.config.shot_map import load_map
from truearc.sim.printed import MOST, left_out_lines

RIG = load_config(SHIPPED).rig
HIT_OR_MISS = structs.replace(RIG, target=structs.replace(RIG.target, three_half_height_m=0.0))
HEADER = "distance_m,velocity_rps,hood_angle_deg,timestamp,successful,notes\n"


def test_2928s_collector(tmp_path: Path) -> None:
    """The header and the form of numbers are those of the team's public file; the numbers are not."""
    (tmp_path / "monday.csv").write_text(
        f"{HEADER}2.000,55.000,48.000,1771719211810,true,\n3.500,62.500,44.000,1771719214249,false,short\n")
    shots = ta.import_shots([tmp_path / "monday.csv"], rig=HIT_OR_MISS, shot_map="viking-2928").shots
    assert shots.text("outcome") == ("two", "miss") and shots.number("distance_m").tolist() == [2.0, 3.5]
    free = RIG.launcher.free_speed_rad_s or math.nan
    assert shots.number("motor_ratio") == pytest.approx([55.0 * 2.0 * math.pi / free, 62.5 * 2.0 * math.pi / free])
    assert np.diff(shots.number("t_s")) == pytest.approx([2.439])


@pytest.mark.parametrize(("name", "text"), [
    ("tracker", "ball\nt\tx\ty\n0.000\t0.10\t1.00\n0.033\t0.35\t1.12\n0.067\t0.61\t1.22\n"),
    ("tracker", "#multi:\n\tball\t\nt\tx\ty\n0.000\t0.10\t1.00\n0.033\t0.35\t1.12\n0.067\t0.61\t1.22\n"),
    ("kinovea", "Time (ms);ball/x;ball/y\n0,0;0,10;1,00\n33,0;0,35;1,12\n67,0;0,61;1,22\n"),
    ("kinovea", '"Time (ms)","ball/x","ball/y"\n0.0,0.10,1.00\n33.0,0.35,1.12\n67.0,0.61,1.22\n')])
def test_hand_made_tracks(name: str, text: str, tmp_path: Path) -> None:
    for shot in ("a", "b"):
        (tmp_path / f"{shot}.txt").write_text(text)
    found = ta.import_shots([tmp_path / "a.txt", tmp_path / "b.txt"], rig=RIG, shot_map=name)
    assert found.shots.shot_id == ("a", "b") and found.tracks is not None
    np.testing.assert_allclose(found.tracks.t_s, [0.0, 0.033, 0.067] * 2)
    np.testing.assert_allclose(found.tracks.x_m, [0.10, 0.35, 0.61] * 2)
    np.testing.assert_allclose(found.tracks.z_m, [1.00, 1.12, 1.22] * 2)
    assert not found.tracks.y_m.any()


def test_a_word_that_the_map_does_not_know_is_named_by_line(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(f"{HEADER}2,55,48,1,maybe,\n")
    with pytest.raises(ta.InputError, match=r"a\.csv:2: successful: 'maybe' is none of the map's values"):
        ta.import_shots([tmp_path / "a.csv"], rig=RIG, shot_map="viking-2928")


@pytest.mark.parametrize(("row", "said"), [("2,fast,48,2,true,", "velocity_rps: 'fast'"),
                                           ("2,55,steep,2,true,", "hood_angle_deg: 'steep'"),
                                           ("near,55,48,2,true,", "distance_m: 'near'")])
def test_a_text_where_a_number_belongs_is_named(row: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(f"{HEADER}2,55,48,1,true,\n{row}\n")
    with pytest.raises(ta.InputError, match=rf"a\.csv:3: {said} is not a number"):
        ta.import_shots([tmp_path / "a.csv"], rig=HIT_OR_MISS, shot_map="viking-2928")


def test_a_key_that_two_sensors_share_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "shots.toml"
    path.write_text('schema = "truearc.shot-map/1"\n[columns]\ndistance_m = "/Battery"\nhood_deg = "/Hood"\n'
                    'battery_v = { key = "/Battery", unit = "V" }\n')
    with pytest.raises(ta.InputError, match=r"columns\.distance_m and columns\.battery_v have the same key, /Battery"):
        load_map(path)


def test_a_table_without_the_columns_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("distance_m,hood\n2,48\n")
    with pytest.raises(ta.InputError, match=r"a\.csv:1: there is no line with the columns distance_m, hood_angle_deg"):
        ta.import_shots([tmp_path / "a.csv"], rig=RIG, shot_map="viking-2928")


def test_two_files_of_one_name_are_refused(tmp_path: Path) -> None:
    for folder in ("x", "y"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "a.txt").write_text("t\tx\ty\n0\t0\t1\n1\t1\t1\n")
    with pytest.raises(ta.InputError, match="two files are called a"):
        ta.import_shots([tmp_path / "x" / "a.txt", tmp_path / "y" / "a.txt"], rig=RIG, shot_map="tracker")


def test_of_many_left_out_a_few_are_named_and_the_others_counted() -> None:
    assert left_out_lines(["a", "b"]) == ["left out: a", "left out: b"]
    many = left_out_lines([f"row {k}" for k in range(MOST + 92)])
    assert many[MOST - 1:] == [f"left out: row {MOST - 1}", "left out: 92 more"]


ROOT = Path(__file__).parents[3]
SPREADSHEET = ROOT / "examples/spreadsheet"


def test_all_missing_keys_of_a_rig_are_named(tmp_path: Path) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text('[target]\n[ball]\nradius_m = 0.1\n[[launcher.wheel]]\nname = "a"\nradius_m = 0.05\ngear = 1.0\n'
                   'clock_deg = 0.0\n[[launcher.wheel]]\nname = "b"\nclock_deg = 180.0\n', encoding="utf-8")
    with pytest.raises(ta.InputError) as error:
        ta.load_rig(rig)
    assert str(error.value) == (f"{rig}: keys are missing: ball.mass_kg, launcher.wheel.radius_m, launcher.wheel.gear, "
                                "target.centre_height_m")


def test_all_missing_keys_of_a_launcher_are_named(tmp_path: Path) -> None:
    launcher = tmp_path / "launcher.toml"
    text = (ROOT / "robot/launcher.toml").read_text(encoding="utf-8")
    kept = [line for line in text.splitlines() if not line.startswith(("fx_px", "kp", "repeats", "mass_kg"))]
    launcher.write_text("\n".join(kept), encoding="utf-8")
    with pytest.raises(ta.InputError) as error:
        load_config(launcher)
    assert str(error.value) == (f"{launcher}: keys are missing: flywheel.pid.kp, hood.pid.kp, camera.fx_px, "
                                "collect.repeats, rig.ball.mass_kg, identify.flywheel.repeats, identify.hood.repeats")


def test_all_missing_keys_of_axes_are_named_by_their_drivers(tmp_path: Path) -> None:
    launcher = tmp_path / "launcher.toml"
    text = (ROOT / "robot/launcher.toml").read_text(encoding="utf-8")
    launcher.write_text(text.replace('driver = "odrive"', 'driver = "spark"', 1).replace("node = 4\n", ""),
                        encoding="utf-8")
    with pytest.raises(ta.InputError) as error:
        load_config(launcher)
    assert str(error.value) == (f"{launcher}:17: axes.flywheels[0].node: unknown key; keys are missing: "
                                "axes.flywheels.device, axes.flywheels.has_endstop, "
                                "axes.flywheels.stall_torque_nm, axes.flywheels.free_speed_rad_s, "
                                "axes.flywheels.rated_v, axes.feeder.node")


def test_a_mistyped_table_is_named_where_its_keys_are_missed(tmp_path: Path) -> None:
    launcher = tmp_path / "launcher.toml"
    text = (ROOT / "robot/launcher.toml").read_text(encoding="utf-8")
    launcher.write_text(text.replace("[rig.ball]", "[rig.bal]"), encoding="utf-8")
    with pytest.raises(ta.InputError, match=r"keys are missing: rig.ball.mass_kg, rig.ball.radius_m; \[rig.bal\] is "
                                            "unknown; did you mean ball"):
        load_config(launcher)


def test_all_missing_columns_of_tracks_are_named() -> None:
    with pytest.raises(ta.InputError, match="tracks: columns t_s, y_m are missing"):
        ta.dataset({"shot_id": ["a"]}, rig={"ball": {"mass_kg": 0.14, "radius_m": 0.09}},
                   tracks={"shot_id": ["a"], "x_m": [0.0], "z_m": [1.0]})


def copy_shots(folder: Path, count: int, columns: int) -> Path:
    """The first shots and columns of the example."""
    folder.mkdir()
    (folder / "rig.toml").write_bytes((SPREADSHEET / "rig.toml").read_bytes())
    rows = (SPREADSHEET / "shots.csv").read_text(encoding="utf-8").splitlines()[:count + 1]
    kept = [row.split(",") for row in rows]
    (folder / "shots.csv").write_text("\n".join(",".join([*row[:columns], row[4]]) for row in kept), encoding="utf-8")
    return folder


def test_all_that_shots_lack_for_a_fit_is_named(tmp_path: Path) -> None:
    with pytest.raises(ta.InputError) as error:
        ta.fit(ta.load_dataset(copy_shots(tmp_path / "few", 20, 1)))
    for name in ("distance_m", "hood_deg or exit_deg", "motor_ratio"):
        assert name in str(error.value)


def test_six_shots_are_warned_of(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    few = copy_shots(tmp_path / "few", 6, 4)
    assert "warning: 6 shots are too few to judge a simulation by" in str(ta.fit(ta.load_dataset(few)))
    assert truearc.main(["check", str(few), "--quiet"]) == 0
    assert "6 shots are too few to judge a simulation by; 10 at least; of a season" in capsys.readouterr().out
    assert truearc.main(["discover", str(few), "--quiet"]) == 2
    assert "6 shots are too few" in capsys.readouterr().err
