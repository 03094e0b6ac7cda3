"""The pose solution's own statistics and derivatives, without pictures."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from tests.robot.good_tick import CONFIG
from truearc.robot.vision.pose import make_optics, make_shape, solve_pose

CAMERA, TAPE = CONFIG.camera, CONFIG.tape
OPTICS = make_optics(CAMERA, CAMERA.width_px, CAMERA.height_px)


def true_pose(distance_m: float, facing_deg: float, height_m: float, pitch_deg: float, roll_deg: float):
    """(rvec, tvec) from target to camera, for a camera at this place; composed axis by axis."""
    facing, pitch, roll = (math.radians(angle) for angle in (facing_deg, pitch_deg, roll_deg))
    about_y = cv2.Rodrigues(np.array([0.0, facing, 0.0]))[0]
    flip = np.diag([1.0, -1.0, -1.0])
    about_x = cv2.Rodrigues(np.array([-pitch, 0.0, 0.0]))[0]         # y down: looking up moves the view down
    about_z = cv2.Rodrigues(np.array([0.0, 0.0, roll]))[0]
    level = np.array([0.0, -(TAPE.centre_height_m - height_m), distance_m])
    turn = about_z @ about_x
    return cv2.Rodrigues(turn @ flip @ about_y)[0].ravel(), turn @ level


def test_errors_are_as_large_as_sigma_says():
    """Corners with independent noise of one sigma, a mounting drawn from the config's beliefs: unit spread to 10 %,
    over 2.5-9 m and 30 degrees off axis."""
    rng = np.random.default_rng(3)
    ratios, costs = [], []
    model_m = make_shape(TAPE).marks_m
    for _ in range(600):
        distance_m = rng.uniform(2.5, 9.0)
        rvec, tvec = true_pose(distance_m, rng.uniform(-30, 30), rng.normal(CAMERA.height_m, CAMERA.height_sigma_m),
                               rng.normal(CAMERA.pitch_deg, CAMERA.pitch_sigma_deg),
                               rng.normal(0, CAMERA.pitch_sigma_deg))
        seen, _ = cv2.projectPoints(model_m, rvec, tvec, OPTICS.matrix, None)
        pose = solve_pose(seen.reshape(-1, 2) + rng.normal(0, 0.4, (4, 2)), 0.4**2 * np.eye(8), OPTICS, CAMERA, TAPE)
        assert pose is not None and pose.doubt is None
        ratios.append((pose.distance_m - distance_m) / pose.sigma_m)
        costs.append(pose.cost)
    assert np.std(ratios) == pytest.approx(1.0, abs=0.1) and abs(np.mean(ratios)) < 0.15
    assert np.mean(costs) == pytest.approx(11 - 6, rel=0.1)         # chi-squared: residuals less parameters


def test_without_noise_the_pose_is_exact():
    for distance_m, facing_deg in ((2.4, 0.0), (5.0, 25.0), (9.0, -30.0)):
        rvec, tvec = true_pose(distance_m, facing_deg, CAMERA.height_m, CAMERA.pitch_deg, 0.0)
        seen, _ = cv2.projectPoints(make_shape(TAPE).marks_m, rvec, tvec, OPTICS.matrix, None)
        pose = solve_pose(seen.reshape(-1, 2), 0.25**2 * np.eye(8), OPTICS, CAMERA, TAPE)
        assert pose is not None and pose.distance_m == pytest.approx(distance_m, abs=1e-4)
        assert pose.reprojection_px < 1e-3 and abs(pose.bearing_rad) < 1e-5


def test_what_no_mounting_explains_is_doubted():
    rvec, tvec = true_pose(4.0, 0.0, CAMERA.height_m + 1.5, CAMERA.pitch_deg, 0.0)
    seen, _ = cv2.projectPoints(make_shape(TAPE).marks_m, rvec, tvec, OPTICS.matrix, None)
    pose = solve_pose(seen.reshape(-1, 2), 0.25**2 * np.eye(8), OPTICS, CAMERA, TAPE)
    assert pose is None or pose.doubt
    rvec, tvec = true_pose(6.0, 10.0, CAMERA.height_m, CAMERA.pitch_deg, 0.0)
    seen, _ = cv2.projectPoints(make_shape(TAPE).marks_m, rvec, tvec, OPTICS.matrix, None)
    marks = seen.reshape(-1, 2)
    moved = marks + np.array([[0, 0], [0, 0], [0, 0], [4.0, -7.0]])
    clean, covered = (solve_pose(points, 0.25**2 * np.eye(8), OPTICS, CAMERA, TAPE) for points in (marks, moved))
    assert clean is not None and clean.doubt is None and (covered is None or covered.doubt)


def test_optics_keep_the_full_height_and_invert_distortion():
    camera = replace(CAMERA, cx_px=345.6, cy_px=207.1, fx_px=700.0, fy_px=690.0)
    wide = make_optics(camera, 1280, 720)
    assert wide.scale == 1.5 and (wide.matrix[0, 0], wide.matrix[1, 1]) == pytest.approx((1050.0, 1035.0))
    assert wide.matrix[0, 2] == pytest.approx(640 + (345.6 + 0.5 - 320) * 1.5 - 0.5)
    assert wide.matrix[1, 2] == pytest.approx((207.1 + 0.5) * 1.5 - 0.5)
    optics = make_optics(replace(CAMERA, distortion=(-0.2, 0.05, 0.001, -0.002, 0.0)), 640, 480)
    points = np.random.default_rng(1).uniform((40, 40), (600, 440), (50, 2))
    assert optics.undistort(optics.distort(points)) == pytest.approx(points, abs=0.02)


@settings(max_examples=300, deadline=None)
@given(st.lists(st.tuples(st.floats(-50, 700), st.floats(-50, 550)), min_size=4, max_size=4), st.floats(0.01, 30.0))
def test_any_four_marks_give_a_pose_or_none(marks, sigma_px):
    """Crossed, on one line, at one place: an answer is finite, or there is none."""
    pose = solve_pose(np.array(marks), sigma_px**2 * np.eye(8), OPTICS, CAMERA, TAPE)
    assert pose is None or (0 < pose.sigma_m < math.inf and math.isfinite(pose.distance_m) and pose.cost >= 0)
