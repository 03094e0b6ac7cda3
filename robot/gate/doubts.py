"""Doubts about readings: missing, stale or faulty ones of the motors and the hood's encoder, by axis."""

import math

from msgspec import UNSET, UnsetType

from truearc.hw.devices.family import Axis
from truearc.hw.devices.registry import family_of
from truearc.hw.protocols import AngleReading, MotorReading
from truearc.hw.reason import Reason
from truearc.robot import reasons as because
from truearc.robot.config.schema import Config, GateConfig
from truearc.robot.hood_encoders import encoder_family_of
from truearc.robot.motors import FEEDER_MOTOR, HOOD_MOTOR, name_wheel
from truearc.robot.types import Inputs

NS = 1e-9
HEARTBEAT_S = 0.25                    # axes, and the hood's encoder, say how they are every 0.1 s; two may be lost
ERRORS_S = 1.0                        # a SPARK says its errors every 0.25 s; three may be lost
ENCODER = "hood encoder"
Doubts = tuple[list[Reason], list[Reason], list[Reason]]        # of the wheels, the hood, the feeder


def doubt_axes(inputs: Inputs, config: Config) -> Doubts:
    """Reasons from missing, stale or faulty readings of the motors and the hood's encoder, by axis."""
    t_ns, gate, axes = inputs.t_ns, config.gate, config.axes
    found: list[Reason] = []
    for number, (axis, motor) in enumerate(zip(axes.flywheels, inputs.flywheels, strict=True), 1):
        if doubts := _motor(number, axis, motor, t_ns, gate):
            found += doubts
    of_hood = _motor(HOOD_MOTOR, axes.hood, inputs.hood_motor, t_ns, gate)
    if config.hood_encoder.is_heard and (doubts := _encoder(inputs.hood_angle, t_ns, config)):
        of_hood = of_hood + doubts
    return found, of_hood, _motor(FEEDER_MOTOR, axes.feeder, inputs.feeder, t_ns, gate)


def doubted_readings(inputs: Inputs, config: Config) -> list[Reason]:
    """The same in one list."""
    wheels, hood, feeder = doubt_axes(inputs, config)
    return [*wheels, *hood, *feeder]


def _encoder(angle: AngleReading | None, t_ns: int, config: Config) -> list[Reason]:
    if angle is None:
        return [because.DEVICE_NEVER_RECEIVED(device=ENCODER)]
    if not _young(t_ns - angle.t_ns, config.gate.reading_age_s):
        return [because.DEVICE_STALE(device=ENCODER, age_s=(t_ns - angle.t_ns) * NS)]
    missing = _no_fault_report(ENCODER, angle.faults_t_ns, t_ns, HEARTBEAT_S)
    found = [] if missing is None else [missing]
    if errors := tuple(encoder_family_of(config.hood_encoder).errors(config.hood_encoder, angle.faults)):
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
    if not (math.isfinite(motor.position_rad) and math.isfinite(motor.velocity_rad_s)
            and math.isfinite(motor.current_a) and math.isfinite(motor.bus_v)):
        return [*found, because.MOTOR_NOT_FINITE(motor=_name(which))]
    family = family_of(axis)
    if errors := family.errors(axis, motor):
        return [*found, because.MOTOR_ERROR(motor=_name(which), errors=errors)]
    if not family.is_driven(axis, motor):
        return [*found, because.MOTOR_NOT_DRIVEN(motor=_name(which), state=motor.axis_state)]
    return found


def _name(which: str | int) -> str:
    return which if isinstance(which, str) else name_wheel(which)


def _no_fault_report(device: str, stamp_ns: int | UnsetType, t_ns: int, limit_s: float) -> Reason | None:
    """Whether a report that must come is missing; None when it has come, and where none must."""
    if stamp_ns is UNSET:
        return None
    if stamp_ns == 0:
        return because.DEVICE_FAULTS_NEVER_RECEIVED(device=device)
    if _young(t_ns - stamp_ns, limit_s):
        return None
    return because.DEVICE_FAULTS_STALE(device=device, age_s=(t_ns - stamp_ns) * NS)


def _young(age_ns: int, limit_s: float) -> bool:
    return 0 <= age_ns * NS <= limit_s
