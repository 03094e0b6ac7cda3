"""Every kind of hood encoder, by the `driver` of [hood_encoder]."""

from types import MappingProxyType
from typing import Any

from truearc.hw.devices.canandmag import CANANDMAG
from truearc.hw.devices.family import EncoderFamily, HoodEncoder, driver_of
from truearc.hw.devices.motor_encoder import MOTOR, NONE
from truearc.hw.devices.spark.encoder import SPARK_ENCODER
from truearc.robot.nt_encoder import NT4

FAMILIES: tuple[EncoderFamily[Any], ...] = (CANANDMAG, SPARK_ENCODER, MOTOR, NT4, NONE)
BY_DRIVER = MappingProxyType({family.driver: family for family in FAMILIES})


def encoder_family_of(table: HoodEncoder) -> EncoderFamily[Any]:
    """The family whose table this is."""
    return BY_DRIVER[driver_of(table)]
