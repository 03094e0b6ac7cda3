"""Checks of launcher.toml: numbers out of range, contradictions between values, and values that no launcher can have.

`limits.toml` has the range of each number; the formats page lists these ranges. A bound is a number or a product of a
number and keys, such as "2 / tick_hz" or "0.5 * hood.pid.output_high"; the narrowest of several bounds applies. A bound
is ignored if it uses a key that the configuration lacks, or a key marked `?` whose value is 0. All other checks, such
as those of the hood's screw angle and the ball's density, are in this module. `load_config` refuses a configuration
that fails any check.
"""

import math
import re
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from truearc.errors import did_you_mean
from truearc.hw.devices.family import driver_of
from truearc.hw.devices.registry import family_of
from truearc.robot.config.named_tables import RECORDED, ReadEncoder, encoder_family_of, find_table
from truearc.robot.config.rig_spec import AIR_KG_M3, DENSEST_KG_M3, TERMS, Rig, too_large

Bound = float | str | tuple[float | str, ...]
FACTOR = re.compile(r"(/ )?([-\w.]+)(\??)")


class Limit(NamedTuple):
    """The permitted range of `key`, both bounds included, and what happens beyond them.

    or_zero: 0 is permitted, too, and means that it is unknown or that there is none.
    """

    key: str                          # dotted, without the numbers of a list: axes.flywheels.rated_v is that of each
    low: Bound
    high: Bound
    why: str
    or_zero: bool = False


ROUNDING = 1e-9                       # of a product: 0.1 * 0.05 * 200 is a little more than 1
STRAIGHT_DEG = 5.0                    # of motor, pivot and nut; chosen: a lever of a twelfth of the shorter arm is left


@cache
def load_limits() -> tuple[Limit, ...]:
    """Load the limits of launcher.toml from limits.toml."""
    table = tomllib.loads(Path(__file__).with_name("limits.toml").read_text(encoding="utf-8"))
    return tuple(Limit(key, _bound(low), _bound(high), why.format_map(table["words"]), "or 0" in more)
                 for keys, low, high, why, *more in table["limits"]
                 for key in ([keys] if isinstance(keys, str) else keys))


def _bound(stated: Any) -> Bound:
    return tuple(stated) if isinstance(stated, list) else stated


def out_of_range(config: Any, limits: tuple[Limit, ...]) -> Iterator[tuple[str, str]]:
    """Yield the key of each number outside its limits, with its value, the permitted range and the reason.

    config: truearc.robot.config.schema.Config, or whatever has the keys of the limits.
    """
    for limit in limits:
        for key, value in numbers(config, limit.key):
            (least, low), (most, high) = narrowest(limit.low, config, max), narrowest(limit.high, config, min)
            slack = ROUNDING * abs(value)
            if not (least - slack <= value <= most + slack or (limit.or_zero and value == 0.0)):
                yield key, f"{value:g} is out of range ({'0, or ' * limit.or_zero}{low} to {high}); {limit.why}"


def numbers(thing: Any, key: str, name: str = "") -> Iterator[tuple[str, float]]:
    """Return (name, value) of each number at a dotted key; list items have their index, an absent table gives none."""
    if isinstance(thing, tuple):
        for index, part in enumerate(thing):
            yield from numbers(part, key, f"{name}[{index}]" if key else name)
    elif not key:
        yield from () if thing is None else ((name, thing),)
    else:
        first, _, rest = key.partition(".")
        yield from numbers(getattr(thing, first, None), rest, f"{name}.{first}".lstrip("."))


def narrowest(bound: Bound, config: Any, choose: Any) -> tuple[float, str]:
    """Return (value, text) of the bound that applies; choose: max of a limit's low ones, min of its high ones."""
    found = [(value, f"{value:g}" + (f" = {shown(one)}" if isinstance(one, str) else ""))
             for one in (bound if isinstance(bound, tuple) else (bound,)) for value in _amounts(one, config)]
    return choose(found) if found else (-choose(-math.inf, math.inf), "any")


def shown(bound: float | str) -> str:
    """Return a bound as text."""
    return bound.replace("?", "") if isinstance(bound, str) else f"{bound:g}"


def _amounts(bound: float | str, config: Any) -> list[float]:
    """Values of a bound: one for each of a list's tables, none where a key is absent."""
    products = [1.0]
    for over, factor, silent in FACTOR.findall(bound if isinstance(bound, str) else f"{bound!r}"):
        try:
            values = [float(factor)]
        except ValueError:
            values = [value for _, value in numbers(config, factor) if value or not (silent or over)]
        products = [one / value if over else one * value for one in products for value in values]
    return products


# --- words and numbers at odds with others

def contradictions(config: Any) -> Iterator[tuple[str, str]]:
    """Yield the key of each word and number that is out of range or contradicts another, and what is wrong with it.

    config: truearc.robot.config.schema.Config, whose module calls this one.
    """
    for key, small_deg in (("hood.low_deg", 1.0), ("hood.high_deg", 0.5 * math.pi)):
        angle = attrgetter(key)(config)
        if 0.0 < abs(angle) < small_deg and (angle > 0.0 or key == "hood.low_deg"):
            yield key, (f"{angle:g} degrees are hardly a limit; if radians, write {math.degrees(angle):.3g}; if turns, "
                        f"{360.0 * angle:.3g}")
    yield from out_of_range(config, load_limits())
    yield from _of_motors(config)
    yield from _of_choices(config)
    yield from _of_encoder(config)
    if not config.hood.holds_itself and family_of(config.axes.hood).is_commanded:
        yield "hood.holds_itself", ("missing key, or not true; a hood that sinks without torque is not driven, since "
                                    "a released one would fall. Write true if it stays where it is, as on an acme "
                                    "screw")


