"""The calibrated lens, for images of any size.

A calibration holds for one image size. An image of another size is taken to be another mode of the same sensor that
shows its full height: focal length and principal point scale with the image's height, and a wider image only sees more
at both sides. (Webcam sensors are 16:9 and crop the sides for 4:3. For the LifeCam HD-3000 the stated 68.5 degrees of
diagonal field agree: 719 px at 480 lines when scaled so from 720, against 539 px if the height were cropped instead.)
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from robot.config import CameraConfig

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Optics:
    """Pinhole `matrix` (3, 3) in px and Brown `distortion` (5,), for images of one size."""

    width_px: int
    height_px: int
    scale: float                      # pixels of this image per pixel of the calibration's
    matrix: Array
    distortion: Array | None          # None = a perfect pinhole

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


@lru_cache(maxsize=8)
def make_optics(camera: CameraConfig, width_px: int, height_px: int) -> Optics:
    """The camera's optics for an image of this size; see the module's text for sizes that are not the calibration's
    (kept: a camera does not change from image to image)."""
    scale = height_px / camera.height_px
    cx_px = (camera.cx_px + 0.5 - camera.width_px / 2) * scale + width_px / 2 - 0.5
    cy_px = (camera.cy_px + 0.5) * scale - 0.5
    matrix = np.array([[camera.fx_px * scale, 0.0, cx_px], [0.0, camera.fy_px * scale, cy_px], [0.0, 0.0, 1.0]])
    distortion = np.array(camera.distortion, dtype=np.float64) if any(camera.distortion) else None
    return Optics(width_px, height_px, scale, matrix, distortion)
