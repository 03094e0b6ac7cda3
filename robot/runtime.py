"""The control loop (read -> tick -> write -> record) that robot, emulation and replay share, and the layers around it.

A layer shows ticks on the operator page, measures their lateness, or feeds the watchdog of the service that started the
loop. The times come with the ticks; no clock is read here.
"""

from bisect import bisect_left
from collections.abc import Callable, Sequence
from itertools import accumulate
from typing import Any, Protocol, runtime_checkable

from msgspec import Struct

from truearc.hw.protocols import NS_PER_S, CameraFrame, Clock
from truearc.robot.config.schema import Config
from truearc.robot.estimate import doubted_readings
from truearc.robot.gate import Gate
from truearc.robot.reasons import DEVICE_HEARTBEAT_STALE, DEVICE_NEVER_RECEIVED, DEVICE_STALE, text
from truearc.robot.tick import step
from truearc.robot.types import Command, Inputs, Memory, Sent, Tick

Think = Callable[[Inputs, Memory, Config, Gate | None], Tick]


class RobotIo(Protocol):
    """A source of inputs that takes commands."""

    def read(self) -> Inputs | None:
        """Return the next tick's inputs, when they are due; None when there will be no more."""

    def write(self, command: Command) -> Sent: ...

    def picture(self) -> CameraFrame | None:
        """Return the newest camera image, if this rig has one."""


class RigLayer:
    """A RobotIo around another that passes everything on; a layer on top overrides what it sees or changes."""

    def __init__(self, rig: RobotIo) -> None:
        self._rig = rig

    def write(self, command: Command) -> Sent:
        return self._rig.write(command)

    def picture(self) -> CameraFrame | None:
        return self._rig.picture()


class Recorder(Protocol):
    """A keeper of ticks. Never blocks the loop."""

    def record(self, tick: Tick, sent: Sent) -> None: ...

    def keep_picture(self, picture: CameraFrame) -> None: ...


def run(rig: RobotIo, config: Config, gate: Gate | None, recorder: Recorder, think: Think = step) -> int:
    """Run until the rig is over; return the number of ticks. `think` is what one tick does; by default, launching."""
    memory = Memory()
    ticks = 0
    while (inputs := rig.read()) is not None:
        tick = think(inputs, memory, config, gate)
        recorder.record(tick, rig.write(tick.command))
        if tick.shot is not None and (picture := rig.picture()) is not None:
            recorder.keep_picture(picture)
        memory = tick.memory
        ticks += 1
    return ticks


class Screen(Protocol):
    """Shows ticks; `show` only keeps one, and never blocks."""

    def show(self, tick: Tick) -> None: ...

    def close(self) -> None: ...


@runtime_checkable
class SeeingScreen(Protocol):
    """A screen that also shows camera pictures: (sighting, image) of a call, None if there is none."""

    def see(self, look: Callable[[], Any]) -> None: ...


OpenScreen = Callable[[Clock], Screen | None]     # can be pickled: whichever process shows it calls it


class Screens:
    """Several screens as one."""

    def __init__(self, screens: Sequence[Screen]) -> None:
        self._screens = screens

    def show(self, tick: Tick) -> None:
        for screen in self._screens:
            screen.show(tick)

    def see(self, look: Callable[[], Any]) -> None:
        """Show camera pictures of `look` on the screens that can."""
        for screen in self._screens:
            if isinstance(screen, SeeingScreen):
                screen.see(look)

    def close(self) -> None:
        for screen in self._screens:
            screen.close()


def open_screens(openers: Sequence[OpenScreen], clock: Clock) -> Screen | None:
    """Open all screens that can be opened; None if there are none."""
    screens = [screen for screen in (opener(clock) for opener in openers) if screen is not None]
    return Screens(screens) if screens else None


class ShowingRecorder:
    """A Recorder that also shows each tick."""

    def __init__(self, recorder: Recorder, screen: Screen) -> None:
        self._recorder, self._screen = recorder, screen

    def record(self, tick: Tick, sent: Sent) -> None:
        self._recorder.record(tick, sent)
        self._screen.show(tick)

    def keep_picture(self, picture: CameraFrame) -> None:
        self._recorder.keep_picture(picture)


def with_screen(recorder: Recorder, screen: Screen | None) -> Recorder:
    """Return `recorder`, whose ticks are shown if there is a screen."""
    return recorder if screen is None else ShowingRecorder(recorder, screen)


AT_MOST_US = (50, 100, 200, 500, 1000, 2000, 5000, 10_000, 20_000)    # one more count holds what is later still
BAR = 40                              # characters
NOT_FRESH = {code.name for code in (DEVICE_NEVER_RECEIVED, DEVICE_STALE, DEVICE_HEARTBEAT_STALE)}
ALIVE_NS = 100_000_000                # how often the watchdog is fed; it wants to hear it once a second


class Second(Struct, frozen=True):
    """One line of lateness.jsonl: the ticks of about a second."""

    t_ns: int                         # of the last of them
    worst_us: float
    at_most_us: tuple[int, ...]       # upper edge of each count but the last, which has none
    counts: tuple[int, ...]


class DueRig(RobotIo, Protocol):
    """A rig that knows how late its newest tick was."""

    late_ns: int


