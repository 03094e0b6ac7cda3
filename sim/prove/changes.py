"""One thing changed and concealed in the MuJoCo world, and which names of the catalogue would then be right.

The world's own law is not the catalogue's: a softer ball leaves slower, lower and with another spin, so that several
names may be right of one change, and for some only the stage is.
"""

from collections.abc import Mapping
from typing import NamedTuple


class Change(NamedTuple):
    """`options` of sim.world.options, how the changed world differs from one as drawn; names and stages that are right
    of it; whether only tracks can show it."""

    name: str
    options: Mapping[str, float]
    names: tuple[str, ...]
    stages: tuple[str, ...]
    tracks_only: bool = False


LAUNCH = ("exit_efficiency", "wheel_slip", "wheel_droop", "ball_compression")
CHANGES: tuple[Change, ...] = (
    Change("nothing", {}, (), ()),
    Change("tail_wind", {"wind_x_m_s": 1.5}, ("wind_x",), ("flight",)),
    Change("head_wind", {"wind_x_m_s": -1.5}, ("wind_x",), ("flight",)),
    Change("cross_wind", {"wind_y_m_s": 1.5}, ("wind_y",), ("flight",), tracks_only=True),
    Change("dense_air", {"air_density_kg_m3": 1.44}, ("air_change", "drag", "magnus"), ("flight",)),
    Change("soft_ball", {"ball_stiffness_scale": 0.6}, LAUNCH, ("launch",)),
    Change("worn_ball", {"wear_stiffness_per_shot": 0.005, "wear_friction_per_shot": 0.002},
           ("ball_wear", *LAUNCH), ("launch",)),
    Change("heavy_ball", {"ball_mass_scale": 1.2}, ("drag", "magnus", "added_mass", "buoyancy", *LAUNCH),
           ("flight", "launch")),
    Change("hood_offset", {"hood_offset_deg": 1.5}, ("hood_offset",), ("sensing",)),
    Change("camera_scale", {"camera_focal_scale": 1.05}, ("distance_scale", "distance_bias"), ("sensing",)),
    Change("encoder_scale", {"encoder_scale": 1.05}, ("encoder_scale", *LAUNCH), ("sensing", "launch")),
    Change("release_height", {"release_height_error_m": 0.1}, ("release_height", "target_height"),
           ("launch", "arrival")),
    Change("sagging_battery", {"battery_drop_v_per_shot": 0.012, "battery_resistance_ohm": 0.08},
           ("battery_sag", "wheel_droop", "rapid_fire"), ("launch",)),
    Change("light_wheels", {"flywheel_inertia_scale": 0.4}, ("wheel_droop", "rapid_fire", *LAUNCH), ("launch",)),
)


def seen_at(level: str) -> tuple[Change, ...]:
    """Those of which data of the level have a trace."""
    return tuple(change for change in CHANGES if level == "L2" or not change.tracks_only)
