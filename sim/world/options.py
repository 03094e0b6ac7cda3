"""The schema of world.toml: possible defects of the emulated robot and its surroundings, with realistic defaults.

Neither the runtime nor the fit ever reads this file.
"""

import math
from pathlib import Path
from typing import Annotated

from msgspec import Meta, Struct
from msgspec.structs import replace

from truearc.robot.config.rig_spec import Rig
from truearc.robot.config.schema import load_toml

Positive = Annotated[float, Meta(gt=0.0, le=100.0)]
Share = Annotated[float, Meta(ge=0.0, le=0.05)]
NotNegative = Annotated[float, Meta(ge=0.0, le=100.0)]
Within20 = Annotated[float, Meta(ge=-20.0, le=20.0)]


class Options(Struct, frozen=True, forbid_unknown_fields=True):
    """All options of a world; `Options()` is the rig as drawn, with ordinary scatter."""

    # air
    wind_x_m_s: Within20 = 0.0                   # along the field towards the target (a tail wind is positive)
    wind_y_m_s: Within20 = 0.0                   # to the left, seen towards the target
    wind_z_m_s: Within20 = 0.0                   # up
    wind_above_m: NotNegative = 0.0           # below this height, and between the wheels, the air stands still
    air_density_kg_m3: Annotated[float, Meta(ge=0.0, le=10.0)] = 1.2      # at 20 C
    temperature_c: Annotated[float, Meta(ge=-40.0, le=60.0)] = 20.0       # thins the air and softens the foam
    drag_coefficient: Annotated[float, Meta(ge=0.0, le=5.0)] = 0.5        # force / (1/2 rho pi r^2 v^2)
    drag_step: Annotated[float, Meta(ge=-0.9, le=5.0)] = 0.0              # share added to it above 9 m/s, 1 m/s wide
    magnus_coefficient: Annotated[float, Meta(ge=-2.0, le=2.0)] = 0.25    # force / (rho 4/3 pi r^3 omega v)
    spin_drag_coefficient: Annotated[float, Meta(ge=0.0, le=20.0)] = 0.0  # MuJoCo's angular drag; 0 = spin is kept

    # balls
    ball_mass_kg: Annotated[float, Meta(ge=0.02, le=1.0)] = 0.14
    ball_radius_m: Annotated[float, Meta(ge=0.05, le=0.2)] = 0.0889       # the launcher's wheels stand as far apart
    ball_mass_scale: Annotated[float, Meta(ge=0.5, le=3.0)] = 1.0
    ball_radius_scale: Annotated[float, Meta(ge=0.96, le=1.1)] = 1.0
    ball_stiffness_scale: Annotated[float, Meta(ge=0.3, le=3.0)] = 1.0
    ball_friction_scale: Annotated[float, Meta(ge=0.7, le=3.0)] = 1.0     # with less the wheels do not draw a ball in
    stiffness_per_c: Annotated[float, Meta(ge=-0.02, le=0.02)] = -0.01    # share per degree above 20 C
    wear_stiffness_per_shot: Share = 0.0      # share lost each time a ball is shot
    wear_radius_per_shot: Annotated[float, Meta(ge=0.0, le=0.005)] = 0.0
    wear_friction_per_shot: Share = 0.0
    scatter_scale: Annotated[float, Meta(ge=0.0, le=3.0)] = 1.0          # 0 = every ball and every shot is the same

    # launcher
    flywheel_inertia_scale: Annotated[float, Meta(ge=0.2, le=5.0)] = 1.0
    release_height_error_m: Annotated[float, Meta(ge=-0.5, le=0.5)] = 0.0
    release_arc: bool = False                 # the exit point rides on the hood's arc instead of staying put
    hood_flex_deg: Within20 = 0.0           # steeper by this per 100 rad/s beyond 250, unseen by the encoder
    encoder_scale: Annotated[float, Meta(ge=0.5, le=2.0)] = 1.0           # flywheel encoders read this times the truth
    driver_current_a: Positive = 40.0         # limit of each motor driver

    # hood
    hood_offset_deg: Within20 = 0.0         # the encoder's magnet sits askew: reading = truth + this
    hood_backlash_deg: Annotated[float, Meta(ge=0.0, le=5.0)] = 0.1       # play of the nut, seen at the hood

    # battery
    battery_start_v: Annotated[float, Meta(ge=6.0, le=20.0)] = 12.6       # open circuit
    battery_resistance_ohm: Annotated[float, Meta(ge=0.0, le=0.2)] = 0.02
    battery_drop_v_per_shot: Annotated[float, Meta(ge=0.0, le=0.5)] = 0.0

    # camera
    camera_focal_scale: Annotated[float, Meta(ge=0.5, le=2.0)] = 1.0
    camera_pitch_error_deg: Within20 = 0.0
    camera_height_m: Positive = 0.60
    camera_pitch_deg: Annotated[float, Meta(ge=-45.0, le=80.0)] = 24.0
    camera_behind_exit_m: Annotated[float, Meta(ge=-2.0, le=2.0)] = 0.20
    ring_light: NotNegative = 1.0             # brightness of the ring light on the tape

    # standing
    pose_scale: Annotated[float, Meta(ge=0.0, le=1.0)] = 1.0              # 0 = always square to the target

    def __post_init__(self) -> None:
        for name in self.__struct_fields__:
            if not math.isfinite(getattr(self, name)):
                raise ValueError(f"not a finite number - at `$.{name}`")


def with_ball(options: Options, rig: Rig) -> Options:
    """Return the same with the rig's ball, if its target faces up; an upright one has the ball of Options."""
    if rig.target is None or not rig.target.faces_up:
        return options
    return replace(options, ball_mass_kg=rig.ball.mass_kg, ball_radius_m=rig.ball.radius_m)


def load_options(path: str | Path | None) -> Options:
    """Load world.toml; None = every option at its default.

    Raises InputError that names file, line and key.
    """
    return Options() if path is None else load_toml(path, Options)
