"""The distance three ways, each by itself, and the three fused by their covariance.

- pose: the marks alone, with nothing believed of how the camera is mounted;
- width: how far apart the marks at the left and at the right are seen, given which way the target faces (from the pose)
  and which way is up (from the mounting);
- elevation: how steeply the marks are seen above the horizon, given the mounting's pitch and height.

They share marks and mounting, so they err together; the fused one is the best linear combination under that joint
covariance. What `detect` reports is the same fusion without the linearisation: one least squares of marks and mounting
(`pose`). Here it is taken apart, for people who want to know why a distance came out as it did.
"""

import math
from typing import NamedTuple

import cv2
import numpy as np
from msgspec.structs import replace

from hw.reading import CameraFrame
from robot.config import CameraConfig, Tape, Vision
from robot.vision import look
from robot.vision.edges import Marks
from robot.vision.optics import Array, Optics, make_optics
from robot.vision.pose import Pose, horizontal, solve_pose
from robot.vision.shape import make_shape

NAMES = ("pose", "width", "elevation")
UNKNOWN = 1e4                         # sigma of a mounting of which nothing is believed, in metres and degrees
STEP = np.array([1e-3] * 8 + [1e-5, 1e-4, 1e-5])    # px, rad, m, rad: for derivatives


class Three(NamedTuple):
    """Horizontal distances from lens to tape centre, in the order of NAMES."""

    distance_m: Array                 # (3,)
    covariance_m2: Array              # (3, 3)
    fused_m: float
    fused_sigma_m: float
    plane_m: float = math.nan         # from the lens at right angles to the target's plane, as `detect` sees it
    plane_sigma_m: float = math.nan


def compare(frame: CameraFrame, camera: CameraConfig, tape: Tape, vision: Vision) -> Three | None:
    """The three in one image; None when `detect` finds no target there."""
    optics = make_optics(camera, frame.image.shape[1], frame.image.shape[0])
    found = look(frame.image, optics, camera, tape, vision)[0]
    if len(found) != 1:
        return None
    marks, pose = found[0]
    spread_px2 = marks.spread_px2 + optics.smooth_spread(marks.ideal_px, vision.corner_sigma_px)
    three = estimate_three(marks, spread_px2, optics.smeared(marks.smear_px2), camera, tape)
    if three is None:
        return None
    rotation, turning = cv2.Rodrigues(pose.rvec)
    slope = np.concatenate([turning.reshape(3, 3, 3)[:, :, 2] @ pose.tvec_m, rotation[:, 2]])
    return three._replace(plane_m=abs(float(rotation[:, 2] @ pose.tvec_m)),
                          plane_sigma_m=math.sqrt(float(slope @ pose.spread @ slope)))


def estimate_three(marks: Marks, spread_px2: Array, optics: Optics, camera: CameraConfig,
                   tape: Tape) -> Three | None:
    """The three, from marks with covariance (8, 8), the calibration's not in it; None when marks alone give no pose.

    Each by itself is what it is with the mounting as believed. For the fused one all are straight lines through the
    marks and the mounting that `detect` comes to, where they agree: ten degrees from there, lines through the believed
    mounting would promise far too much.
    """
    blind = replace(camera, height_sigma_m=UNKNOWN, pitch_sigma_deg=UNKNOWN)
    alone = solve_pose(marks.ideal_px, spread_px2, optics, blind, tape)
    seen = solve_pose(marks.ideal_px, spread_px2, optics, camera, tape)
    if alone is None or seen is None:
        return None
    fitted_px = marks.ideal_px + seen.off_px.reshape(4, 2)
    there = solve_pose(fitted_px, spread_px2, optics, blind, tape)
    if there is None:
        return None
    pitch_sigma = math.radians(camera.pitch_sigma_deg)
    spread = np.zeros((11, 11))
    spread[:8, :8] = spread_px2 + optics.camera_spread(marks.ideal_px)
    spread[range(8, 11), range(8, 11)] = pitch_sigma**2, camera.height_sigma_m**2, pitch_sigma**2
    believed, likely = np.array([math.radians(camera.pitch_deg), camera.height_m, 0.0]), _mounting(seen, tape)
    distance_m, slope = _linear(alone, marks.ideal_px, believed, optics, tape)
    likely_m, likely_slope = _linear(there, fitted_px, likely, optics, tape)
    off = np.concatenate([-seen.off_px, believed - likely])
    fused_m, fused_sigma_m = _fuse(likely_m + likely_slope @ off, likely_slope @ spread @ likely_slope.T)
    return Three(distance_m - camera.bias_m, slope @ spread @ slope.T + camera.bias_sigma_m**2,
                 fused_m - camera.bias_m, math.hypot(fused_sigma_m, camera.bias_sigma_m))


