"""Numbers of a launcher's configuration that are of the right kind and still cannot be."""

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from truearc.robot.config.rig_spec import DENSEST_KG_M3, Rig, too_large

if TYPE_CHECKING:                     # the schema calls this module
    from truearc.robot.config.schema import Config

MAX_TORQUE_NM = 100.0                 # at the motor shaft; the strongest of a team's motors give 7


def contradictions(config: "Config") -> Iterator[tuple[str, str]]:
    """Yield the key of each limit that is on the wrong side of another, and of each number that is out of range."""
    hood, collect, wheel = config.hood, config.collect, config.flywheel
    for low_key, low, high_key, high in (
            ("hood.low_deg", hood.low_deg, "high_deg", hood.high_deg),
            ("collect.hood_low_deg", collect.hood_low_deg, "hood_high_deg", collect.hood_high_deg),
            ("hood.pid.output_low", hood.pid.output_low, "output_high", hood.pid.output_high),
            ("flywheel.pid.output_low", wheel.pid.output_low, "output_high", wheel.pid.output_high)):
        if low > high:
            yield low_key, f"{low:g} is above {high_key}, {high:g}"
    torques, gains, turn = (-MAX_TORQUE_NM, MAX_TORQUE_NM), (0.0, math.inf), "a motor is turned round by its direction"
    for key, value, (least, most), why in (
            *((f"{name}.pid.{gain}", getattr(pid, gain), gains, f"a gain of the other sign runs away; {turn}")
              for name, pid in (("flywheel", wheel.pid), ("hood", hood.pid)) for gain in ("kp", "ki", "kd")),
            *((f"{name}.pid.{end}", getattr(pid, end), torques, "no motor gives more Nm")
              for name, pid in (("flywheel", wheel.pid), ("hood", hood.pid)) for end in ("output_low", "output_high")),
            ("flywheel.ks_nm", wheel.ks_nm, torques, "no motor gives more Nm"),
            ("hood.friction_nm", hood.friction_nm, torques, "no motor gives more Nm"),
            ("hood.homing_torque_nm", hood.homing_torque_nm, (-MAX_TORQUE_NM, -1e-4), f"toward the switch; {turn}"),
            ("feeder.torque_nm", config.feeder.torque_nm, (0.0, MAX_TORQUE_NM), turn),
            ("collect.hood_low_deg", collect.hood_low_deg, (hood.low_deg, hood.high_deg), "the hood goes no further"),
            ("collect.hood_high_deg", collect.hood_high_deg, (hood.low_deg, hood.high_deg), "the hood goes no further"),
            ("collect.spread", collect.spread, (0.0, 0.5), "a share of the speed: 0.06 varies it by 6 %"),
            ("collect.repeats", collect.repeats, (1, 1000), "shots at each set point"),
            ("collect.efficiency", collect.efficiency, (0.1, 1.5), "exit speed by the wheels': about 0.65"),
            ("collect.walk_step", collect.walk_step, (0.0, 0.5), "log speed a mark: 0.02 corrects it by 2 %"),
            *(("collect.walk_start", one, (-3.0, 3.0), "log speed; 0 is no correction") for one in collect.walk_start)):
        if not least <= value <= most:
            yield key, f"{value:g} is out of range ({least:g} to {most:g}); {why}"


def cannot_throw(rig: Rig) -> Iterator[tuple[str, str]]:
    """Key and objection of values that a rig may have on paper, and a launcher cannot."""
    if rig.target is not None and rig.target.centre_height_m <= 0:
        yield "rig.target.centre_height_m", f"{rig.target.centre_height_m:g} must be above 0, the floor"
    if not any(wheel.gear for wheel in rig.launcher.wheel):
        yield "rig.launcher.wheel.gear", "no wheel turns"
    yield from ((f"rig.{key}", what) for key, what in too_large(rig))
    ball = rig.ball
    if ball.radius_m > 0 and ball.density_kg_m3 > DENSEST_KG_M3:
        yield "rig.ball.mass_kg", (f"{ball.mass_kg:g} kg in a ball of {ball.radius_m:g} m radius is denser than any "
                                   "metal; are these grams?")