class Lateness:
    """Counts ticks by how late they were; each second's counts go to `keep`. `period_ns`: between ticks."""

    def __init__(self, keep: Callable[[Second], None], period_ns: int) -> None:
        self._keep, self._period_ns = keep, period_ns
        self._counts, self._worst_us = [0] * (len(AT_MOST_US) + 1), 0.0
        self._began_ns: int | None = None
        self._t_ns = 0
        self._totals, self._worst_of_all_us, self._missed = [0] * len(self._counts), 0.0, 0

    def note(self, t_ns: int, late_ns: int) -> None:
        """Count one tick at `t_ns` that was due `late_ns` earlier."""
        if self._began_ns is not None and t_ns - self._began_ns >= NS_PER_S:
            self.close()
        if self._began_ns is None:
            self._began_ns = t_ns
        late_us = late_ns / 1000
        self._counts[bisect_left(AT_MOST_US, late_us)] += 1
        self._worst_us = max(self._worst_us, late_us)
        self._missed += late_ns >= self._period_ns
        self._t_ns = t_ns

    def close(self) -> None:
        """Pass on what has been counted since the last whole second."""
        if self._began_ns is None:
            return
        self._keep(Second(self._t_ns, self._worst_us, AT_MOST_US, tuple(self._counts)))
        self._totals = [a + b for a, b in zip(self._totals, self._counts, strict=True)]
        self._worst_of_all_us = max(self._worst_of_all_us, self._worst_us)
        self._counts, self._worst_us, self._began_ns = [0] * len(self._counts), 0.0, None

    def lines(self) -> list[str]:
        """The closed seconds as a sentence and as bars; empty before the first tick."""
        ticks = sum(self._totals)
        if not ticks:
            return []
        edges = [f"<= {edge / 1000:g} ms" for edge in AT_MOST_US] + [f" > {AT_MOST_US[-1] / 1000:g} ms"]
        return [f"ticks came late by at most {_quantile(self._totals, 0.5)} (half of them), "
                f"{_quantile(self._totals, 0.99)} (99 of 100), {self._worst_of_all_us / 1000:.2f} ms (all); "
                f"{self._missed} of {ticks} by a whole tick or more",
                *(f"  {edge:>10s} {count:9d} {'#' * -(-BAR * count // ticks)}"
                  for edge, count in zip(edges, self._totals, strict=True) if count)]


class TimedRig(RigLayer):
    """Passes everything through, and notes how late each tick was; the first one cannot be late."""

    def __init__(self, rig: DueRig, lateness: Lateness) -> None:
        super().__init__(rig)
        self._due, self._lateness = rig, lateness

    def read(self) -> Inputs | None:
        inputs = self._rig.read()
        if inputs is not None and inputs.cycle > 1:
            self._lateness.note(inputs.t_ns, self._due.late_ns)
        return inputs


def _quantile(totals: list[int], share: float) -> str:
    """The upper edge of the count in which the tick lies."""
    place = bisect_left(list(accumulate(totals)), share * sum(totals))
    return f"{AT_MOST_US[place] / 1000:g} ms" if place < len(AT_MOST_US) else f"more than {AT_MOST_US[-1] / 1000:g} ms"


class WatchedRig(RigLayer):
    """Passes everything through; reports READY after the first full set of fresh readings, then WATCHDOG.

    WATCHDOG is sent only at the end of a tick whose commands have been sent: a loop that hangs falls silent even if
    other threads go on. Until READY the status line names what is missing.
    """

    def __init__(self, rig: RobotIo, config: Config, say: Callable[[str], None]) -> None:
        super().__init__(rig)
        self._config, self._say = config, say
        self._seen_ns: int | None = None          # when the newest image was taken, whatever it showed
        self._missing: str | None = None
        self._ready = False
        self._alive_ns = 0
        self._t_ns = 0

    def read(self) -> Inputs | None:
        inputs = self._rig.read()
        if inputs is not None:
            self._t_ns = inputs.t_ns
            if not self._ready:
                self._look(inputs)
        return inputs

    def write(self, command: Command) -> Sent:
        sent = self._rig.write(command)
        if self._ready and self._t_ns - self._alive_ns >= ALIVE_NS:
            self._alive_ns = self._t_ns
            self._say("WATCHDOG=1")
        return sent

    def _look(self, inputs: Inputs) -> None:
        if inputs.sighting is not None:
            self._seen_ns = inputs.sighting.t_ns
        missing = first_missing(inputs, self._seen_ns, self._config)
        self._ready = not missing
        if missing != self._missing:
            self._missing = missing
            self._say("READY=1\nSTATUS=running" if self._ready else f"STATUS=waiting: {missing}")


def first_missing(inputs: Inputs, seen_ns: int | None, config: Config) -> str:
    """Name the first reading that is missing or stale; "" when there is none.

    `seen_ns`: when the newest image was taken, None before the first.
    """
    for reason in doubted_readings(inputs, config):
        if reason.code in NOT_FRESH:
            return str(reason.params["device"])
    if inputs.faults:                             # a silent button box is one of them
        return text(inputs.faults[0])
    if seen_ns is None or not 0 <= inputs.t_ns - seen_ns <= config.gate.sighting_age_s * NS_PER_S:
        return "camera"
    return ""
