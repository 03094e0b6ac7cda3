"""Words and numbers of a launcher's configuration that are of the right kind and still cannot be."""

import math
import sys
from collections.abc import Iterator
from operator import attrgetter
from pathlib import Path
from typing import Any

import msgspec

from truearc.errors import did_you_mean
from truearc.hw.devices.axis import driver_of
from truearc.hw.devices.registry import family_of
from truearc.robot.config.limit_table import out_of_range
from truearc.robot.config.reading_tables import find_table
from truearc.robot.config.rig_spec import AIR_KG_M3, DENSEST_KG_M3, TERMS, Rig, too_large


def contradictions(config: Any) -> Iterator[tuple[str, str]]:
    """Yield the key of each word and number that is out of range, or at odds with another, and what is wrong with it.

    config: truearc.robot.config.schema.Config, whose module calls this one.
    """
    for key, small_deg in (("hood.low_deg", 1.0), ("hood.high_deg", 0.5 * math.pi)):
        angle = attrgetter(key)(config)
        if 0.0 < abs(angle) < small_deg and (angle > 0.0 or key == "hood.low_deg"):
            yield key, (f"{angle:g} degrees are hardly a limit; if radians, write {math.degrees(angle):.3g}; if turns, "
                        f"{360.0 * angle:.3g}")
    yield from out_of_range(config)
    yield from _of_motors(config)
    yield from _of_choices(config)
    yield from _of_encoder(config)
    if not config.hood.holds_itself and family_of(config.axes.hood).is_commanded:
        yield "hood.holds_itself", ("is not true; a hood that sinks without torque is not driven, since a released one "
                                    "would fall. Write true if it stays where it is, as on an acme screw")


def _of_choices(config: Any) -> Iterator[tuple[str, str]]:
    if config.gate.policy not in ("collect", "model"):
        yield "gate.policy", f"{config.gate.policy!r} is not known here; there are collect, model"
    if config.camera.target == "apriltag" and config.apriltag is None:
        yield "camera.target", "an AprilTag is to be seen, and there is no [apriltag] with ids, side_m, centre_height_m"
    for name, stated in config.readings.items():
        other = find_table(name)
        yield from other.errors(msgspec.convert(stated, other.table), config)


def _of_encoder(config: Any) -> Iterator[tuple[str, str]]:
    # drivers need cantools, which most commands do without
    from truearc.robot.hood_encoders import RECORDED, ReadEncoder, encoder_family_of

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
    if bent[0] <= bent[1] and not 0.0 < bent[0] <= bent[1] < 180.0:
        yield "hood.included_deg", (f"from low_deg to high_deg the angle motor, pivot, nut goes from {bent[0]:g} to "
                                    f"{bent[1]:g} degrees; it stays between 0 and 180")
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
    """Warn on stderr of a camera's pitch that may be radians. camera: truearc.robot.config.schema.CameraConfig."""
    if 0.0 < abs(camera.pitch_deg) < 0.5 * math.pi:
        print(f"warning: {path}: camera.pitch_deg: {camera.pitch_deg:g} is nearly level; if radians, write "
              f"{math.degrees(camera.pitch_deg):.3g}", file=sys.stderr)


def warn_of_terms(path: str | Path, rig: Rig) -> None:
    """Warn on stderr of believed terms that are nearly one of ours: they may also be those of another distribution."""
    for name in rig.believe.terms:
        if name not in TERMS and (near := did_you_mean(name, TERMS)):
            print(f"warning: {path}: rig.believe.terms: {name!r} is none of truearc's terms{near}", file=sys.stderr)


def cannot_throw(rig: Rig) -> Iterator[tuple[str, str]]:
    """Key and objection of values that a rig may have on paper, and a launcher cannot."""
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
