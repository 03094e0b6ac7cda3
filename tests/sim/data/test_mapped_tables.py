"""Tables of other programs, under the maps that come with truearc."""

import math
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

import truearc as ta
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


def test_every_wrong_cell_of_a_column_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(f"{HEADER}2,fast,48,1,true,\n2,55,48,1,true,\n2,slow,48,1,true,\n")
    with pytest.raises(ta.InputError, match=r"a\.csv:2: .*fast. is not a number\n.*a\.csv:4: .*slow. is not a number"):
        ta.import_shots([tmp_path / "a.csv"], rig=HIT_OR_MISS, shot_map="viking-2928")


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
