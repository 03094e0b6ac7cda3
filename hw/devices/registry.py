"""Every family of motor controllers: those of this package, and those of installed distributions.

A distribution names its MotorFamily by its driver. It is loaded when a configuration first names that driver, before
the first tick:

    [project.entry-points."truearc.motors"]
    samplemotor = "truearc_samplemotor:SAMPLEMOTOR"
"""

import functools
from importlib.metadata import entry_points
from types import MappingProxyType
from typing import Any

from truearc.errors import PluginError, load_plugin, only_point, place_of
from truearc.hw.devices.advisory import ADVISORY
from truearc.hw.devices.family import Axis, MotorFamily, driver_of
from truearc.hw.devices.odrive.family import ODRIVE
from truearc.hw.devices.spark.family import SPARK
from truearc.hw.reason import Message

GROUP = "truearc.motors"
FAMILIES: tuple[MotorFamily[Any], ...] = (ODRIVE, SPARK, ADVISORY)
BY_DRIVER = MappingProxyType({family.driver: family for family in FAMILIES})


_BY_TABLE: dict[type[Axis], MotorFamily[Any]] = {}


def family_of(axis: Axis) -> MotorFamily[Any]:
    """The family whose table this is; raises as find_family."""
    table = axis.__class__
    if table not in _BY_TABLE:        # called in the tick
        _BY_TABLE[table] = find_family(driver_of(axis))
    return _BY_TABLE[table]


def find_family(driver: str) -> MotorFamily[Any]:
    """The family of this name.

    Raises:
        LookupError: there is none.
        PluginError: its distribution is broken, or is not the only one of that name.
    """
    return BY_DRIVER[driver] if driver in BY_DRIVER else _load(driver)


def drivers() -> tuple[str, ...]:
    """Names of all families, without loading those of distributions."""
    return tuple(dict.fromkeys((*BY_DRIVER, *sorted(point.name for point in entry_points(group=GROUP)))))


@functools.cache
def find_messages(code: str) -> tuple[Message, ...]:
    """Messages for a code "DRIVER.WHAT" of a distribution's family; () for any other, and where it cannot be loaded."""
    driver, dot, _ = code.partition(".")
    try:
        return tuple(message for message in _load(driver).messages if message.code.name == code) if dot else ()
    except (LookupError, PluginError):
        return ()


@functools.cache
def _load(driver: str) -> MotorFamily[Any]:
    point = only_point(tuple(entry_points(group=GROUP, name=driver)), driver)
    family = load_plugin(point)
    if not (isinstance(family, MotorFamily) and issubclass(family.axis, Axis)
            and family.driver == driver_of(family.example) == driver):
        raise PluginError(f"{place_of(point)}: is not a MotorFamily whose driver and tag are {driver!r}")
    for message in family.messages:
        if not message.code.name.startswith(f"{driver}."):
            raise PluginError(f"{place_of(point)}: reason {message.code.name!r} must be named '{driver}.WHAT'")
    return family
