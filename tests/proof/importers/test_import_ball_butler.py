"""Importing flights of the ball-throwing robot: one shot a flight, x along the throws, every bad row named."""

import csv
import json
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import truearc.cli.main as truearc
from truearc.errors import InputError
from truearc.sim.check.check import check_plausible
from truearc.sim.data.files import load_dataset
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


def test_cameras_that_disagree_do_not_end_a_flight(tmp_path: Path) -> None:
    place = throw(5.0)
    place[250:] += (1.5, -1.0, 0.5)
    place[300:] += np.random.default_rng(1).normal(0.0, 0.3, (len(place) - 300, 3))
    whole, broken = (import_ball_butler(recording(tmp_path, {"b0": [(1, one)]})).tracks for one in (throw(5.0), place))
    assert whole is not None and broken is not None and abs(len(whole.t_s) - len(broken.t_s)) <= 4


@pytest.mark.parametrize(("change", "told"), [
    ({"Markers": 3}, r"session9\.json: .*\$\.Markers"),
    ({"Timebase": {"Frequency": 0.0}}, r"session9\.json: Timebase: Frequency: 0; expected 20 to 100000 Hz"),
    ({"Timebase": {"Frequency": 1e-300}}, r"Frequency: 1e-300; expected 20 to 100000 Hz"),
    ({"Timebase": {}}, r"missing required field `Frequency`"),
    ({"Markers": [{"Name": "b0", "Parts": [{"Range": {"Start": 10**30}, "Values": []}]}]},
     r"'b0' has a frame or place"),
    ({"Markers": [{"Name": "b0", "Parts": [{"Range": {"Start": 1}, "Values": [[1e300, 0.0, 0.0, 0.0]]}]}]},
     r"'b0' has a frame or place"),
    ({"Markers": [{"Name": "b0", "Parts": [{"Range": {"Start": 1}, "Values": [[None, 0.0, 0.0, 0.0]]}]}]},
     r"session9\.json: is not a recording"),
    ({"Markers": [{"Name": "b0", "Parts": [{"Range": {"Start": 1}, "Values": []}]}]}, r"has no flight of 8 samples"),
    ({"Markers": [{"Name": "b0", "Parts": [{"Range": {"Start": 1}, "Values": [[1.0, 2.0]]}]}]},
     r"session9\.json: .*Markers\[0\]\.Parts|session9\.json: .*\[\.\.\.\]"),
    ({"Markers": [{"Name": "b0", "Parts": []}] * 2}, r"session9\.json: Markers: two have the name 'b0'"),
    ({"Markers": []}, r"session9\.json: has no flight of 8 samples"),
])
def test_a_recording_that_is_none_is_refused(tmp_path: Path, change: dict[str, object], told: str) -> None:
    path = recording(tmp_path, {"b0": [(1, throw(5.0))]})
    path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
    with pytest.raises(InputError, match=told):
        import_ball_butler(path)


def test_a_recording_that_ends_early_is_refused(tmp_path: Path) -> None:
    path = recording(tmp_path, {"b0": [(1, throw(5.0))]})
    path.write_text(path.read_text()[:4000])
    with pytest.raises(InputError, match=r"session9\.json: is not a recording of Qualisys Track Manager"):
        import_ball_butler(path)


@pytest.mark.data
def test_the_recorded_session_is_read_and_is_plausible(data_dir: Path, tmp_path: Path) -> None:
    out = tmp_path / "session-3"
    session = data_dir / "real" / "ball_butler_tracks.csv"
    assert truearc.main(["import", "ball-butler", str(session), "-o", str(out)]) == 0
    dataset = load_dataset(out)
    assert len(dataset.shots) == 20 and dataset.tracks is not None and len(dataset.tracks.t_s) == 3885
    assert dataset.rig == RIG
    assert check_plausible(dataset).accepted == ()
