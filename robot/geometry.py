"""The hood's acme screw and the places of camera and ball exit: plane geometry, pure."""

import math

from truearc.hw.devices.axis import HoodEncoder
from truearc.robot.config.schema import CameraConfig, Hood


def screw_length_m(elevation_deg: float, hood: Hood) -> float:
    """Distance from the screw motor's pivot to the nut at a launch elevation (law of cosines)."""
    included = math.radians(hood.included_deg + elevation_deg)
    a, b = hood.pivot_to_motor_m, hood.pivot_to_nut_m
    return math.sqrt(a * a + b * b - 2.0 * a * b * math.cos(included))


def elevation_from_screw_deg(turned_rad: float, hood: Hood) -> float | None:
    """Launch elevation when the screw motor has turned this far up from the limit switch; None beyond the linkage."""
    a, b = hood.pivot_to_motor_m, hood.pivot_to_nut_m
    travel = turned_rad * hood.screw_gear * hood.screw_lead_m / (2.0 * math.pi)
    length = screw_length_m(hood.low_deg, hood) + travel
    cosine = (a * a + b * b - length * length) / (2.0 * a * b)
    if not -1.0 <= cosine <= 1.0:
        return None
    return math.degrees(math.acos(cosine)) - hood.included_deg


def elevation_per_rad(elevation_deg: float, hood: Hood) -> float:
    """Degrees of elevation per radian of the screw motor, at a launch elevation."""
    included = math.radians(hood.included_deg + elevation_deg)
    lever = hood.pivot_to_motor_m * hood.pivot_to_nut_m * math.sin(included) / screw_length_m(elevation_deg, hood)
    return math.degrees(hood.screw_gear * hood.screw_lead_m / (2.0 * math.pi) / lever)


def screw_rad(elevation_deg: float, hood: Hood) -> float:
    """How far the screw motor has turned up from the limit switch at a launch elevation."""
    travel_m = screw_length_m(elevation_deg, hood) - screw_length_m(hood.low_deg, hood)
    return travel_m / (hood.screw_gear * hood.screw_lead_m) * 2.0 * math.pi


def screw_travel_rad(hood: Hood) -> float:
    """How far the screw motor turns from the hood's lowest elevation to its highest."""
    return screw_rad(hood.high_deg, hood)


def elevation_from_encoder_deg(angle_rad: float, encoder: HoodEncoder, zero_deg: float) -> float:
    """Launch elevation from the encoder on the hood pivot, in (-180, 180]; zero_deg: its reading where that is 0."""
    turned = (math.degrees(angle_rad) - zero_deg) * encoder.direction
    return 180.0 - (180.0 - turned) % 360.0


def exit_distance_m(lens_distance_m: float, camera: CameraConfig) -> float:
    """Horizontal distance from the ball's exit point to the target plane, given that of the lens."""
    return lens_distance_m - camera.behind_exit_m
