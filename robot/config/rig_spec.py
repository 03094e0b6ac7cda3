"""The rig specification: the contents of rig.toml and of [rig] in launcher.toml.

Users write these files by hand. Optional keys that are absent take the defaults stated here. `unknown_keys` lists
unrecognised keys, so that the caller can warn about them. A wrong type or a missing required key is an error.
"""

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import msgspec
from msgspec import UNSET, Struct, UnsetType, field

from truearc.robot.config.targets import HEIGHTS, target_errors
from truearc.robot.config.targets import Target as Target

POSITIVE = ("ball.mass_kg", "ball.radius_m", "launcher.free_speed_rad_s", "launcher.wheel.radius_m",
            "target.two_half_height_m", "target.radius_m", "target.length_m", "target.width_m", "target.across_flats_m",
            "target.points", "target.ring.radius_m", "target.ring.points", "target.backboard.behind_m",
            "target.backboard.height_m", "world.gravity_m_s2",
            "tracker.scale_sd", "tracker.tilt_sd_deg", "tracker.clock_sd")
NOT_NEGATIVE = ("launcher.release_height_m", "air.density_kg_m3", "noise.distance_m", "noise.hood_deg",
                "noise.wheel_rad_s", "noise.track_m", "target.three_half_height_m", "target.lip_m")

DOWNWARD = {"world.gravity_m_s2": "; it is a size and points down: write 9.81"}


class Ball(Struct, frozen=True):
    mass_kg: float
    radius_m: float

    @property
    def density_kg_m3(self) -> float:
        """Mass divided by volume; inf if the volume is too small for a number."""
        volume_m3 = 4.0 / 3.0 * math.pi * self.radius_m * self.radius_m * self.radius_m
        return self.mass_kg / volume_m3 if volume_m3 > 0.0 else math.inf


class Wheel(Struct, frozen=True):
    """One driven wheel; `clock_deg` is where it touches the ball, seen along the exit direction: 0 top, 180 bottom."""

    name: str
    radius_m: float
    gear: float                       # wheel speed / motor speed
    clock_deg: float


class HoodFacts(Struct, frozen=True):
    """`map`: measured points (position of the hood's servo, elevation in degrees), by rising position.

    Between two points the elevation is linear in the position, which has any unit and zero.
    """

    map: tuple[tuple[float, float], ...]


class LauncherFacts(Struct, frozen=True):
    release_height_m: float = 0.0
    free_speed_rad_s: float | None = None
    wheel: tuple[Wheel, ...] = ()
    hood: HoodFacts | UnsetType = UNSET       # as Rig.tracker


class Air(Struct, frozen=True):
    density_kg_m3: float = 1.2


class WorldFacts(Struct, frozen=True):
    gravity_m_s2: float = 9.81


class Noise(Struct, frozen=True):
    """Assumed standard deviations of the sensors."""

    distance_m: float = 0.05
    hood_deg: float = 0.2
    wheel_rad_s: float = 0.5
    track_m: float = 0.015


class Tracker(Struct, frozen=True):
    """Uncertainty of a tracker's calibration: standard deviations, None for the usual value of a tracker.

    calibrated: lengths, level and clock were checked against a known object; the usual value is then a 25th.
    """

    calibrated: bool = False
    scale_sd: float | None = None
    tilt_sd_deg: float | None = None
    clock_sd: float | None = None


class Site(Struct, frozen=True):
    """Where the shots are taken. indoor: in a closed hall, where the air hardly moves."""

    indoor: bool = False


class Believe(Struct, frozen=True):
    terms: tuple[str, ...] = ("gravity", "drag", "magnus")


