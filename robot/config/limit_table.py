"""The least and the greatest value of every number of launcher.toml that moves or times something, and why.

`LIMITS` is the one place where they stand: `load_config` refuses what is outside, and the page of formats shows them.
A bound is a number or a product of a number and keys, such as "2 / tick_hz" or "0.5 * hood.pid.output_high"; of
several the narrowest counts. A key that the configuration lacks bounds nothing, nor does one with `?` that is 0.
"""

import math
import re
from collections.abc import Iterator
from typing import Any, NamedTuple

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
    Limit("flywheel.ks_nm", -0.01, "0.5 * flywheel.pid.output_high", "below, nothing rubs; above, wheels are stuck"),
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
