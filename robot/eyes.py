"""The sources of sightings, and of readings from other programs."""

from collections.abc import Callable, Iterable
from contextlib import ExitStack
from pathlib import Path
from typing import Protocol

import msgspec
import numpy as np
import numpy.typing as npt
from msgspec import Struct

from truearc.hw.devices.family import Finding
from truearc.hw.protocols import Camera, CameraFrame, Clock, LinkLost
from truearc.hw.real.processes import Capacity, Slots
from truearc.hw.reason import Reason
from truearc.robot.config import named_tables, schema
from truearc.robot.reasons import VISION_FAILED, VISION_UNRESPONSIVE
from truearc.robot.runtime import RobotIo, Screen, Screens
from truearc.robot.types import Sighting

LONGEST_DETAIL = 1000                 # characters, of whatever an error has to say


class Eyes(Protocol):
    """A source of sightings. Neither call blocks the tick; both raise LinkLost when the camera is lost."""

    def read(self) -> Sighting | None:
        """Return the sighting in the newest image, once; None if there is nothing new."""

    def picture(self) -> CameraFrame | None:
        """Return the image behind the newest sighting read."""


class NoEyes:
    """Eyes for a run that needs no target."""

    def read(self) -> Sighting | None:
        return None

    def picture(self) -> CameraFrame | None:
        return None


class InlineEyes:
    """Camera and vision run in the caller's thread."""

    def __init__(self, camera: Camera, see: Callable[[CameraFrame], Sighting]) -> None:
        self._camera, self._see = camera, see
        self._picture: CameraFrame | None = None
        self._seen: Seen | None = None

    def read(self) -> Sighting | None:
        picture = self._camera.read()
        if picture is None:
            return None
        self._picture = picture
        try:
            sighting = self._see(picture)
            self._seen = sighting, picture.image
            return sighting
        except Exception as error:    # whatever vision or its libraries may raise: the loop goes on, and holds
            raise LinkLost(vision_failed(error)) from error

    def picture(self) -> CameraFrame | None:
        return self._picture

    def look(self) -> "Seen | None":
        """Return the newest sighting and its image; called by any thread."""
        return self._seen


def vision_failed(error: Exception) -> Reason:
    """Return the sighting for an image on which vision failed: it does not even know that there is no target."""
    return VISION_FAILED(detail=f"{type(error).__name__}: {error}"[:LONGEST_DETAIL])


LOOK_S = 0.002                        # between looks at whether there is a new image
SILENT_NS = 1_500_000_000             # without a sign of life for so long, the process does not respond
TEXT_BYTES, IMAGES = 4096, 4          # with four, the newest image stays whole for two more at least

See = Callable[[CameraFrame], Sighting]
Seen = tuple[Sighting, npt.NDArray[np.uint8] | None]


class News(Struct, frozen=True):
    """Result of vision: a sighting, or why there is no image."""

    sighting: Sighting | None
    lost: Reason | None = None


def make_room(width_px: int, height_px: int) -> Capacity:
    """Return the capacity that news and images of that size need."""
    return Capacity(IMAGES, TEXT_BYTES, 3 * width_px * height_px)


def watch(camera: Camera, see: See, slots: Slots, clock: Clock, is_over: Callable[[float], bool]) -> None:
    """Report every image until `is_over(wait_s)` is true; it waits that long."""
    _watch(lambda: None if (frame := camera.read()) is None else (see(frame), frame.image), slots, clock, is_over)


def relay(eyes: Eyes, slots: Slots, clock: Clock, is_over: Callable[[float], bool]) -> None:
    """Report every sighting of eyes without images, in the same way."""
    _watch(lambda: None if (sighting := eyes.read()) is None else (sighting, None), slots, clock, is_over)


def _watch(look: Callable[[], Seen | None], slots: Slots, clock: Clock, is_over: Callable[[float], bool]) -> None:
    told: Reason | None = None
    while not is_over(LOOK_S):
        slots.beat(clock.now_ns())
        try:
            seen = look()
            if seen is None:
                continue
            slots.put(msgspec.json.encode(News(seen[0])), seen[1])
            told = None
        except LinkLost as error:
            told = tell(slots, error.reason, told)
        except Exception as error:    # whatever is raised is reported; the next image may succeed
            told = tell(slots, vision_failed(error), told)


