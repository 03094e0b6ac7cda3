"""Drawn clips: every flight is found where it was, nothing else is, and doubtful clips get their sentence."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import truearc as ta
from tests.sim.video.film import Scene, Throw, film
from truearc.sim.video.calibrate import Mark, depths, noise_factors
from truearc.sim.video.detect import Blob
from truearc.sim.video.frames import Clip, open_clip
from truearc.sim.video.link import settle, sigma_px
from truearc.sim.video.overlay import draw_flight
from truearc.sim.video.track import TrackedClip, View, Watched, measure, track_clip
from truearc.sim.video.write import match_flights, name_flights, save_tracks

BALL_M = 0.178
M_PER_PX = BALL_M / 24.0
FALL_PX_S2 = 9.81 / M_PER_PX
EXIT = (60.0, 250.0)
KNOWN = View(BALL_M)


def throws(count: int, seed: int, *, first_s: float = 0.7, every_s: float = 1.1) -> list[Throw]:
    """Balls that leave the same exit at 3.6 to 4.6 m/s."""
    rng = np.random.default_rng(seed)
    found = []
    for number in range(count):
        speed, angle = rng.uniform(3.6, 4.6) / M_PER_PX, np.radians(rng.uniform(45.0, 60.0))
        begin_s = first_s + every_s * number + rng.uniform(0.0, 0.1)
        found.append(Throw(begin_s, begin_s + 0.72, *EXIT, speed * np.cos(angle), -speed * np.sin(angle), FALL_PX_S2))
    return found


def tracked(path: Path, balls: list[Throw], scene: Scene, view: View = KNOWN, **how) -> TrackedClip:
    film(path, balls, max([1.5, *(ball.end_s + 0.4 for ball in balls)]), scene, **how)
    return track_clip(open_clip(path), view)


def errors(found: TrackedClip, balls: list[Throw], scene: Scene) -> np.ndarray:
    """Centre found less the true one [n, 2], in pixels; by the time at which its row was exposed."""
    off = []
    for flight in found.flights:
        ball = min(balls, key=lambda one: abs(one.begin_s - flight.blobs[0].time_s))
        for blob in flight.blobs:
            time_s = blob.time_s
            for _ in range(4):
                time_s = blob.time_s + scene.readout_s * (ball.place(time_s)[1] / scene.height - 0.5)
            off.append(np.array([blob.x_px, blob.y_px]) - ball.place(time_s))
    return np.array(off)


@pytest.mark.parametrize("scene", [
    pytest.param(Scene(), id="still"), pytest.param(Scene(exposure_s=0.014, seed=2), id="blurred"),
    pytest.param(Scene(readout_s=0.02, seed=3), id="rolling"),
    pytest.param(Scene(rate_hz=30.0, exposure_s=0.016, readout_s=0.02, noise=5.0, seed=4), id="slow-and-noisy")])
def test_every_flight_is_found_where_it_was(tmp_path, scene):
    balls = throws(3, scene.seed)
    found = tracked(tmp_path / "a.mp4", balls, scene)
    assert len(found.flights) == len(balls)
    assert not found.warnings and not found.left_out
    off = errors(found, balls, scene)
    assert np.sqrt((off ** 2).mean(axis=0)).max() < 0.3
    assert found.self_test.gravity_m_s2 == pytest.approx(9.81, rel=0.025)
    # the stated sigma, of the noise: a constant error is the calibration's
    factor = np.array(noise_factors(found.flights))
    sigma = np.array([sigma_px(blob) for flight in found.flights for blob in flight.blobs])[:, None] * factor
    held = (np.abs(off - off.mean(axis=0)) < sigma).mean()
    assert 0.5 < held < 0.85
    assert abs(found.self_test.readout_s - scene.readout_s) < 0.012


def test_two_balls_in_the_air_do_not_merge(tmp_path):
    first = throws(1, 5)[0]
    balls = [first, replace(first, begin_s=first.begin_s + 0.1, end_s=first.end_s + 0.1),
             replace(first, begin_s=first.begin_s + 0.2, end_s=first.end_s + 0.2, vx_px_s=0.9 * first.vx_px_s)]
    found = tracked(tmp_path / "a.mp4", balls, Scene())
    assert len(found.flights) == 3
    assert np.abs(errors(found, balls, Scene())).max() < 1.5


def carried(picture: np.ndarray, time_s: float) -> None:
    """A ball that a hand moves about, one that rolls along the floor, and a person's arm."""
    rows, columns = np.mgrid[0:picture.shape[0], 0:picture.shape[1]]
    hand = 320.0 + 90.0 * np.sin(2.3 * time_s), 150.0 + 60.0 * np.sin(1.7 * time_s + 1.0)
    for x, y in (hand, (80.0 * time_s, 330.0)):
        picture[(columns - x) ** 2 + (rows - y) ** 2 < 12.0 ** 2] = (200.0, 60.0, 60.0)
    picture[(abs(columns - hand[0]) < 9) & (rows > hand[1] + 8)] = (180.0, 150.0, 130.0)


