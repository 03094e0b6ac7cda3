"""Vision in a process of its own: killed, stopped, blind or beside itself, the control loop knows why."""

import itertools
import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import ExitStack

import numpy as np
import pytest
from msgspec.structs import replace

from tests.waiting import SetClock
from truearc.cli.common import SHIPPED
from truearc.cli.run_processes import ThreeProcesses, look_again
from truearc.hw.emulated.camera import PictureServer
from truearc.hw.fault_codes import CAMERA_SILENT, PROCESS_KILLED
from truearc.hw.protocols import CameraFrame, LinkLost
from truearc.hw.real.clock import MonotonicClock
from truearc.hw.real.processes import Slots
from truearc.robot.config.schema import load_config
from truearc.robot.eyes import FarEyes, InlineEyes, make_room, watch
from truearc.robot.reasons import BOX_LOST, CAMERA_LOST, CAN_LOST, IMAGE_DARK, VISION_FAILED, VISION_UNRESPONSIVE
from truearc.robot.recording.reader import TickReader
from truearc.robot.types import Sighting

PATIENCE_S = 30.0                     # of a loaded machine
ROOM = make_room(8, 6)
posix = pytest.mark.skipif(os.name != "posix", reason="signals")


class Views:
    """A camera that gives each of `views`, or raises it."""

    def __init__(self, *views):
        self.views = list(views)

    def read(self):
        view = self.views.pop(0)
        if isinstance(view, LinkLost):
            raise view
        return view


def see(frame):
    if frame.image[0, 0, 0] == 13:
        raise ZeroDivisionError("thirteen")
    return Sighting(frame.t_ns, False, IMAGE_DARK(), sigma_m=1 / 3)


def frame(value):
    return CameraFrame(value * 1000, np.full((6, 8, 3), value, np.uint8))


def told(*views):
    """What eyes say, one view after the other, and the picture then."""
    slots, clock = Slots(bytearray(ROOM.bytes), ROOM), SetClock(1_000_000_000)
    eyes = FarEyes(slots, lambda: None, clock)
    said = []
    for view in views:
        looks = iter([False, True])
        watch(Views(view), see, slots, clock, lambda wait_s, looks=looks: next(looks))
        try:
            said.append(eyes.read())
        except LinkLost as error:
            said.append(error.reason)
    return said, eyes.picture()


def test_sightings_come_over_to_the_bit_and_what_is_lost_stays_so():
    said, picture = told(None, frame(7), None)
    assert said == [None, see(frame(7)), None]
    assert picture.t_ns == 7000 and (picture.image == 7).all()
    gone = LinkLost(CAMERA_SILENT(camera="0"))
    said, _ = told(frame(7), gone, gone, None, frame(8))
    assert said == [see(frame(7)), *[gone.reason] * 3, see(frame(8))]
    said, picture = told(CameraFrame(1, np.zeros((7, 8, 3), np.uint8)))
    assert said[0].code == VISION_FAILED.name and "there is room for" in said[0].params["detail"] and picture is None


def test_a_screen_looks_at_what_vision_saw_beside_the_robot():
    memory = bytearray(ROOM.bytes)
    slots, robot = Slots(memory, ROOM), FarEyes(Slots(memory, ROOM), lambda: None, SetClock(1_000_000_000))
    screen = Slots(memory, ROOM)
    assert look_again(screen) is None
    looks = iter([False, True])
    watch(Views(frame(7)), see, slots, SetClock(1_000_000_000), lambda wait_s: next(looks))
    sighting, image = look_again(screen)
    assert sighting == see(frame(7)) == robot.read() and (image == 7).all()
    assert look_again(screen) is None                       # nothing new


def test_vision_that_fails_or_does_not_stir_says_so():
    said, _ = told(frame(13), None, frame(8))
    failed = VISION_FAILED(detail="ZeroDivisionError: thirteen")
    assert said == [failed, failed, see(frame(8))]
    eyes = InlineEyes(Views(frame(13), frame(8)), see)
    with pytest.raises(LinkLost) as lost:
        eyes.read()
    assert lost.value.reason == failed
    assert eyes.read() == see(frame(8))
    slots, clock = Slots(bytearray(ROOM.bytes), ROOM), SetClock(1_000_000_000)
    eyes = FarEyes(slots, lambda: None, clock)
    slots.beat(clock.t_ns)
    clock.t_ns += 1_400_000_000
    assert eyes.read() is None
    clock.t_ns += 200_000_000
    with pytest.raises(LinkLost, match="vision_unresponsive"):
        eyes.read()


