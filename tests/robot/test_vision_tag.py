"""Distance from AprilTags on rendered pictures, with an honest sigma; and no tag where there is none."""

import cv2
import numpy as np
import pytest
from msgspec.structs import replace

from tests.robot.good_tick import CONFIG as SHIPPED_CONFIG
from tests.robot.tag_scene import View, render
from truearc.cli.common import SHIPPED
from truearc.errors import InputError
from truearc.hw.protocols import CameraFrame
from truearc.robot import reasons as because
from truearc.robot.config.schema import AprilTag, CameraConfig, load_config
from truearc.robot.vision import detect_tag, find_target

TAG = AprilTag((4, 7), 0.1651, 1.35)                  # 6.5 in, as on an FRC field
# as of the global-shutter cameras that teams use for tags
CAMERA = replace(SHIPPED_CONFIG.camera, target="apriltag", width_px=1280, height_px=800, fx_px=950.0, fy_px=950.0,
                 cx_px=639.5, cy_px=399.5, pitch_deg=12.0, turn_sigma_deg_s=0.0, readout_s=0.0)
CONFIG = replace(SHIPPED_CONFIG, camera=CAMERA, apriltag=TAG)


def looking(distance_m: float) -> CameraConfig:
    """A mounting that has the tag in view: robots look up less when they shoot from afar."""
    rise_m = TAG.centre_height_m - CAMERA.height_m
    return replace(CAMERA, pitch_deg=float(np.clip(np.degrees(np.arctan2(rise_m, distance_m)) - 6.0, 5.0, 55.0)))


def seen(rng: np.random.Generator, distance_m: float, number: int = 7, camera: CameraConfig = CAMERA,
         **how: float) -> CameraFrame:
    """Mounted as well as believed."""
    rise_m = TAG.centre_height_m - camera.height_m
    pitch_deg = camera.pitch_deg + camera.pitch_sigma_deg * float(np.clip(rng.normal(), -2, 2))
    usual = {"facing_deg": float(rng.uniform(-35, 35)), "bearing_deg": float(rng.uniform(-9, 9)),
             "roll_deg": float(rng.normal()) * 0.7}
    view = View(distance_m, rise_m + camera.height_sigma_m * float(np.clip(rng.normal(), -2, 2)), pitch_deg=pitch_deg,
                **{**usual, **how})
    return render(view, camera, number, TAG.side_m, rng)


@pytest.mark.slow
def test_distance_is_within_two_percent_and_sigma_honest_from_one_to_eight_metres() -> None:
    rng = np.random.default_rng(36)
    distances = rng.uniform(1.0, 8.0, 160)
    found = []
    for distance_m in distances.tolist():
        camera = looking(distance_m)
        found.append((distance_m, find_target(seen(rng, distance_m, camera=camera), replace(CONFIG, camera=camera))))
    there = [(distance_m, one) for distance_m, one in found if one.found]
    assert len(there) >= 0.97 * len(found)
    off = np.array([one.distance_m - distance_m for distance_m, one in there])     # type: ignore[operator]
    sigma = np.array([one.sigma_m for _, one in there], dtype=float)
    true = np.array([distance_m for distance_m, _ in there])
    assert np.sqrt(np.mean((off / true)**2)) <= 0.02
    assert np.abs(off / true).max() <= 0.05
    assert 0.6 <= np.mean(np.abs(off) <= sigma) <= 0.75
    assert np.mean(np.abs(off) <= 2.0 * sigma) >= 0.9


def test_bearing_corners_and_distance_are_those_of_the_view() -> None:
    rng = np.random.default_rng(1)
    right, left = (find_target(seen(rng, 3.0, bearing_deg=angle), CONFIG) for angle in (8.0, -8.0))
    assert right.bearing_deg == pytest.approx(-left.bearing_deg, abs=1.0)          # type: ignore[operator]
    assert abs(right.bearing_deg or 0.0) == pytest.approx(8.0, abs=1.0)
    assert len(right.corners_px) == 4
    frame = seen(np.random.default_rng(2), 3.0)
    near, far = (detect_tag(frame, CAMERA, tag, CONFIG.vision) for tag in (TAG, replace(TAG, behind_m=0.6)))
    assert far.distance_m == pytest.approx((near.distance_m or 0.0) + 0.6)


def test_other_numbers_heights_and_empty_images_are_not_the_target() -> None:
    sighting = find_target(seen(np.random.default_rng(3), 3.0, number=5), CONFIG)
    assert not sighting.found and sighting.reason == because.NO_TAG()
    lower = replace(CONFIG, apriltag=replace(TAG, centre_height_m=0.6))
    sighting = find_target(seen(np.random.default_rng(4), 2.0), lower)
    assert not sighting.found and sighting.reason is not None and sighting.reason.code == "pose_off_mounting"
    assert find_target(CameraFrame(0, np.zeros((4, 4, 3), np.uint8)), CONFIG).reason == because.IMAGE_TOO_SMALL(
        width_px=4, height_px=4)
    assert find_target(CameraFrame(0, np.zeros((480, 640, 3), np.uint8)), CONFIG).reason == because.NO_TAG()


def distractor(rng: np.random.Generator) -> CameraFrame:
    """Black squares with random cells, chequers, lines and noise: what a field has beside tags."""
    picture = np.full((480, 640, 3), rng.integers(40, 220), np.uint8)
    for _ in range(int(rng.integers(2, 7))):
        side = int(rng.integers(24, 160))
        cells = rng.integers(4, 11)
        sheet = np.zeros((cells + 2, cells + 2), np.uint8)
        sheet[1:-1, 1:-1] = rng.integers(0, 2, (cells, cells)) * 235
        sheet = np.pad(sheet, 1, constant_values=235)
        square = cv2.resize(sheet, (side, side), interpolation=cv2.INTER_NEAREST)
        x, y = int(rng.integers(0, 640 - side)), int(rng.integers(0, 480 - side))
        picture[y:y + side, x:x + side] = square[:, :, None]
    turn = cv2.getRotationMatrix2D((320, 240), float(rng.uniform(0, 360)), 1.0)
    picture = cv2.warpAffine(picture, turn, (640, 480), borderMode=cv2.BORDER_REPLICATE)
    return CameraFrame(0, np.clip(picture + rng.normal(0, 5, picture.shape), 0, 255).astype(np.uint8))


def test_no_wrong_tag_among_distractors() -> None:
    """Every number counts here; benchmarks/vision_tag.py has ten thousand of them."""
    every = replace(CONFIG, apriltag=replace(TAG, ids=tuple(range(587))))
    rng = np.random.default_rng(5)
    for _ in range(150):
        assert not find_target(distractor(rng), every).found


def test_a_configuration_without_the_tag_is_refused(tmp_path) -> None:
    text = SHIPPED.read_text(encoding="utf-8").replace("[camera]\n", '[camera]\ntarget = "apriltag"\n', 1)
    (tmp_path / "launcher.toml").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"camera\.target: an AprilTag is to be seen, and there is no \[apriltag\]"):
        load_config(tmp_path / "launcher.toml")
    tag = "\n[apriltag]\nids = [4, 7]\nside_m = 0.1651\ncentre_height_m = 1.35\n"
    (tmp_path / "launcher.toml").write_text(text + tag, encoding="utf-8")
    assert load_config(tmp_path / "launcher.toml").apriltag == TAG
