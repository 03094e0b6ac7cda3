"""Frames that a SPARK may be sent, and those that it and hosts send."""

from collections.abc import Mapping

from msgspec.structs import replace

from truearc.hw.devices.bus_rules import NS_PER_MS, Rules, allow_seldom, kinds_of
from truearc.hw.devices.spark import frames as spark
from truearc.hw.tx_allowlist import allow

PULSE_NS = 10 * NS_PER_MS             # STATUS_0: how often a device says how it is; its maker's own setting


def make_rules(axis: spark.SparkAxis, each_tick: int) -> Rules:
    """`each_tick`: how often within WINDOW_NS a frame may be sent that each tick sends once."""
    allowed = (allow(spark.make_duty(axis, 0.0), each_tick), allow(spark.make_heartbeat(()), each_tick),
               # twice: it may have reset
               allow(spark.make_setting(axis, spark.IDLE_MODE, 0.0), 2 * len(spark.PARAMETERS)),
               *allow_seldom([spark.make_statuses(axis, spark.STATUSES), spark.make_clear_faults(axis),
                              spark.make_version_query(axis)]))
    by_host, by_device = (kinds_of(spark.ids_sent_by(axis, node), True) for node in ("Host", "Spark"))
    return Rules(allowed, by_host, by_device, {(spark.frame_id(axis, "STATUS_0"), True, False): PULSE_NS})


def make_encoder_rules(axis: spark.SparkAxis, settings: Mapping[int, float] | None, each_tick: int) -> Rules:
    """Of a SPARK that has the encoder on its data port; settings: of that, None where nothing is sent to it."""
    if settings is None:
        return replace(make_rules(axis, each_tick), allowed=())
    parameter, value = next(iter(settings.items()))
    allowed = (allow(spark.make_setting(axis, parameter, value), 2 * len(settings)),
               *allow_seldom([spark.make_statuses(axis, spark.ENCODER_STATUSES), spark.make_version_query(axis)]))
    return replace(make_rules(axis, each_tick), allowed=allowed)
