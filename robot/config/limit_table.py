"""The least and the greatest value of every number of launcher.toml that moves or times something, and why.

`LIMITS` is the one place where they stand: `load_config` refuses what is outside, and the page of formats shows them.
A bound is a number or a product of a number and keys, such as "2 / tick_hz" or "0.5 * hood.pid.output_high"; of
several the narrowest counts. A key that the configuration does not have bounds nothing, nor does one with `?` that is 0.
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
STRONGEST_NM = 10.0                   # Kraken X60 stalls at 7.1 Nm, with field-oriented control at 9.4
LOCKED = "2 kN at a nut without friction bends the hood"          # 2000 N / (2 pi) = 318 N
BELOW_FRICTION = "less than friction moves nothing"
SHAKES = "an integral faster than ten ticks shakes"
NOISE = "the noise of one reading would give the full torque"
AXES = ("axes.flywheels", "axes.hood", "axes.feeder")

# Rows name only keys of rows above them, or of none: what is named first is the number that is wrong.
LIMITS: tuple[Limit, ...] = (
    Limit("tick_hz", 20, 1000, "slower misses the ball's dip; a bus of 1 Mbit/s carries no more commands"),
    *(Limit(f"{axis}.stall_torque_nm", 0.01, STRONGEST_NM, "no motor of a robot stalls at more Nm, or turns with less")
      for axis in AXES),
    *(Limit(f"{axis}.free_speed_rad_s", 50, 3000, "no motor of a robot is slower or faster; this may be rev/min")
      for axis in AXES),
    *(Limit(f"{axis}.rated_v", 3, 60, "of data sheets; a wrong one scales every torque") for axis in AXES),

    Limit("gate.reading_age_s", "2 / tick_hz", 1, "younger is no reading; after 1 s of silence a device is dead"),
    Limit("hood_encoder.period_ms", 0, "500 * gate.reading_age_s", "one reading lost would be a HOLD"),
    Limit("hood_encoder.zero_deg", -360, 360, "one turn"),
    Limit("hood_encoder.gear", 0.001, 1000, "turns of the encoder per turn of the hood: no gear is larger"),
    Limit("gate.sighting_age_s", 0.02, 2, "younger is no image; within 2 s a robot that pulls away at 2 m/s2 goes 4 m"),
    Limit("gate.threshold", 0.01, 0.99, "a model that may say 0 or must say 1 decides nothing"),

    Limit("flywheel.pid.output_high", 0.01, (STRONGEST_NM, "axes.flywheels.stall_torque_nm"),
          "the motor gives no more, and with none nothing turns"),
    Limit("flywheel.pid.output_low", (-STRONGEST_NM, "-1 * axes.flywheels.stall_torque_nm"), 0,
          "it brakes: above 0 it would drive wheels that are too fast; the motor gives no more"),
    Limit("flywheel.ks_nm", -0.01, "0.5 * flywheel.pid.output_high", "wheels that rub by half of all torque are stuck"),
    Limit("flywheel.kv_nm_s", -1e-4, ("flywheel.pid.output_high / rig.launcher.free_speed_rad_s", 1e-2),
          "friction grows with speed; above it all torque is friction"),
    Limit("flywheel.ka_nm_s2", 0, 0.1, "inertia in kg m2 per motor: a steel disc of 10 kg and 0.28 m has 0.1"),
    Limit("flywheel.pid.kp", 0, ("flywheel.pid.output_high", "flywheel.ka_nm_s2? * tick_hz"),
          "full torque for 1 rad/s, or for what one tick corrects, is a switch; the other sign runs away"),
    Limit("flywheel.pid.ki", 0, ("0.1 * flywheel.pid.kp? * tick_hz", "10 * flywheel.pid.output_high"), SHAKES),
    Limit("flywheel.pid.kd", 0, "2 * flywheel.pid.output_high / tick_hz", f"{NOISE} (0.5 rad/s)"),
    Limit("flywheel.pid.derivative_tau_s", 0, 0.5, "slower than the wheels, it pushes when all is over"),
    Limit("flywheel.pid.integral_limit", 0, "flywheel.pid.output_high", "more cannot be given and only winds up"),
    Limit("flywheel.tolerance_rad_s", 0.1, (100, "0.05 * rig.launcher.free_speed_rad_s"),
          "below lies the reading's noise; 5 % of the speed are 10 % of the distance"),
    Limit("flywheel.spread_rad_s", 0.1, (100, "0.1 * rig.launcher.free_speed_rad_s"),
          "below lies the reading's noise; motors that differ by more share no belt"),
    Limit("flywheel.steady_s", "2 / tick_hz", 2, "one reading may be a speed that passes; no wheels need 2 s to settle"),
    Limit("gate.request_s", "2 * flywheel.steady_s", 60, "it lapses before wheels settle; nobody waits for a minute"),
    Limit("gate.doubt_s", 0, "gate.request_s", "the request has lapsed by then"),

    Limit("hood.low_deg", -30, 90, "launch elevation; nothing is thrown backwards"),
    Limit("hood.high_deg", "hood.low_deg", 90, "above the switch; nothing is thrown backwards"),
    Limit("hood.screw_lead_m", 0.0005, 0.1, "no screw is finer or coarser; this may be millimetres"),
    Limit("hood.screw_gear", 0.005, 20, "turns of the screw per turn of the motor: no gear is larger"),
    Limit("hood.pivot_to_motor_m", 0.02, 2, "a launcher's size; this may be millimetres"),
    Limit("hood.pivot_to_nut_m", 0.02, 2, "a launcher's size; this may be millimetres"),
    Limit("hood.pid.output_high", 0.005, (STRONGEST_NM, "318 * hood.screw_lead_m * hood.screw_gear",
                                          "axes.hood.stall_torque_nm"), f"{LOCKED}; with none nothing turns"),
    Limit("hood.pid.output_low", (-STRONGEST_NM, "-318 * hood.screw_lead_m * hood.screw_gear",
                                  "-1 * axes.hood.stall_torque_nm"), -0.005, f"{LOCKED}; with none nothing goes down"),
    Limit("hood.friction_nm", 0, ("0.5 * hood.pid.output_high", "-0.5 * hood.pid.output_low"),
          "a screw that takes half of all torque is stuck"),
    Limit("hood.homing_torque_nm", "0.5 * hood.pid.output_low", (-0.001, "-1 * hood.friction_nm"),
          f"it ends at the switch, beside the stop: half of all torque at most; {BELOW_FRICTION}"),
    Limit("hood.pid.kp", 0, "10 * hood.pid.output_high",
          "full torque for 0.1 degrees is a switch; the other sign runs away"),
    Limit("hood.pid.ki", 0, ("0.1 * hood.pid.kp? * tick_hz", "10 * hood.pid.output_high"), SHAKES),
    Limit("hood.pid.kd", 0, "10 * hood.pid.output_high / tick_hz", f"{NOISE} (0.1 degrees)"),
    Limit("hood.pid.derivative_tau_s", 0, 0.5, "slower than the hood, it pushes when all is over"),
    Limit("hood.pid.integral_limit", 0, "hood.pid.output_high", "more cannot be given and only winds up"),
    Limit("hood.tolerance_deg", 0.02, 5, "finer than any encoder; 5 degrees miss by a metre"),
    Limit("hood.deadband_deg", 0, "hood.tolerance_deg", "a hood left alone beyond its tolerance is never ready"),
    Limit("hood.crosscheck_deg", 0.2, 5, "below lies the screw's play; it is how far past its end a hood may go unseen"),

    Limit("feeder.torque_nm", 0.005, (STRONGEST_NM, "axes.feeder.stall_torque_nm"),
          "a FIRE that feeds nothing is a shot on record alone; the motor gives no more"),
    Limit("feeder.feed_s", "2 / tick_hz", 2, "a motor hardly starts; whoever feeds for 2 s feeds two balls"),
    Limit("feeder.clear_s", "feeder.feed_s", 10, "the next ball would come while one is fed; a driver gives up"),

    Limit("camera.fps", 1, 240, "no camera of this kind is faster; this may be seconds per image"),
    Limit("camera.exposure_s", 0, "1 / camera.fps", "no image is exposed for longer than there is until the next"),
    Limit("camera.height_m", -5, 5, "a launcher's size; this may be millimetres"),
    Limit("collect.hood_low_deg", "hood.low_deg", "hood.high_deg", "the hood goes no further"),
    Limit("collect.hood_high_deg", "collect.hood_low_deg", "hood.high_deg", "the hood goes no further"),
    Limit("collect.spread", 0, 0.5, "a share of the speed: 0.06 varies it by 6 %"),
    Limit("collect.repeats", 1, 1000, "shots at each set point; a session has no more"),
    Limit("collect.efficiency", 0.1, 1.5, "exit speed by the wheels': about 0.65"),
    Limit("collect.walk_start", -3, 3, "log speed; 0 corrects nothing"),
    Limit("collect.walk_step", 0, 0.2, "log speed a mark: 0.02 corrects it by 2 %"),
    Limit("aim.correction_step", 0, 0.2, "log speed a mark: 0.005 corrects it by 0.5 %"),
    Limit("nt4.velocity.most_m_s", 0.01, 6, "no robot drives faster; this may be another unit"),
    Limit("nt4.velocity.pointing_deg", 0.1, 15, "15 degrees beside the lead miss every target"),
    Limit("nt4.velocity.delay_s", 0, 1, "a ball that takes longer is not on its way"),

    Limit("identify.flywheel.step_nm", 0.001, "flywheel.pid.output_high", "everything sent is cut to it"),
    Limit("identify.flywheel.ramp_nm_s", 1e-5, "identify.flywheel.step_nm", "a ramp of less than 1 s is a step"),
    Limit("identify.flywheel.top_rad_s", 1, (3000, "rig.launcher.free_speed_rad_s"), "the motor goes no faster"),
    Limit("identify.flywheel.longest_s", 0.5, 60, "a phase that has not ended by then will not"),
    Limit("identify.hood.step_nm", 0.001, "hood.pid.output_high", "everything sent is cut to it"),
    Limit("identify.hood.ramp_nm_s", 1e-5, "identify.hood.step_nm", "a ramp of less than 1 s is a step"),
    Limit("identify.hood.top_rad_s", 1, 600, "faster the hood crosses its travel before a reading says so"),
    Limit("identify.hood.longest_s", 0.5, 60, "a phase that has not ended by then will not"),
    Limit("identify.hood.margin_deg", 1, 45, "a hood coasts for degrees; twice 45 leave no travel"),
)


def out_of_range(config: Any) -> Iterator[tuple[str, str]]:
    """Yield the key of each number that is outside its limits, and what it is, what it may be and why.

    config: truearc.robot.config.schema.Config.
    """
    for limit in LIMITS:
        for key, value in numbers(config, limit.key):
            (least, low), (most, high) = narrowest(limit.low, config, max), narrowest(limit.high, config, min)
            slack = ROUNDING * abs(value)
            if not least - slack <= value <= most + slack:
                yield key, f"{value:g} is out of range ({low} to {high}); {limit.why}"


def numbers(thing: Any, key: str, name: str = "") -> Iterator[tuple[str, float]]:
    """(name, value) of each number at a dotted key; a list's names have its index, none stands where a table is absent."""
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
    return choose(found) if found else (choose(-math.inf, math.inf), "any")


def shown(bound: float | str) -> str:
    """A bound for people."""
    return bound.replace("?", "") if isinstance(bound, str) else f"{bound:g}"


def _amounts(bound: float | str, config: Any) -> list[float]:
    """What a bound comes to: a number for each of a list's, none where nothing is said."""
    products = [1.0]
    for over, factor, silent in FACTOR.findall(bound if isinstance(bound, str) else f"{bound!r}"):
        try:
            values = [float(factor)]
        except ValueError:
            values = [value for _, value in numbers(config, factor) if value or not (silent or over)]
        products = [one / value if over else one * value for one in products for value in values]
    return products
