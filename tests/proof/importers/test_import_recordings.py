"""Importing the three-wheel launcher's HDF5 recordings: the same as from the tables, every bad launch named.

The files are made here, as the launcher's public code writes them and ball_prediction's reads them.
"""

import csv
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import truearc.cli.main as truearc
from tests.proof.importers.test_import_mpi import bouncing, good, write
from tests.sim.same_dataset import assert_same
from truearc.errors import InputError
from truearc.sim.data.files import load_dataset
from truearc_proof.importers.mpi import import_mpi
from truearc_proof.importers.mpi_recordings import BALL, WITH_ROBOT

RPM = (350.0, 350.0, 2800.0)


def record(path: Path, launches: Iterable[tuple[str, np.ndarray, np.ndarray]], names: tuple[str, str, str] = BALL,
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


@pytest.mark.parametrize(("names", "unit"), [(BALL, 1.0), (WITH_ROBOT, 1.0), (BALL, 1e-9)])
def test_a_recording_says_the_same_as_the_tables(tmp_path: Path, names: tuple[str, str, str], unit: float) -> None:
    launches, tracks = good()
    path = record(tmp_path / "mn5008_spin.hdf5", of_tables(launches, tracks), names, unit)
    assert_same(import_mpi(path), import_mpi(*write(tmp_path, launches, tracks)), 1e-9)


def test_nanoseconds_since_the_epoch_lose_nothing_that_matters(tmp_path: Path) -> None:
    parameters, samples = flight()
    path = record(tmp_path / "spin.hdf5", [("4", parameters, samples)])
    with h5py.File(path, "a") as file:
        del file["originals/4/time_stamps"]
        file["originals/4/time_stamps"] = (1_700_000_000_000_000_000 + np.rint(samples[:, 0] * 1e9)).astype(np.uint64)
    again = record(tmp_path / "again.hdf5", [("4", parameters, samples)])
    tracks, others = import_mpi(path).tracks, import_mpi(again).tracks
    assert tracks is not None and others is not None
    assert tracks.t_s == pytest.approx(others.t_s, abs=1e-6)


def test_many_recordings_are_one_dataset_with_a_session_each(tmp_path: Path) -> None:
    first = record(tmp_path / "mn5008_backspin.hdf5", [(name, *flight()) for name in ("10", "2", "0")])
    second = record(tmp_path / "no_spin_robot.hdf5", [("0", *flight((1140.0,) * 3))], WITH_ROBOT)
    out = tmp_path / "out"
    assert truearc.main(["import", "mpi", str(first), str(second), "-o", str(out)]) == 0
    shots = load_dataset(out).shots
    assert shots.shot_id == ("backspin-0", "backspin-2", "backspin-10", "no_spin_robot-0")
    assert shots.text("session") == ("backspin",) * 3 + ("no_spin_robot",)
    assert shots.number("wheel_top_left_rad_s")[[0, 3]] == pytest.approx([36.6519143, 119.3805208])


def test_samples_without_a_ball_and_empty_launches_are_left_out(tmp_path: Path) -> None:
    parameters, samples = flight()
    path = record(tmp_path / "spin.hdf5", [("0", parameters, samples), ("1", parameters, samples[:0])], WITH_ROBOT)
    with h5py.File(path, "a") as file:
        file["originals/0/ball_ids"] = np.where(np.arange(100) < 3, -1, 7)
        file["originals/0/ball_positions"][:3] = np.nan
    dataset = import_mpi(path)
    assert dataset.left_out == ("spin-1: fewer than 8 samples before the bounce",)
    assert dataset.tracks is not None
    assert dataset.tracks.x_m[0] == pytest.approx(samples[3, 1])


def spoil(name: str, values: object) -> Callable[[Any], None]:
    """What puts other values into launch 4, or nothing at all."""
    def change(file: Any) -> None:
        del file[f"originals/4/{name}"]
        if values is not None:
            file[f"originals/4/{name}"] = values
    return change


def spoil_sample(file: Any) -> None:
    file["originals/4/positions"][30, 2] = np.nan


def repeat_stamp(file: Any) -> None:
    file["originals/4/time_stamps"][30] = file["originals/4/time_stamps"][29]


def without_originals(file: Any) -> None:
    file.move("originals", "filtered")


def no_group(file: Any) -> None:
    file["originals/5"] = 3.0


@pytest.mark.parametrize(("change", "says"), [
    (spoil("time_stamps", None), ", group 4: time_stamps is missing"),
    (spoil("launch_param", None), ", group 4: launch_param is missing"),
    (spoil("launch_param", [0.5, 0.5]), ", group 4: launch_param has not 5 numbers (phi_cmd, theta_cmd, motor"),
    (spoil("launch_param", [0.5, 0.5, -1.0, -1.0, -1.0]), ", group 4: motor_bottom_rpm: -1 is not a speed in rpm"),
    (spoil("launch_param", [0.5, 0.5, 0.4, 9.0, 9.0]), ", group 4: motor_top_left_rpm: 0.4 is not a speed in rpm"),
    (spoil("launch_param", [0.5, np.nan, 9.0, 9.0, 9.0]), ", group 4:1: theta_cmd: nan is not a finite number"),
    (spoil("positions", np.zeros((99, 3))), ", group 4: positions has not 3 numbers for each of time_stamps"),
    (spoil("positions", "far"), ", group 4: positions holds no numbers"),
    (spoil_sample, ", group 4:31: z_m: nan is not a finite number"),
    (repeat_stamp, ", group 4:31: t_s: does not follow the sample before of the same launch"),
    (without_originals, ": has no group 'originals' with launches in it"),
    (no_group, ", group 5: is not a group"),
])
def test_what_is_wrong_with_a_launch_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str],
                                              change: Callable[[Any], None], says: str) -> None:
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


def test_without_the_package_it_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = record(tmp_path / "spin.hdf5", [("4", *flight())])
    monkeypatch.setitem(__import__("sys").modules, "h5py", None)
    with pytest.raises(InputError, match=r"needs h5py: pip install ./proof"):
        import_mpi(path)


@pytest.mark.data
def test_the_real_launches_are_the_same_out_of_recordings(tmp_path: Path, data_dir: Path) -> None:
    tables = [data_dir / f"real/mpi_{name}.csv" for name in ("launches", "tracks")]
    launches, tracks = ([list(row.values()) for row in csv.DictReader(path.open(newline=""))] for path in tables)
    files = [record(tmp_path / name, of_tables([row for row in launches if row[0] == kind], tracks), names)
             for kind, name, names in (("backspin", "mn5008_backspin.hdf5", BALL),
                                       ("no_spin", "mn5008_no_spin.hdf5", BALL),
                                       ("no_spin_robot", "no_spin_robot.hdf5", WITH_ROBOT))]
    assert_same(import_mpi(*files), import_mpi(*tables), 1e-9)
