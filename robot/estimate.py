"""The estimate of the launcher's present state from Inputs, with the missing, stale or faulty readings of each axis."""

import math

from msgspec import UNSET, UnsetType
from msgspec.structs import replace

from truearc.hw.devices.family import Axis
from truearc.hw.devices.registry import family_of
from truearc.hw.protocols import NS, AngleReading, MotorReading
from truearc.hw.reason import Reason
from truearc.robot import motors
from truearc.robot import reasons as because
from truearc.robot.aim_file import needs_aim
from truearc.robot.config.named_tables import encoder_family_of
from truearc.robot.config.schema import Config, GateConfig
from truearc.robot.types import Count, Estimate, Inputs, Memory, Sighting, Track

MEMORY_S = 0.15                       # time constant of the filter of distances
LONGEST_GAP_S, LARGEST_JUMP_M = 0.5, 0.5      # between sightings: beyond, the filter starts again
# A step of the hood motor's position between readings: what is more than this, and this times its speed, is a jump
JUMP_RAD, JUMP_SHARE = 1.0, 1.5


def remember(inputs: Inputs, memory: Memory, config: Config) -> Memory:
    """Carry over the newest sighting of the target, and the screw's zero when the limit switch closes."""
    seen = inputs.sighting
    if seen is not None and seen.found:
        memory = replace(memory, last_sighting=replace(seen, corners_px=()),
                         track=_followed(memory.track, seen, config) if needs_aim(config) else memory.track)
    memory = _home(_doubt_count(inputs, memory, config), inputs, config)
    motor = inputs.hood_motor
    if config.hood_encoder.is_heard:
        return memory
    return replace(memory, count=Count(motor.t_ns, motor.position_rad, motor.velocity_rad_s))


def _doubt_count(inputs: Inputs, memory: Memory, config: Config) -> Memory:
    """Homed no longer where the hood's motor has lost count, in a reset for one: arming homes it again.

    With an encoder that is what it says of the screw, and while armed a HOLD that keeps the zero. Without one it is a
    gap in the readings, or a step that the motor's speed does not explain; it homes again at once.
    """
    if not config.hood_encoder.is_heard:
        lost = memory.count is not UNSET and _has_jumped(inputs, memory.count, config)
    else:
        lost = not memory.armed and _screw_differs(inputs, memory, config)
    return replace(memory, homed=False) if memory.homed and lost else memory


def _has_jumped(inputs: Inputs, last: Count, config: Config) -> bool:
    motor = inputs.hood_motor
    gap_s = (motor.t_ns - last.t_ns) * NS
    if not (is_fresh(inputs, motor.t_ns, config) and 0.0 <= gap_s <= config.gate.reading_age_s):
        return True
    fastest = max(abs(motor.velocity_rad_s), abs(last.velocity_rad_s))
    return not abs(motor.position_rad - last.position_rad) <= JUMP_RAD + JUMP_SHARE * fastest * gap_s


def _home(memory: Memory, inputs: Inputs, config: Config) -> Memory:
    """The screw's zero, and that of an encoder that has none of its own, where the limit switch closed; one answer of
    the switch may be wrong, so two in a row say so."""
    motor, angle, encoder, first = inputs.hood_motor, inputs.hood_angle, config.hood_encoder, memory.switch
    if memory.homed or not memory.armed or not motor.endstop:
        return memory if first is UNSET else replace(memory, switch=UNSET)
    if not (is_fresh(inputs, motor.endstop_t_ns, config) and is_fresh(inputs, motor.t_ns, config)):
        return memory
    if first is UNSET:
        return replace(memory, switch=Count(motor.endstop_t_ns, motor.position_rad, motor.velocity_rad_s))
    if motor.endstop_t_ns <= first.t_ns:
        return memory
    if encoder.zero_deg is None:
        here_deg = motors.elevation_from_screw_deg(motor.position_rad - first.position_rad, config.hood)
        if here_deg is None or angle is None or not is_fresh(inputs, angle.t_ns, config):
            return memory
        memory = replace(memory, zero_deg=math.degrees(angle.angle_rad) - encoder.direction * here_deg)
    return replace(memory, homed=True, screw_zero_rad=first.position_rad, switch=UNSET)


def _followed(track: Track | UnsetType, seen: Sighting, config: Config) -> Track | UnsetType:
    """The distance and its rate with one more sighting: the fading-memory filter of degree 1 (Morrison, Introduction
    to Sequential Smoothing and Prediction, 1969), whose error at a constant speed is 0."""
    if seen.distance_m is None:
        return track
    distance_m = motors.exit_distance_m(seen.distance_m, config.camera)
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
    screw_deg = motors.elevation_from_screw_deg(motor.position_rad - memory.screw_zero_rad, config.hood)
    encoder_deg = _encoder_deg(inputs, memory, config)
    return angle.magnet_ok and not (screw_deg is not None and encoder_deg is not None
                                    and abs(encoder_deg - screw_deg) <= config.hood.crosscheck_deg)


