"""A rolling shutter on a camera that turns: rows are exposed one after another, from where the camera then points."""

import math

import cv2
import numpy as np

from truearc.hw.emulated.camera import Array, Lens, distort, project

ROUNDS = 4                            # the row where a point is seen and the moment at which that row is exposed
CAMERA_RIGHT = np.array([1.0, 0.0, 0.0])


def project_turning(points_m: Array, camera_from_points: Array, lens: Lens, focal_scale: float,
                    turn_deg_s: tuple[float, float], readout_s: float) -> tuple[Array, Array]:
    """As lens.project, of a camera that turns right about the points' own upright axis and up about its own level one;
    `camera_from_points` is of the image's middle row."""
    pixels, ahead_m = project(points_m, camera_from_points, lens, focal_scale)
    if readout_s == 0.0 or not any(turn_deg_s) or (ahead_m <= 0.0).any():     # behind it nothing has a row
        return pixels, ahead_m
    right, up = (math.radians(rate) for rate in turn_deg_s)
    rate = right * camera_from_points[:3, 1] - up * CAMERA_RIGHT      # of the points, as the camera has them
    for _ in range(ROUNDS):
        late_s = readout_s * (distort(pixels, lens)[:, 1] / lens.height_px - 0.5)
        for k, t_s in enumerate(late_s):
            turned = np.eye(4)
            turned[:3, :3], _ = cv2.Rodrigues(rate * t_s)
            seen, ahead = project(points_m[k:k + 1], turned @ camera_from_points, lens, focal_scale)
            pixels[k], ahead_m[k] = seen[0], ahead[0]
    return pixels, ahead_m
