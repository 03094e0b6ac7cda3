"""The emulated robot's camera and vision, in a process of their own as on the robot.

Rendering and seeing an image takes longer than a tick; here they overlap with the ticks until the image is due. What
the rig reads, and when, is settled by the stepped clock alone: a reading that is due is waited for.
"""

import contextlib
import multiprocessing
from collections import deque
from multiprocessing.connection import Connection

import cv2

from hw.emulated.camera import EmulatedCamera, Lens, TapeSize
from hw.emulated.faults import Fault
from hw.emulated.plant import Plant, View
from hw.reading import CameraFrame
from robot.config import CameraConfig, Config, Tape
from robot.types import Sighting
from robot.vision import detect

LATENCY_NS = 45_000_000               # middle of the exposure until the robot can read the sighting
CLOSE_S = 2.0
KEPT = 4                              # pictures the process remembers


class TwinEyes:
    """robot.eyes.Eyes on an emulated world; whoever owns the clock calls `step`."""

    def __init__(self, plant: Plant, config: Config, seed: int, faults: tuple[Fault, ...] = ()) -> None:
        """While one of `faults` stands the camera gives nothing, whatever the fault's kind."""
        methods = multiprocessing.get_all_start_methods()
        context = multiprocessing.get_context("fork" if "fork" in methods else "spawn")
        self._ours, theirs = context.Pipe()
        self._process = context.Process(target=_look, args=(theirs, config, seed), name="vision", daemon=True)
        self._process.start()
        theirs.close()
        self._plant, self._faults = plant, faults
        self._period_ns = round(1e9 / config.camera.fps)
        self._due_ns = self._now_ns = 0
        self._asked: deque[int] = deque()         # exposures whose sightings have not been read
        self._early: deque[Sighting] = deque()    # of those, sightings that had to be taken in before they were due
        self._read_ns = 0

    def step(self, t_ns: int) -> None:
        """Expose when an image is due."""
        self._now_ns = t_ns
        if t_ns < self._due_ns:
            return
        self._due_ns += ((t_ns - self._due_ns) // self._period_ns + 1) * self._period_ns
        if not any(fault.begin_ns <= t_ns < fault.end_ns for fault in self._faults):
            self._ours.send((t_ns, self._plant.view()))
            self._asked.append(t_ns)

    def read(self) -> Sighting | None:
        newest = None
        while self._asked and self._asked[0] + LATENCY_NS <= self._now_ns:
            self._read_ns = self._asked.popleft()
            newest = self._early.popleft() if self._early else self._ours.recv()
        return newest

    def picture(self) -> CameraFrame | None:
        while len(self._early) < len(self._asked):
            self._early.append(self._ours.recv())
        self._ours.send((self._read_ns, None))
        picture: CameraFrame | None = self._ours.recv()
        return picture

    def close(self) -> None:
        with contextlib.suppress(BrokenPipeError):
            self._ours.send(None)
        self._process.join(CLOSE_S)
        self._process.terminate()
        self._ours.close()


def _look(wire: Connection, config: Config, seed: int) -> None:
    """The process: (time, view) -> sighting; (time, None) -> the picture of that time; None -> the end."""
    cv2.setNumThreads(1)
    stage = _Stage()
    camera = EmulatedCamera(stage, make_lens(config.camera), make_tape(config.tape), config.camera.fps, 0.0, seed)
    pictures: deque[CameraFrame] = deque(maxlen=KEPT)
    while True:
        try:
            message = wire.recv()
        except (EOFError, KeyboardInterrupt):
            return
        if message is None:
            return
        t_ns, what = message
        if what is None:
            wire.send(next((picture for picture in pictures if picture.t_ns == t_ns), None))
        else:
            stage.now = what
            picture = camera.expose(t_ns)
            pictures.append(picture)
            wire.send(detect(picture, config.camera, config.tape, config.vision))


class _Stage:
    """As much of the plant as a camera looks at."""

    now: View

    def view(self) -> View:
        return self.now


def make_lens(camera: CameraConfig) -> Lens:
    return Lens(camera.width_px, camera.height_px, camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px,
                camera.distortion)


def make_tape(tape: Tape) -> TapeSize:
    return TapeSize(tape.top_width_m, tape.bottom_width_m, tape.height_m, tape.tape_width_m)