def test_carried_and_rolling_balls_are_no_flights(tmp_path):
    film(tmp_path / "a.mp4", (), 6.0, Scene(), extra=carried)
    found = track_clip(open_clip(tmp_path / "a.mp4"), View(BALL_M))
    assert not found.flights
    assert "no flight" in found.warnings[0]


def test_wrong_diameter_is_given_away_by_gravity(tmp_path):
    found = tracked(tmp_path / "a.mp4", throws(3, 6), Scene(), View(0.24))
    assert found.self_test.gravity_m_s2 == pytest.approx(9.81 * 24.0 / 17.8, rel=0.03)
    assert "check the ball's diameter" in str(found.self_test)
    assert found.self_test.diameter_m == pytest.approx(BALL_M, rel=0.03)


def test_slow_motion_is_named(tmp_path):
    balls = throws(2, 7)
    rate = Scene(rate_hz=120.0)
    times = np.arange(0.0, 3.2, 1.0 / 120.0)
    slow = [replace(ball, vx_px_s=ball.vx_px_s / 2, vy_px_s=ball.vy_px_s / 2, begin_s=2 * ball.begin_s,
                    end_s=2 * ball.end_s, g_px_s2=ball.g_px_s2 / 4) for ball in balls]
    film(tmp_path / "a.mp4", slow, 0.0, rate, times_s=2.0 * times)
    assert "--slow-motion 2" in str(track_clip(open_clip(tmp_path / "a.mp4"), View(BALL_M)).self_test)
    assert track_clip(open_clip(tmp_path / "a.mp4", slow_motion=2.0), View(BALL_M)).self_test.is_sound


def test_unknown_diameter_is_asked_of_gravity(tmp_path):
    found = tracked(tmp_path / "a.mp4", throws(2, 8), Scene(), View())
    assert "no scale: gravity asks for a ball of 17." in str(found.self_test)
    assert not found.placed


def test_marks_give_scale_level_and_origin(tmp_path):
    marks = (Mark(*EXIT, 0.0, 0.75), Mark(EXIT[0] + 400.0, EXIT[1], 400.0 * M_PER_PX, 0.75))
    found = tracked(tmp_path / "a.mp4", throws(2, 9), Scene(), View(None, marks))
    assert found.calibration.metres_per_px == pytest.approx(M_PER_PX, rel=1e-6)
    assert found.self_test.is_sound
    first = found.placed[0]
    assert np.interp(0.0, first.x_m, first.z_m) == pytest.approx(0.75, abs=0.03)


def test_moving_camera_is_named(tmp_path):
    found = tracked(tmp_path / "a.mp4", [], Scene(shake_px=12.0))
    assert any("camera moves" in line for line in found.warnings)


def test_few_pictures_a_second_are_named(tmp_path):
    found = tracked(tmp_path / "a.mp4", throws(2, 10), Scene(rate_hz=8.0))
    assert "film with 60 or more" in found.warnings[-1]


def test_second_launcher_is_left_out_and_named(tmp_path):
    own = throws(3, 11)
    other = replace(own[0], begin_s=own[2].end_s + 0.3, end_s=own[2].end_s + 1.0, x_px=580.0, vx_px_s=-own[0].vx_px_s)
    found = tracked(tmp_path / "a.mp4", [*own, other], Scene())
    assert len(found.flights) == 3
    assert any("another launcher" in line for line in found.warnings)
    assert len(found.left_out) == 1
    chosen = track_clip(open_clip(tmp_path / "a.mp4"), View(BALL_M, exit_px=(580.0, 250.0)))
    assert len(chosen.flights) == 1 and (np.diff(chosen.placed[0].x_m) > 0.0).all()


