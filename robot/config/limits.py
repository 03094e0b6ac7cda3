"""Limits of launcher.toml: the least and the greatest value of each number, and contradictions between values.

`LIMITS` is the one place where limits stand: `load_config` refuses what is outside, and the page of formats shows them.
A bound is a number or a product of a number and keys, such as "2 / tick_hz" or "0.5 * hood.pid.output_high"; of several
the narrowest counts. A key that the configuration lacks bounds nothing, nor does one with `?` that is 0.
"""

import math
import re
import sys
from collections.abc import Iterator
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
    """What `key` may be, both bounds included, and what happens beyond them."""

    key: str                          # dotted, without the numbers of a list: axes.flywheels.rated_v is that of each
    low: Bound
    high: Bound
    why: str


ROUNDING = 1e-9                       # of a product: 0.1 * 0.05 * 200 is a little more than 1
STRONGEST_NM = 10.0                   # a Kraken X60 stalls at 7.1 Nm, with field-oriented control at 9.4
AXES = ("axes.flywheels", "axes.hood", "axes.feeder")
SWITCH = "above, all torque answers"
RUNS_AWAY = "below 0 it runs away"
NO_STRONGER = "above, the motor gives no more"
THRUST = "further from 0, a nut without friction would push with 2 kN and bend the hood"     # 2000 N / 2 pi = 318 N
SIZE = "no launcher has such a size; this may be millimetres"
GEAR = "no gear is so large or so small"

