"""Launch of the paper's two-wheel rig from motor ratio and elevation (its Eq. 11 and 12)."""

from typing import Any

from truearc.robot.config.rig_spec import Rig, Wheel
from truearc.robot.config.schema import InputError
from truearc.sim.physics.launch import Exit, exit_opposed


def exit_seed(facts: Rig, motor_ratio: Any, hood_deg: Any) -> Exit:
    """Launch of the two-wheel rig at motor speed / free speed and elevation.

    The seed's Eq. 11 and 12, the latter with the paper's own factor (twice the spin of a ball that does not slip).
    Raises InputError when the rig has no free speed or not one wheel above and one below.
    """
    upper, lower = opposed_wheels(facts)
    motor_rad_s = motor_ratio * free_speed_rad_s(facts)
    return exit_opposed(facts, motor_rad_s * (upper.gear * upper.radius_m), motor_rad_s * (lower.gear * lower.radius_m),
                        hood_deg)


def opposed_wheels(facts: Rig) -> tuple[Wheel, Wheel]:
    """(upper, lower) of a rig with exactly one wheel on top and one at the bottom; InputError otherwise."""
    clocks = [round(wheel.clock_deg % 360.0, 6) for wheel in facts.launcher.wheel]
    if sorted(clocks) != [0.0, 180.0]:
        raise InputError("rig.toml: launcher.wheel: the seed's Eq. 11 and 12 need two wheels, clock_deg 0 and 180")
    return facts.launcher.wheel[clocks.index(0.0)], facts.launcher.wheel[clocks.index(180.0)]


def free_speed_rad_s(facts: Rig) -> float:
    """The motors' free speed; InputError when rig.toml does not state it."""
    if facts.launcher.free_speed_rad_s is None:
        raise InputError("rig.toml: launcher.free_speed_rad_s is needed to turn motor_ratio into a launch")
    return facts.launcher.free_speed_rad_s
