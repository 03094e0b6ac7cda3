"""Camera images for a run: a few scenes, rendered once, and one camera for stepped time and one for real time."""

import functools
import threading
from collections.abc import Callable

import numpy as np

from truearc.hw.emulated.camera import NOTHING, Image, Stage, outline_m, project
from truearc.hw.fault_codes import CAMERA_ERROR
from truearc.hw.protocols import CameraFrame, Clock, LinkLost
from truearc.hw.real.wires import CameraThread
from truearc.robot.config.schema import CameraConfig, Config, Tape
from truearc.sim.world.emulated_robot import make_lens, make_tape
from truearc_proof.world.camera_damage import StagedCamera, floor_reflection, place, second_goal

LENS_M = 4.2                          # from lens to target: 4.0 m from the ball's exit
NEAR_M = 2.5
ASKED = 12                            # pictures from its place until the robot "drives off": by then fire was pressed
DRAWN = 5                             # pictures of each scene, shown in turn
SECOND_GOAL_SEED = 33                 # of those that vision takes for another target
SLOW_NS = 500_000_000
NS_PER_S = 1_000_000_000
SCENES = ("black", "saturated", "two targets", "reflections", "elsewhere")


@functools.cache
def draw(scene: str, camera: CameraConfig, tape: Tape) -> tuple[Image, ...]:
    """Pictures of "target" or one of SCENES."""
    if scene == "saturated":
        return tuple(np.full((camera.height_px, camera.width_px, 3), 255 - k, np.uint8) for k in range(DRAWN))
    lens, shape = make_lens(camera), make_tape(tape)
    rise_m = tape.centre_height_m - camera.height_m
    view = place(NEAR_M if scene == "elsewhere" else LENS_M, rise_m, camera.pitch_deg)
    staged = StagedCamera(Stage(NOTHING if scene == "black" else view), lens, shape, 1)
    staged.black(scene == "black")
    corners, _ = project(outline_m(shape), view.camera_from_target, lens)
    if scene == "two targets":
        staged.clutter(second_goal(lens, corners, np.random.default_rng(SECOND_GOAL_SEED)))
    elif scene == "reflections":
        staged.clutter(floor_reflection(lens, corners, np.random.default_rng(1)))
    return tuple(staged.expose(0).image for _ in range(DRAWN))


class Scenery:
    """Which picture is due: "target" while nothing is wrong."""

    def __init__(self, config: Config, what: str, stands: Callable[[], bool]) -> None:
        self._config, self._what, self._stands = config, what, stands
        self._count = self._in_trouble = 0
        self._kept: Image | None = None
        draw("target", config.camera, config.tape)
        if (scene := "elsewhere" if what == "drives off" else what) in SCENES:
            draw(scene, config.camera, config.tape)

    @property
    def trouble(self) -> str:
        """The fault of the camera now; empty without one."""
        return self._what if self._stands() else ""

    def next(self) -> Image:
        trouble = self.trouble
        if trouble == "frozen" and self._kept is not None:
            return self._kept
        self._count += 1
        self._in_trouble += bool(trouble)
        if trouble == "drives off":
            trouble = "elsewhere" if self._in_trouble > ASKED else ""
        images = draw(trouble if trouble in SCENES else "target", self._config.camera, self._config.tape)
        self._kept = images[self._count % DRAWN]
        return self._kept


class SteppedCamera:
    """truearc.hw.protocols.Camera on a stepped clock."""

    def __init__(self, scenery: Scenery, fps: float, clock: Clock) -> None:
        self._scenery, self._clock, self._period_ns = scenery, clock, round(NS_PER_S / fps)
        self._due_ns = 0

    def read(self) -> CameraFrame | None:
        now_ns, trouble = self._clock.now_ns(), self._scenery.trouble
        if trouble == "unplugged":
            raise LinkLost(CAMERA_ERROR(camera="of the run", detail="pulled out"))
        if now_ns < self._due_ns or trouble == "hangs":
            return None
        self._due_ns = now_ns + (NS_PER_S if trouble == "1 per second" else self._period_ns)
        return CameraFrame(stamp(now_ns, trouble, self._scenery), self._scenery.next())

    def close(self) -> None: ...


def stamp(now_ns: int, trouble: str, scenery: Scenery) -> int:
    """The driver's timestamp of an image that comes now."""
    if trouble == "old stamps":
        scenery.odd = not getattr(scenery, "odd", False)
        return now_ns - (150_000_000 if scenery.odd else 10_000_000)
    return now_ns + {"slow": -SLOW_NS, "stamps to come": SLOW_NS}.get(trouble, -10_000_000)


class Capture:
    """As much of cv2.VideoCapture as truearc.hw.real.wires reads: waits for each image."""

    def __init__(self, scenery: Scenery, fps: float, clock: Clock) -> None:
        self._scenery, self._clock, self._period_s = scenery, clock, 1.0 / fps
        self._wait = threading.Event()
        self._stamp_ns = 0

    def read(self) -> tuple[bool, Image | None]:
        trouble = self._scenery.trouble
        if trouble == "unplugged":
            return False, None
        self._wait.wait(1.0 if trouble == "1 per second" else self._period_s)
        while self._scenery.trouble == "hangs":
            self._wait.wait(self._period_s)
        self._stamp_ns = stamp(self._clock.now_ns(), self._scenery.trouble, self._scenery)
        return True, self._scenery.next()

    def get(self, number: int) -> float:
        return self._stamp_ns / 1e6

    def release(self) -> None:
        self._wait.set()


def open_camera(scenery: Scenery, fps: float, clock: Clock) -> CameraThread:
    """LinkLost while it is unplugged."""
    if scenery.trouble == "unplugged":
        raise LinkLost(CAMERA_ERROR(camera="of the run", detail="pulled out"))
    return CameraThread(Capture(scenery, fps, clock), clock, "of the run")
