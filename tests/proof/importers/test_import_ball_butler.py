"""Importing flights of the ball-throwing robot: one shot a flight, x along the throws, every bad row named."""

import csv
import math
from pathlib import Path

import numpy as np
import pytest

import truearc.cli.main as truearc
from truearc.robot.config.schema import InputError
from truearc.sim.data.dataset import load_dataset
from truearc.sim.infer.plausibility.check import check_plausible
from truearc_proof.importers.ball_butler import RIG, import_ball_butler

HEADER = ("shot_id", "t_s", "x_m", "y_m", "z_m")
RATE_HZ = 300.0


def flight(name: str, yaw_deg: float, begins_s: float = 0.0, count: int = 180) -> list[list[object]]:
    """A throw without air at 1 m/s along the ground and 1.5 m/s up, from (-0.8, -0.2, 2.4)."""
    yaw = math.radians(yaw_deg)
    t_s = np.arange(count) / RATE_HZ
    return [[name, begins_s + t, -0.8 + math.cos(yaw) * t, -0.2 + math.sin(yaw) * t, 2.4 + 1.5 * t - 4.905 * t * t]
            for t in t_s]


def write(home: Path, rows: list[list[object]]) -> Path:
    path = home / "flights.csv"
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([HEADER, *rows])
    return path


def test_each_flight_is_a_shot_and_x_points_along_them(tmp_path: Path) -> None:
    dataset = import_ball_butler(write(tmp_path, [*flight("s4-00", 5.0), *flight("s4-01", 25.0, 7.5)]))
    tracks = dataset.tracks
    assert dataset.shots.shot_id == ("s4-00", "s4-01") and dataset.shots.text("session") == ("s4", "s4")
    assert tracks is not None
    for row, aside_deg in enumerate((-10.0, 10.0)):
        here = tracks.shot == row
        flown_s = tracks.t_s[here]
        assert flown_s[0] == 0.0 and len(flown_s) == 180
        np.testing.assert_allclose(tracks.x_m[here], flown_s * math.cos(math.radians(aside_deg)), atol=1e-9)
        np.testing.assert_allclose(tracks.y_m[here], flown_s * math.sin(math.radians(aside_deg)), atol=1e-9)
        np.testing.assert_allclose(tracks.z_m[here], 2.4 + 1.5 * flown_s - 4.905 * flown_s**2, atol=1e-9)


def test_a_flight_of_a_few_samples_is_left_out_and_said(tmp_path: Path) -> None:
    dataset = import_ball_butler(write(tmp_path, [*flight("s4-00", 5.0), *flight("s4-01", 5.0, count=7)]))
    assert dataset.shots.shot_id == ("s4-00",) and dataset.left_out == ("s4-01: fewer than 8 samples",)
    with pytest.raises(InputError, match=r"flights\.csv: has no flight of 8 samples"):
        import_ball_butler(write(tmp_path, flight("s4-00", 5.0, count=7)))


def test_a_time_that_goes_back_is_named_by_its_line(tmp_path: Path) -> None:
    rows = flight("s4-00", 5.0)
    rows[20][1] = rows[10][1]
    with pytest.raises(InputError, match=r"flights\.csv:22: t_s: does not follow the sample before"):
        import_ball_butler(write(tmp_path, rows))


@pytest.mark.data
def test_the_recorded_session_is_read_and_is_plausible(data_dir: Path, tmp_path: Path) -> None:
    out = tmp_path / "session-3"
    session = data_dir / "real" / "ball_butler_tracks.csv"
    assert truearc.main(["import", "ball-butler", str(session), "-o", str(out)]) == 0
    dataset = load_dataset(out)
    assert len(dataset.shots) == 20 and dataset.tracks is not None and len(dataset.tracks.t_s) == 3885
    assert dataset.rig == RIG
    assert check_plausible(dataset).accepted == ()
