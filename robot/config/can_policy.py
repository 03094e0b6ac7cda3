"""What the configuration says of the CAN bus: what may be sent and how often, what is heard, and in what cadence."""

import math
from collections import Counter
from collections.abc import Iterable

from msgspec import Struct

from truearc.hw.devices.canandmag import frames as canandmag
from truearc.hw.devices.odrive import frames as odrive
from truearc.hw.devices.spark import frames as spark
from truearc.hw.monitor import Kind, MonitoredBus
from truearc.hw.protocols import Bus, Clock, Frame
from truearc.hw.tx_allowlist import WINDOW_NS, Allowed, AllowedBus, allow
from truearc.robot.config.schema import AdvisoryAxis, Axis, Config, OdriveAxis, SparkAxis
from truearc.robot.motors import name_axes, odrive_axis, spark_axis

NS_PER_MS, NS_PER_S = 1_000_000, 1_000_000_000
SPARE = 1.5                           # a set point is sent once a tick at most, but after a late tick the next is early
SELDOM = 5                            # within WINDOW_NS, of what is asked a few times a second at most
ODRIVE_PULSE_NS = 100 * NS_PER_MS     # heartbeat: how often an axis says how it is; its maker's own setting
SPARK_PULSE_NS = 10 * NS_PER_MS       # STATUS_0, likewise


class Rules(Struct, frozen=True):
    """Of one device: what it may be sent, what hosts and it itself send, and one kind of its frames with its period."""

    allowed: tuple[Allowed, ...]
    by_host: tuple[Kind, ...]
    by_device: tuple[Kind, ...]
    pulse: dict[Kind, int]


def guard(bus: Bus, config: Config, clock: Clock, tally: Counter[str]) -> Bus:
    """`bus` with these rules on it: what breaks them is counted in `tally` and is a fault."""
    rules = make_rules(config)
    allowed = [kind for one in rules for kind in one.allowed]
    ours = {(kind.arbitration_id, kind.is_extended, kind.is_remote) for kind in allowed}
    # what we could send to our devices but never do is ours, too; an advisory one is another host's to command
    ours |= {kind for one in rules if one.allowed for kind in one.by_host}
    known = {kind for one in rules for kind in (*one.by_device, *one.by_host)} - ours
    pulses = {kind: period_ns for one in rules for kind, period_ns in one.pulse.items()}
    return MonitoredBus(AllowedBus(bus, allowed, clock, tally), known, ours, pulses, clock, tally)


def make_rules(config: Config) -> tuple[Rules, ...]:
    """Of every device of the launcher."""
    each_tick = math.ceil(SPARE * config.tick_hz * WINDOW_NS / NS_PER_S) + 1
    return (_encoder(config), *(_axis(axis, each_tick) for _, axis in name_axes(config)))


def _axis(axis: Axis, each_tick: int) -> Rules:
    match axis:
        case OdriveAxis():
            return _odrive(odrive_axis(axis), each_tick)
        case SparkAxis():
            return _spark(spark_axis(axis), each_tick)
        case AdvisoryAxis(listens_to="odrive"):
            theirs = _odrive(odrive.OdriveAxis(axis.device, axis.direction), each_tick)
        case AdvisoryAxis():
            theirs = _spark(spark.SparkAxis(axis.device, axis.direction, axis.has_endstop), each_tick)
    return Rules((), theirs.by_host, theirs.by_device, theirs.pulse)


def _odrive(axis: odrive.OdriveAxis, each_tick: int) -> Rules:
    seldom = [odrive.make_state(axis, odrive.IDLE), odrive.make_clear_errors(axis),
              odrive.make_controller_mode(axis, odrive.TORQUE, odrive.PASSTHROUGH), odrive.make_estop(axis),
              odrive.make_version_query(axis)]
    if axis.endstop_endpoint:
        seldom.append(odrive.make_endstop_query(axis))
    by_host, by_device = (_kinds(odrive.ids_sent_by(axis, node), False) for node in ("Host", "Axis"))
    return Rules((allow(odrive.make_torque(axis, 0.0), each_tick), *_seldom(seldom)), by_host, by_device,
                 {(odrive.heartbeat_id(axis), False, False): ODRIVE_PULSE_NS})


def _spark(axis: spark.SparkAxis, each_tick: int) -> Rules:
    settings = spark.settings(axis)
    parameter, value = next(iter(settings.items()))
    allowed = (allow(spark.make_duty(axis, 0.0), each_tick), allow(spark.make_heartbeat(()), each_tick),
               allow(spark.make_setting(axis, parameter, value), 2 * len(settings)),      # twice: it may have reset
               *_seldom([spark.make_statuses(axis, spark.STATUSES), spark.make_clear_faults(axis),
                         spark.make_version_query(axis)]))
    by_host, by_device = (_kinds(spark.ids_sent_by(axis, node), True) for node in ("Host", "Spark"))
    return Rules(allowed, by_host, by_device,
                 {(spark.frame_id(axis, "STATUS_0"), True, False): SPARK_PULSE_NS})


def _encoder(config: Config) -> Rules:
    device, period_ms = canandmag.Encoder(config.hood_encoder.device), config.hood_encoder.period_ms
    by_host, by_device = (_kinds(canandmag.ids_sent_by(device, node), True) for node in ("Host", "Encoder"))
    if not period_ms:                 # nothing is sent to it, and its cadence is another's to say
        return Rules((), by_host, by_device, {})
    return Rules(tuple(_seldom([canandmag.make_position_period(device, period_ms)])), by_host, by_device,
                 {(canandmag.frame_ids(device)[0], True, False): period_ms * NS_PER_MS})


def _seldom(frames: Iterable[Frame]) -> list[Allowed]:
    return [allow(frame, SELDOM) for frame in frames]


def _kinds(frame_ids: Iterable[int], is_extended: bool) -> tuple[Kind, ...]:
    return tuple((frame_id, is_extended, False) for frame_id in frame_ids)
