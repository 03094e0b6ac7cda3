"""Importing the ball drops: each ball's own mass and size, time from zero, nothing lost, every bad row named."""

import csv
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import spearmanr

import truearc.cli.main as truearc
from truearc.errors import InputError
from truearc.sim.data.files import load_dataset
from truearc_proof.importers.ball_drops import import_ball_drops

HEADER = ("ball", "sheet", "drop", "t_s", "height_m", "velocity_mps", "mass_kg", "diameter_m")
# name -> (mass in ounces, circumference in cm) as the source has them
BALLS = {"golfball": (1.62, 13.8), "tennisball": (2.0, 20.75), "bowlingball": (81.0, 67.0)}
FRAME_S = 1.0 / 15.0


def body(ball: str) -> list[object]:
    """Mass in kg and diameter in m, as the source's figures convert."""
    ounces, circumference_cm = BALLS[ball]
    return [ounces * 0.028349523, circumference_cm / 100.0 / math.pi]


def drop(ball: str, number: int, count: int = 20, starts_s: float = 0.0) -> list[list[object]]:
    """A fall from 47 m without air."""
    rows: list[list[object]] = []
    for k in range(count):
        t = k * FRAME_S
        rows.append([ball, ball.title(), number, starts_s + t, 47.0 - 4.905 * t**2, -9.81 * t, *body(ball)])
    return rows


def good() -> list[list[object]]:
    return [*drop("golfball", 1), *drop("golfball", 2, starts_s=3.5), *drop("tennisball", 1), *drop("bowlingball", 1)]


def write(home: Path, rows: list[list[object]]) -> Path:
    path = home / "drops.csv"
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([HEADER, *rows])
    return path


def test_each_drop_is_a_shot_with_its_own_balls_mass_and_size(tmp_path: Path) -> None:
    dataset = import_ball_drops(write(tmp_path, good()))
    shots = dataset.shots
    assert shots.shot_id == ("golfball-1", "golfball-2", "tennisball-1", "bowlingball-1")
    assert shots.text("ball_id") == ("golfball", "golfball", "tennisball", "bowlingball")
    assert shots.text("session") == ("drop 1", "drop 2", "drop 1", "drop 1")
    assert shots.number("mass_kg") == pytest.approx([0.045926, 0.045926, 0.056699, 2.296311], abs=1e-6)
    assert shots.number("radius_m") == pytest.approx([0.0219634, 0.0219634, 0.0330247, 0.1066338], abs=1e-6)
    # pi r^2 / m by hand: 15.155 cm2 / 45.926 g; 34.263 / 56.699; 357.22 / 2296.3
    assert shots.number("area_per_mass_m2_kg") == pytest.approx([0.032998, 0.032998, 0.060429, 0.015556], rel=1e-4)


def test_the_fall_is_vertical_and_its_time_starts_at_zero(tmp_path: Path) -> None:
    tracks = import_ball_drops(write(tmp_path, good())).tracks
    assert tracks is not None
    assert not tracks.x_m.any()
    assert not tracks.y_m.any()
    for shot in range(4):
        here = tracks.shot == shot
        assert tracks.t_s[here] == pytest.approx(FRAME_S * np.arange(20))
        assert tracks.z_m[here] == pytest.approx(47.0 - 4.905 * tracks.t_s[here]**2)


def test_the_rig_has_no_wheels_and_the_ball_between_the_others(tmp_path: Path) -> None:
    facts = import_ball_drops(write(tmp_path, good())).facts
    assert facts.launcher.wheel == ()
    assert facts.target is None
    assert facts.launcher.release_height_m == 47.16        # the source's, whatever these drops are
    assert facts.ball.mass_kg == pytest.approx(0.045926, abs=1e-6)       # bowling < golf < tennis in area per mass


def test_a_ball_that_nobody_weighed_is_kept_with_empty_cells(tmp_path: Path) -> None:
    unknown = [[*row[:6], "", ""] for row in drop("golfball", 1)]
    rows = [["volleyball", *row[1:]] for row in unknown] + drop("tennisball", 1)
    out = tmp_path / "out"
    assert truearc.main(["import", "ball-drops", str(write(tmp_path, rows)), "-o", str(out)]) == 0
    shots = load_dataset(out).shots
    assert shots.shot_id == ("volleyball-1", "tennisball-1")
    assert np.isnan(shots.number("mass_kg")).tolist() == [True, False]
    with pytest.raises(InputError, match=r"drops\.csv: no drop of 8 samples has a ball of known mass_kg and "
                                         r"diameter_m"):
        import_ball_drops(write(tmp_path, unknown))


