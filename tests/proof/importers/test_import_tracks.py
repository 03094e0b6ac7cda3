"""Tracks of table-tennis launches and of thrown balls."""

import csv
import json
import math
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import truearc.cli.main as truearc
from tests.sim.same_dataset import assert_same
from truearc.errors import InputError
from truearc.sim.data.files import load_dataset
from truearc_proof.importers.ball_butler import import_ball_butler
from truearc_proof.importers.mpi import BALL_NAMES, LAUNCH_COLUMNS, ROBOT_NAMES, TRACK_COLUMNS, import_mpi

TABLE_M, BALL_M = 0.76, 0.02
RPM = (350.0, 350.0, 2800.0)


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
def test_only_samples_before_the_bounce_are_kept(tmp_path_factory, up, start, count, seed):
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
    (0, 2, "set", "", "launches.csv:2: set: is missing"),
    (0, 2, "n_samples", "99", "launches.csv:2: n_samples: is 99, but the tracks have 100"),
    (1, 31, "z_m", "nan", "tracks.csv:31: z_m: 'nan' is not a finite number"),
    (1, 31, "t_s", "0.0", "tracks.csv:31: t_s: does not follow"),
    (1, 31, "launch", "5", "tracks.csv:31: launch: set 'spin' launch 5 is not among the launches")])
def test_a_bad_cell_is_named(tmp_path: Path, table: int, line: int, column: str, cell: str, says: str) -> None:
    rows = good()
    header = (LAUNCH_COLUMNS, TRACK_COLUMNS)[table]
    rows[table][line - 2][header.index(column)] = cell
    with pytest.raises(InputError) as caught:
        import_mpi(*write(tmp_path, *rows))
    assert says in str(caught.value)


def test_the_door_writes_a_dataset_and_refuses_too_few_files(tmp_path, capsys):
    launches, tracks = write(tmp_path, *good())
    assert truearc.main(["import", "mpi", str(launches), str(tracks), "-o", str(tmp_path / "out")]) == 0
    assert "1 shots" in capsys.readouterr().out
    assert load_dataset(tmp_path / "out").shots.shot_id == ("spin-4",)
    assert truearc.main(["import", "mpi", str(launches), "-o", str(tmp_path / "no")]) == 2
    assert "mpi takes RECORDING.hdf5 ..., or LAUNCHES.csv TRACKS.csv; not" in capsys.readouterr().err


def record(path: Path, launches: Iterable[tuple[str, np.ndarray, np.ndarray]], names: tuple[str, str, str] = BALL_NAMES,
           unit: float = 1.0) -> Path:
    """launches: number, parameters [5] and samples [k, 4]; unit: of the clock in s."""
    with h5py.File(path, "w") as file:
        for number, parameters, samples in launches:
            group = file.create_group(f"originals/{number}")
            for name, values in zip(names, (parameters, samples[:, 0] / unit, samples[:, 1:]), strict=True):
                group.create_dataset(name, data=values)
            group.create_dataset("velocities", data=np.zeros((len(samples), 3)))
    return path


def of_tables(launches: list[list[Any]], tracks: list[list[Any]]) -> list[tuple[str, np.ndarray, np.ndarray]]:
    return [(str(row[1]), np.array(row[2:7], float),
             np.array([sample[2:] for sample in tracks if sample[:2] == row[:2]], float)) for row in launches]


def flight(rpm: tuple[float, ...] = RPM) -> tuple[np.ndarray, np.ndarray]:
    return np.array([0.5, 0.5, *rpm]), bouncing(1.0, 1.1, 100)[0]


@pytest.mark.parametrize(("names", "unit"), [(BALL_NAMES, 1.0), (ROBOT_NAMES, 1.0), (BALL_NAMES, 1e-9)])
def test_a_recording_says_the_same_as_the_tables(tmp_path: Path, names: tuple[str, str, str], unit: float) -> None:
    launches, tracks = good()
    path = record(tmp_path / "mn5008_spin.hdf5", of_tables(launches, tracks), names, unit)
    assert_same(import_mpi(path), import_mpi(*write(tmp_path, launches, tracks)), 1e-9)


def test_many_recordings_are_one_dataset_with_a_session_each(tmp_path: Path) -> None:
    first = record(tmp_path / "mn5008_backspin.hdf5", [(name, *flight()) for name in ("10", "2", "0")])
    second = record(tmp_path / "no_spin_robot.hdf5", [("0", *flight((1140.0,) * 3))], ROBOT_NAMES)
    out = tmp_path / "out"
    assert truearc.main(["import", "mpi", str(first), str(second), "-o", str(out)]) == 0
    shots = load_dataset(out).shots
    assert shots.shot_id == ("backspin-0", "backspin-2", "backspin-10", "no_spin_robot-0")
    assert shots.text("session") == ("backspin",) * 3 + ("no_spin_robot",)
    assert shots.number("wheel_top_left_rad_s")[[0, 3]] == pytest.approx([36.6519143, 119.3805208])


