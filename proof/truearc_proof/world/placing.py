"""Where a target stands before a camera."""

import math

import numpy as np

from truearc.hw.emulated.nodes import View


def place(distance_m: float, rise_m: float, pitch_deg: float, *, facing_deg: float = 0.0, bearing_deg: float = 0.0,
          roll_deg: float = 0.0, focal_scale: float = 1.0, brightness: float = 1.0) -> View:
    """The target's centre at this horizontal distance and bearing (right is positive), `rise_m` above the lens, turned
    about the vertical by `facing_deg` from squarely facing that way; the optical axis rises by `pitch_deg`."""
    facing, bearing, pitch, roll = (math.radians(angle) for angle in (facing_deg, bearing_deg, pitch_deg, roll_deg))
    # level axes: x right, y up, z backwards
    turned = np.array([[math.cos(facing), 0, math.sin(facing)], [0, 1, 0], [-math.sin(facing), 0, math.cos(facing)]])
    centre_m = np.array([distance_m * math.sin(bearing), rise_m, -distance_m * math.cos(bearing)])
    tilt = np.array([[1, 0, 0], [0, math.cos(pitch), math.sin(pitch)], [0, -math.sin(pitch), math.cos(pitch)]])
    lean = np.array([[math.cos(roll), -math.sin(roll), 0], [math.sin(roll), math.cos(roll), 0], [0, 0, 1]])
    camera_from_level = lean @ np.diag([1.0, -1.0, -1.0]) @ tilt
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = camera_from_level @ turned, camera_from_level @ centre_m
    return View(pose, focal_scale, brightness)