# Rows name only keys of rows above them, so that what is named first is the number that is wrong.
LIMITS: tuple[Limit, ...] = (
    Limit("tick_hz", 20, 1000, "below, a reading waits 50 ms; above, commands to four axes fill half of the bus"),
    Limit("rig.launcher.free_speed_rad_s", 50, 3000, "no motor is so slow or so fast; this may be rev/min"),
    *(Limit(f"{axis}.stall_torque_nm", 0.01, STRONGEST_NM, "no motor of a robot is so weak or so strong")
      for axis in AXES),
    *(Limit(f"{axis}.free_speed_rad_s", 50, 3000, "no motor is so slow or so fast; this may be rev/min")
      for axis in AXES),
    *(Limit(f"{axis}.torque_nm_a", 0, 10, "no motor gives more for an ampere; 0: not known, and no limits are sent")
      for axis in AXES[:2]),
    *(Limit(f"{axis}.rated_v", 3, 60, "no data sheet is for such a voltage, and every torque scales with it")
      for axis in AXES),

    Limit("gate.reading_age_s", "2 / tick_hz", 1,
          "below, no reading is young enough; above, the device is dead"),
    Limit("gate.sighting_age_s", 0.02, 2, "below, no image is young enough; above, the robot may be 4 m away"),
    Limit("gate.threshold", 0.01, 0.99, "below, the model cannot say no; above, it can hardly say yes"),
    Limit("hood_encoder.period_ms", 0, "500 * gate.reading_age_s", "above, one lost reading is a HOLD"),
    Limit("hood_encoder.zero_deg", -360, 360, "an encoder reads within one turn"),
    Limit("hood_encoder.gear", 0.001, 1000, GEAR),

    Limit("flywheel.pid.output_high", 0.01, (STRONGEST_NM, "axes.flywheels.stall_torque_nm"),
          f"below, nothing turns; {NO_STRONGER}"),
    Limit("flywheel.pid.output_low", (-STRONGEST_NM, "-1 * axes.flywheels.stall_torque_nm"), 0,
          "below, the motor gives no more; above 0 it would drive wheels that are too fast"),
    Limit("flywheel.ks_nm", -0.01, "0.5 * flywheel.pid.output_high",
          "below, nothing rubs (a line through bent friction may be a little below 0); above, wheels are stuck"),
    Limit("flywheel.kv_nm_s", -1e-4, "flywheel.pid.output_high / rig.launcher.free_speed_rad_s",
          "below, friction falls with speed; above, it takes all torque at free speed"),
    Limit("flywheel.ka_nm_s2", 0, 0.1, "inertia for each motor in kg m2: a steel disc of 10 kg and 0.28 m has 0.1"),
    Limit("flywheel.pid.kp", 0, ("flywheel.pid.output_high", "flywheel.ka_nm_s2? * tick_hz"),
          f"{SWITCH} an error of 1 rad/s, or one tick corrects more than the error; {RUNS_AWAY}"),
    Limit("flywheel.pid.ki", 0, ("0.1 * flywheel.pid.kp? * tick_hz", "10 * flywheel.pid.output_high"),
          f"above, the integral overtakes the error within ten ticks and the loop shakes; {RUNS_AWAY}"),
    Limit("flywheel.pid.kd", 0, "2 * flywheel.pid.output_high / tick_hz",
          f"{SWITCH} the 0.5 rad/s of noise of one reading; {RUNS_AWAY}"),
    Limit("flywheel.pid.derivative_tau_s", 0, 0.5, "above, the derivative comes when the wheels are there"),
    Limit("flywheel.pid.integral_limit", 0, "flywheel.pid.output_high", "above, it cannot be given and only winds up"),
    Limit("flywheel.tolerance_rad_s", 0.1, "0.05 * rig.launcher.free_speed_rad_s",
          "below, the noise of a reading is larger; above, a ball lands 10 % off"),
    Limit("flywheel.spread_rad_s", 0.1, "0.1 * rig.launcher.free_speed_rad_s",
          "below, the noise of a reading is larger; above, the motors share no belt"),
    Limit("flywheel.steady_s", "2 / tick_hz", 2, "below, a speed that passes is a steady one; above, no shot comes"),
    Limit("flywheel.idle_s", 0, 600, "above, wheels stay at speed for ever, which 0 says"),
    Limit("gate.request_s", "2 * flywheel.steady_s", 60, "below, no wheels settle in time; above, it is forgotten"),
    Limit("gate.doubt_s", 0, "gate.request_s", "above, the request has lapsed"),

    Limit("hood.low_deg", -30, 90, "no ball is thrown further down, or backwards"),
    Limit("hood.high_deg", "hood.low_deg", 90, "below, there is no travel; above, a ball is thrown backwards"),
    Limit("hood.included_deg", -90, 180, "motor, pivot and nut make no triangle at any elevation"),
    Limit("hood.screw_lead_m", 0.0005, 0.1, "no screw is so fine or so coarse; this may be millimetres"),
    Limit("hood.screw_gear", 0.005, 20, GEAR),
    Limit("hood.pivot_to_motor_m", 0.02, 2, SIZE),
    Limit("hood.pivot_to_nut_m", 0.02, 2, SIZE),
    Limit("hood.pid.output_high", 0.005, (STRONGEST_NM, "318 * hood.screw_lead_m * hood.screw_gear",
                                          "axes.hood.stall_torque_nm"), f"{THRUST}; nearer, nothing goes up"),
    Limit("hood.pid.output_low", (-STRONGEST_NM, "-318 * hood.screw_lead_m * hood.screw_gear",
                                  "-1 * axes.hood.stall_torque_nm"), -0.005, f"{THRUST}; nearer, nothing goes down"),
    Limit("hood.friction_nm", 0.001, ("0.5 * hood.pid.output_high", "-0.5 * hood.pid.output_low"),
          "below, no screw is so light; above, it is stuck; it is added in the direction of motion"),
    Limit("hood.homing_torque_nm", "0.5 * hood.pid.output_low", (-0.001, "-1 * hood.friction_nm"),
          "below, the hood meets its stop too hard; above, friction holds it and homing never ends"),
    Limit("hood.pid.kp", 0, "10 * hood.pid.output_high", f"{SWITCH} an error of 0.1 degrees; {RUNS_AWAY}"),
    Limit("hood.pid.ki", 0, ("0.1 * hood.pid.kp? * tick_hz", "10 * hood.pid.output_high"),
          f"above, the integral overtakes the error within ten ticks and the loop shakes; {RUNS_AWAY}"),
    Limit("hood.pid.kd", 0, "10 * hood.pid.output_high / tick_hz",
          f"{SWITCH} the 0.1 degrees of noise of one reading; {RUNS_AWAY}"),
    Limit("hood.pid.derivative_tau_s", 0, 0.5, "above, the derivative comes when the hood is there"),
    Limit("hood.pid.integral_limit", 0, "hood.pid.output_high", "above, it cannot be given and only winds up"),
    Limit("hood.tolerance_deg", 0.02, 5, "below, no encoder is so fine; above, a ball misses by a metre"),
    Limit("hood.deadband_deg", 0, "hood.tolerance_deg", "above, a hood that is left alone is not ready"),
    Limit("hood.crosscheck_deg", 0.2, 5, "below, the screw's play is larger; above, the hood is driven into its stop"),

    Limit("hood.max_deg_s", 1, 45, "below, no shot comes; above, a hood that is let go coasts 4 degrees and more"),

    Limit("feeder.torque_nm", 0.005, (STRONGEST_NM, "axes.feeder.stall_torque_nm"),
          f"below, a FIRE feeds nothing and is recorded as a shot; {NO_STRONGER}"),
    Limit("feeder.feed_s", "2 / tick_hz", 2, "below, the motor hardly starts; above, it feeds two balls"),
    Limit("feeder.clear_s", "feeder.feed_s", 10, "below, two balls are fed; above, the robot seems dead"),

    Limit("camera.fps", 1, 240, "no camera is so slow or so fast; this may be seconds for each image"),
    Limit("camera.exposure_s", 0, "1 / camera.fps", "above, the next image is due"),
    Limit("camera.readout_s", 0, 0.2, "above, no rolling shutter is so slow; this may be milliseconds"),
    Limit("camera.height_m", -5, 5, SIZE),
    Limit("collect.hood_low_deg", "hood.low_deg", "hood.high_deg", "the hood goes no further"),
    Limit("collect.hood_high_deg", "collect.hood_low_deg", "hood.high_deg", "the hood goes no further"),
    Limit("collect.spread", 0, 0.5, "a share of the speed: 0.06 varies it by 6 %"),
    Limit("collect.repeats", 1, 1000, "no session has more shots"),
    Limit("collect.efficiency", 0.1, 1.5, "exit speed by the wheels': about 0.65"),
    Limit("collect.walk_start", -3, 3, "log speed; 0 corrects nothing"),
    Limit("collect.walk_step", 0, 0.2, "log speed a mark: 0.02 corrects it by 2 %"),
    Limit("aim.correction_step", 0, 0.2, "log speed a mark: 0.005 corrects it by 0.5 %"),

    Limit("identify.flywheel.repeats", 0, 20, "above, the motor is hot before the end; 0 leaves it alone"),
    Limit("identify.flywheel.step_nm", 0.001, "flywheel.pid.output_high", "above, it is cut; below, nothing turns"),
    Limit("identify.flywheel.ramp_nm_s", 1e-5, "identify.flywheel.step_nm", "above, a ramp of less than 1 s is a step"),
    Limit("identify.flywheel.top_rad_s", 1, "rig.launcher.free_speed_rad_s", "above, the motor does not go"),
    Limit("identify.flywheel.longest_s", 0.5, 60, "above, a motor that turns nothing is heated for a minute"),
    Limit("identify.hood.repeats", 0, 20, "above, the motor is hot before the end; 0 leaves it alone"),
    Limit("identify.hood.step_nm", 0.001, "hood.pid.output_high", "above, it is cut; below, nothing turns"),
    Limit("identify.hood.ramp_nm_s", 1e-5, "identify.hood.step_nm", "above, a ramp of less than 1 s is a step"),
    Limit("identify.hood.top_rad_s", 1, 240, "above (50 degrees/s, as shipped), it coasts through its margin"),
    Limit("identify.hood.longest_s", 0.5, 60, "above, a motor that turns nothing is heated for a minute"),
    Limit("identify.hood.margin_deg", 1, 45, "below, the hood coasts further; above, no travel is left"),
)