@pytest.mark.parametrize(("line", "column", "cell", "says"), [
    (5, "height_m", "high", "drops.csv:5: height_m: 'high' is not a finite number"),
    (5, "height_m", "inf", "drops.csv:5: height_m: 'inf' is not a finite number"),
    (5, "t_s", "", "drops.csv:5: t_s: is missing"),
    (5, "t_s", "0.0", "drops.csv:5: t_s: does not follow the sample before of the same drop"),
    (5, "ball", "", "drops.csv:5: ball: is missing"),
    (5, "drop", "", "drops.csv:5: drop: is missing"),
    (2, "mass_kg", "-0.1", "drops.csv:2: mass_kg: -0.1 is out of range"),
    (30, "mass_kg", "0.05", "drops.csv:30: mass_kg: 'golfball' has another in"),
    (30, "diameter_m", "", "drops.csv:30: diameter_m: 'golfball' has another in"),
])
def test_a_bad_cell_is_named(tmp_path: Path, line: int, column: str, cell: str, says: str) -> None:
    rows = good()
    rows[line - 2][HEADER.index(column)] = cell
    with pytest.raises(InputError) as caught:
        import_ball_drops(write(tmp_path, rows))
    assert says in str(caught.value)


def test_a_missing_column_is_named(tmp_path: Path) -> None:
    path = write(tmp_path, good())
    path.write_text(path.read_text().replace("height_m", "height_ft"))
    with pytest.raises(InputError, match=r"drops\.csv:1: column height_m is missing"):
        import_ball_drops(path)


def test_a_drop_too_short_to_use_is_left_out_and_named(tmp_path: Path) -> None:
    dataset = import_ball_drops(write(tmp_path, good() + drop("tennisball", 2, count=7)))
    assert dataset.shots.shot_id[-1] == "bowlingball-1"
    assert dataset.left_out == ("tennisball-2: fewer than 8 samples",)


def test_the_door_says_which_files_it_wants(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = str(write(tmp_path, good()))
    assert truearc.main(["import", "ball-drops", path, path, "-o", str(tmp_path / "out")]) == 2
    assert "ball-drops takes Ball_drops_data.xls balls.txt, or DROPS.csv; not" in capsys.readouterr().err


HEIGHTS = st.lists(st.floats(0.0, 60.0), min_size=8, max_size=40)


@settings(max_examples=40, deadline=None)
@given(heights=st.dictionaries(st.tuples(st.sampled_from(sorted(BALLS)), st.integers(1, 9)), HEIGHTS, min_size=1),
       starts_s=st.floats(0.0, 1e4))
def test_every_sample_arrives_under_its_drop(tmp_path_factory: pytest.TempPathFactory,
                                             heights: dict[tuple[str, int], list[float]], starts_s: float) -> None:
    rows = [[ball, ball, number, starts_s + k * FRAME_S, height, 0.0, *body(ball)]
            for (ball, number), column in heights.items() for k, height in enumerate(column)]
    dataset = import_ball_drops(write(tmp_path_factory.mktemp("drops"), rows))
    assert dataset.tracks is not None
    assert dataset.shots.shot_id == tuple(f"{ball}-{number}" for ball, number in heights)
    for shot, column in enumerate(heights.values()):
        here = dataset.tracks.shot == shot
        assert dataset.tracks.z_m[here].tolist() == column
        assert dataset.tracks.t_s[here] == pytest.approx(FRAME_S * np.arange(len(column)), abs=1e-9)


@pytest.mark.data
def test_the_real_drops_are_all_there_and_fall_as_their_mass_and_size_say(data_dir: Path) -> None:
    dataset = import_ball_drops(data_dir / "real/ball_drops.csv")
    shots, tracks = dataset.shots, dataset.tracks
    assert tracks is not None
    assert (len(shots), len(set(shots.text("ball_id"))), len(tracks.t_s)) == (22, 11, 1064)
    assert dataset.left_out == ()
    golf, bowling = shots.shot_id.index("golfball-1"), shots.shot_id.index("bowlingball-2")
    # 1.62 ounces and 13.8 cm around; 81 ounces
    assert shots.number("mass_kg")[golf] == pytest.approx(1.62 * 0.0283495, rel=1e-3)
    assert 200.0 * math.pi * shots.number("radius_m")[golf] == pytest.approx(13.8, rel=1e-3)
    assert shots.number("mass_kg")[bowling] == pytest.approx(81.0 * 0.0283495, rel=1e-3)
    late_m_s2 = np.array([late_acceleration(tracks.t_s[tracks.shot == shot], tracks.z_m[tracks.shot == shot])
                          for shot in range(22)])
    assert -11.0 < late_m_s2[bowling] < -8.5
    known = np.isfinite(shots.number("mass_kg"))
    # what of gravity is left over in the second half of the fall goes with area per mass, without any model of drag
    assert spearmanr(shots.number("area_per_mass_m2_kg")[known], late_m_s2[known]).statistic > 0.8


def late_acceleration(t_s: np.ndarray, z_m: np.ndarray) -> float:
    late = t_s > 0.5 * t_s[-1]
    return float(2.0 * np.polynomial.polynomial.polyfit(t_s[late], z_m[late], 2)[2])
