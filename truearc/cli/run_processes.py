"""The eyes and recorder of `truearc run`, in the control loop's process or in processes of their own."""

import socket
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from functools import partial
from pathlib import Path

import cv2
import msgspec
import numpy as np
import numpy.typing as npt

from truearc.errors import about
from truearc.hw.protocols import NS_PER_S, CameraFrame, Clock, LinkLost
from truearc.hw.real.clock import MonotonicClock, wall_offset_ns
from truearc.hw.real.processes import Capacity, Child, Inbox, Line, Outbox, Slots, make_shared
from truearc.hw.real.wires import MendedCamera, open_camera
from truearc.robot.config.schema import Config, RecordingConfig
from truearc.robot.eyes import Eyes, FarEyes, InlineEyes, News, make_room, open_eyes, relay, tell, watch
from truearc.robot.recording import files, upkeep
from truearc.robot.recording.writer import NEWS, Desk, FarKeeper, Keeper, LaneKeeper
from truearc.robot.runtime import OpenScreen, Recorder, Screen, SeeingScreen, with_screen
from truearc.robot.types import Sighting, Tick
from truearc.robot.vision import find_target

CLOSE_S = 2.0                         # for a camera to be let go


class OneProcess:
    """Layout with everything in this process; `wires` closes what is opened. `open_screen`: opens the screen for
    ticks."""

    def __init__(self, config: Config, wires: ExitStack, open_screen: OpenScreen | None = None) -> None:
        self._config, self._wires, self._open_screen = config, wires, open_screen
        self._eyes: InlineEyes | None = None

    def open_eyes(self, clock: Clock) -> Eyes:
        """Open the configuration's camera, which may be connected later."""
        if (elsewhere := open_eyes(self._config, clock)) is not None:
            self._wires.callback(elsewhere.close)
            return elsewhere
        cv2.setNumThreads(1)
        camera = open_mended(self._config, clock)
        self._wires.callback(camera.close)
        self._eyes = InlineEyes(camera, make_see(self._config))
        return self._eyes

    def open_keeper(self, folder: Path, contents: Mapping[str, bytes]) -> Keeper:
        """Make a recording's folder and open its files; OSError or InputError if that fails."""
        upkeep.start_pruning(self._config.recording, now_unix_s, folder)
        return LaneKeeper(folder, contents, lossless=False, waits=True)

    def show(self, recorder: Recorder) -> Recorder:
        """Return that recorder; its ticks are shown if there is a screen."""
        screen = None if self._open_screen is None else self._open_screen(MonotonicClock())
        if screen is not None:
            self._wires.callback(screen.close)
        if self._eyes is not None and isinstance(screen, SeeingScreen):
            screen.see(self._eyes.look)
        return with_screen(recorder, screen)

    def lines(self) -> list[str]:
        """Return what runs where, as text."""
        return ["vision and recorder are in the same process"]


class ThreeProcesses:
    """Layout with vision and the recorder with its screens in their own processes; `wires` ends them.

    Both start at once, in parallel. Methods as in OneProcess.
    """

    def __init__(self, config: Config, wires: ExitStack, open_screen: OpenScreen | None = None) -> None:
        room = make_room(config.camera.width_px, config.camera.height_px)
        memory = make_shared(room.bytes)
        self._sightings = Slots(memory, room)
        self.vision = Child("vision", look, (config, memory, room), restarts=True, mortal=True)
        wires.callback(self.vision.close, CLOSE_S)
        self.recorder = RecorderProcess(wires, open_screen, config.recording, (memory, room))

    def open_eyes(self, clock: Clock) -> Eyes:
        self.vision.wait()
        return FarEyes(self._sightings, lambda: self.vision.trouble, clock)

    def open_keeper(self, folder: Path, contents: Mapping[str, bytes]) -> Keeper:
        return self.recorder.open_keeper(folder, contents)

    def show(self, recorder: Recorder) -> Recorder:
        return recorder                           # its process does

    def lines(self) -> list[str]:
        return [f"vision is process {self.vision.pid}", f"recorder is process {self.recorder.child.pid}"]


