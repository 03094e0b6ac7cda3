"""What other distributions read and show while the robot runs, by their tables of launcher.toml."""

from collections.abc import Callable, Iterable
from contextlib import ExitStack
from pathlib import Path
from typing import Protocol

from truearc.hw.devices.family import Finding
from truearc.hw.protocols import Clock
from truearc.robot.config.reading_tables import find_table
from truearc.robot.config.schema import Config
from truearc.robot.eyes import Eyes
from truearc.robot.runtime import RobotIo, Screen, Screens

Layer = Callable[[RobotIo], RobotIo]


class OwnEyes(Eyes, Protocol):
    """Eyes with a connection of their own, to be closed."""

    def close(self) -> None: ...


class Source:
    """What reads one table's data; a subclass overrides what it has. config: one that has the table."""

    def __init__(self, config: Config) -> None:
        self.config = config

    def open_eyes(self, clock: Clock) -> OwnEyes | None:
        """The camera of its `vision`; None without one. In the vision process, where there is one."""
        return None

    def open_layer(self, wires: ExitStack, is_apart: bool) -> Layer | None:
        """What adds to the inputs of each tick; None for nothing. In the control process, and never waits.

        Args:
            wires: Closes what is opened.
            is_apart: The control process may not read a network itself: a process of its own is to.
        """
        return None

    def open_screen(self, gate_path: Path | None, clock: Clock | None) -> Screen | None:
        """What shows ticks; None for nothing. In the recorder process, where there is one.

        Args:
            gate_path: Model that is asked for the novelty of a shot; None: there is none.
            clock: That of the ticks; None where time passes otherwise.
        """
        return None

    def findings(self) -> Iterable[Finding]:
        """What the doctor says of it."""
        return ()


def sources_of(config: Config) -> tuple[Source, ...]:
    """One for each table of another distribution."""
    return tuple(find_table(name).source(config) for name in config.readings)


def open_eyes(config: Config, clock: Clock) -> OwnEyes | None:
    """The camera that sees instead of [camera]'s; None where there is none."""
    eyes = (source.open_eyes(clock) for source in sources_of(config))
    return next((one for one in eyes if one is not None), None)


def open_their_screens(config: Config, gate_path: Path | None, own_time: bool, clock: Clock) -> Screen | None:
    """All screens of other distributions as one; own_time: the ticks' time is another than that of `clock`."""
    told = None if own_time else clock
    screens = [source.open_screen(gate_path, told) for source in sources_of(config)]
    return Screens([one for one in screens if one is not None]) if any(screens) else None
