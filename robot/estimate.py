"""Inputs to Estimate: what the launcher is doing now, and how old that knowledge is."""

import math

from msgspec import UNSET, UnsetType
from msgspec.structs import replace

from truearc.robot.aim_file import needs_aim
from truearc.robot.config.schema import Config
from truearc.robot.geometry import elevation_from_encoder_deg, elevation_from_screw_deg, exit_distance_m
from truearc.robot.types import Estimate, Inputs, Memory, Sighting, Track

NS = 1e-9
MEMORY_S = 0.15                       # time constant of the filter of distances
LONGEST_GAP_S, LARGEST_JUMP_M = 0.5, 0.5      # between sightings: beyond, the filter starts again


def remember(inputs: Inputs, memory: Memory, config: Config) -> Memory:
    """Carry over the newest sighting with a target in it, and the screw's zero when the limit switch closes."""
    seen = inputs.sighting
    if seen is not None and seen.found:
        memory = replace(memory, last_sighting=replace(seen, corners_px=()),
                         track=_followed(memory.track, seen, config) if needs_aim(config) else memory.track)
    motor = inputs.hood_motor
    if memory.homed and not memory.armed and _screw_differs(inputs, memory, config):
        memory = replace(memory, homed=False)     # its motor has lost count, in a reset for one: arming homes it again
    if not memory.homed and memory.armed and motor.endstop and (
            is_fresh(inputs, motor.endstop_t_ns, config) and is_fresh(inputs, motor.t_ns, config)):
        memory = replace(memory, homed=True, screw_zero_rad=motor.position_rad)
    return memory


def _followed(track: Track | UnsetType, seen: Sighting, config: Config) -> Track | UnsetType:
    """The distance and its rate with one more sighting: the fading-memory filter of degree 1 (Morrison, Introduction
    to Sequential Smoothing and Prediction, 1969), whose error at a constant speed is 0."""
    if seen.distance_m is None:
        return track
    distance_m = exit_distance_m(seen.distance_m, config.camera)
    if track is UNSET or not 0.0 < (seen.t_ns - track.t_ns) * NS <= LONGEST_GAP_S:
        return Track(seen.t_ns, distance_m, 0.0)
    gap_s = (seen.t_ns - track.t_ns) * NS
    ahead_m = track.distance_m + track.rate_m_s * gap_s
    off_m = distance_m - ahead_m
    if not abs(off_m) <= LARGEST_JUMP_M:
        return Track(seen.t_ns, distance_m, 0.0)
    fading = math.exp(-gap_s / MEMORY_S)
    return Track(seen.t_ns, ahead_m + (1.0 - fading * fading) * off_m,
                 track.rate_m_s + (1.0 - fading)**2 * off_m / gap_s)


def _screw_differs(inputs: Inputs, memory: Memory, config: Config) -> bool:
    """Whether the hood's encoder and its screw are known and say different things."""
    angle, motor = inputs.hood_angle, inputs.hood_motor
    if angle is None or not (is_fresh(inputs, angle.t_ns, config) and is_fresh(inputs, motor.t_ns, config)):
        return False
    screw_deg = elevation_from_screw_deg(motor.position_rad - memory.screw_zero_rad, config.hood)
    encoder_deg = elevation_from_encoder_deg(angle.angle_rad, config.hood_encoder)
    return angle.magnet_ok and not (screw_deg is not None
                                    and abs(encoder_deg - screw_deg) <= config.hood.crosscheck_deg)


def is_fresh(inputs: Inputs, t_ns: int, config: Config) -> bool:
    """Whether a reading stamped `t_ns` is young enough to act on; one never heard (0) is not."""
    return t_ns > 0 and 0 <= (inputs.t_ns - t_ns) * NS <= config.gate.reading_age_s


def estimate(inputs: Inputs, memory: Memory, config: Config) -> Estimate:
    """The launcher's state; None where it cannot be known.

    Where `aim.policy` is "belief", the distance is that of this tick: the newest sighting's, filtered, and what the
    robot has driven since.
    """
    speeds = [motor.velocity_rad_s for motor in inputs.flywheels]
    mean = sum(speeds) / len(speeds)
    free = config.rig.launcher.free_speed_rad_s
    sighting = memory.last_sighting
    distance = None
    if sighting is not None and sighting.distance_m is not None:
        distance = exit_distance_m(sighting.distance_m, config.camera)
    rate: float | UnsetType = UNSET
    if memory.track is not UNSET:
        rate = memory.track.rate_m_s
        distance = memory.track.distance_m + rate * (inputs.t_ns - memory.track.t_ns) * NS
    return Estimate(
        motor_rad_s=mean,
        motor_ratio=mean / free if free else 0.0,
        motor_spread_rad_s=max(speeds) - min(speeds),
        hood_deg=(elevation_from_encoder_deg(inputs.hood_angle.angle_rad, config.hood_encoder)
                  if inputs.hood_angle is not None else None),
        hood_screw_deg=(elevation_from_screw_deg(inputs.hood_motor.position_rad - memory.screw_zero_rad, config.hood)
                        if memory.homed else None),
        distance_m=distance,
        distance_sigma_m=None if sighting is None else sighting.sigma_m,
        battery_v=sum(motor.bus_v for motor in inputs.flywheels) / len(inputs.flywheels),
        oldest_s=_oldest_s(inputs),
        sighting_s=None if sighting is None else (inputs.t_ns - sighting.t_ns) * NS,
        closing_m_s=rate,
    )


def _oldest_s(inputs: Inputs) -> float:
    stamps = [motor.t_ns for motor in inputs.flywheels]
    stamps += [inputs.hood_motor.t_ns, inputs.feeder.t_ns, inputs.hood_angle.t_ns if inputs.hood_angle else 0]
    return (inputs.t_ns - min(stamps)) * NS