def test_samples_without_a_ball_and_empty_launches_are_left_out(tmp_path: Path) -> None:
    parameters, samples = flight()
    path = record(tmp_path / "spin.hdf5", [("0", parameters, samples), ("1", parameters, samples[:0])], ROBOT_NAMES)
    with h5py.File(path, "a") as file:
        file["originals/0/ball_ids"] = np.where(np.arange(100) < 3, -1, 7)
        file["originals/0/ball_positions"][:3] = np.nan
    dataset = import_mpi(path)
    assert dataset.left_out == ("spin-1: fewer than 8 samples before the bounce",)
    assert dataset.tracks is not None
    assert dataset.tracks.x_m[0] == pytest.approx(samples[3, 1])


def spoil(name: str, values: object, row: int | None = None) -> Callable[[Any], None]:
    """What puts other values into launch 4, or nothing at all; row: into that one alone."""
    def change(file: Any) -> None:
        if row is not None:
            file[f"originals/4/{name}"][row] = values
            return
        del file[f"originals/4/{name}"]
        if values is not None:
            file[f"originals/4/{name}"] = values
    return change


@pytest.mark.parametrize(("change", "says"), [
    (spoil("time_stamps", None), ", group 4: time_stamps is missing"),
    (spoil("launch_param", [0.5, 0.5]), ", group 4: launch_param has not 5 numbers (phi_cmd, theta_cmd, motor"),
    (spoil("launch_param", [0.5, 0.5, -1.0, -1.0, -1.0]), ", group 4: motor_bottom_rpm: -1 is not a speed in rpm"),
    (spoil("positions", np.zeros((99, 3))), ", group 4: positions has not 3 numbers for each of time_stamps"),
    (spoil("positions", np.nan, 30), ", group 4:31: x_m: nan is not a finite number"),
    (spoil("time_stamps", 0.0, 30), ", group 4:31: t_s: does not follow the sample before of the same launch"),
    (lambda file: file.move("originals", "filtered"), ": has no group 'originals' with launches in it")])
def test_what_is_wrong_with_a_launch_is_named(tmp_path, capsys, change, says):
    path = record(tmp_path / "spin.hdf5", [("4", *flight())])
    with h5py.File(path, "a") as file:
        change(file)
    assert truearc.main(["import", "mpi", str(path), "-o", str(tmp_path / "out")]) == 2
    assert f"spin.hdf5{says}" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_file_that_is_cut_short_or_stands_twice_is_refused(tmp_path: Path) -> None:
    path = record(tmp_path / "spin.hdf5", [("4", *flight())])
    with pytest.raises(InputError, match="launch spin-4 stands twice"):
        import_mpi(path, path)
    path.write_bytes(path.read_bytes()[:-500])
    with pytest.raises(InputError, match=r"spin\.hdf5: not a readable HDF5 file .*truncated"):
        import_mpi(path)
    with pytest.raises(InputError, match=r"missing\.hdf5: not a readable HDF5 file .*No such file"):
        import_mpi(tmp_path / "missing.hdf5")


HEADER = ("shot_id", "t_s", "x_m", "y_m", "z_m")
RATE_HZ = 300.0


def throws(name: str, yaw_deg: float, begins_s: float = 0.0, count: int = 180) -> list[list[object]]:
    """A throw without air at 1 m/s along the ground and 1.5 m/s up, from (-0.8, -0.2, 2.4)."""
    yaw = math.radians(yaw_deg)
    t_s = np.arange(count) / RATE_HZ
    return [[name, begins_s + t, -0.8 + math.cos(yaw) * t, -0.2 + math.sin(yaw) * t, 2.4 + 1.5 * t - 4.905 * t * t]
            for t in t_s]


def csv_of(home: Path, rows: list[list[object]]) -> Path:
    path = home / "flights.csv"
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([HEADER, *rows])
    return path


def test_each_flight_is_a_shot_and_x_points_along_them(tmp_path: Path) -> None:
    dataset = import_ball_butler(csv_of(tmp_path, [*throws("s4-00", 5.0), *throws("s4-01", 25.0, 7.5)]))
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
    dataset = import_ball_butler(csv_of(tmp_path, [*throws("s4-00", 5.0), *throws("s4-01", 5.0, count=7)]))
    assert dataset.shots.shot_id == ("s4-00",) and dataset.left_out == ("s4-01: fewer than 8 samples",)
    with pytest.raises(InputError, match=r"flights\.csv: has no flight of 8 samples"):
        import_ball_butler(csv_of(tmp_path, throws("s4-00", 5.0, count=7)))


