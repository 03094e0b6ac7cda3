"""Everything that a file lacks is said at once."""

from pathlib import Path

import pytest

import truearc as ta
import truearc.cli.main as truearc
from truearc.robot.config.schema import load_config

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
