"""Screens, which show ticks to people: the operator's page, and what other distributions publish."""

from collections.abc import Callable, Sequence
from typing import Protocol

from truearc.hw.protocols import CameraFrame, Clock
from truearc.robot.runtime import Recorder
from truearc.robot.types import Sent, Tick


class Screen(Protocol):
    """Shows ticks; `show` only keeps one, and never blocks."""

    def show(self, tick: Tick) -> None: ...

    def close(self) -> None: ...


OpenScreen = Callable[[Clock], Screen | None]     # can be pickled: whichever process shows it calls it


class Screens:
    """Several as one."""

    def __init__(self, screens: Sequence[Screen]) -> None:
        self._screens = screens

    def show(self, tick: Tick) -> None:
        for screen in self._screens:
            screen.show(tick)

    def close(self) -> None:
        for screen in self._screens:
            screen.close()


def open_screens(openers: Sequence[OpenScreen], clock: Clock) -> Screen | None:
    """All of those that can be opened; None where there is none."""
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
    """`recorder`, whose ticks are shown if there is a screen."""
    return recorder if screen is None else ShowingRecorder(recorder, screen)