def _encoder_deg(inputs: Inputs, memory: Memory, config: Config) -> float | None:
    """Launch elevation that the hood's encoder reads; None before its first angle, or its zero."""
    angle, zero_deg = inputs.hood_angle, config.hood_encoder.zero_deg
    if zero_deg is None:
        zero_deg = None if memory.zero_deg is UNSET else memory.zero_deg
    if angle is None or zero_deg is None:
        return None
    return motors.elevation_from_encoder_deg(angle.angle_rad, config.hood_encoder, zero_deg)


def is_fresh(inputs: Inputs, t_ns: int, config: Config) -> bool:
    """Return whether a reading stamped `t_ns` is recent enough to act on; one never received (0) is not."""
    return t_ns > 0 and 0 <= (inputs.t_ns - t_ns) * NS <= config.gate.reading_age_s


def estimate(inputs: Inputs, memory: Memory, config: Config) -> Estimate:
    """Return the launcher's state; None where it cannot be known.

    If `aim.policy` is "belief", the distance is that of this tick: the newest sighting's, filtered, plus the robot's
    motion since.
    """
    wheels = inputs.flywheels
    fastest = slowest = wheels[0].velocity_rad_s
    total_rad_s = bus_v = 0.0
    for motor in wheels:              # one loop: min, max and sum over lists take 2 us
        speed = motor.velocity_rad_s
        total_rad_s, bus_v = total_rad_s + speed, bus_v + motor.bus_v
        if speed > fastest:
            fastest = speed
        elif speed < slowest:
            slowest = speed
    mean, free = total_rad_s / len(wheels), config.rig.launcher.free_speed_rad_s
    sighting = memory.last_sighting
    distance = None
    if sighting is not None and sighting.distance_m is not None:
        distance = motors.exit_distance_m(sighting.distance_m, config.camera)
    screw_deg = (motors.elevation_from_screw_deg(inputs.hood_motor.position_rad - memory.screw_zero_rad, config.hood)
                 if memory.homed else None)
    encoder_deg = _encoder_deg(inputs, memory, config)
    is_heard = config.hood_encoder.is_heard or encoder_deg is not None     # advice has the robot's own angle
    rate: float | UnsetType = UNSET
    if memory.track is not UNSET:
        rate = memory.track.rate_m_s
        distance = memory.track.distance_m + rate * (inputs.t_ns - memory.track.t_ns) * NS
    toward, leftward, bearing = _NOT_TOLD if inputs.velocity is UNSET else _velocity(inputs, sighting, config)
    return Estimate(
        motor_rad_s=mean,
        motor_ratio=mean / free if free else 0.0,
        motor_spread_rad_s=fastest - slowest,
        hood_deg=encoder_deg if is_heard else screw_deg,
        hood_screw_deg=screw_deg,
        distance_m=distance,
        distance_sigma_m=None if sighting is None else sighting.sigma_m,
        battery_v=bus_v / len(wheels),
        oldest_s=_oldest_s(inputs, config),
        sighting_s=None if sighting is None else (inputs.t_ns - sighting.t_ns) * NS,
        closing_m_s=rate, toward_m_s=toward, leftward_m_s=leftward, bearing_deg=bearing,
    )


Velocity = tuple[float | UnsetType, float | UnsetType, float | UnsetType]
_NOT_TOLD: Velocity = (UNSET, UNSET, UNSET)


def _velocity(inputs: Inputs, sighting: Sighting | None, config: Config) -> Velocity:
    """(toward the target, to the left of it, bearing of the target in degrees), absent where one is not known."""
    moves = inputs.velocity
    if moves is UNSET or sighting is None or not is_fresh(inputs, moves.t_ns, config):
        return _NOT_TOLD
    bearing = math.radians(sighting.bearing_deg or 0.0)
    c, s = math.cos(bearing), math.sin(bearing)
    return (c * moves.forward_m_s - s * moves.left_m_s, s * moves.forward_m_s + c * moves.left_m_s,
            sighting.bearing_deg or 0.0)


def _oldest_s(inputs: Inputs, config: Config) -> float:
    oldest_ns = inputs.hood_motor.t_ns
    if config.hood_encoder.is_heard and (inputs.hood_angle is None or inputs.hood_angle.t_ns < oldest_ns):
        oldest_ns = 0 if inputs.hood_angle is None else inputs.hood_angle.t_ns
    for motor in (inputs.feeder, *inputs.flywheels):
        oldest_ns = motor.t_ns if motor.t_ns < oldest_ns else oldest_ns
    return (inputs.t_ns - oldest_ns) * NS


