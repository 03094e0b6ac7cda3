"""Rules of the CAN bus from the configuration: frames that may be sent, how often, frames received, their periods."""

import math
from collections import Counter

from truearc.hw.bus_rules import WINDOW_NS, AllowedBus, MonitoredBus, Rules
from truearc.hw.devices.registry import family_of
from truearc.hw.protocols import Bus, Clock
from truearc.robot.config.schema import Config
from truearc.robot.hood_encoders import encoder_family_of
from truearc.robot.motors import name_axes

NS_PER_S = 1_000_000_000
SPARE = 1.5                           # a set point is sent once a tick at most, but after a late tick the next is early


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
    encoder = config.hood_encoder
    return (*encoder_family_of(encoder).make_rules(encoder, each_tick),
            *(family_of(axis).make_rules(axis, each_tick) for _, axis in name_axes(config)))
