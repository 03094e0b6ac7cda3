"""The motor axes of the configuration, their names and drivers; what its hood encoder needs of it."""

from truearc.hw.devices.axis import Axis
from truearc.hw.devices.hood_encoder import Around
from truearc.hw.devices.registry import family_of
from truearc.hw.protocols import Motor
from truearc.robot.config.schema import Config, InputError

HOOD_MOTOR = "hood motor"


def name_axes(config: Config) -> tuple[tuple[str, Axis], ...]:
    """Every motor axis and what it is called: the flywheels, the hood, the feeder."""
    wheels = ((f"flywheel motor {number}", axis) for number, axis in enumerate(config.axes.flywheels, 1))
    return (*wheels, (HOOD_MOTOR, config.axes.hood), ("feeder motor", config.axes.feeder))


def make_motors(config: Config) -> tuple[Motor, ...]:
    """The axes' drivers, in the order of `name_axes`; InputError names two axes that are one device."""
    names, axes = zip(*name_axes(config), strict=True)
    made: dict[int, Motor] = {}
    for family in dict.fromkeys(map(family_of, axes)):
        places = [place for place, axis in enumerate(axes) if family_of(axis) is family]
        made |= zip(places, family.make_motors([axes[place] for place in places]), strict=True)
    motors = tuple(made[place] for place in range(len(axes)))
    owner: dict[tuple[int, bool], str] = {}
    for name, motor in zip(names, motors, strict=True):
        for key in motor.ids():
            if owner.setdefault(key, name) != name:
                raise InputError(f"axes: {owner[key]} and {name} are the same device (CAN frame 0x{key[0]:x})")
    return motors


def around_encoder(config: Config) -> Around:
    """The part of the configuration beside its own table that the hood's encoder may need."""
    return Around(config.gate.reading_age_s, "" if config.nt4 is None else config.nt4.server)
