"""Pictures of AprilTags from a pinhole camera, rendered by warping and averaging: nothing here is truearc's vision."""

import math
from typing import NamedTuple

import cv2
import numpy as np

from truearc.hw.protocols import CameraFrame
from truearc.robot.config.schema import CameraConfig

CELLS, CELL_PX, FINER = 8, 40, 4      # of a tag's black square; of its picture; each pixel is averaged over FINER^2
DICTIONARY = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)


class View(NamedTuple):
    """Where the lens stands before the tag's centre: metres and degrees; the picture's noise and blur."""

    distance_m: float
    rise_m: float                     # of the tag above the lens
    facing_deg: float                 # of the tag about the vertical
    bearing_deg: float                # of the camera's axis, to the left of the tag
    pitch_deg: float
    roll_deg: float
    noise: float = 3.0
    blur_px: float = 0.6
    light: float = 1.0


def render(view: View, camera: CameraConfig, number: int, side_m: float, rng: np.random.Generator) -> CameraFrame:
    """A tag on a white plate in front of a grey wall with clutter, as that camera sees it."""
    sheet = np.full((CELL_PX * (CELLS + 2),) * 2, 235, np.uint8)
    tag = cv2.aruco.generateImageMarker(DICTIONARY, number, CELL_PX * CELLS)
    sheet[CELL_PX:-CELL_PX, CELL_PX:-CELL_PX] = np.where(tag > 0, 235, 20)
    wide, high = camera.width_px * FINER, camera.height_px * FINER
    background = cv2.resize(rng.integers(60, 150, (12, 16), dtype=np.uint8), (wide, high),
                            interpolation=cv2.INTER_NEAREST)
    half = side_m * (CELLS + 2) / CELLS / 2
    corners = np.array([[-half, half, 0.0], [half, half, 0.0], [half, -half, 0.0], [-half, -half, 0.0]])
    seen = (project(corners, view, camera) + 0.5) * FINER - 0.5
    size = sheet.shape[0] - 0.0
    flat = np.array([[0, 0], [size, 0], [size, size], [0, size]], np.float32) - 0.5
    turn = cv2.getPerspectiveTransform(flat, seen.astype(np.float32))
    cv2.warpPerspective(sheet, turn, (wide, high), background, cv2.INTER_LINEAR, cv2.BORDER_TRANSPARENT)
    picture = cv2.resize(background, (camera.width_px, camera.height_px), interpolation=cv2.INTER_AREA)
    picture = cv2.GaussianBlur(picture, (0, 0), view.blur_px).astype(float) * view.light
    picture += rng.normal(0.0, view.noise, picture.shape)
    grey = np.clip(np.rint(picture), 0, 255).astype(np.uint8)
    return CameraFrame(0, np.repeat(grey[:, :, None], 3, axis=2))


def project(points_m: np.ndarray, view: View, camera: CameraConfig) -> np.ndarray:
    """Pixels (n, 2) of points in the tag's frame: x right, y up, z towards the viewer."""
    facing, bearing, pitch, roll = np.radians([view.facing_deg, view.bearing_deg, view.pitch_deg, view.roll_deg])
    about_y = np.array([[math.cos(facing), 0, math.sin(facing)], [0, 1, 0], [-math.sin(facing), 0, math.cos(facing)]])
    world = points_m @ about_y.T      # x right, y up, z towards a viewer straight before it
    away = np.column_stack([world[:, 0], world[:, 1] + view.rise_m, view.distance_m - world[:, 2]])   # right, up, ahead
    turned = away @ np.array([[math.cos(bearing), 0, math.sin(bearing)], [0, 1, 0],
                              [-math.sin(bearing), 0, math.cos(bearing)]])
    right, up, ahead = turned.T
    along = ahead * math.cos(pitch) + up * math.sin(pitch)
    above = up * math.cos(pitch) - ahead * math.sin(pitch)
    x, y = right / along, -above / along
    c, s = math.cos(roll), math.sin(roll)
    x, y = c * x + s * y, c * y - s * x
    return np.column_stack([camera.fx_px * x + camera.cx_px, camera.fy_px * y + camera.cy_px])