def _of_choices(config: Any) -> Iterator[tuple[str, str]]:
    if config.gate.policy not in ("collect", "model"):
        yield "gate.policy", f"{config.gate.policy!r} is not known here; there are collect, model"
    if config.camera.target == "apriltag" and config.apriltag is None:
        yield "camera.target", "an AprilTag is to be seen, and there is no [apriltag] with ids, side_m, centre_height_m"
    for name, stated in config.readings.items():
        other = find_table(name)
        yield from other.errors(msgspec.convert(stated, other.table), config)


def _of_encoder(config: Any) -> Iterator[tuple[str, str]]:
    family, driver = encoder_family_of(config.hood_encoder), driver_of(config.hood_encoder)
    if isinstance(config.hood_encoder, ReadEncoder):
        if driver not in config.readings:
            yield "hood_encoder.driver", f"{driver!r} needs [{driver}]"
        elif family is RECORDED:
            yield "hood_encoder.driver", f"[{driver}] gives no angle of a hood"
    if config.rig.noise.hood_deg < family.least_sigma_deg:
        yield "rig.noise.hood_deg", (f"{config.rig.noise.hood_deg:g} is too small: hood_encoder.driver "
                                     f"{family.driver!r} knows the angle to {family.least_sigma_deg:g} deg at best")


def _of_motors(config: Any) -> Iterator[tuple[str, str]]:
    """Motors that are one and the same device, a screw that cannot be built."""
    bent = [config.hood.included_deg + end for end in (config.hood.low_deg, config.hood.high_deg)]
    if bent[0] <= bent[1] and not STRAIGHT_DEG <= bent[0] <= bent[1] <= 180.0 - STRAIGHT_DEG:
        yield "hood.included_deg", (f"from low_deg to high_deg the angle motor, pivot, nut goes from {bent[0]:g} to "
                                    f"{bent[1]:g} degrees; it stays between {STRAIGHT_DEG:g} and "
                                    f"{180.0 - STRAIGHT_DEG:g}, since a screw in line with the pivot has no lever")
    if len({family_of(axis).is_commanded for axis in config.axes.flywheels}) > 1:
        yield "axes.flywheels", ("some are \"advisory\", which another controller drives, and some are driven here; "
                                 "the motors of one belt have one master")
    named = [(f"axes.flywheels[{number}]", axis) for number, axis in enumerate(config.axes.flywheels)]
    encoder = getattr(config.hood_encoder, "controller", None)
    owner: dict[tuple[str, int], str] = {}
    for name, axis in (*named, ("axes.hood", config.axes.hood), ("axes.feeder", config.axes.feeder),
                       *((("hood_encoder.controller", encoder),) if encoder is not None else ())):
        for key in {"node", "device"} & set(axis.__struct_fields__):
            first = owner.setdefault((driver_of(axis), getattr(axis, key)), name)
            if first != name:
                yield f"{name}.{key}", f"{getattr(axis, key)} is that of {first}, too; each motor has its own"


def warn_of_pitch(path: str | Path, camera: Any) -> None:
    """Warn on stderr if a camera's pitch may be in radians. camera: truearc.robot.config.schema.CameraConfig."""
    if 0.0 < abs(camera.pitch_deg) < 0.5 * math.pi:
        print(f"warning: {path}: camera.pitch_deg: {camera.pitch_deg:g} is nearly level; if radians, write "
              f"{math.degrees(camera.pitch_deg):.3g}", file=sys.stderr)


def warn_of_terms(path: str | Path, rig: Rig) -> None:
    """Warn on stderr of believed terms with nearly the name of ours; they may also belong to another distribution."""
    for name in rig.believe.terms:
        if name not in TERMS and (near := did_you_mean(name, TERMS)):
            print(f"warning: {path}: rig.believe.terms: {name!r} is none of truearc's terms{near}", file=sys.stderr)


def cannot_throw(rig: Rig) -> Iterator[tuple[str, str]]:
    """Return the key and error of values that a rig may have on paper but no launcher can have."""
    if rig.target is not None and rig.target.centre_height_m <= 0:
        yield "rig.target.centre_height_m", f"{rig.target.centre_height_m:g} must be above 0, the floor"
    if rig.launcher.free_speed_rad_s is None:
        yield "rig.launcher.free_speed_rad_s", "missing key; the motors' speed without load, where motor_ratio is 1"
    if not any(wheel.gear for wheel in rig.launcher.wheel):
        yield "rig.launcher.wheel.gear", "no wheel turns"
    yield from ((f"rig.{key}", what) for key, what in too_large(rig))
    ball = rig.ball
    if ball.radius_m > 0 and ball.density_kg_m3 > DENSEST_KG_M3:
        yield "rig.ball.mass_kg", (f"{ball.mass_kg:g} kg in a ball of {ball.radius_m:g} m radius is denser than any "
                                   "metal; are these grams?")
    elif ball.density_kg_m3 < AIR_KG_M3:
        yield "rig.ball.radius_m", (f"{ball.mass_kg:g} kg in a ball of {ball.radius_m:g} m radius is lighter than air; "
                                    "look at the units")
