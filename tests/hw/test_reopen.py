"""A button box and a camera that are unplugged and come back, the box on a real pseudo-terminal under a stable name."""

import threading
import time

import numpy as np
import pytest

from truearc.hw.devices.button_box import make_heartbeat, make_press, parse_lines
from truearc.hw.fault_codes import CAMERA_NOT_OPENED, CAMERA_STOPPED
from truearc.hw.protocols import CameraFrame, LinkLost
from truearc.hw.real.wires import LONGEST_S, MendedCamera, MendedStream, open_serial

PATIENCE_S = 20.0                                          # of a loaded machine; usually a few milliseconds


def wait_for(what):
    """The first answer of `what` that is not None and does not say LinkLost."""
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        try:
            if (answer := what()) is not None:
                return answer
        except LinkLost:
            pass
        time.sleep(0.001)
    raise AssertionError("never came back")


def test_a_box_that_is_plugged_in_again_is_heard_again(tmp_path):
    PtyCable = pytest.importorskip("truearc.hw.emulated.serial_link").PtyCable
    name = tmp_path / "buttonbox"                          # as udev's link of a device by its serial number
    cable = PtyCable()
    name.symlink_to(cable.port)
    stream = MendedStream(lambda: open_serial(str(name), 115200), pause_s=0.005)
    cable.write(make_press(1, "arm"))
    assert stream.read() == make_press(1, "arm")
    name.unlink()                                          # first: another test may be given the terminal next
    cable.close()
    for _ in range(50):                                    # every read says so, until it is back
        with pytest.raises(LinkLost, match="buttonbox"):
            stream.read()
        time.sleep(0.001)
    again = PtyCable()
    name.symlink_to(again.port)
    wait_for(stream.read)
    again.write(make_heartbeat(0))
    again.write(make_press(1, "fire"))
    heard = b""
    while b"fire" not in heard:
        heard += wait_for(lambda: stream.read() or None)
    events, _, faults = parse_lines(b"", heard, 0)
    assert [getattr(event, "button", "beat") for event in events] == ["beat", "fire"] and not faults
    stream.close()
    again.close()


class Lens:
    """A camera that gives so many images and is then gone."""

    def __init__(self, images):
        self.images, self.closed = images, False

    def read(self):
        if not self.images:
            raise LinkLost(CAMERA_STOPPED(camera="0"))
        return self.images.pop()

    def close(self):
        self.closed = True


def picture(t_ns, grey=None):
    return CameraFrame(t_ns, np.full((8, 8, 3), t_ns if grey is None else grey, np.uint8))


def test_a_camera_that_comes_back_is_looked_through_again_and_the_old_one_is_let_go():
    lenses = [Lens([picture(1)]), None, None, Lens([picture(2)])]
    made = []

    def open_lens():
        lens = lenses.pop(0)
        if lens is None:
            raise LinkLost(CAMERA_NOT_OPENED(camera="0"))
        made.append(lens)
        return lens

    camera = MendedCamera(open_lens, pause_s=0.001)
    assert camera.read().t_ns == 1
    with pytest.raises(LinkLost, match="stopped giving images"):
        camera.read()
    assert wait_for(camera.read).t_ns == 2
    assert made[0].closed and lenses == []
    camera.close()
    assert made[1].closed


class Stop(threading.Event):
    """One that is never set, and that is waited for no longer than it takes to note for how long."""

    def __init__(self):
        super().__init__()
        self.waits_s = []

    def wait(self, timeout=None):
        self.waits_s.append(timeout)
        return False


def hurried(*lenses):
    """A camera that is opened again at once, each time as the next of `lenses` (None: not at all); and its Stop."""
    left = list(lenses)

    def open_lens():
        lens = left.pop(0)
        if lens is None:
            raise LinkLost(CAMERA_NOT_OPENED(camera="0"))
        return lens

    camera = MendedCamera(open_lens)
    camera._stop = stop = Stop()
    return camera, stop


def test_a_camera_is_opened_again_after_pauses_and_its_last_image_is_none():
    camera, stop = hurried(*(Lens([picture(t_ns, 7)]) for t_ns in (1, 2, 3, 4)), Lens([picture(6, 8), picture(5, 7)]))
    assert camera.read().t_ns == 1
    assert wait_for(camera.read).t_ns == 6
    assert stop.waits_s == [0.5, 1.0, 2.0, 4.0]
    camera, stop = hurried(Lens([]), Lens([]), None, None, Lens([picture(1)]), Lens([picture(2)]))
    assert [wait_for(camera.read).t_ns for _ in range(2)] == [1, 2]
    assert stop.waits_s == [0.5, 1.0, 0.5, 0.5, 0.5]
    camera, stop = hurried(*(Lens([]) for _ in range(6)), Lens([picture(1)]))
    wait_for(camera.read)
    assert stop.waits_s == [0.5, 1.0, 2.0, LONGEST_S, LONGEST_S, LONGEST_S]


def test_what_is_not_there_at_the_start_is_opened_when_it_comes(tmp_path):
    PtyCable = pytest.importorskip("truearc.hw.emulated.serial_link").PtyCable
    stream = MendedStream(lambda: open_serial(str(tmp_path / "box"), 115200), pause_s=0.005)
    assert stream.lost is not None
    with pytest.raises(LinkLost, match="box"):
        stream.read()
    cable = PtyCable()
    (tmp_path / "box").symlink_to(cable.port)
    wait_for(stream.read)
    assert stream.lost is None
    stream.close()
    cable.close()


def test_a_camera_that_comes_late_gives_its_first_picture():
    openings = [Lens([picture(1)])]
    plugged_in = threading.Event()

    def open_lens():
        if not plugged_in.is_set():
            raise LinkLost(CAMERA_NOT_OPENED(camera="0"))
        return openings.pop()

    camera = MendedCamera(open_lens, pause_s=0.001)
    assert camera.lost == CAMERA_NOT_OPENED(camera="0")
    plugged_in.set()
    assert wait_for(camera.read) is not None
    camera.close()


def test_closing_while_it_is_lost_ends_the_search():
    lens = Lens([])
    openings = [lens]

    def open_lens():
        if not openings:
            raise LinkLost(CAMERA_NOT_OPENED(camera="0"))
        return openings.pop()

    camera = MendedCamera(open_lens, pause_s=0.001)
    with pytest.raises(LinkLost):
        camera.read()
    camera.close()
    with pytest.raises(LinkLost):
        camera.read()
    assert lens.closed
