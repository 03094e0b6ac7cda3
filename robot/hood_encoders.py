"""Every kind of hood encoder, by the `driver` of [hood_encoder]: devices, and readings of other distributions."""

import functools
from types import MappingProxyType
from typing import Any, Literal, NoReturn

from msgspec import Struct

from truearc.errors import ELSEWHERE, InputError, PluginError
from truearc.hw.devices.canandmag import CANANDMAG
from truearc.hw.devices.family import Direction, EncoderFamily, Finite, HoodEncoder, driver_of
from truearc.hw.devices.motor_encoder import MOTOR, NONE
from truearc.hw.devices.spark.encoder import SPARK_ENCODER
from truearc.robot.config.reading_tables import find_table, table_names

FAMILIES: tuple[EncoderFamily[Any], ...] = (CANANDMAG, SPARK_ENCODER, MOTOR, NONE)
BY_DRIVER = MappingProxyType({family.driver: family for family in FAMILIES})


class ReadEncoder(Struct, HoodEncoder, frozen=True, forbid_unknown_fields=True):
    """The hood's angle as another program publishes it, in each of its loops, equal values too."""

    driver: str                       # the table of launcher.toml that says where (truearc.readings)
    key: str
    unit: Literal["deg", "rad", "rev"]
    zero_deg: Finite                  # its value in degrees where the launch elevation is 0
    direction: Direction              # +1 if it grows with elevation


def _refuse(table: ReadEncoder, around: object) -> NoReturn:
    raise InputError(f"hood_encoder.driver: {table.driver!r} is of a distribution that is not installed")


# of a recording whose distribution is not installed: its angles are recorded, and nothing else is asked of it
RECORDED = EncoderFamily(
    driver="", table=ReadEncoder, example=ReadEncoder("", "", "deg", 0.0, 1), least_sigma_deg=0.0, make=_refuse,
    make_rules=lambda table, each_tick: (), questions=lambda table: (), examine=lambda table, around, heard: (),
    make_node=lambda table, plant, nodes: None, make_off_bus=_refuse)


def encoder_drivers() -> tuple[str, ...]:
    """Every driver that [hood_encoder] may name; no distribution is loaded."""
    return tuple(dict.fromkeys((*BY_DRIVER, *table_names())))


def encoder_table(driver: str, has_key: bool) -> type[HoodEncoder]:
    """The struct of [hood_encoder] with this driver, has_key: and with a key `key`.

    Raises:
        LookupError: there is no such driver. Any other distribution's reading may be in a recording.
    """
    if driver in BY_DRIVER or not (has_key or driver in ELSEWHERE or driver in table_names()):
        return BY_DRIVER[driver].table
    return ReadEncoder


def encoder_family_of(table: HoodEncoder) -> EncoderFamily[Any]:
    """The family whose table this is."""
    return _family_of(driver_of(table))


@functools.cache
def _family_of(driver: str) -> EncoderFamily[Any]:
    if driver in BY_DRIVER:
        return BY_DRIVER[driver]
    try:
        make = find_table(driver).encoder
    except (LookupError, PluginError):
        return RECORDED
    return RECORDED if make is None else make()
