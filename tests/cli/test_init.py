"""`truearc init` and `truearc check`: from nothing to a dataset that can be fitted, without reading source code."""

import re
import shutil
import tomllib
from pathlib import Path

import pytest

import truearc as ta
from truearc.cli.datasets import GAMES
from truearc.cli.main import main
from truearc.robot.config.schema import load_config
from truearc.sim.data.files import load_rig

SHOTS = Path(__file__).parents[2] / "examples" / "spreadsheet"
DOCS = Path(__file__).parents[2] / "docs" / "reference" / "dataset.md"
MEASURED = {"mass_kg": 0.14, "radius_m": 0.0508, "release_height_m": 0.75, "free_speed_rad_s": 594.0,
            "centre_height_m": 2.44}


@pytest.fixture
def made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A dataset folder as `truearc init` makes it, in the working directory."""
    monkeypatch.chdir(tmp_path)
    assert main(["init", "week"]) == 0
    return tmp_path / "week"


def test_template_states_every_key_that_the_page_documents(made: Path) -> None:
    part = DOCS.read_text().split("\n## rig.toml\n")[1].split("\n## ")[0]
    keys = {key.rpartition(".")[2] for key in re.findall(r"^\| `([\w.]+)` \|", part, re.MULTILINE)}
    assert keys == set(re.findall(r"^(?:# )?(\w+) = ", (made / "rig.toml").read_text(), re.MULTILINE))


def test_check_names_all_that_is_not_filled_in(made: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "week"]) == 2
    said = capsys.readouterr().err
    assert all(f"{key}: nan is not finite" in said for key in MEASURED)


def test_check_plans_a_season_where_there_are_no_shots(made: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = made / "rig.toml"                      # every nan is replaced by what was measured
    path.write_text(re.sub(r"^(\w+) = nan\b", lambda key: f"{key[1]} = {MEASURED[key[1]]}", path.read_text(),
                           flags=re.MULTILINE))
    assert main(["check", "week", "--quiet"]) == 0
    said = capsys.readouterr().out
    assert "no shots yet" in said and "300 shots of this kind (L0) would show" in said


def test_check_says_what_filled_in_shots_could_show(made: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("rig.toml", "shots.csv"):
        shutil.copy(SHOTS / name, made / name)
    assert main(["check", "week", "--quiet"]) == 0
    said = capsys.readouterr().out
    assert "week: 48 shots (21 miss, 8 three, 19 two)" in said and "plausible: every check passed" in said
    assert "48 shots of this kind (L0) would show" in said and "hood_deg             31.1 to 53.6" in said
    seen = ta.identifiability(ta.load_dataset("week"))
    labels = {term.name: term.label for term in ta.catalogue()}
    line = next(line for line in said.splitlines() if line.startswith("  would be seen: "))
    assert set(line.split(": ")[1].split(", ")) == {labels[one.term] for one in seen.sight.terms if one.power >= 0.8}
    assert said.endswith("effect by effect: truearc identifiability week\n")


def test_check_names_settings_that_no_shot_states(made: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.copy(SHOTS / "rig.toml", made)
    (made / "shots.csv").write_text("shot_id,outcome\n1,two\n2,two\n")
    assert main(["check", "week", "--quiet"]) == 0
    said = capsys.readouterr().out
    assert "hood_deg or exit_deg: no shot states its elevation" in said and "no shot states its result" not in said
    assert all(f"no shot states its {what}" in said for what in ("distance to the target", "speed"))
    assert "\nnote: only makes: nothing can be learnt about misses; " in said


def test_a_folder_without_a_rig_is_told_of_init(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(tmp_path), "--quiet"]) == 2
    assert f"rig.toml: there is no such file; `truearc init {tmp_path}` writes a template" in capsys.readouterr().err


def test_check_refuses_implausible_data_by_name_unless_accepted(made: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rig = (SHOTS / "rig.toml").read_text().replace("mass_kg = 0.14 ", "mass_kg = 140.0 ")
    (made / "rig.toml").write_text(rig.replace("mass_kg = 0.14", "mass_kg = 140.0"))
    shutil.copy(SHOTS / "shots.csv", made)
    assert main(["check", "week", "--quiet"]) == 2
    assert "ball.mass_kg" in capsys.readouterr().err
    assert main(["check", "week", "--quiet", "--accept", "mass"]) == 0
    assert "warning: mass: rig.toml: ball.mass_kg" in capsys.readouterr().out


@pytest.mark.parametrize("game", GAMES)
def test_game_fills_in_ball_and_target_with_sources(tmp_path: Path, game: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["init", "--game", game]) == 0
    text = (tmp_path / game / "rig.toml").read_text()
    assert text.count("[ball]") == text.count("\n[target]") == 1
    lines = text[text.index("[ball]"):text.index("[site]")].splitlines()
    stated = [line for line in lines if re.match(r"\w+ = [\d.]", line)]
    assert len(stated) >= 5 and all(re.search(r"not verified|section|Eq\.|by the vendor", line) for line in stated)
    (tmp_path / "rig.toml").write_text(text.replace("= nan", "= 0.05").replace("rad_s = 0.05", "rad_s = 600"))
    rig = load_rig(tmp_path / "rig.toml")
    assert rig.target.faces_up == (game != "frc-2020") and 0.05 < rig.ball.radius_m < 0.13
    assert "side" in (tmp_path / game / "shots.csv").read_text()


def test_game_without_a_target_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["init", "--game", "frc-2026", "x", "--tracks"]) == 2
    assert "--game: goes with a rig.toml that has a target" in capsys.readouterr().err


def test_init_keeps_what_is_there(made: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (made / "rig.toml").write_text("mine")
    assert main(["init", "week"]) == 2
    assert (made / "rig.toml").read_text() == "mine"
    assert main(["init", "week", "--force"]) == 0
    assert (made / "rig.toml").read_text() != "mine"


def test_init_robot_writes_a_configuration_that_loads(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "my_launcher.toml"
    assert main(["init", "--robot", str(out)]) == 0
    assert load_config(out) == load_config(Path(ta.__file__).parents[1] / "robot" / "launcher.toml")
    assert f"truearc doctor --config {out}" in capsys.readouterr().out


def test_init_of_tracks_asks_for_no_wheels_and_no_target(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "throws"
    assert main(["init", str(folder), "--tracks"]) == 0
    assert (folder / "tracks.csv").read_text(encoding="utf-8") == "shot_id,t_s,x_m,y_m,z_m\n"
    rig = tomllib.loads((folder / "rig.toml").read_text(encoding="utf-8"))
    assert set(rig["launcher"]) == {"release_height_m"} and "target" not in rig and rig["noise"]["track_m"] == 0.015
    filled = re.sub(r"^(\w+) = nan\b", r"\1 = 0.14", (folder / "rig.toml").read_text("utf-8"), flags=re.MULTILINE)
    (folder / "rig.toml").write_text(filled, encoding="utf-8")
    for name in ("shots.csv", "tracks.csv"):
        (folder / name).write_bytes((SHOTS.parent / "tracks" / name).read_bytes())
    assert len(ta.load_dataset(folder).shots) == 24
    assert main(["init", str(tmp_path / "other"), "--tracks", "--units", "ft"]) == 2
    assert not (tmp_path / "other" / "tracks.csv").exists()


def test_shots_in_the_users_units(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "week"
    assert main(["init", str(folder), "--units", "ft,rad"]) == 0
    assert (folder / "shots.csv").read_text(encoding="utf-8") == "shot_id,distance_ft,hood_rad,motor_ratio,outcome\n"
    shutil.copy(SHOTS / "rig.toml", folder)
    with open(folder / "shots.csv", "a", encoding="utf-8") as file:
        file.write("a,10,0.7853981634,0.5,three\n")
    shots = ta.load_dataset(folder).shots
    assert shots.number("distance_m")[0] == pytest.approx(3.048)
    assert shots.number("hood_deg")[0] == pytest.approx(45.0)
    assert main(["init", str(tmp_path / "other"), "--units", "rods"]) == 2
    assert "'rods' is not a unit of a distance or an angle; there are m, mm, cm, in, ft, yd" in capsys.readouterr().err
    assert not (tmp_path / "other" / "shots.csv").exists()