class RecorderProcess:
    """Process that writes files until the control process ends or dies, which it must outlive."""

    def __init__(self, wires: ExitStack, open_screen: OpenScreen | None = None,
                 limits: RecordingConfig | None = None, seen: tuple[object, Capacity] | None = None) -> None:
        """`limits`: what earlier sessions may take; `seen`: memory of the vision process, for the screen's pictures."""
        ours, self._theirs = socket.socketpair()
        memory = make_shared(NEWS.bytes)
        self.child = Child("recorder", write, (self._theirs, memory, open_screen, limits, seen), restarts=False,
                           mortal=False)
        self._outbox, self._news = Outbox(ours), Slots(memory, NEWS)
        wires.callback(self._theirs.close)        # last: a process that is just being started still takes it over
        wires.callback(self.child.close, CLOSE_S)
        wires.callback(self._outbox.close)        # which ends it, if nothing else did

    def open_keeper(self, folder: Path, contents: Mapping[str, bytes]) -> Keeper:
        """Open the keeper; InputError if the process cannot start, or the files cannot be opened."""
        with about("cannot start", LinkLost):
            self.child.wait()
        self._theirs.close()                      # the other process has it
        return FarKeeper(folder, contents, self._outbox, self._news, self.child, MonotonicClock())


ProcessLayout = OneProcess | ThreeProcesses
LAYOUTS: dict[str, type[ProcessLayout]] = {"three": ThreeProcesses, "one": OneProcess}


def look(line: Line, is_first: bool, config: Config, memory: object, room: Capacity) -> None:
    """Run the vision process; its camera may be connected later."""
    cv2.setNumThreads(1)
    clock, slots = MonotonicClock(), Slots(memory, room)
    slots.beat(clock.now_ns())
    if (elsewhere := open_eyes(config, clock)) is not None:
        line.say(None)
        relay(elsewhere, slots, clock, line.is_over)
        elsewhere.close()
        return
    camera = open_mended(config, clock)
    if camera.lost is not None:
        tell(slots, camera.lost, None)
    line.say(None)
    watch(camera, make_see(config), slots, clock, line.is_over)
    camera.close()


def write(line: Line, is_first: bool, end: socket.socket, memory: object,
          open_screen: OpenScreen | None, limits: RecordingConfig | None = None,
          seen: tuple[object, Capacity] | None = None) -> None:
    """Run the recorder process until the control process ends or dies."""
    cv2.setNumThreads(1)
    inbox, clock = Inbox(end), MonotonicClock()
    screen = None if open_screen is None else open_screen(clock)
    if seen is not None and isinstance(screen, SeeingScreen):
        screen.see(partial(look_again, Slots(*seen)))
    desk = Desk(Slots(memory, NEWS), clock, make_show(screen), partial(upkeep.start_pruning, limits, now_unix_s))
    line.say(None)
    desk.serve(inbox)
    inbox.close()
    if screen is not None:
        screen.close()


def look_again(slots: Slots) -> tuple[Sighting, npt.NDArray[np.uint8]] | None:
    """Return what vision reported last, with its image; None if there is none, or it is being overwritten."""
    text = slots.read()
    sighting = None if text is None else msgspec.json.decode(text, type=News).sighting
    image = None if sighting is None else slots.image()
    return None if sighting is None or image is None else (sighting, image)


def now_unix_s() -> float:
    """Return the time of day, as used in file timestamps."""
    return (MonotonicClock().now_ns() + wall_offset_ns()) / NS_PER_S


def make_show(screen: Screen | None) -> Callable[[list[files.Row]], None]:
    """Return a function that shows rows of ticks on the screen as they are written; none without a screen."""
    if screen is None:
        return lambda rows: None
    decoder = msgspec.json.Decoder(Tick)

    def show(rows: list[files.Row]) -> None:
        for _, text, *_ in rows:
            screen.show(decoder.decode(text))

    return show


def open_mended(config: Config, clock: Clock) -> MendedCamera:
    """Open the configuration's camera as soon as it is present, and again when it was lost."""
    asked = config.camera
    return MendedCamera(lambda: open_camera(asked.device, asked.width_px, asked.height_px, asked.fps, clock,
                                            asked.exposure_s))


def make_see(config: Config) -> Callable[[CameraFrame], Sighting]:
    """Return the vision function of the configuration."""
    return lambda frame: find_target(frame, config)
