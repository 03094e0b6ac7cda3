"""The real robot's CAN bus, put together: an adapter that may come and go, and the configuration's rules on it."""

from collections import Counter
from contextlib import ExitStack

from truearc.hw.protocols import Bus, Clock
from truearc.hw.real.can_bus import open_can
from truearc.hw.real.supervised_bus import WAIT_S, SupervisedBus
from truearc.robot.config.can_policy import guard
from truearc.robot.config.schema import Config


def open_bus(config: Config, clock: Clock, wires: ExitStack, tally: Counter[str]) -> Bus:
    """To be closed by `wires`; LinkLost when it cannot be opened. `tally` counts what happens on it beside what
    should."""
    can = config.can
    supervised = SupervisedBus(
        lambda: open_can(can.interface, can.channel, can.bitrate, clock, WAIT_S, tally), clock, tally)
    wires.callback(supervised.close)
    return guard(supervised, config, clock, tally)
