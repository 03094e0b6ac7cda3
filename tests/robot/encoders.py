"""Configurations with each hood encoder, and a well one's noise."""

from msgspec.structs import replace

from tests.robot.good_tick import CONFIG
from tests.robot.sparks import SPARK_HOOD
from truearc.hw.devices.family import HoodEncoder
from truearc.hw.devices.odrive.family import OdriveConfig
from truearc.hw.devices.registry import MotorEncoderConfig, NoEncoder
from truearc.hw.devices.spark.family import SparkConfig, SparkEncoderConfig
from truearc.robot.config.named_tables import ReadEncoder
from truearc.robot.config.schema import Config


def with_encoder(table: HoodEncoder, config: Config = CONFIG) -> Config:
    noise = replace(config.rig.noise, hood_deg=0.6)
    return replace(config, hood_encoder=table, rig=replace(config.rig, noise=noise))


NONE = with_encoder(NoEncoder())
SPARK = with_encoder(SparkEncoderConfig(7, 10, 40.0, -1))
SPARK_OWN = with_encoder(SparkEncoderConfig(3, 10, 350.0, 1), SPARK_HOOD)        # on the hood motor's own SPARK
ODRIVE = with_encoder(MotorEncoderConfig(OdriveConfig(6, -1, 0), 2.0, 33.0))
COUNTING = with_encoder(MotorEncoderConfig(SparkConfig(7, 1, False, 1.0, 500.0, 12.0), 3.0))
NT4 = replace(with_encoder(ReadEncoder("nt4", "/Hood/Rot", "rev", 90.0, -1)),
              readings={"nt4": {"server": "127.0.0.1:1"}})
