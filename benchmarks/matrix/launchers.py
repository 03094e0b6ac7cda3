"""The launchers of a run: the shipped one, the same with SPARKs, and one that belongs to another controller."""

from msgspec.structs import replace

from truearc.hw.devices.advisory import AdvisoryConfig
from truearc.hw.devices.spark.family import SparkConfig
from truearc.robot.config.schema import Axes, Config

WHEEL = SparkConfig(device=11, direction=1, has_endstop=False, stall_torque_nm=2.6, free_speed_rad_s=594.0,
                    rated_v=12.0)
SPARKS = Axes((WHEEL, replace(WHEEL, device=12, direction=-1)), replace(WHEEL, device=3, has_endstop=True),
              replace(WHEEL, device=14, stall_torque_nm=0.7, free_speed_rad_s=1000.0))


def with_launcher(config: Config, launcher: str) -> Config:
    """`config` with the axes of "odrive", "spark" (also with a feed as long as the shipped one's) or "advisory"."""
    match launcher:
        case "spark":
            return replace(config, axes=SPARKS)
        case "spark, long feed":
            return replace(config, axes=SPARKS, feeder=replace(config.feeder, feed_s=0.25, clear_s=0.35))
        case "advisory":
            theirs = Axes(tuple(_heard(axis) for axis in (WHEEL, SPARKS.flywheels[1])), _heard(SPARKS.hood),
                          _heard(SPARKS.feeder))
            return replace(config, axes=theirs, hood_encoder=replace(config.hood_encoder, period_ms=0))
    return config


def _heard(axis: object) -> AdvisoryConfig:
    assert isinstance(axis, SparkConfig)
    return AdvisoryConfig("spark", axis.device, axis.direction, axis.has_endstop)
