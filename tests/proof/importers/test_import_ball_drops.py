"""Importing the ball drops: each ball's own mass and size, time from zero, nothing lost, every bad row named."""

import csv
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import truearc as ta
from truearc_proof.importers.ball_drops import import_ball_drops, import_sepia_drops

HEADER = ("ball", "sheet", "drop", "t_s", "height_m", "velocity_mps", "mass_kg", "diameter_m")
# name -> (mass in ounces, circumference in cm) as the source has them
BALLS = {"golfball": (1.62, 13.8), "tennisball": (2.0, 20.75), "bowlingball": (81.0, 67.0)}
FRAME_S = 1.0 / 15.0
TIMES = "1.220e+00 2.015e+00\n1.121e+00 1.726e+00\n"
DROPS = """# R_ball rho_air rho_ball height time sd(time)
 1.2e-1 1.184 84.0 20.0 2.29 0.1
 1.2e-1 1.184 84.0 40.0 3.26 0.1
 3.8e-2 1.184 626.0 20.0 2.01 0.1   % a baseball
"""


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
    facts = dataset.facts
    assert facts.launcher.wheel == () and facts.target is None
    assert facts.launcher.release_height_m == 47.16        # the source's, whatever these drops are
    assert facts.ball.mass_kg == pytest.approx(0.045926, abs=1e-6)       # bowling < golf < tennis in area per mass


def test_a_ball_that_nobody_weighed_is_kept_with_empty_cells(tmp_path: Path) -> None:
    unknown = [[*row[:6], "", ""] for row in drop("golfball", 1)]
    rows = [["volleyball", *row[1:]] for row in unknown] + drop("tennisball", 1)
    shots = import_ball_drops(write(tmp_path, rows)).shots
    assert shots.shot_id == ("volleyball-1", "tennisball-1")
    assert np.isnan(shots.number("mass_kg")).tolist() == [True, False]
    with pytest.raises(ta.InputError, match=r"drops\.csv: no drop of 8 samples has a ball of known mass_kg and "
                                         r"diameter_m"):
        import_ball_drops(write(tmp_path, unknown))


@pytest.mark.parametrize(("line", "column", "cell", "says"), [
    (5, "height_m", "inf", "drops.csv:5: height_m: 'inf' is not a finite number"),
    (5, "t_s", "", "drops.csv:5: t_s: is missing"),
    (5, "t_s", "0.0", "drops.csv:5: t_s: does not follow the sample before of the same drop"),
    (5, "ball", "", "drops.csv:5: ball: is missing"),
    (2, "mass_kg", "-0.1", "drops.csv:2: mass_kg: -0.1 is out of range"),
    (30, "mass_kg", "0.05", "drops.csv:30: mass_kg: 'golfball' has another in"),
    (30, "diameter_m", "", "drops.csv:30: diameter_m: 'golfball' has another in")])
def test_a_bad_cell_is_named(tmp_path: Path, line: int, column: str, cell: str, says: str) -> None:
    rows = good()
    rows[line - 2][HEADER.index(column)] = cell
    with pytest.raises(ta.InputError) as caught:
        import_ball_drops(write(tmp_path, rows))
    assert says in str(caught.value)


def test_a_drop_too_short_to_use_is_left_out_and_named(tmp_path: Path) -> None:
    dataset = import_ball_drops(write(tmp_path, good() + drop("tennisball", 2, count=7)))
    assert dataset.shots.shot_id[-1] == "bowlingball-1"
    assert dataset.left_out == ("tennisball-2: fewer than 8 samples",)


HEIGHTS = st.lists(st.floats(0.0, 60.0), min_size=8, max_size=40)


@settings(max_examples=40, deadline=None)
@given(heights=st.dictionaries(st.tuples(st.sampled_from(sorted(BALLS)), st.integers(1, 9)), HEIGHTS, min_size=1),
       starts_s=st.floats(0.0, 1e4))
