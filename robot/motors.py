"""The motor axes of the configuration, their names and drivers; what its hood encoder needs of it."""

import math

from truearc.errors import InputError
from truearc.hw.devices.axis import Axis, Bounds
from truearc.hw.devices.hood_encoder import Around
from truearc.hw.devices.registry import family_of
from truearc.hw.protocols import Motor
from truearc.robot.config.schema import Config
from truearc.robot.geometry import screw_length_m

HOOD_OVERSPEED = 1.5                  # times the hood's speed limit, which its loop keeps to a fifth: it is released

HOOD_MOTOR, FEEDER_MOTOR = "hood motor", "feeder motor"


def name_axes(config: Config) -> tuple[tuple[str, Axis], ...]:
    """Every motor axis and what it is called: the flywheels, the hood, the feeder."""
    wheels = ((name_wheel(number), axis) for number, axis in enumerate(config.axes.flywheels, 1))
    return (*wheels, (HOOD_MOTOR, config.axes.hood), (FEEDER_MOTOR, config.axes.feeder))


def name_wheel(number: int) -> str:
    """What a flywheel's motor is called; they are numbered from 1."""
    return f"flywheel motor {number}"


def make_motors(config: Config) -> tuple[Motor, ...]:
    """The axes' drivers, in the order of `name_axes`; InputError names two axes that are one device."""
    names, axes = zip(*name_axes(config), strict=True)
    made: dict[int, Motor] = {}
    bounds = bound_axes(config)
    for family in dict.fromkeys(map(family_of, axes)):
        places = [place for place, axis in enumerate(axes) if family_of(axis) is family]
        of_family = family.make_motors([axes[place] for place in places], [bounds[place] for place in places])
        made |= zip(places, of_family, strict=True)
    motors = tuple(made[place] for place in range(len(axes)))
    owner: dict[tuple[int, bool], str] = {}
    for name, motor in zip(names, motors, strict=True):
        for key in motor.ids():
            if owner.setdefault(key, name) != name:
                raise InputError(f"axes: {owner[key]} and {name} are the same device (CAN frame 0x{key[0]:x})")
    return motors


def bound_axes(config: Config) -> tuple[Bounds, ...]:
    """What each axis never exceeds while all is well, in the order of `name_axes`; the tick's interlocks act before.

    Wheels coast, and the hood brakes, when they are let go. Nothing is known of the feeder's speed, nor of how it is
    best stopped.
    """
    wheels, hood = config.flywheel.pid, config.hood
    free_rad_s = config.rig.launcher.free_speed_rad_s
    asked_nm = max(map(abs, (hood.pid.output_low, hood.pid.output_high, hood.homing_torque_nm)))
    return (*[Bounds(free_rad_s, max(abs(wheels.output_low), abs(wheels.output_high)), False)]
            * len(config.axes.flywheels), Bounds(_hood_top_rad_s(config), asked_nm, True),
            Bounds(None, abs(config.feeder.torque_nm), None))


def _hood_top_rad_s(config: Config) -> float:
    """Speed of the hood's motor at which its interlock acts, where the hood's lever is longest, or that of sysid."""
    hood = config.hood
    highest = max(hood.low_deg + 1.0, hood.high_deg)
    degrees = [hood.low_deg + at for at in range(math.ceil(highest - hood.low_deg))]
    turns_deg = max(screw_length_m(deg + 1.0, hood) - screw_length_m(deg, hood) for deg in degrees) / (
        hood.screw_lead_m * hood.screw_gear)
    asked_rad_s = 0.0 if config.identify is None else config.identify.hood.top_rad_s
    return HOOD_OVERSPEED * max(math.tau * turns_deg * hood.max_deg_s, asked_rad_s)


def around_encoder(config: Config) -> Around:
    """The part of the configuration beside its own table that the hood's encoder may need."""
    return Around(config.gate.reading_age_s, config.readings)
