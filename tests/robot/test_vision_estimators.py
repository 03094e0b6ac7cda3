"""The three estimators by themselves: their errors are as large as they say, and their fusion is what `detect` says."""

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from msgspec.structs import replace

import robot
from hw.emulated.camera import EmulatedCamera
from hw.emulated.lens import Lens
from hw.emulated.stage import Stage, place
from hw.reading import CameraFrame
from robot.config import CameraFile, load_config, load_toml
from robot.vision import detect
from robot.vision.estimators import NAMES, compare

CONFIG = load_config(Path(robot.__file__).parent / "launcher.toml")
CAMERA, TAPE, VISION = replace(CONFIG.camera, readout_s=0.0), CONFIG.tape, CONFIG.vision    # as it is rendered


def picture(distance_m: float, facing_deg: float, bearing_deg: float, pitch_deg: float, seed: int) -> CameraFrame:
    """The target before a camera with this pitch, which may not be what the configuration believes."""
    lens = Lens(CAMERA.width_px, CAMERA.height_px, CAMERA.fx_px, CAMERA.fy_px, CAMERA.cx_px, CAMERA.cy_px)
    view = place(distance_m, TAPE.centre_height_m - CAMERA.height_m, pitch_deg, facing_deg=facing_deg,
                 bearing_deg=bearing_deg)
    return EmulatedCamera(Stage(view), lens, TAPE, 20.0, 0.0, seed).expose(0)


@pytest.fixture(scope="module")
def trials():
    rng, rows = np.random.default_rng(4), []
    for seed in range(150):
        distance_m, pitch_deg = rng.uniform(2.6, 8.5), CAMERA.pitch_deg + CAMERA.pitch_sigma_deg * rng.normal()
        frame = picture(distance_m, rng.uniform(-30, 30), rng.uniform(-7, 7), pitch_deg, seed)
        three, seen = compare(frame, CAMERA, TAPE, VISION), detect(frame, CAMERA, TAPE, VISION)
        if seen.found:
            rows.append((distance_m, seen, three))
    assert len(rows) > 130
    return rows


@pytest.mark.parametrize("k", range(3), ids=NAMES)
def test_each_errs_as_much_as_it_says(trials, k):
    ratios = [(three.distance_m[k] - true_m) / math.sqrt(three.covariance_m2[k, k]) for true_m, _, three in trials]
    assert 0.7 < np.sqrt(np.mean(np.square(ratios))) < 1.35


def test_fused_is_better_than_each_and_nearly_what_detect_says(trials):
    errors = np.array([[*three.distance_m, three.fused_m, seen.distance_m] for _, seen, three in trials])
    rms = np.sqrt(np.mean((errors - np.array([[true_m] for true_m, _, _ in trials])) ** 2, axis=0))
    assert rms[3] < rms[:3].min() and rms[4] < 1.02 * rms[3]
    apart = [abs(three.fused_m - seen.distance_m) / seen.sigma_m for _, seen, three in trials]
    assert np.median(apart) < 0.5


@pytest.mark.parametrize(("pitch_sigma_deg", "height_sigma_m"), [(10.0, 0.3), (5.0, 0.1), (0.5, 0.01)])
def test_fused_is_never_surer_than_what_detect_says(pitch_sigma_deg, height_sigma_m):
    """It is made of the same marks and mounting; the mounting is off by as much as it may be."""
    rng = np.random.default_rng(6)
    for seed in range(12):
        pitch_deg = CAMERA.pitch_deg + pitch_sigma_deg * rng.uniform(-1.5, 1.5)
        camera = replace(CAMERA, pitch_deg=pitch_deg, pitch_sigma_deg=pitch_sigma_deg, height_sigma_m=height_sigma_m)
        frame = picture(rng.uniform(3.0, 6.5), rng.uniform(-30, 30), rng.uniform(-7, 7), CAMERA.pitch_deg, seed)
        three, seen = compare(frame, camera, TAPE, VISION), detect(frame, camera, TAPE, VISION)
        assert seen.found, seen.reason
        assert 0.99 * seen.sigma_m < three.fused_sigma_m < 1.2 * seen.sigma_m
        assert abs(three.fused_m - seen.distance_m) < 0.5 * seen.sigma_m


def test_fused_in_photographs_is_what_detect_says(data_dir):
    file = load_toml(Path(robot.__file__).parent / "cameras" / "lifecam_hd3000_480p.toml", CameraFile)
    for path in sorted((data_dir / "goal_images").glob("*.jpg")):
        frame = CameraFrame(0, cv2.imread(str(path)))
        three = compare(frame, file.camera, file.tape, file.vision)
        seen = detect(frame, file.camera, file.tape, file.vision)
        assert three.fused_m == pytest.approx(seen.distance_m, abs=0.1 * seen.sigma_m), path.name
        assert three.fused_sigma_m == pytest.approx(seen.sigma_m, rel=0.02)


def test_what_is_known_better_counts_for_more():
    frame = picture(4.0, 10.0, 3.0, CAMERA.pitch_deg, 2)
    loose, tight = (compare(frame, replace(CAMERA, pitch_sigma_deg=sigma_deg, height_sigma_m=0.002), TAPE, VISION)
                    for sigma_deg in (5.0, 0.02))
    assert loose.covariance_m2[2, 2] > 100 * tight.covariance_m2[2, 2]
    assert tight.fused_sigma_m < math.sqrt(tight.covariance_m2[0, 0]) / 3
    assert tight.fused_m == pytest.approx(4.0, abs=0.02) and loose.distance_m[0] == tight.distance_m[0]


def test_aside_the_plane_is_nearer_than_the_target():
    three = compare(picture(5.0, 30.0, 0.0, CAMERA.pitch_deg, 5), CAMERA, TAPE, VISION)
    assert three.plane_m == pytest.approx(5.0 * math.cos(math.radians(30.0)), abs=0.05)
    assert three.plane_m - 5.0 < -three.plane_sigma_m


def test_the_plane_errs_as_much_as_it_says():
    """Which way the target faces is badly seen, so its plane is, too: its sigma says so."""
    ratios = []
    for seed in range(60):
        facing_deg, distance_m = np.random.default_rng(seed).uniform((-35.0, 2.6), (35.0, 8.0))
        three = compare(picture(distance_m, facing_deg, 0.0, CAMERA.pitch_deg, seed), CAMERA, TAPE, VISION)
        if three is not None:
            true_m = distance_m * math.cos(math.radians(facing_deg))
            ratios.append((three.plane_m - true_m) / three.plane_sigma_m)
    assert len(ratios) > 50 and 0.6 < np.sqrt(np.mean(np.square(ratios))) < 1.3


def test_no_target_no_estimate():
    frame = picture(-4.0, 0.0, 0.0, 20.0, 3)
    assert compare(frame, CAMERA, TAPE, VISION) is None
