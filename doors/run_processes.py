"""What `truearc run` is made of beside the control loop: eyes, in this process or in another."""

from collections.abc import Callable
from contextlib import ExitStack
from typing import Protocol

import cv2

from hw.link import Clock, LinkLost
from hw.reading import CameraFrame
from hw.real.camera import open_camera
from hw.real.child import Child, Line, make_shared
from hw.real.clock import MonotonicClock
from hw.real.reopen import PAUSE_S, MendedCamera
from hw.slots import Room, Slots
from robot.config import Config
from robot.eyes import Eyes, InlineEyes
from robot.processes.vision import FarEyes, make_room, tell, watch
from robot.types import Sighting
from robot.vision import detect

CLOSE_S = 2.0                         # for a camera to be let go


class Layout(Protocol):
    """Which process does what."""

    def open_eyes(self, clock: Clock) -> Eyes:
        """LinkLost, saying why, when there is no camera."""

    def lines(self) -> list[str]:
        """What runs where, in words."""


class OneProcess:
    """Everything in this process; what `wires` closes."""

    def __init__(self, config: Config, wires: ExitStack) -> None:
        self._config, self._wires = config, wires

    def open_eyes(self, clock: Clock) -> Eyes:
        cv2.setNumThreads(1)
        camera = open_mended(self._config, clock)
        self._wires.callback(camera.close)
        return InlineEyes(camera, make_see(self._config))

    def lines(self) -> list[str]:
        return ["control, vision and recorder in one process"]


class ThreeProcesses:
    """Vision in a process of its own, which starts at once; `wires` ends it."""

    def __init__(self, config: Config, wires: ExitStack) -> None:
        room = make_room(config.camera.width_px, config.camera.height_px)
        memory = make_shared(room.bytes)
        self._slots = Slots(memory, room)
        self.vision = Child("vision", look, (config, memory, room), mended=True, mortal=True)
        wires.callback(self.vision.close, CLOSE_S)

    def open_eyes(self, clock: Clock) -> Eyes:
        self.vision.wait()
        return FarEyes(self._slots, lambda: self.vision.trouble, clock)

    def lines(self) -> list[str]:
        return [f"vision is process {self.vision.pid}"]


LAYOUTS: dict[str, Callable[[Config, ExitStack], Layout]] = {"three": ThreeProcesses, "one": OneProcess}


def look(line: Line, is_first: bool, config: Config, memory: object, room: Room) -> None:
    """The vision process. The first one's camera must be there; a later one waits for it."""
    cv2.setNumThreads(1)
    clock, slots = MonotonicClock(), Slots(memory, room)
    told = ""
    while True:
        slots.beat(clock.now_ns())
        try:
            camera = open_mended(config, clock)
            break
        except LinkLost as error:
            if is_first:
                return line.say(str(error))
            told = tell(slots, str(error), told)
            line.say("")
        if line.is_over(PAUSE_S):
            return None
    line.say("")
    watch(camera, make_see(config), slots, clock, line.is_over)
    camera.close()
    return None


def open_mended(config: Config, clock: Clock) -> MendedCamera:
    """The configuration's camera, which comes back when it was lost; LinkLost when it cannot be opened now."""
    asked = config.camera
    return MendedCamera(lambda: open_camera(asked.device, asked.width_px, asked.height_px, asked.fps, clock,
                                            asked.exposure_s))


def make_see(config: Config) -> Callable[[CameraFrame], Sighting]:
    """Vision as configured."""
    return lambda frame: detect(frame, config.camera, config.tape, config.vision)
