"""The aim file from a belief to the robot: checked against the simulator, aimed by on the emulated robot, replayed."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest

import truearc as ta
from truearc.cli.common import SHIPPED
from truearc.cli.main import main
from truearc.robot.aim_file import load_aim, load_aim_for
from truearc.robot.config.schema import load_config
from truearc.robot.operator_ui.aim_inbox import AimInbox
from truearc.robot.recording.replay import replay
from truearc.robot.recording.session import AIMS
from truearc.sim.infer.belief import point_belief

CONFIG = load_config(SHIPPED)
BELIEF = point_belief({"drag": {"cd": 0.45}, "magnus": {"cl": 0.1}, "exit_efficiency": {"loss": 0.38}},
                      {"speed": 0.015, "elevation_deg": 0.5})


@pytest.fixture(scope="module")
def table() -> ta.AimTable:
    return ta.aim(BELIEF, CONFIG.rig, distances_m=np.arange(2.0, 8.1, 0.25), hood_deg=(30.0, 54.0))


@pytest.fixture(scope="module")
def aim_file(table: ta.AimTable, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("aim") / "aim.json"
    check = ta.export_aim(table, BELIEF, CONFIG.rig, path, note="first")
    assert check.passed and str(check).startswith("at 40 random distances")
    return path


@pytest.fixture(scope="module")
def session(aim_file: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("session") / "s"
    played = ta.emulate(CONFIG, folder, 4, 3, aim_path=aim_file)
    assert str(played).startswith(f"{folder}: {len(played.balls)} balls launched (")
    assert len(played.table()) == len(played.balls) > 0
    return folder


def test_the_robot_reads_what_the_table_says(table: ta.AimTable, aim_file: Path) -> None:
    aim = load_aim(aim_file)
    for distance_m in np.linspace(table.rows[0].distance_m, table.rows[-1].distance_m, 57):
        row, point = table.at(float(distance_m)), aim.at(float(distance_m))
        assert point == pytest.approx((row.hood_deg, row.motor_ratio, row.lead_deg), rel=1e-9, abs=1e-9)


def test_a_file_of_another_belief_is_told_apart(aim_file: Path) -> None:
    other = point_belief({"drag": {"cd": 0.45}, "magnus": {"cl": 0.1}, "exit_efficiency": {"loss": 0.42}},
                         {"speed": 0.015, "elevation_deg": 0.5})
    with pytest.raises(ta.InputError, match=r"aim\.json: at .* m the set point has .* points less than the best"):
        ta.verify_aim(aim_file, other, CONFIG.rig)


def test_distances_without_a_set_point_part_the_file(table: ta.AimTable, tmp_path: Path) -> None:
    kept = [row for row in table.rows if row.distance_m not in (4.0, 4.25, 4.5)]
    path = tmp_path / "aim.json"
    ta.export_aim(ta.AimTable(tuple(kept), ((4.0, "why"), (4.25, "why"), (4.5, "why"))), BELIEF, CONFIG.rig, path)
    aim = load_aim(path)
    assert aim.at(3.6) and aim.at(5.0) and aim.at(4.3) is None and len(aim.content.segments) == 2
    with pytest.raises(ta.InputError, match="no two neighbouring distances"):
        ta.export_aim(ta.AimTable(table.rows[:1]), BELIEF, CONFIG.rig, tmp_path / "one.json")


def test_a_file_stays_where_the_new_one_falls_short(table: ta.AimTable, tmp_path: Path) -> None:
    path, slow = tmp_path / "aim.json", tuple(row._replace(motor_ratio=0.5 * row.motor_ratio) for row in table.rows)
    path.write_text("the good one")
    with pytest.raises(ta.InputError, match="^" + re.escape(str(path))):
        ta.export_aim(ta.AimTable(slow), BELIEF, CONFIG.rig, path)
    assert path.read_text() == "the good one" and list(tmp_path.iterdir()) == [path]


def test_the_emulated_robot_fires_with_the_set_points_of_the_file(session: Path, aim_file: Path) -> None:
    aim, fired = load_aim(aim_file), 0
    for tick in ta.Recording(session):
        if tick.verdict.fire:
            held = tick.aim
            point = aim.at(tick.memory.aim_place_m)
            assert point is not None and held.source == "belief" and held.hood_deg == point.hood_deg
            assert held.motor_ratio == pytest.approx(point.motor_ratio * np.exp(held.correction), rel=1e-12)
            fired += 1
    assert fired == 4


def test_its_recording_replays_to_the_bit_with_its_file_and_not_without(session: Path, tmp_path: Path) -> None:
    assert replay(session).ticks > 500
    assert main(["session", "replay", str(session), "--from", "frames", "--check"]) == 0
    assert main(["session", "replay", str(session), "--config", str(session.parent / "none.toml")]) == 2
    lost = shutil.copytree(session, tmp_path / "lost")
    (lost / "aim.json").unlink()
    with pytest.raises(ta.InputError, match="the aim file of the recording is missing"):
        replay(lost)
    other = shutil.copytree(session, tmp_path / "other")
    (other / "aim.json").write_bytes((session / "aim.json").read_bytes() + b" ")
    with pytest.raises(ta.InputError, match="damaged or altered"):
        replay(other)


def test_the_inbox_offers_the_newest_sound_file_once_and_keeps_it(aim_file, table, tmp_path, capsys):
    folder, session = tmp_path / "in", tmp_path / "s"
    folder.mkdir()
    session.mkdir()
    aims = {"": load_aim_for(aim_file, CONFIG)}
    inbox = AimInbox(folder, CONFIG, session, aims)
    inbox.look()
    shutil.copy(aim_file, folder / "same.json")
    inbox.look()
    assert inbox.offer is None                    # what is aimed by already is not offered
    (folder / "broken.json").write_text("{")
    inbox.look()
    assert inbox.offer is None and "not offered: " in capsys.readouterr().err
    ta.export_aim(ta.AimTable(table.rows[2:]), BELIEF, CONFIG.rig, folder / "new.json", note="wind")
    inbox.look()
    assert inbox.offer is not None and inbox.offer.note == "wind"
    assert load_aim(session / AIMS / f"{inbox.offer.sha256}.json").sha256 == inbox.offer.sha256 in aims
    shutil.copy(aim_file, folder / "back.json")   # the first one again: the driver may go back
    inbox.look()
    first = load_aim(aim_file).sha256
    assert inbox.offer.sha256 == first and aims[first].sha256 == first
    assert load_aim(session / AIMS / f"{first}.json").sha256 == first
    assert capsys.readouterr().err == ""


def test_the_command_writes_a_file_that_verify_passes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    belief, path = tmp_path / "b.toml", tmp_path / "aim.json"
    BELIEF.save(belief)
    assert main(["aim", str(belief), "--rig", str(SHIPPED), "--distances", "3:5:0.25", "--robot", str(path),
                 "--note", "hall"]) == 0
    assert load_aim_for(path, CONFIG).content.note == "hall"
    assert main(["verify", str(path), "--belief", str(belief), "--rig", str(SHIPPED)]) == 0
    assert main(["verify", str(path), "--weights", "w"]) == 2
    assert main(["verify", str(path)]) == 2
    assert main(["aim", str(belief), "--rig", str(SHIPPED), "--note", "x"]) == 2
    assert "--note" in capsys.readouterr().err


def test_policy_and_file_go_together(tmp_path: Path, aim_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = SHIPPED.read_text(encoding="utf-8")
    belief = tmp_path / "belief.toml"
    belief.write_text(text + '\n[aim]\npolicy = "belief"\ncorrection_step = 0.005\n', encoding="utf-8")
    assert load_config(belief).aim.policy == "belief"
    for config, more, words in ((belief, [], "so --aim is needed"), (SHIPPED, ["--aim", str(aim_file)], "not used")):
        assert main(["run", "--config", str(config), "--out", str(tmp_path), *more]) == 2
        assert words in capsys.readouterr().err
    assert main(["emulate", "--config", str(belief), "--trials", "1", "--out", str(tmp_path / "s")]) == 2
    assert "aim file is needed" in capsys.readouterr().err
