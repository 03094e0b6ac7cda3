"""What may be hidden in a world: names, stages, typical amplitudes. The laws are in launch, air, sensors.

Names that the solver's catalogue has too are meant to be the same hypothesis; the laws behind them are written here
from the physics alone. Amplitude 0 is exact absence.
"""

from collections.abc import Mapping
from typing import NamedTuple

from truearc.errors import InputError


class Effect(NamedTuple):
    """`typical` in `unit`; `signed`: nature may turn it either way."""

    name: str
    stage: str
    typical: float
    unit: str
    signed: bool
    meaning: str


CATALOGUED: tuple[Effect, ...] = (
    Effect("hood_offset", "sensing", 0.8, "deg", True, "true elevation minus what the hood's encoder says"),
    Effect("hood_backlash", "sensing", 0.6, "deg", False, "true elevation is this far short of the way the hood came"),
    Effect("encoder_scale", "sensing", 0.01, "1", True, "true surface speeds of all wheels / those by encoder - 1"),
    Effect("distance_scale", "sensing", 0.02, "1", True, "true distance / measured - 1"),
    Effect("distance_bias", "sensing", 0.06, "m", True, "true distance minus measured"),
    Effect("vision_latency", "sensing", 0.05, "s", False, "the distance is this old; the robot was closing in"),
    Effect("track_scale", "sensing", 0.02, "1", True, "tracked lengths / true - 1, about the frame's origin"),
    Effect("track_tilt", "sensing", 1.0, "deg", True, "the tracker sees x axis points this far higher"),
    Effect("track_clock", "sensing", 0.02, "1", True, "the tracker's seconds / true - 1"),
    Effect("wheel_slip", "launch", 0.0075, "s/m", False, "slowness of the ball minus slowness of the surface"),
    Effect("wheel_droop", "launch", 0.05, "1", False, "speed lost at the wheels' mean dip, in proportion to the dip"),
    Effect("ball_compression", "launch", 0.10, "1", False, "share of its radius that the ball is squeezed by"),
    Effect("ball_wear", "launch", 0.03, "1", False, "speed lost by the most used ball"),
    Effect("ball_spread", "launch", 0.03, "1", False, "standard deviation of speed between balls"),
    Effect("battery_sag", "launch", 0.25, "1", False, "relative speed per relative voltage"),
    Effect("rapid_fire", "launch", 0.04, "1", False, "speed lost at no pause, gone with a time constant of 1 s"),
    Effect("release_height", "launch", 0.04, "m", True, "true exit height minus rig.toml's"),
    Effect("buoyancy", "flight", 1.0, "1", False, "share of the displaced air's weight that the ball feels"),
    Effect("added_mass", "flight", 1.0, "1", False, "share of half the displaced air's mass that moves with the ball"),
    Effect("spin_decay", "flight", 0.6, "1/s", False, "rate at which spin dies away"),
    Effect("spin_drag", "flight", 0.15, "1", False, "added to the drag coefficient, times (r w / v)^2"),
    Effect("drag_reynolds", "flight", -0.3, "1", False, "relative drag coefficient per (speed / 10 m/s - 1)"),
    Effect("lift_saturation", "flight", 1.0, "1", False, "e in lift coefficient k S / (1 + e S)"),
    Effect("wind_x", "flight", 0.8, "m/s", True, "air moving toward the target"),
    Effect("wind_y", "flight", 0.8, "m/s", True, "air moving to the left"),
    Effect("wind_z", "flight", 0.8, "m/s", True, "air rising"),
    Effect("air_density", "flight", 1.0, "1", False, "share of the ideal gas's density changes that is real"),
    Effect("drag_wear", "flight", 0.15, "1", True, "relative drag added on the most used ball"),
    Effect("target_height", "arrival", 0.05, "m", True, "true target centre minus rig.toml's"),
    Effect("rim_catch", "arrival", 0.03, "m", False, "both half heights are this much more forgiving"),
)
UNCATALOGUED: tuple[Effect, ...] = (
    Effect("late_gust", "flight", 2.5, "m/s", True, "air along x in the last third of the flight only"),
    Effect("far_kick", "launch", 0.05, "1", True, "relative speed per 2.5 m of distance beyond 4.5 m"),
    Effect("supplier_drag", "flight", 0.15, "1", True, "relative drag of balls of supplier south"),
    Effect("seam_force", "flight", 0.5, "m/s2", True, "sideways push per 10 degrees C above 20"),
    Effect("hood_flex", "launch", 0.6, "deg", True, "elevation per 100 rad/s of the first wheel beyond 250 rad/s"),
    Effect("worn_wheel", "launch", 0.03, "1", True, "true radius of the first wheel / stated - 1"),
    Effect("cold_rubber", "launch", 0.03, "1", True, "relative speed per 10 degrees C above 20"),
    Effect("drag_crisis", "flight", -0.35, "1", False, "relative step of the drag coefficient at 9 m/s, 1 m/s wide"),
)
EFFECTS = CATALOGUED + UNCATALOGUED
COVARIATE_EFFECTS = ("vision_latency", "wheel_droop", "battery_sag", "rapid_fire", "air_density", "ball_spread",
                     "supplier_drag", "seam_force", "cold_rubber")
# a believed coefficient takes these up whole: all wheels too fast is a better efficiency and more lift, and the spin of
# a squeezed ball is more lift; without a measured spin no data show them
ABSORBED = ("encoder_scale", "ball_compression")
TRACK_EFFECTS = ("track_scale", "track_tilt", "track_clock", "wind_y", "seam_force")


def find_effect(name: str) -> Effect:
    """The effect of that name; InputError when there is none."""
    for effect in EFFECTS:
        if effect.name == name:
            return effect
    raise InputError(f"there is no effect {name!r}; there are {', '.join(effect.name for effect in EFFECTS)}")


def check_effects(effects: Mapping[str, float]) -> dict[str, float]:
    """Effects as floats, by name; InputError for an unknown one."""
    return {find_effect(name).name: float(amount) for name, amount in sorted(effects.items())}
