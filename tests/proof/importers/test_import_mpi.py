"""Importing the three-wheel launcher: units, the cut before the bounce, and every bad row named."""

import csv
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import truearc.cli.main as truearc
from truearc.errors import InputError
from truearc.sim.data.files import load_dataset
from truearc_proof.importers.mpi import LAUNCH_COLUMNS, TRACK_COLUMNS, import_mpi

TABLE_M, BALL_M = 0.76, 0.02


def bouncing(up_m_s: float, start_m: float, count: int, step_s: float = 0.0055) -> tuple[np.ndarray, float]:
    """Samples [count, 4] of a ball that falls on a table and bounces with 0.85 of its speed, and when it does."""
    floor = TABLE_M + BALL_M
    hit_s = (up_m_s + np.sqrt(up_m_s**2 + 2.0 * 9.81 * (start_m - floor))) / 9.81
    back = 0.85 * (9.81 * hit_s - up_m_s)
    t = step_s * np.arange(count)
    after = t - hit_s
    z = np.where(after < 0.0, start_m + up_m_s * t - 4.905 * t**2, floor + back * after - 4.905 * after**2)
    return np.stack([t, 4.0 * t, 0.1 * t, z], axis=1), float(hit_s)


def write(home: Path, launches: list[list[object]], tracks: list[list[object]]) -> tuple[Path, Path]:
    paths = home / "launches.csv", home / "tracks.csv"
    for path, header, rows in zip(paths, (LAUNCH_COLUMNS, TRACK_COLUMNS), (launches, tracks), strict=True):
        with path.open("w", newline="") as file:
            csv.writer(file).writerows([header, *rows])
    return paths


def good(count: int = 100) -> tuple[list[list[object]], list[list[object]]]:
    samples, _ = bouncing(2.0, 1.07, count)
    return ([["spin", 4, 0.5, 0.5, 350.0, 350.0, 2800.0, count]], [["spin", 4, *row] for row in samples.tolist()])


def test_commands_become_rad_per_s_and_time_starts_at_zero(tmp_path: Path) -> None:
    launches, tracks = good()
    for row in tracks:
        row[2] += 7.0                                      # type: ignore[operator]
    dataset = import_mpi(*write(tmp_path, launches, tracks))
    assert dataset.shots.shot_id == ("spin-4",)
    assert dataset.shots.text("session") == ("spin",)
    assert dataset.shots.number("wheel_bottom_rad_s")[0] == pytest.approx(293.2153143)      # 2800 / 60 x 2 pi
    assert dataset.tracks is not None
    assert dataset.tracks.t_s[0] == 0.0
    assert dataset.tracks.t_s[1] == pytest.approx(0.0055)
    assert dataset.facts.ball.mass_kg == 0.0027


@settings(max_examples=60, deadline=None)
@given(up=st.floats(0.5, 3.0), start=st.floats(1.0, 1.4), count=st.integers(90, 220), seed=st.integers(0, 999))
def test_only_samples_before_the_bounce_are_kept(tmp_path_factory: pytest.TempPathFactory, up: float, start: float,
                                                 count: int, seed: int) -> None:
    samples, hit_s = bouncing(up, start, count)
    samples[:, 3] += np.random.default_rng(seed).normal(0.0, 0.001, count)
    rows = [["spin", 4, *row] for row in samples.tolist()]
    launches = [["spin", 4, 0.5, 0.5, 350.0, 350.0, 2800.0, count]]
    tracks = import_mpi(*write(tmp_path_factory.mktemp("mpi"), launches, rows)).tracks
    assert tracks is not None
    assert tracks.t_s[-1] < hit_s + 0.6 * 0.0055           # nearer than half a frame and the noise nobody can tell
    # at most the contact sample and one before it are given up
    assert tracks.t_s[-1] > min(hit_s, samples[-1, 0]) - 2.5 * 0.0055


