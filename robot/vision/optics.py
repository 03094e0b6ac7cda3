"""The calibrated lens, for images of any size, and what its calibration leaves open.

A calibration holds for one image size. An image of another size is taken to be another mode of the same sensor that
shows its full height: focal length and principal point scale with the image's height, and a wider image only sees more
at both sides. (Webcam sensors are 16:9 and crop the sides for 4:3. For the LifeCam HD-3000 the stated 68.5 degrees of
diagonal field agree: 719 px at 480 lines when scaled so from 720, against 539 px if the height were cropped instead.)

A rolling shutter reads one row after another, so a camera that turns meanwhile shears its picture, and one that nods
stretches it. One image hardly tells that from a target seen more from the side: how fast it may turn is stated, and a
picture that is smeared to one side says that it does turn.

Two things are known of any camera without calibrating it: its pixels are square and its axis is near the image's
middle. A calibration that states standard deviations is weighed against that knowledge; any other is taken as it is.
"""

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from truearc.robot.config.schema import CameraConfig

Array = npt.NDArray[np.float64]

SQUARE_SIGMA = 0.002                  # of fy / fx about 1: lithography does better, lenses may not
BEND_SHARE = 0.08                     # of the image's height: reach of an unmodelled bending; two waves a frame have it
MIDDLE_SIGMA = 0.02                   # of the axis about the image's middle, as a share of its height
SHORT_S = 0.005                       # an exposure of which nothing is said
NODDING = 0.2                         # of a camera's turning is up or down: robots turn about the vertical


@dataclass(frozen=True)
class Optics:
    """Pinhole `matrix` (3, 3) in px and Brown `distortion` (5,), for images of one size."""

    width_px: int
    height_px: int
    scale: float                      # pixels of this image per pixel of the calibration's
    matrix: Array
    distortion: Array | None          # None = a perfect pinhole
    doubts: tuple[float, float, float]    # one sigma: focal length (share), fy / fx (share), either centre (px)
    turns: tuple[float, float]        # one sigma: px right and px down that a rolling shutter adds from row to row
    exposures: float                  # this many exposures pass from row to row

    def undistort(self, points_px: Any) -> Array:
        """(n, 2) pixels as seen -> (n, 2) pixels of a perfect pinhole with the same matrix."""
        points = np.asarray(points_px, dtype=np.float64).reshape(-1, 2)
        if self.distortion is None or not len(points):
            return points
        ideal = cv2.undistortPoints(points.reshape(-1, 1, 2), self.matrix, self.distortion, P=self.matrix)
        return np.asarray(ideal, dtype=np.float64).reshape(-1, 2)

    def distort(self, points_px: Array) -> Array:
        """The inverse of undistort."""
        if self.distortion is None:
            return points_px
        rays = np.column_stack([points_px, np.ones(len(points_px))]) @ np.linalg.inv(self.matrix).T
        seen, _ = cv2.projectPoints(rays.reshape(-1, 1, 3), np.zeros(3), np.zeros(3), self.matrix, self.distortion)
        return np.asarray(seen, dtype=np.float64).reshape(-1, 2)

    def smooth_spread(self, points_px: Array, sigma_px: float) -> Array:
        """(2 n, 2 n): covariance of (n, 2) pixels that a smooth bending of the image displaces by `sigma_px`: what is
        left of the lens's distortion, a rolling shutter that shakes. Neighbours are displaced together."""
        away = points_px[:, None, :] - points_px
        near = np.exp(-(away * away).sum(axis=2) / (2.0 * (BEND_SHARE * self.height_px) ** 2))
        spread = np.zeros((2 * len(points_px), 2 * len(points_px)))
        spread[::2, ::2] = spread[1::2, 1::2] = sigma_px**2 * near
        return spread

    def smeared(self, smear_px2: float) -> "Optics":
        """The same where a motion of the camera is seen: it went on from row to row."""
        if smear_px2 == 0.0:
            return self
        right, down = self.turns
        seen = self.exposures * math.sqrt(abs(smear_px2))
        sideways = (math.hypot(right, seen), down)
        return replace(self, turns=sideways if smear_px2 > 0.0 else (right, math.hypot(down, seen)))

    def camera_spread(self, points_px: Array) -> Array:
        """(2 n, 2 n): covariance of (n, 2) ideal pixels from the calibration's uncertainty and a camera that turns
        while its rows are read: then the picture is sheared, or stretched from row to row."""
        off = points_px - self.matrix[:2, 2]
        focal, aspect, centre_px = self.doubts
        shifts = np.zeros((6, len(points_px), 2))
        shifts[0] = focal * off
        shifts[1] = 0.5 * aspect * off * np.array([-1.0, 1.0])
        shifts[2, :, 0] = shifts[3, :, 1] = centre_px
        rows = points_px[:, 1] - points_px[:, 1].mean()
        shifts[4, :, 0], shifts[5, :, 1] = self.turns[0] * rows, self.turns[1] * rows
        flat = shifts.reshape(6, -1)
        return np.asarray(flat.T @ flat, dtype=np.float64)


@lru_cache(maxsize=8)
def make_optics(camera: CameraConfig, width_px: int, height_px: int) -> Optics:
    """The camera's optics for an image of this size; see the module's text for sizes that are not the calibration's
    (kept: a camera does not change from image to image)."""
    scale = height_px / camera.height_px
    middle_sigma_px = MIDDLE_SIGMA * camera.height_px
    aspect, aspect_sigma = _weigh(math.log(camera.fy_px / camera.fx_px), camera.aspect_sigma, 0.0, SQUARE_SIGMA)
    cx, centre_sigma_px = _weigh(camera.cx_px, camera.centre_sigma_px, camera.width_px / 2 - 0.5, middle_sigma_px)
    cy, _ = _weigh(camera.cy_px, camera.centre_sigma_px, camera.height_px / 2 - 0.5, middle_sigma_px)
    focal_px = math.sqrt(camera.fx_px * camera.fy_px) * scale
    cx_px = (cx + 0.5 - camera.width_px / 2) * scale + width_px / 2 - 0.5
    cy_px = (cy + 0.5) * scale - 0.5
    matrix = np.array([[focal_px * math.exp(-aspect / 2), 0.0, cx_px], [0.0, focal_px * math.exp(aspect / 2), cy_px],
                       [0.0, 0.0, 1.0]])
    shear = math.radians(camera.turn_sigma_deg_s) * camera.readout_s * focal_px / height_px
    distortion = np.array(camera.distortion, dtype=np.float64) if any(camera.distortion) else None
    return Optics(width_px, height_px, scale, matrix, distortion,
                  (camera.focal_sigma, aspect_sigma, centre_sigma_px * scale), (shear, NODDING * shear),
                  camera.readout_s / height_px / (camera.exposure_s or SHORT_S))


def _weigh(stated: float, sigma: float, usual: float, usual_sigma: float) -> tuple[float, float]:
    """A stated value weighed against what is usual, and its sigma."""
    share = sigma**2 / (sigma**2 + usual_sigma**2)
    return stated + share * (usual - stated), usual_sigma * math.sqrt(share)
