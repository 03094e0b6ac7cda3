"""Concealed changes of the MuJoCo world, and the names of the catalogue that are right for each.

The world's own law is not the catalogue's: a softer ball leaves slower, lower and with another spin, so that several
names may be right of one change, and for some only the stage is.
"""

from collections.abc import Mapping
from itertools import combinations
from typing import NamedTuple


class Change(NamedTuple):
    """`options` of truearc.sim.world.options, how the changed world differs from one as drawn; names and stages that
    are right of it; whether only tracks can show it; options that go with it and are not larger where it is; whether
    nature may turn it either way, where another change is not already the other."""

    name: str
    options: Mapping[str, float]
    names: tuple[str, ...]
    stages: tuple[str, ...]
    tracks_only: bool = False
    beside: tuple[tuple[str, float], ...] = ()
    signed: bool = False


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


# Effects in no catalogue. They move heights at the plane by (RMS of 100 shots without scatter): release_arc .06 m;
# hood_flex .13 m (by -0.2) to .28 (by 0.4); drag_crisis .12 (by -0.1) to .26 (by -0.2); wind_aloft .11 (by 0.25) to .28
# (by -0.5). Effects that the NumPy engine has too follow the same covariates as there (whose drag steps more gently).
UNCATALOGUED: tuple[Change, ...] = (
    Change("release_arc", {}, (), ("launch",), beside=(("release_arc", 1.0),)),
    Change("hood_flex", {"hood_flex_deg": 0.2}, (), ("launch",), signed=True),
    Change("drag_crisis", {"drag_step": -0.1}, (), ("flight",)),
    Change("wind_aloft", {"wind_x_m_s": 0.25}, (), ("flight",), beside=(("wind_above_m", 2.5),), signed=True),
)
# Of which a class of names that such data never tell apart is the only right answer
# (truearc_proof.worlds.sampling_plan.ALIKE).
ALIKE_CHANGES = {"L0": ("release_height", "camera_scale"), "L1": ("release_height",), "L2": ("camera_scale",)}
WORN_CHANGE = "worn_ball"             # what a battery that falls with it is a decoy for
AND = "+"                             # between the names of two


def seen_at(level: str) -> tuple[Change, ...]:
    """Those of which data of the level have a trace."""
    return tuple(change for change in CHANGES if level == "L2" or not change.tracks_only)


def changes_of(name: str) -> tuple[Change, ...]:
    """What that is: nothing, one change or two. ValueError where there is no such change."""
    known = {change.name: change for change in (*CHANGES, *UNCATALOGUED)}
    missing = set(name.split(AND)) - set(known)
    if missing:
        raise ValueError(f"there is no change {', '.join(sorted(missing))}; there are {', '.join(known)}")
    return tuple(known[one] for one in name.split(AND) if known[one] is not CHANGES[0])


def pairs_at(level: str) -> tuple[tuple[Change, Change], ...]:
    """Two that share neither an option nor a right name: no one name is right of both."""
    return tuple((one, other) for one, other in combinations(seen_at(level)[1:], 2)
                 if not set(one.options) & set(other.options) and not set(one.names) & set(other.names))