@pytest.mark.parametrize(("table", "line", "column", "cell", "says"), [
    (0, 2, "motor_bottom_rpm", "fast", "launches.csv:2: motor_bottom_rpm: 'fast' is not a finite number"),
    (0, 2, "phi_cmd", "", "launches.csv:2: phi_cmd: is missing"),
    (0, 2, "set", "", "launches.csv:2: set: is missing"),
    (0, 2, "n_samples", "99", "launches.csv:2: n_samples: is 99, but the tracks have 100"),
    (1, 31, "z_m", "nan", "tracks.csv:31: z_m: 'nan' is not a finite number"),
    (1, 31, "x_m", "", "tracks.csv:31: x_m: is missing"),
    (1, 31, "t_s", "0.0", "tracks.csv:31: t_s: does not follow"),
    (1, 31, "launch", "5", "tracks.csv:31: launch: set 'spin' launch 5 is not among the launches"),
])
def test_a_bad_cell_is_named(tmp_path: Path, table: int, line: int, column: str, cell: str, says: str) -> None:
    rows = good()
    header = (LAUNCH_COLUMNS, TRACK_COLUMNS)[table]
    rows[table][line - 2][header.index(column)] = cell
    with pytest.raises(InputError) as caught:
        import_mpi(*write(tmp_path, *rows))
    assert says in str(caught.value)


def test_a_launch_that_stands_twice_is_named(tmp_path: Path) -> None:
    launches, tracks = good()
    with pytest.raises(InputError, match=r"launches\.csv:3: launch: set 'spin' has launch 4 already"):
        import_mpi(*write(tmp_path, launches + launches, tracks))


def test_a_missing_column_is_named(tmp_path: Path) -> None:
    launches, tracks = write(tmp_path, *good())
    tracks.write_text(tracks.read_text().replace("z_m", "height"))
    with pytest.raises(InputError, match=r"tracks\.csv:1: column z_m is missing"):
        import_mpi(launches, tracks)


def test_a_flight_too_short_to_use_is_left_out_and_named(tmp_path: Path) -> None:
    launches, tracks = good()
    short = [["spin", 6, *row[2:]] for row in tracks[:5]]
    dataset = import_mpi(*write(tmp_path, [*launches, ["spin", 6, 0.5, 0.5, 1.0, 1.0, 1.0, 5]], tracks + short))
    assert dataset.shots.shot_id == ("spin-4",)
    assert dataset.left_out == ("spin-6: fewer than 8 samples before the bounce",)


def test_the_door_writes_a_dataset_and_refuses_too_few_files(tmp_path: Path,
                                                             capsys: pytest.CaptureFixture[str]) -> None:
    launches, tracks = write(tmp_path, *good())
    assert truearc.main(["import", "mpi", str(launches), str(tracks), "-o", str(tmp_path / "out")]) == 0
    assert "1 shots" in capsys.readouterr().out
    assert load_dataset(tmp_path / "out").shots.shot_id == ("spin-4",)
    assert truearc.main(["import", "mpi", str(launches), "-o", str(tmp_path / "no")]) == 2
    assert "mpi takes RECORDING.hdf5 ..., or LAUNCHES.csv TRACKS.csv; not" in capsys.readouterr().err


@pytest.mark.data
def test_the_real_flights_end_above_the_table_and_still_falling(data_dir: Path) -> None:
    dataset = import_mpi(data_dir / "real/mpi_launches.csv", data_dir / "real/mpi_tracks.csv")
    assert len(dataset.shots) == 37
    assert dataset.left_out == ()
    tracks = dataset.tracks
    assert tracks is not None
    for shot in range(37):
        z_m, t_s = tracks.z_m[tracks.shot == shot], tracks.t_s[tracks.shot == shot]
        assert t_s[0] == 0.0
        assert z_m[-1] > TABLE_M
        # the last three samples fall at 1 to 5 m/s, as a ball from that height does
        assert 1.0 < (z_m[-3] - z_m[-1]) / (t_s[-1] - t_s[-3]) < 5.0