def test_every_sample_arrives_under_its_drop(tmp_path_factory, heights, starts_s):
    rows = [[ball, ball, number, starts_s + k * FRAME_S, height, 0.0, *body(ball)]
            for (ball, number), column in heights.items() for k, height in enumerate(column)]
    dataset = import_ball_drops(write(tmp_path_factory.mktemp("drops"), rows))
    assert dataset.tracks is not None and not dataset.tracks.x_m.any() and not dataset.tracks.y_m.any()
    assert dataset.shots.shot_id == tuple(f"{ball}-{number}" for ball, number in heights)
    for shot, column in enumerate(heights.values()):
        here = dataset.tracks.shot == shot
        assert dataset.tracks.z_m[here].tolist() == column
        assert dataset.tracks.t_s[here] == pytest.approx(FRAME_S * np.arange(len(column)), abs=1e-9)


def tutorial(folder: Path, times: str = TIMES, heights: str = "5\n10\n", radii: str = "0.1\n0.2\n") -> tuple[str, ...]:
    paths = tuple(str(folder / f"field.{end}") for end in ("dat", "height", "radii"))
    for path, text in zip(paths, (times, heights, radii), strict=True):
        Path(path).write_text(text, encoding="utf-8")
    return paths


def test_a_time_belongs_to_its_radius_and_its_height(tmp_path: Path) -> None:
    dataset = import_sepia_drops(*tutorial(tmp_path))
    times, shots = dataset.times, dataset.shots
    assert times is not None and len(shots) == 4
    assert shots.number("radius_m").tolist() == [0.1, 0.1, 0.2, 0.2]
    assert (dataset.rig.launcher.release_height_m - times.height_m).tolist() == [5.0, 10.0, 5.0, 10.0]
    assert times.t_s.tolist() == [1.22, 2.015, 1.121, 1.726]
    assert shots.text("ball_id") == ("ball1", "ball1", "ball2", "ball2")
    density = shots.number("mass_kg") / (4.0 / 3.0 * np.pi * shots.number("radius_m")**3)
    assert np.ptp(density) < 1e-9


def test_a_table_of_drops_has_its_own_balls_air_and_errors(tmp_path: Path) -> None:
    (tmp_path / "drops.txt").write_text(DROPS, encoding="utf-8")
    dataset = import_sepia_drops(tmp_path / "drops.txt")
    assert dataset.times is not None
    assert dataset.times.sigma_s.tolist() == [0.1] * 3 and dataset.rig.air.density_kg_m3 == 1.184
    assert dataset.shots.number("mass_kg")[2] == pytest.approx(626.0 * 4.0 / 3.0 * np.pi * 0.038**3)
    assert dataset.times.height_m.tolist() == [20.0, 0.0, 20.0]


@pytest.mark.parametrize(("change", "said"), [
    ({"times": "1.2 2.0\n1.1 x\n"}, "field.dat:2"), ({"times": "1.2 2.0\n1.1\n"}, "field.dat:2: has 1 numbers"),
    ({"times": "1.2 2.0\n"}, "has 1 rows of 2"), ({"radii": "0.1\n-0.2\n"}, "radius: -0.2 must be above 0"),
    ({"times": "# nothing\n"}, "has no numbers"), ({"times": "1.2 nan\n1.1 1.7\n"}, "time: nan must be above 0")])
def test_a_bad_file_is_named(tmp_path: Path, change: dict[str, str], said: str) -> None:
    with pytest.raises(ta.InputError, match=said):
        import_sepia_drops(*tutorial(tmp_path, **change))


@pytest.mark.parametrize(("text", "said"), [
    (DROPS.replace("626.0 20.0", "626.0"), "txt:4: has 5 numbers"), ("1 2 3\n", "has 3 columns"),
    (DROPS.replace("1.184 626", "1.100 626"), "one air a dataset")])
def test_a_bad_table_is_named(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "drops.txt").write_text(text, encoding="utf-8")
    with pytest.raises(ta.InputError, match=said):
        import_sepia_drops(tmp_path / "drops.txt")