class Rig(Struct, frozen=True):
    """Contents of rig.toml: ball, launcher, target, air, world, noise, tracker, site and believed terms; SI and
    degrees.

    `target`: None if there was no opening to shoot at. Keys and their meaning: docs/reference/dataset.md.
    """

    ball: Ball
    launcher: LauncherFacts = field(default_factory=LauncherFacts)
    target: Target | None = None
    air: Air = field(default_factory=Air)
    world: WorldFacts = field(default_factory=WorldFacts)
    noise: Noise = field(default_factory=Noise)
    believe: Believe = field(default_factory=Believe)
    tracker: Tracker | UnsetType = UNSET      # not written where it is not stated, so that hashes stay
    site: Site | UnsetType = UNSET


# sizes that any launcher's are within, where they are not 0: a ball of table tennis has 0.0027 kg and 0.02 m
REAL = {"ball.mass_kg": (1e-4, 1e3), "ball.radius_m": (1e-3, math.inf), "launcher.wheel.radius_m": (5e-3, math.inf),
        "launcher.wheel.gear": (1e-3, 100.0), "launcher.wheel.clock_deg": (0.0, 360.0),
        "launcher.free_speed_rad_s": (1.0, math.inf), "target.two_half_height_m": (1e-3, math.inf),
        "target.tilt_deg": (0.0, 60.0),       # of a steeper one it is hardly said that it faces up
        "world.gravity_m_s2": (0.01, math.inf)}
ANY = (0.0, math.inf)
# more than any launcher's; beyond is another unit
MOST = {"ball.radius_m": 0.5, "launcher.wheel.radius_m": 1.0, "launcher.release_height_m": 5.0,
        "launcher.free_speed_rad_s": 3000.0, "target.centre_height_m": 10.0, "target.two_half_height_m": 3.0,
        "target.width_m": 6.0, "target.lip_m": 1.0, "target.backboard.behind_m": 5.0, "target.backboard.height_m": 5.0,
        "air.density_kg_m3": 2.0,
        "world.gravity_m_s2": 25.0,   # Jupiter's
        # standard deviations: a tape is good to 0.01 m, a camera at 10 m to 0.5 m; worse ones make a fit of noise
        "noise.distance_m": 2.0, "noise.hood_deg": 15.0, "noise.wheel_rad_s": 100.0, "noise.track_m": 0.5,
        "tracker.scale_sd": 0.5, "tracker.tilt_sd_deg": 45.0, "tracker.clock_sd": 0.5}
DENSEST_KG_M3, AIR_KG_M3 = 23_000.0, 1.2      # of a ball: no metal is heavier, and what is lighter flies away
LENGTHS_M = {"centimetres": 0.01, "inches": 0.0254, "millimetres": 0.001}
OTHER_UNITS = {"m": "another unit", "s": "revolutions per minute", "m3": "another unit",
               "s2": "feet or centimetres per second squared; on Earth it is 9.81", "deg": "another unit",
               "sd": "per cent; it is a share: 0.01 for one per cent"}
# the terms that truearc.sim has; a distribution may add others (docs/reference/terms.md)
TERMS = ("hood_offset", "hood_backlash", "encoder_scale", "distance_scale", "distance_bias", "vision_latency",
         "track_scale", "track_tilt", "track_roll", "track_clock", "track_perspective", "wheel_slip",
         "exit_efficiency", "wheel_droop", "ball_compression", "ball_wear", "ball_spread", "battery_sag", "rapid_fire",
         "release_height", "spin_decay", "wind_x", "wind_y", "wind_z", "gravity", "drag", "magnus", "spin_drag",
         "drag_reynolds", "lift_saturation", "drag_wear", "air_density", "air_change", "buoyancy", "added_mass",
         "target_height", "rim_catch", "backboard_bounce")
RADIAN_STEP, RADIAN_SLIP = math.pi / 12.0, 0.005  # clock angles in radians are multiples of it, as rounded


