"""Axes of other drivers, for configurations in which they take the place of ODrives."""

from msgspec.structs import replace

from tests.robot.good_tick import CONFIG
from truearc.hw.devices.registry import AdvisoryConfig
from truearc.hw.devices.spark.family import SparkConfig
from truearc.robot.config.schema import Config

HOOD = SparkConfig(device=3, direction=1, has_endstop=True, stall_torque_nm=2.6, free_speed_rad_s=594.0, rated_v=12.0)
LEFT = replace(HOOD, device=11, has_endstop=False)
RIGHT = replace(HOOD, device=12, direction=-1, has_endstop=False)
FEEDER = replace(LEFT, device=14, stall_torque_nm=0.7, free_speed_rad_s=1000.0)

SPARK_HOOD = replace(CONFIG, axes=replace(CONFIG.axes, hood=HOOD))
SPARK_WHEELS = replace(CONFIG, axes=replace(CONFIG.axes, flywheels=(LEFT, RIGHT)))
ALL_SPARK = replace(CONFIG, axes=replace(CONFIG.axes, flywheels=(LEFT, RIGHT), hood=HOOD, feeder=FEEDER))


def only_advice(listens_to: str) -> Config:
    """All axes belong to another host, and nothing is sent to the hood's encoder either."""
    def heard(device: int, direction: int = 1) -> AdvisoryConfig:
        return AdvisoryConfig(listens_to=listens_to, device=device, direction=direction,
                            has_endstop=device == 3 and listens_to == "spark")

    axes = replace(CONFIG.axes, flywheels=(heard(11), heard(12, -1)), hood=heard(3), feeder=heard(14))
    return replace(CONFIG, axes=axes, hood_encoder=replace(CONFIG.hood_encoder, period_ms=0))