def tell(slots: Slots, why: Reason, told: Reason | None) -> Reason:
    """Report why there is no image, unless that was the last report; return the last report."""
    if why != told:
        slots.put(msgspec.json.encode(News(None, _shortened(why))))
    return why


class FarEyes:
    """truearc.robot.eyes.Eyes on what another process sees.

    `how_it_is`: what is wrong with that process; None while it works.
    """

    def __init__(self, slots: Slots, how_it_is: Callable[[], Reason | None], clock: Clock) -> None:
        self._slots, self._how_it_is, self._clock = slots, how_it_is, clock
        self._decoder = msgspec.json.Decoder(News)
        self._lost: Reason | None = None
        self._seen_ns = 0

    def read(self) -> Sighting | None:
        silent_ns = self._clock.now_ns() - self._slots.beaten_ns()
        if (trouble := self._how_it_is() or (VISION_UNRESPONSIVE() if silent_ns > SILENT_NS else None)) is not None:
            raise LinkLost(trouble)
        text = self._slots.read()
        if text is None:
            if self._lost is not None:
                raise LinkLost(self._lost)
            return None
        news = self._decoder.decode(text)
        self._lost = news.lost
        if self._lost is not None:
            raise LinkLost(self._lost)
        assert news.sighting is not None
        self._seen_ns = news.sighting.t_ns
        return news.sighting

    def picture(self) -> CameraFrame | None:
        """Return a copy of the image behind the newest sighting read; None if vision has overwritten it."""
        image = self._slots.image()
        return None if image is None else CameraFrame(self._seen_ns, image)


def _shortened(why: Reason) -> Reason:
    """A detail of any length would not fit into a slot."""
    detail = why.params.get("detail")
    if not isinstance(detail, str):
        return why
    return Reason(why.code, {**why.params, "detail": detail[:LONGEST_DETAIL]})


# --- sources of other distributions

Layer = Callable[[RobotIo], RobotIo]


class OwnEyes(Eyes, Protocol):
    """Eyes that own their connection and close it."""

    def close(self) -> None: ...


class Source:
    """Reader of one table's data; a subclass overrides what it provides. config: one that has the table."""

    def __init__(self, config: schema.Config) -> None:
        self.config = config

    def open_eyes(self, clock: Clock) -> OwnEyes | None:
        """Open the camera of its `vision`; None without one. Runs in the vision process, if there is one."""
        return None

    def open_layer(self, wires: ExitStack, is_apart: bool) -> Layer | None:
        """Open what adds to the inputs of each tick; None for nothing. Runs in the control process, and never waits.

        Args:
            wires: Closes what is opened.
            is_apart: The control process may not read a network itself: a process of its own is to.
        """
        return None

    def open_screen(self, gate_path: Path | None, clock: Clock | None) -> Screen | None:
        """Open what shows ticks; None for nothing. Runs in the recorder process, if there is one.

        Args:
            gate_path: Model that is asked for the novelty of a shot; None: there is none.
            clock: That of the ticks; None where time passes otherwise.
        """
        return None

    def findings(self) -> Iterable[Finding]:
        """Return the doctor's findings on it."""
        return ()


def sources_of(config: schema.Config) -> tuple[Source, ...]:
    """Return one source for each table of another distribution."""
    return tuple(named_tables.find_table(name).source(config) for name in config.readings)


def open_eyes(config: schema.Config, clock: Clock) -> OwnEyes | None:
    """Open the camera that replaces [camera]; None if there is none."""
    eyes = (source.open_eyes(clock) for source in sources_of(config))
    return next((one for one in eyes if one is not None), None)


def open_their_screens(config: schema.Config, gate_path: Path | None, own_time: bool, clock: Clock) -> Screen | None:
    """Open all screens of other distributions as one; own_time: the ticks' time differs from that of `clock`."""
    told = None if own_time else clock
    screens = [source.open_screen(gate_path, told) for source in sources_of(config)]
    return Screens([one for one in screens if one is not None]) if any(screens) else None
