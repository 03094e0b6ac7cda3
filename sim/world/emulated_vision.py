"""The emulated robot's camera and vision, in a process of their own as on the robot.

Rendering and seeing an image takes longer than a tick; here they overlap with the ticks until the image is due. The
stepped clock alone settles what the rig reads, and when: a reading that is due is waited for.
"""

import contextlib
import pickle
import subprocess
import sys
from collections import deque
from typing import IO, Any

import cv2

from truearc.hw.emulated.camera import NOTHING, EmulatedCamera, Lens, Stage, TapeSize
from truearc.hw.emulated.nodes import Plant
from truearc.hw.fault_codes import PROCESS_ENDED
from truearc.hw.protocols import CameraFrame, LinkLost
from truearc.robot.config.schema import CameraConfig, Config, Tape
from truearc.robot.types import Sighting
from truearc.robot.vision import detect

LATENCY_NS = 45_000_000               # middle of the exposure until the robot can read the sighting
CLOSE_S = 2.0
KEPT = 4                              # pictures the process remembers


class TwinEyes:
    """truearc.robot.eyes.Eyes on an emulated world; whoever owns the clock calls `step`."""

    def __init__(self, plant: Plant, config: Config, seed: int) -> None:
        # A new interpreter: forking one in which JAX runs threads may hang; spawning would run its main module again.
        self._process = subprocess.Popen([sys.executable, "-m", __name__], stdin=subprocess.PIPE,
                                         stdout=subprocess.PIPE)
        self._say((config, seed))
        self._plant = plant
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
        self.expose(t_ns)

    def expose(self, t_ns: int) -> None:
        """Take an image now."""
        self._say((t_ns, self._plant.view()))
        self._asked.append(t_ns)

    def read(self) -> Sighting | None:
        newest = None
        while self._asked and self._asked[0] + LATENCY_NS <= self._now_ns:
            self._read_ns = self._asked.popleft()
            newest = self._early.popleft() if self._early else self._hear()
        return newest

    def picture(self) -> CameraFrame | None:
        while len(self._early) < len(self._asked):
            self._early.append(self._hear())
        self._say((self._read_ns, None))
        picture: CameraFrame | None = self._hear()
        return picture

    def close(self) -> None:
        assert self._process.stdin is not None and self._process.stdout is not None
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(CLOSE_S)
        self._process.kill()
        self._process.stdout.close()

    def _say(self, what: object) -> None:
        assert self._process.stdin is not None
        pickle.dump(what, self._process.stdin)
        self._process.stdin.flush()

    def _hear(self) -> Any:
        assert self._process.stdout is not None
        try:
            return pickle.load(self._process.stdout)
        except EOFError as error:
            raise LinkLost(PROCESS_ENDED(process="vision")) from error


def look(ours: IO[bytes], theirs: IO[bytes]) -> None:
    """The process, until its input ends: (time, view) -> sighting; (time, None) -> the picture of that time."""
    cv2.setNumThreads(1)
    stage = Stage(NOTHING)
    config, seed = pickle.load(ours)
    camera = EmulatedCamera(stage, make_lens(config.camera), make_tape(config.tape), seed)
    pictures: deque[CameraFrame] = deque(maxlen=KEPT)
    while True:
        try:
            t_ns, what = pickle.load(ours)
        except (EOFError, KeyboardInterrupt):
            return
        if what is None:
            answer: object = next((picture for picture in pictures if picture.t_ns == t_ns), None)
        else:
            stage.now = what
            pictures.append(camera.expose(t_ns))
            answer = detect(pictures[-1], config.camera, config.tape, config.vision)
        pickle.dump(answer, theirs)
        theirs.flush()


def make_lens(camera: CameraConfig) -> Lens:
    return Lens(camera.width_px, camera.height_px, camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px,
                camera.distortion)


def make_tape(tape: Tape) -> TapeSize:
    return TapeSize(tape.top_width_m, tape.bottom_width_m, tape.height_m, tape.tape_width_m)


if __name__ == "__main__":
    look(sys.stdin.buffer, sys.stdout.buffer)
