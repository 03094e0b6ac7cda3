"""The emulated robot, filmed and tracked: its sheet gives scale and exit wherever it stands; the whole chain (slow)."""

from dataclasses import replace

import numpy as np
import pytest

import truearc as ta
from truearc.cli.main import main
from truearc.hw.emulated.imaging.hall import RobotPose
from truearc.hw.emulated.imaging.phone import Path3D, Phone, SideCamera
from truearc.sim.video.frames import open_clip
from truearc.sim.video.track import View, track_clip
from truearc.sim.video.write import match_flights

pytest.importorskip("av")
EXIT_M, RADIUS_M = 0.75, 0.0889
CLOSE = Phone(width_px=800, height_px=450, place_m=(-2.6, 7.0, 1.5), view_m=6.4, tilt_deg=2.0, pitch_deg=0.0)
WAITS_S = (1.0, 4.1, 9.7, 12.9)


def thrown(shot: int, begin_s: float, stand_m: float) -> Path3D:
    since = np.arange(0.0, 0.9, 0.005)
    places = np.column_stack([stand_m + 3.2 * since, 0.0 * since, EXIT_M + 5.0 * since - 4.905 * since ** 2])
    return Path3D(shot, begin_s + since, places, RADIUS_M, -2.0, RobotPose(stand_m, 0.0, 0.0), (begin_s, begin_s + 0.9))


def test_sheet_gives_the_exit_wherever_the_robot_stands(tmp_path):
    balls = [thrown(number, begin_s, -4.6 + 0.8 * (number // 2)) for number, begin_s in enumerate(WAITS_S)]
    poses = [(0.0, balls[0].pose), (7.0, balls[2].pose)]
    truth = SideCamera(CLOSE, EXIT_M, 2.44, 5).film(tmp_path / "a.mp4", balls, poses,
                                                   [(one - 0.6, one + 1.0) for one in WAITS_S])
    found = track_clip(open_clip(tmp_path / "a.mp4"), View(2.0 * RADIUS_M, release_height_m=EXIT_M, mass_kg=0.14))
    assert len(found.flights) == len(found.placed) == 4, found.warnings
    assert found.self_test.is_sound and not found.warnings
    # the phone leans: what is ahead seems higher, so its own x axis points down
    assert np.degrees(found.calibration.tilt_rad) == pytest.approx(-2.0, abs=0.3)
    for number, placed in enumerate(found.placed):
        rows = np.array([(row.time_s, row.x_m, row.z_m) for row in truth if row.shot == number])
        inside = (placed.time_s > rows[0, 0]) & (placed.time_s < rows[-1, 0])
        for axis, place in ((1, placed.x_m), (2, placed.z_m)):
            off = place[inside] - np.interp(placed.time_s[inside], rows[:, 0], rows[:, axis])
            assert abs(off[0]) < 0.03 and np.abs(off).max() < 0.05
    shots = {"shot_id": [f"s-{k}" for k in range(6)], "t_s": 60.0 + np.array([*WAITS_S, 20.0, 23.3])}
    recorded = ta.dataset(shots, rig={"ball": {"mass_kg": 0.14, "radius_m": RADIUS_M}})
    assert match_flights([replace(found, end_s=14.0)], recorded).shot_id == (("s-0", "s-1", "s-2", "s-3"),)


@pytest.mark.slow
def test_chain_from_the_emulated_robot_to_a_finding(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["emulate", "--film", "clips/", "--trials", "24", "--out", "sessions/s", "--quiet"]) == 0
    clips = sorted(map(str, (tmp_path / "clips").iterdir()))
    assert clips and (tmp_path / "clips-truth.csv").is_file()
    main(["track", *clips, "--session", "sessions/s", "-o", "data/s", "--quiet"])
    said = capsys.readouterr().out
    assert said.count(": matched ") == len(clips)
    data = ta.load_dataset("data/s")
    assert len(set(data.tracks.shot)) >= 0.9 * len(data.shots)
    assert main(["discover", "data/s", "--report", "finding.html", "--quiet"]) in (0, 1)
    assert (tmp_path / "finding.html").is_file()