def out_of_range(config: Any, limits: tuple[Limit, ...] = LIMITS) -> Iterator[tuple[str, str]]:
    """Yield the key of each number that is outside its limits, and what it is, what it may be and why.

    config: truearc.robot.config.schema.Config, or whatever has the keys of the limits.
    """
    for limit in limits:
        for key, value in numbers(config, limit.key):
            (least, low), (most, high) = narrowest(limit.low, config, max), narrowest(limit.high, config, min)
            slack = ROUNDING * abs(value)
            if not least - slack <= value <= most + slack:
                yield key, f"{value:g} is out of range ({low} to {high}); {limit.why}"


def numbers(thing: Any, key: str, name: str = "") -> Iterator[tuple[str, float]]:
    """(name, value) of each number at a dotted key; a list's names have its index, an absent table has none."""
    if isinstance(thing, tuple):
        for index, part in enumerate(thing):
            yield from numbers(part, key, f"{name}[{index}]" if key else name)
    elif not key:
        yield from () if thing is None else ((name, thing),)
    else:
        first, _, rest = key.partition(".")
        yield from numbers(getattr(thing, first, None), rest, f"{name}.{first}".lstrip("."))


def narrowest(bound: Bound, config: Any, choose: Any) -> tuple[float, str]:
    """(value, text) of the bound that counts; choose: max of a limit's low ones, min of its high ones."""
    found = [(value, f"{value:g}" + (f" = {shown(one)}" if isinstance(one, str) else ""))
             for one in (bound if isinstance(bound, tuple) else (bound,)) for value in _amounts(one, config)]
    return choose(found) if found else (-choose(-math.inf, math.inf), "any")


def shown(bound: float | str) -> str:
    """A bound for people."""
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