def test_clips_become_a_dataset_of_the_recordings_shots(tmp_path):
    balls = throws(5, 12)
    found = tracked(tmp_path / "film.mp4", balls, Scene(), View(BALL_M, release_height_m=0.75, exit_px=EXIT))
    rig = {"ball": {"mass_kg": 0.14, "radius_m": BALL_M / 2}, "launcher": {"release_height_m": 0.75}}
    shot_s = 40.0 + np.array([-7.0, -3.1, *(ball.begin_s for ball in balls), 9.0, 11.7])
    names = [f"s-{number}" for number in range(len(shot_s))]
    recorded = ta.dataset({"shot_id": names, "t_s": shot_s}, rig=rig)
    named = match_flights([found], recorded)
    assert named.complete, named.lines
    assert named.shot_id == (tuple(names[2:7]),)
    assert save_tracks(tmp_path / "data", [found], named, recorded.rig, recorded) == 5
    read = ta.load_dataset(tmp_path / "data")
    assert len(read.shots) == len(shot_s)
    assert (read.tracks.y_m == 0.0).all()
    assert read.rig.tracker.scale_sd == pytest.approx(0.022, abs=0.01)
    # the picture that a finding shows has the flights where they were
    to_pixel, mine = np.array(read.film.to_pixel[names[2]]), read.tracks.shot == 2
    at = np.column_stack([read.tracks.x_m[mine], read.tracks.z_m[mine], np.ones(mine.sum())]) @ to_pixel
    assert np.abs(at - [(blob.x_px, blob.y_px) for blob in found.flights[0].blobs]).max() < 1.0
    assert "sigma_z_m" in (tmp_path / "data" / "tracks.csv").read_text().splitlines()[0]
    assert save_tracks(tmp_path / "alone", [found], name_flights([found]), None) == 5
    assert draw_flight(found, 0).shape == (360, 640, 3)


def watched(name: str, seed: int, diameter_px: float, hall: np.ndarray) -> Watched:
    """A clip with three flights, the ball of which seems as large as that, before a wall."""
    flights = []
    for ball in throws(3, seed):
        times = np.arange(ball.begin_s, ball.end_s, 1.0 / 60.0)
        flights.append(settle(tuple(Blob(t, *ball.place(t), diameter_px, 4.0, 0.0, 90.0, 0.0, round(60 * t))
                                    for t in times)))
    return Watched(Clip(Path(name), 60.0, 5.0), end_s=5.0, pictures=300, blobs=300, background=hall, flights=flights)


def test_clips_of_a_still_camera_share_one_scale():
    rng = np.random.default_rng(5)
    hall = cv2.GaussianBlur(rng.integers(0, 255, (360, 640)).astype(np.uint8), (0, 0), 2.0)
    robot = hall.copy()
    robot[240:330, 40:150] = 30       # it has driven there since
    moved = cv2.warpAffine(hall, cv2.getRotationMatrix2D((320, 180), 0.0, 1.02), (640, 360))
    one, other, third = measure([watched("a.mp4", 1, 24.0, hall), watched("b.mp4", 2, 24.5, robot),
                                 watched("c.mp4", 3, 24.5, moved)], KNOWN)
    assert one.calibration == other.calibration
    assert BALL_M / 24.5 < one.calibration.metres_per_px < BALL_M / 24.0
    assert third.calibration.metres_per_px == pytest.approx(BALL_M / 24.5)
    assert not one.warnings and not other.warnings and "stood elsewhere" in third.warnings[0]


def test_ball_that_seems_smaller_flies_farther_away():
    near, far = (watched(name, 1, size, np.zeros((360, 640), np.uint8)).flights
                 for name, size in (("a.mp4", 24.0), ("b.mp4", 23.28)))
    ratio = depths([*near, *far])
    assert (ratio[3:] / ratio[:3]).mean() == pytest.approx(24.0 / 23.28, rel=0.004)
    # what is within the errors of diameters is none
    rng = np.random.default_rng(3)
    alike = [settle(tuple(blob._replace(diameter_px=24.0 + rng.normal(0.0, 0.3)) for blob in flight.blobs))
             for flight in [*near, *near, *near]]
    assert np.abs(np.log(depths(alike))).max() < 0.003


def test_name_of_a_clip_is_its_files(tmp_path):
    assert Clip(tmp_path / "a.b.mov", 30.0, 1.0).name == "a.b"