class Scene:
    """A network camera, and the eyes of `truearc run` on it."""

    def __init__(self, stack):
        self.server = PictureServer()
        self.over = threading.Event()
        threading.Thread(target=self.show, daemon=True).start()
        stack.callback(self.over.set)
        config = load_config(SHIPPED)
        config = replace(config, camera=replace(config.camera, device=self.server.url, width_px=64, height_px=48))
        self.layout = ThreeProcesses(config, stack)
        self.eyes = self.layout.open_eyes(MonotonicClock())
        self.child = self.layout.vision

    def show(self):
        for grey in itertools.cycle(range(60, 90)):       # an image that stays the same is none
            if self.over.wait(0.02):
                return
            self.server.show(np.full((48, 64, 3), grey, np.uint8))

    def until(self, true, limit_s=PATIENCE_S):
        """Read until what comes is as asked; what is lost comes as words."""
        end = time.monotonic() + limit_s
        while time.monotonic() < end:
            try:
                answer = self.eyes.read()
            except LinkLost as error:
                answer = error.reason
            if answer is not None and true(answer):
                return answer
            time.sleep(0.002)
        raise AssertionError(f"it never came; last: {answer}")


@pytest.fixture
def scene():
    with ExitStack() as stack:
        yield Scene(stack)


def is_seen(answer):
    return isinstance(answer, Sighting)


@posix
def test_killed_vision_is_told_at_once_and_comes_back(scene):
    scene.until(is_seen)
    picture = scene.eyes.picture()
    assert picture is None or picture.image.shape == (48, 64, 3)
    os.kill(scene.child.pid, signal.SIGKILL)
    scene.until(lambda answer: answer == PROCESS_KILLED(process="vision", signal=9), 1.0)
    before = time.monotonic_ns()
    sighting = scene.until(is_seen)
    scene.until(lambda answer: is_seen(answer) and answer.t_ns > max(before, sighting.t_ns))
    assert scene.child.starts == 2


@posix
def test_stopped_vision_is_old_then_silent_and_goes_on_where_it_can(scene):
    scene.until(is_seen)
    os.kill(scene.child.pid, signal.SIGSTOP)
    scene.until(lambda answer: answer == VISION_UNRESPONSIVE(), 3.0)
    os.kill(scene.child.pid, signal.SIGCONT)
    now = time.monotonic_ns()
    scene.until(lambda answer: is_seen(answer) and answer.t_ns > now)      # and not what it had seen before
    assert scene.child.starts == 1


def test_a_camera_that_stops_is_lost_in_the_cameras_words(scene):
    scene.until(is_seen)
    scene.over.set()
    assert "http://" in scene.until(lambda answer: not is_seen(answer)).params["camera"]


@pytest.mark.slow
@pytest.mark.parametrize("layout", ["one", "three"])
def test_without_camera_box_and_adapter_it_starts_holds_and_opens_what_appears(layout, tmp_path):
    PtyCable = pytest.importorskip("truearc.hw.emulated.serial_link").PtyCable
    box, adapter, out = tmp_path / "buttonbox", tmp_path / "adapter", tmp_path / "out"
    words = ["--can", f"slcan:{adapter}", "--buttons", str(box), "--camera", "/dev/video99", "--layout", layout]
    robot = subprocess.Popen([sys.executable, "-m", "truearc", "run", "--config", str(SHIPPED), "--out", str(out),
                              "--page", "off", *words], stderr=subprocess.PIPE, text=True)
    said = []
    for line in robot.stderr:                     # the last of what it says before it runs
        said.append(line)
        if "video99" in line:
            break
    time.sleep(1.5)
    cables = PtyCable(), PtyCable()
    for place, cable in zip((box, adapter), cables, strict=True):
        place.symlink_to(cable.port)              # plugged in
    time.sleep(2.0)
    robot.terminate()
    said += robot.stderr.readlines()
    assert robot.wait(20) == 0, said
    for cable in cables:
        cable.close()
    assert any("CAN slcan" in line and "holding until it can be opened" in line for line in said), said
    assert any("buttonbox" in line and "holding until it can be opened" in line for line in said), said
    assert any("camera /dev/video99: cannot be opened: holding until" in line for line in said), said
    session, = out.iterdir()
    held = [{reason.code for reason in tick.verdict.reasons} for tick, _ in TickReader(session)]
    assert all(CAMERA_LOST.name in codes for codes in held[20:]) and not any(
        tick.verdict.fire for tick, _ in TickReader(session))
    assert BOX_LOST.name in held[20] and BOX_LOST.name not in held[-1]
    assert CAN_LOST.name in held[20] and not all(CAN_LOST.name in codes for codes in held)
