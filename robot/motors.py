"""The launcher's motor axes: their names, drivers, limits and bus rules, and the geometry of the hood's screw."""

import math
from collections import Counter

from truearc.errors import InputError
from truearc.hw.bus_rules import WINDOW_NS, AllowedBus, MonitoredBus, Rules
from truearc.hw.devices.family import Around, Axis, Bounds, HoodEncoder
from truearc.hw.devices.registry import family_of
from truearc.hw.protocols import NS_PER_S, Bus, Clock, Motor
from truearc.robot.config.named_tables import encoder_family_of
from truearc.robot.config.schema import CameraConfig, Config, Hood

# --- the hood's screw

def screw_length_m(elevation_deg: float, hood: Hood) -> float:
    """Return the distance from the screw motor's pivot to the nut at a launch elevation."""
    a, b = hood.pivot_to_motor_m, hood.pivot_to_nut_m
    included = math.radians(hood.included_deg + elevation_deg)
    return math.sqrt(a * a + b * b - 2.0 * a * b * math.cos(included))       # law of cosines


def elevation_from_screw_deg(turned_rad: float, hood: Hood) -> float | None:
    """Return the launch elevation for this turn of the screw motor up from the limit switch; None beyond the
    linkage."""
    a, b = hood.pivot_to_motor_m, hood.pivot_to_nut_m
    squares, twice = a * a + b * b, 2.0 * a * b
    lowest = math.sqrt(squares - twice * math.cos(math.radians(hood.included_deg + hood.low_deg)))
    length = lowest + turned_rad * hood.screw_gear * hood.screw_lead_m / math.tau
    cosine = (squares - length * length) / twice
    if not -1.0 <= cosine <= 1.0:
        return None
    return math.degrees(math.acos(cosine)) - hood.included_deg


def within_travel(elevation_deg: float, hood: Hood) -> float:
    """Return the elevation, or the end of the hood's travel that is nearest to it."""
    return (hood.low_deg if elevation_deg < hood.low_deg else
            hood.high_deg if elevation_deg > hood.high_deg else elevation_deg)


def elevation_per_rad(elevation_deg: float, hood: Hood) -> float:
    """Return degrees of elevation per radian of the screw motor, at a launch elevation."""
    included, a, b = math.radians(hood.included_deg + elevation_deg), hood.pivot_to_motor_m, hood.pivot_to_nut_m
    length = math.sqrt(a * a + b * b - 2.0 * a * b * math.cos(included))     # as screw_length_m, in one call
    return math.degrees(hood.screw_gear * hood.screw_lead_m / math.tau / (a * b * math.sin(included) / length))


def screw_rad(elevation_deg: float, hood: Hood) -> float:
    """Return how far the screw motor has turned up from the limit switch at a launch elevation."""
    travel_m = screw_length_m(elevation_deg, hood) - screw_length_m(hood.low_deg, hood)
    return travel_m / (hood.screw_gear * hood.screw_lead_m) * 2.0 * math.pi


def screw_travel_rad(hood: Hood) -> float:
    """Return how far the screw motor turns from the hood's lowest elevation to its highest."""
    return screw_rad(hood.high_deg, hood)


def elevation_from_encoder_deg(angle_rad: float, encoder: HoodEncoder, zero_deg: float) -> float:
    """Return the launch elevation from the encoder on the hood pivot, in (-180, 180]; zero_deg: its reading at 0."""
    turned = (math.degrees(angle_rad) - zero_deg) * encoder.direction
    return 180.0 - (180.0 - turned) % 360.0


def exit_distance_m(lens_distance_m: float, camera: CameraConfig) -> float:
    """Return the horizontal distance from the ball's exit to the target plane, given that from the lens."""
    return lens_distance_m - camera.behind_exit_m


# --- axes

HOOD_OVERSPEED = 1.5                  # times the hood's speed limit, which its loop keeps to a fifth: it is released

HOOD_MOTOR, FEEDER_MOTOR = "hood motor", "feeder motor"


def name_axes(config: Config) -> tuple[tuple[str, Axis], ...]:
    """Return every motor axis with its name: the flywheels, the hood, the feeder."""
    wheels = ((name_wheel(number), axis) for number, axis in enumerate(config.axes.flywheels, 1))
    return (*wheels, (HOOD_MOTOR, config.axes.hood), (FEEDER_MOTOR, config.axes.feeder))


def name_wheel(number: int) -> str:
    """Return the name of a flywheel's motor; they are numbered from 1."""
    return f"flywheel motor {number}"


def make_motors(config: Config) -> tuple[Motor, ...]:
    """Return the axes' drivers, in the order of `name_axes`; InputError names two axes that are one device."""
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
    """Return what each axis never exceeds in normal operation, in the order of `name_axes`; interlocks act earlier.

    Wheels coast, and the hood brakes, when released. Nothing is known of the feeder's speed or the best way to stop it.
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
    """Return the part of the configuration, besides its own table, that the hood's encoder may need."""
    return Around(config.gate.reading_age_s, config.readings)


# --- rules of the bus

SPARE = 1.5                           # a set point is sent once a tick at most, but after a late tick the next is early


def guard(bus: Bus, config: Config, clock: Clock, tally: Counter[str]) -> Bus:
    """Return `bus` with these rules: a violation is counted in `tally` and is a fault."""
    rules = make_rules(config)
    allowed = [kind for one in rules for kind in one.allowed]
    ours = {(kind.arbitration_id, kind.is_extended, kind.is_remote) for kind in allowed}
    # what we could send to our devices but never do is ours, too; an advisory one is another host's to command
    ours |= {kind for one in rules if one.allowed for kind in one.by_host}
    known = {kind for one in rules for kind in (*one.by_device, *one.by_host)} - ours
    pulses = {kind: period_ns for one in rules for kind, period_ns in one.pulse.items()}
    return MonitoredBus(AllowedBus(bus, allowed, clock, tally), known, ours, pulses, clock, tally)


def make_rules(config: Config) -> tuple[Rules, ...]:
    """Return the rules of every device of the launcher."""
    each_tick = math.ceil(SPARE * config.tick_hz * WINDOW_NS / NS_PER_S) + 1
    encoder = config.hood_encoder
    return (*encoder_family_of(encoder).make_rules(encoder, each_tick),
            *(family_of(axis).make_rules(axis, each_tick) for _, axis in name_axes(config)))