def too_large(rig: Rig) -> Iterator[tuple[str, str]]:
    """Yield the dotted key of each number larger than any launcher's, and what it looks like, such as clock angles in
    radians."""
    clocks = [clock for wheel in rig.launcher.wheel if math.isfinite(clock := wheel.clock_deg) and clock]
    steps = [round(clock / RADIAN_STEP) for clock in clocks]
    if clocks and all(0 < step <= 24 and abs(clock - step * RADIAN_STEP) < RADIAN_SLIP
                      for clock, step in zip(clocks, steps, strict=True)):
        degrees = ", ".join(f"{15 * step} for {clock:g}" for clock, step in zip(clocks, steps, strict=True))
        yield "launcher.wheel.clock_deg", f"these look like radians; write degrees: {degrees}"
    for key, value in _leaves(as_table(rig), ""):
        if key in MOST and isinstance(value, int | float) and value > MOST[key]:
            lengths = [name for name, metres in LENGTHS_M.items() if key.endswith("_m")
                       and 0.02 * MOST[key] < value * metres <= MOST[key]]
            whose = "Jupiter's" if key == "world.gravity_m_s2" else "any launcher's"
            yield key, (f"{value:g} is more than {whose} {MOST[key]:g}; this looks like "
                        + (" or ".join(lengths) or OTHER_UNITS[key.rpartition("_")[2]]))


def as_table(rig: Rig) -> dict[str, Any]:
    """Return the contents of rig.toml, with every key stated that is not derived from others."""
    table: dict[str, Any] = msgspec.to_builtins(rig)
    if rig.target and rig.target.faces_up:
        table["target"] = {key: value for key, value in table["target"].items() if key not in HEIGHTS}
    return table


def rig_errors(rig: Rig) -> Iterator[tuple[str, str]]:
    """Yield the dotted key of each impossible number, and what is wrong with it."""
    for key, value in _leaves(as_table(rig), ""):
        if not isinstance(value, int | float):
            continue
        if not math.isfinite(value):
            yield key, f"{value} is not finite" + ("; measure it and write the number" if math.isnan(value) else "")
        elif key in POSITIVE and value <= 0:
            yield key, f"{value} must be above 0" + DOWNWARD.get(key, "")
        elif key in NOT_NEGATIVE and value < 0:
            yield key, f"{value} must not be below 0"
        elif value and not (real := REAL.get(key, ANY))[0] <= abs(value) <= real[1]:
            yield key, f"{value:g} is out of range ({real[0]:g} to {real[1]:g} in size); look at its unit"
    for key, names in (("launcher.wheel.name", [wheel.name for wheel in rig.launcher.wheel]),
                       ("believe.terms", rig.believe.terms)):
        for name in sorted({name for name in names if names.count(name) > 1}):
            yield key, f"{name!r} stands there more than once; keep one"
    yield from (("launcher.hood.map", what) for what in _map_errors(rig.launcher.hood))
    if rig.target:
        yield from ((f"target.{key}", what) for key, what in target_errors(rig.target, rig.ball.radius_m))


def _map_errors(hood: HoodFacts | UnsetType) -> Iterator[str]:
    if isinstance(hood, UnsetType):
        return
    points = hood.map
    steps = list(pairwise(points))
    if len(points) < 2:
        yield "needs two measured points or more: [[position, degrees], [position, degrees]]"
    if any(not position < following for (position, _), (following, _) in steps):
        yield "positions must rise from point to point"
    if not all(0.0 <= deg <= 90.0 for _, deg in points):
        yield "a point is [position, degrees above the horizontal]; degrees are from 0 to 90"
    if len({deg < following for (_, deg), (_, following) in steps}) > 1 or any(a[1] == b[1] for a, b in steps):
        yield "degrees must rise at each point, or fall at each"


def _leaves(value: Any, key: str) -> list[tuple[str, Any]]:
    if isinstance(value, dict):
        return [leaf for name, part in value.items() for leaf in _leaves(part, f"{key}.{name}" if key else name)]
    if isinstance(value, list | tuple):
        return [leaf for part in value for leaf in _leaves(part, key)]
    return [(key, value)]