HEARTBEAT_S = 0.25                    # axes, and the hood's encoder, say how they are every 0.1 s; two may be lost
ERRORS_S = 1.0                        # a SPARK says its errors every 0.25 s; three may be lost
ENCODER = "hood encoder"
Doubts = tuple[list[Reason], list[Reason], list[Reason]]        # of the wheels, the hood, the feeder


def doubt_axes(inputs: Inputs, config: Config) -> Doubts:
    """Return reasons from missing, stale or faulty readings of the motors and the hood's encoder, by axis."""
    t_ns, gate, axes = inputs.t_ns, config.gate, config.axes
    found: list[Reason] = []
    for number, (axis, motor) in enumerate(zip(axes.flywheels, inputs.flywheels, strict=True), 1):
        if doubts := _motor(number, axis, motor, t_ns, gate):
            found += doubts
    of_hood = _motor(motors.HOOD_MOTOR, axes.hood, inputs.hood_motor, t_ns, gate)
    if config.hood_encoder.is_heard and (doubts := _encoder(inputs.hood_angle, t_ns, config)):
        of_hood = of_hood + doubts
    return found, of_hood, _motor(motors.FEEDER_MOTOR, axes.feeder, inputs.feeder, t_ns, gate)


def doubted_readings(inputs: Inputs, config: Config) -> list[Reason]:
    """Return the same reasons in one list."""
    wheels, hood, feeder = doubt_axes(inputs, config)
    return [*wheels, *hood, *feeder]


def _encoder(angle: AngleReading | None, t_ns: int, config: Config) -> list[Reason]:
    if angle is None:
        return [because.DEVICE_NEVER_RECEIVED(device=ENCODER)]
    if not _young(t_ns - angle.t_ns, config.gate.reading_age_s):
        return [because.DEVICE_STALE(device=ENCODER, age_s=(t_ns - angle.t_ns) * NS)]
    if not math.isfinite(angle.angle_rad):
        return [because.MOTOR_NOT_FINITE(motor=ENCODER)]
    missing = None if angle.faults_t_ns is UNSET else _no_fault_report(ENCODER, angle.faults_t_ns, t_ns, HEARTBEAT_S)
    found = [] if missing is None else [missing]
    if angle.faults and (errors := tuple(encoder_family_of(config.hood_encoder).errors(
            config.hood_encoder, angle.faults))):
        return [*found, because.MOTOR_ERROR(motor=ENCODER, errors=errors)]
    return found if angle.magnet_ok else [*found, because.MAGNET_LOST()]


def _motor(which: str | int, axis: Axis, motor: MotorReading, t_ns: int, gate: GateConfig) -> list[Reason]:
    """`which`: the motor's name, or a flywheel's number: a name is made only where something is wrong."""
    if motor.t_ns == 0 or motor.heartbeat_t_ns == 0:
        return [because.DEVICE_NEVER_RECEIVED(device=_name(which))]
    if not 0.0 <= (age_s := (t_ns - motor.t_ns) * NS) <= gate.reading_age_s:
        return [because.DEVICE_STALE(device=_name(which), age_s=age_s)]
    found: list[Reason] = []
    if not 0.0 <= (age_s := (t_ns - motor.heartbeat_t_ns) * NS) <= HEARTBEAT_S:
        found.append(because.DEVICE_HEARTBEAT_STALE(device=_name(which), age_s=age_s))
    if motor.errors_t_ns is not UNSET and (missing := _no_fault_report(_name(which), motor.errors_t_ns, t_ns,
                                                                       ERRORS_S)):
        found.append(missing)
    if not math.isfinite(motor.position_rad + motor.velocity_rad_s + motor.current_a + motor.bus_v):
        return [*found, because.MOTOR_NOT_FINITE(motor=_name(which))]
    family = family_of(axis)
    if errors := family.errors(axis, motor):
        return [*found, because.MOTOR_ERROR(motor=_name(which), errors=errors)]
    if not family.is_driven(axis, motor):
        return [*found, because.MOTOR_NOT_DRIVEN(motor=_name(which), state=motor.axis_state)]
    return found


def _name(which: str | int) -> str:
    return which if isinstance(which, str) else motors.name_wheel(which)


def _no_fault_report(device: str, stamp_ns: int, t_ns: int, limit_s: float) -> Reason | None:
    """Whether a report that must come is missing; None when it has come."""
    if stamp_ns == 0:
        return because.DEVICE_FAULTS_NEVER_RECEIVED(device=device)
    if _young(t_ns - stamp_ns, limit_s):
        return None
    return because.DEVICE_FAULTS_STALE(device=device, age_s=(t_ns - stamp_ns) * NS)


def _young(age_ns: int, limit_s: float) -> bool:
    return 0 <= age_ns * NS <= limit_s
