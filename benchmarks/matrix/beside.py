"""Vision and recorder in processes of their own, as `truearc run` has them; only what the camera sees is the run's."""

from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path

import cv2

from benchmarks.matrix.pictures import Scenery, open_camera
from truearc.cli.run_processes import CLOSE_S, RecorderProcess, make_see
from truearc.hw.protocols import Clock
from truearc.hw.real.clock import MonotonicClock
from truearc.hw.real.processes import Capacity, Child, Line, Slots, make_shared
from truearc.robot.config.schema import Config
from truearc.robot.processes.vision import FarEyes, make_room, watch
from truearc.robot.recording.writer import Keeper


class Beside:
    """Both processes; their numbers are in `folder`/vision.pid and recorder.pid, for who wants to stop or kill them."""

    def __init__(self, config: Config, folder: Path, wires: ExitStack) -> None:
        room = make_room(config.camera.width_px, config.camera.height_px)
        memory = make_shared(room.bytes)
        self._folder, self._sightings = folder, Slots(memory, room)
        self._vision = Child("vision", look, (config, memory, room), restarts=True, mortal=True)
        wires.callback(self._vision.close, CLOSE_S)
        self._recorder = RecorderProcess(wires)

    def open_eyes(self, clock: Clock) -> FarEyes:
        self._vision.wait()
        self._tell("vision", self._vision)
        return FarEyes(self._sightings, lambda: self._vision.trouble, clock)

    def open_keeper(self, folder: Path, contents: Mapping[str, bytes]) -> Keeper:
        keeper = self._recorder.open_keeper(folder, contents)
        self._tell("recorder", self._recorder.child)
        return keeper

    def _tell(self, name: str, child: Child) -> None:
        (self._folder / f"{name}.pid").write_text(str(child.pid))


def look(line: Line, is_first: bool, config: Config, memory: object, room: Capacity) -> None:
    """The vision process."""
    cv2.setNumThreads(1)
    clock = MonotonicClock()
    camera = open_camera(Scenery(config, "", lambda: False), config.camera.fps, clock)
    line.say(None)
    watch(camera, make_see(config), Slots(memory, room), clock, line.is_over)
    camera.close()
