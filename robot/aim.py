"""Where the launcher should be for the next trial: a deliberately spread plan, walked onto the target by the driver.

The plan is a low-discrepancy sequence, so a replay needs no random state. Speeds come from vacuum ballistics divided
by an efficiency that the driver's high and low marks correct (a Robbins-Monro walk on log speed, level and slope in
distance): what a crew does by hand when it walks shots in.
"""

import math

from robot.config import Collect, Config
from robot.facts import Target
from robot.types import Aim, Estimate, Memory

R2 = (0.7548776662466927, 0.5698402909980532)   # additive recurrence that fills the unit square evenly
FEASIBLE_DEG = 12.0                   # launch at least this much above the line of sight to the target
WALK_CENTRE_M = 5.0                   # distance at which the walk's slope term vanishes
IDLE = Aim(motor_ratio=0.0, hood_deg=0.0, source="idle")


def config_id(trial: int, collect: Collect) -> str:
    """Name of the plan's configuration that a trial uses; repeats share it."""
    return f"c{trial // collect.repeats:04d}"


def plan(trial: int, collect: Collect) -> tuple[float, float]:
    """Share of the feasible hood range (0-1) and speed trim (a signed fraction) of one trial.

    Trims are denser near zero, so that misses, two-pointers and three-pointers come in similar numbers.
    """
    index = trial // collect.repeats
    hood_share = (0.5 + R2[0] * index) % 1.0
    u = 2.0 * ((0.5 + R2[1] * index) % 1.0) - 1.0
    return hood_share, collect.spread * u * abs(u)


def vacuum_speed_m_s(distance_m: float, rise_m: float, elevation_deg: float, gravity_m_s2: float) -> float | None:
    """Exit speed whose parabola passes through the target; None when the elevation points below it."""
    tangent = math.tan(math.radians(elevation_deg))
    drop_m = distance_m * tangent - rise_m
    if drop_m <= 0.0:
        return None
    return distance_m * math.sqrt(gravity_m_s2 * (1.0 + tangent * tangent) / (2.0 * drop_m))


def aim(estimate: Estimate, memory: Memory, config: Config) -> Aim:
    """Set points for the current trial; IDLE while disarmed or before the target has ever been seen."""
    target = config.rig.target
    if not memory.armed or estimate.distance_m is None or target is None:
        return IDLE
    hood_deg, trim = _elevation(estimate.distance_m, target, memory.trial, config)
    rise_m = target.centre_height_m - config.rig.launcher.release_height_m
    speed = vacuum_speed_m_s(estimate.distance_m, rise_m, hood_deg, config.rig.world.gravity_m_s2)
    if speed is None:
        return IDLE
    correction = walked(memory.walk, estimate.distance_m)
    ratio = speed * (1.0 + trim) * math.exp(correction) / (config.collect.efficiency * surface_m_s(config))
    return Aim(motor_ratio=min(max(ratio, 0.0), 1.0), hood_deg=hood_deg, source="plan")


def surface_m_s(config: Config) -> float:
    """Mean surface speed of the wheels when the motors run at free speed (the seed's Eq. 11)."""
    launcher = config.rig.launcher
    speeds = [wheel.radius_m * wheel.gear * (launcher.free_speed_rad_s or 0.0) for wheel in launcher.wheel]
    return sum(speeds) / len(speeds)


def walked(walk: tuple[float, float], distance_m: float) -> float:
    """Log speed correction at a distance."""
    return walk[0] + walk[1] * (distance_m - WALK_CENTRE_M) / WALK_CENTRE_M


def step_walk(walk: tuple[float, float], side: int, distance_m: float, step: float) -> tuple[float, float]:
    """One driver's mark: side -1 = passed low (more speed), +1 = passed high (less), 0 = on target (nothing)."""
    lever = (distance_m - WALK_CENTRE_M) / WALK_CENTRE_M
    return walk[0] - step * side, walk[1] - step * side * lever


def _elevation(distance_m: float, target: Target, trial: int, config: Config) -> tuple[float, float]:
    collect = config.collect
    hood_share, trim = plan(trial, collect)
    rise_m = target.centre_height_m - config.rig.launcher.release_height_m
    sight_deg = math.degrees(math.atan2(rise_m, max(distance_m, 0.1)))
    low = min(max(collect.hood_low_deg, sight_deg + FEASIBLE_DEG), config.hood.high_deg)
    high = max(low, collect.hood_high_deg)
    return low + (high - low) * hood_share, trim