def throw(yaw_deg: float, air: float = 0.0) -> np.ndarray:
    """Frames of a ball in mm: half a second in the hand, 0.1 s thrown upward, free flight (drag: `air` per m) until the
    floor, and a second of rolling there."""
    yaw = math.radians(yaw_deg)
    along = np.array([math.cos(yaw), math.sin(yaw), 0.0])
    still = np.tile([-0.9, -0.2, 2.1], (150, 1))
    thrown_s = np.arange(1, 31) / RATE_HZ
    hand = still[0] + np.outer(thrown_s**2 / 2.0, 12.0 * along + (0.0, 0.0, 28.0))
    begin = np.concatenate([hand[-1], (12.0 * along + (0.0, 0.0, 28.0)) * thrown_s[-1]])

    def law(_: float, now: np.ndarray) -> np.ndarray:
        return np.concatenate([now[3:], (0.0, 0.0, -9.81) - air * np.linalg.norm(now[3:]) * now[3:]])

    flown_s = np.arange(1, 300) / RATE_HZ
    flown = solve_ivp(law, (0.0, 1.0), begin, method="DOP853", t_eval=flown_s, rtol=1e-11, atol=1e-11).y[:3].T
    flown = flown[flown[:, 2] > 0.0]
    rolls = flown[-1] * (1.0, 1.0, 0.0) + np.outer(np.arange(1, 301) / RATE_HZ, along)
    return 1000.0 * np.concatenate([still, hand, flown, rolls])


def recording(home: Path, markers: dict[str, list[tuple[int, np.ndarray]]], name: str = "session9.json") -> Path:
    """A file as Qualisys Track Manager exports it; markers: parts as (first frame, places in mm)."""
    path = home / name
    path.write_text(json.dumps({"Name": "a.qtm", "Timebase": {"Frequency": RATE_HZ, "Range": {"Start": 1, "End": 9000}},
                                "Markers": [{"Name": name, "Color": 65280, "Parts": [
                                    {"Range": {"Start": start, "End": start + len(place) - 1},
                                     "Values": [[*row, 0.5] for row in place.tolist()]} for start, place in parts]}
                                    for name, parts in markers.items()]}))
    return path


@pytest.mark.parametrize("air", [0.0, 0.03])
def test_of_a_recording_the_free_flight_is_cut_out(tmp_path: Path, air: float) -> None:
    places = [throw(5.0, air), throw(25.0, air)]
    path = recording(tmp_path, {"b-0": [(1, places[0])], "b1": [(2000, places[1][:90]), (2200, places[1])],
                                "hoop": [(1, np.tile([0.0, 0.0, 750.0], (900, 1)))]})
    dataset = import_ball_butler(path)
    assert dataset.shots.shot_id == ("session9-b-0", "session9-b1")
    assert dataset.shots.text("session") == ("session9", "session9")
    assert dataset.left_out == ("session9-hoop: fewer than 8 samples",)
    assert dataset.tracks is not None
    for row, place in enumerate(places):
        here = dataset.tracks.shot == row
        z_m = dataset.tracks.z_m[here]
        first = int(np.flatnonzero(np.isclose(place[:, 2] / 1000.0, z_m[0], atol=1e-9))[-1])
        np.testing.assert_allclose(z_m, place[first:first + len(z_m), 2] / 1000.0, atol=1e-12)
        np.testing.assert_allclose(dataset.tracks.t_s[here], np.arange(len(z_m)) / RATE_HZ, atol=1e-9)
        left, met = 180, len(place) - 300                 # frames in which the hand lets go and the floor is met
        assert left < first <= left + 30 and met - 30 <= first + len(z_m) <= met


@pytest.mark.parametrize(("change", "told"), [
    ({"Markers": 3}, r"session9\.json: .*\$\.Markers"),
    ({"Timebase": {"Frequency": 0.0}}, r"session9\.json: Timebase: Frequency: 0; expected 20 to 100000 Hz"),
    ({"Timebase": {}}, r"missing required field `Frequency`"),
    ({"Markers": [{"Name": "b0", "Parts": [{"Range": {"Start": 10**30}, "Values": []}]}]},
     r"'b0' has a frame or place"),
    ({"Markers": [{"Name": "b0", "Parts": [{"Range": {"Start": 1}, "Values": [[1e300, 0.0, 0.0, 0.0]]}]}]},
     r"'b0' has a frame or place"),
    ({"Markers": [{"Name": "b0", "Parts": []}] * 2}, r"session9\.json: Markers: two have the name 'b0'"),
    ({"Markers": []}, r"session9\.json: has no flight of 8 samples")])
def test_a_recording_that_is_none_is_refused(tmp_path: Path, change: dict[str, object], told: str) -> None:
    path = recording(tmp_path, {"b0": [(1, throw(5.0))]})
    path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
    with pytest.raises(InputError, match=told):
        import_ball_butler(path)