def _mounting(pose: Pose, tape: Tape) -> Array:
    """Pitch and height of the lens and roll, (3,), as a pose has them."""
    rotation, _ = cv2.Rodrigues(pose.rvec)
    height_m = tape.centre_height_m - rotation[:, 1] @ pose.tvec_m
    return np.array([math.asin(min(1.0, max(-1.0, rotation[2, 1]))), height_m,
                     math.atan2(rotation[0, 1], -rotation[1, 1])])


def _linear(alone: Pose, ideal_px: Array, mounting: Array, optics: Optics, tape: Tape) -> tuple[Array, Array]:
    """The three (3,) with these marks and this mounting, and how they follow marks, pitch, height and roll (3, 11); the
    target's facing follows the marks to first order."""
    rotation, turning = cv2.Rodrigues(alone.rvec)
    distance_m, gradient = horizontal(rotation, turning.reshape(3, 3, 3), alone.tvec_m)
    given = np.concatenate([ideal_px.ravel(), mounting])

    def level(values: Array) -> Array:
        return _level_distances(values, alone.rvec + alone.gain[:3] @ (values[:8] - given[:8]), optics, tape)

    slope = np.zeros((3, 11))
    slope[0, :8] = gradient @ alone.gain
    for k, step in enumerate(STEP):
        shift = np.zeros(11)
        shift[k] = step
        slope[1:, k] = (level(given + shift) - level(given - shift)) / (2 * step)
    return np.append(distance_m, level(given)), slope


def _fuse(distance_m: Array, covariance_m2: Array) -> tuple[float, float]:
    """Best linear unbiased: weights that sum to one and make the variance least."""
    pull = np.linalg.solve(covariance_m2 + 1e-9 * np.trace(covariance_m2) * np.eye(3), np.ones(3))
    return float(pull @ distance_m / pull.sum()), 1.0 / math.sqrt(float(pull.sum()))


def _level_distances(values: Array, rvec: Array, optics: Optics, tape: Tape) -> Array:
    """(2,): by width and by elevation, from `values`: four marks in ideal px, pitch and lens height and roll."""
    pitch, height_m, roll = values[8:]
    shape = make_shape(tape)
    rays = _level(np.column_stack([values[:8].reshape(4, 2), np.ones(4)]) @ np.linalg.inv(optics.matrix).T, pitch, roll)
    rotation, _ = cv2.Rodrigues(rvec)
    facing = _level(rotation[:, :1].T, pitch, roll)[0, [0, 2]]        # along the tape, seen from above
    flat = rays[:, [0, 2]]
    middles = []
    for right, left in ((0, 1), (3, 2)):
        apart_m = float(shape.marks_m[right, 0] - shape.marks_m[left, 0])
        reach = np.linalg.solve(np.column_stack([flat[right], -flat[left]]), apart_m * facing / np.linalg.norm(facing))
        middles.append((flat[right] * reach[0] + flat[left] * reach[1]) / 2)
    by_width = float(np.linalg.norm(np.mean(middles, axis=0)))
    rise_m = tape.centre_height_m + shape.marks_m[:, 1] - height_m
    by_elevation = float(np.linalg.norm((flat * (rise_m / rays[:, 1])[:, None]).mean(axis=0)))
    return np.array([by_width, by_elevation])


def _level(rays: Array, pitch: float, roll: float) -> Array:
    """(n, 3) camera rays (right, down, forward) -> level ones (right, up, forward)."""
    right = rays[:, 0] * math.cos(roll) + rays[:, 1] * math.sin(roll)
    up = rays[:, 0] * math.sin(roll) - rays[:, 1] * math.cos(roll)
    return np.column_stack([right, rays[:, 2] * math.sin(pitch) + up * math.cos(pitch),
                            rays[:, 2] * math.cos(pitch) - up * math.sin(pitch)])
