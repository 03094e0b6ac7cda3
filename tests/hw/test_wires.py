"""A button box over a real pseudo-terminal or socket and a camera, also unplugged and back; pictures over HTTP."""

import os
import threading
import time

import numpy as np
import pytest

from truearc.hw.devices import button_box
from truearc.hw.emulated.camera import PictureServer
from truearc.hw.emulated.serial_link import PtyCable, SocketCable
from truearc.hw.fault_codes import CAMERA_NOT_OPENED, CAMERA_STOPPED
from truearc.hw.protocols import ButtonEvent, CameraFrame, LinkLost
from truearc.hw.real.clock import MonotonicClock
from truearc.hw.real.wires import LONGEST_S, MendedCamera, MendedStream, open_camera, open_serial

S = 1_000_000_000


def hear(stream, t_ns: int = 0):
    events, rest, faults = button_box.parse_lines(b"", stream.read(), t_ns)
    assert not rest and not faults
    return events


@pytest.fixture
def box():
    box = button_box.open_button_box()
    yield box
    box.unplug()


def test_presses_are_there_at_the_very_next_read(box) -> None:
    stream = open_serial(box.port, 115200)
    for seq in range(1, 501):                              # kernel delivery is asynchronous: once is no proof
        button = button_box.BUTTONS[seq % len(button_box.BUTTONS)]
        box.press(button)
        assert hear(stream) == [ButtonEvent(0, seq, button)]
    assert stream.read() == b""
    stream.close()


def test_heartbeats_keep_time_and_tell_the_newest_press(box) -> None:
    stream = open_serial(box.port, 115200)
    heard = []
    for tick in range(401):                                # 0 to 2 s in steps of 5 ms
        box.step(tick * S // 200)
        if tick == 150:
            box.press("fire")
        heard += hear(stream, tick * S // 200)
    assert [event for event in heard if isinstance(event, button_box.BoxHeartbeat)] == [
        button_box.BoxHeartbeat(0, 0),
        button_box.BoxHeartbeat(S // 2, 0),
        button_box.BoxHeartbeat(S, 1),
        button_box.BoxHeartbeat(3 * S // 2, 1),
        button_box.BoxHeartbeat(2 * S, 1),
    ]
    stream.close()


def test_missed_heartbeats_are_skipped_not_burst(box) -> None:
    stream = open_serial(box.port, 115200)
    box.step(0)
    box.step(10 * S)
    box.step(10 * S + 1)
    assert hear(stream) == [button_box.BoxHeartbeat(0, 0), button_box.BoxHeartbeat(0, 0)]
    stream.close()


def test_the_line_carries_every_byte_and_blocks_nobody(box) -> None:
    cable = PtyCable()
    stream = open_serial(cable.port, 115200)
    cable.write(bytes(range(256)))
    assert stream.read() == bytes(range(256))
    stream.close()
    cable.close()
    cable = PtyCable()
    box = button_box.ButtonBox(cable)
    for _ in range(1000):
        box.press("three")
    box.unplug()


def test_a_second_reader_is_refused_and_an_unplugged_box_a_lost_link(box) -> None:
    stream = open_serial(box.port, 115200)
    with pytest.raises(LinkLost, match=box.port):
        open_serial(box.port, 115200)
    stream.close()
    stream = open_serial(box.port, 115200)
    box.press("arm")
    box.unplug()
    box.press("fire")                                      # into the air
    for _ in range(2):
        with pytest.raises(LinkLost, match=box.port):
            stream.read()
    stream.close()


@pytest.mark.parametrize("port", ["/dev/nosuchport", "socket://127.0.0.1:1", "nosuchscheme://x"])
def test_what_cannot_be_opened_is_named(port: str) -> None:
    with pytest.raises(LinkLost, match=port):
        open_serial(port, 115200)


def test_a_box_on_a_socket_where_there_are_no_pseudo_terminals(monkeypatch) -> None:
    box = button_box.ButtonBox(SocketCable())
    stream = open_serial(box.port, 115200)
    assert stream.read() == b""
    box.press("two")
    received = b""
    while not received.endswith(b"\n"):
        received += stream.read()
    assert received == button_box.make_press(1, "two")
    box.unplug()
    with pytest.raises(LinkLost, match="socket://"):
        while True:
            stream.read()
    stream.close()
    def refuse() -> tuple[int, int]:
        raise OSError("out of pty devices")

    monkeypatch.setattr(os, "openpty", refuse)
    box = button_box.open_button_box()
    assert box.port.startswith("socket://127.0.0.1:")
    box.unplug()


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
    cable.write(button_box.make_press(1, "arm"))
    assert stream.read() == button_box.make_press(1, "arm")
    name.unlink()                                          # first: another test may be given the terminal next
    cable.close()
    for _ in range(50):                                    # every read says so, until it is back
        with pytest.raises(LinkLost, match="buttonbox"):
            stream.read()
        time.sleep(0.001)
    again = PtyCable()
    name.symlink_to(again.port)
    wait_for(stream.read)
    again.write(button_box.make_heartbeat(0))
    again.write(button_box.make_press(1, "fire"))
    heard = b""
    while b"fire" not in heard:
        heard += wait_for(lambda: stream.read() or None)
    events, _, faults = button_box.parse_lines(b"", heard, 0)
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


def make_picture(shade: int) -> np.ndarray:
    """Two halves: one of the shade, one of another colour."""
    image = np.full((48, 64, 3), (6, shade, 113), np.uint8)
    image[:, 32:] = (shade, 20, 20)
    return image


class Show(threading.Thread):
    """Shows pictures one after the other until it is told to end, as a camera does."""

    def __init__(self, server: PictureServer) -> None:
        super().__init__(daemon=True)
        self.server, self.over, self.shade = server, threading.Event(), 0

    def run(self) -> None:
        while not self.over.wait(0.02):
            self.shade = min(self.shade + 5, 200)
            self.server.show(make_picture(self.shade))


def test_the_newest_picture_is_seen_as_it_was_shown_and_its_end_is_a_lost_camera() -> None:
    server, clock = PictureServer(), MonotonicClock()
    show = Show(server)
    show.start()
    camera = open_camera(server.url, 64, 48, 50.0, clock)
    seen = None
    while seen is None or seen.image[24, 16, 1] < 195:
        seen = camera.read() or seen
        show.over.wait(0.005)
    assert np.abs(seen.image.astype(int) - make_picture(200)).max() <= 8
    assert 0 <= clock.now_ns() - seen.t_ns < 60_000_000_000            # stamped with the machine's own clock
    show.over.set()
    show.join()
    server.close()
    with pytest.raises(LinkLost, match="camera http://"):
        while True:
            camera.read()
            threading.Event().wait(0.01)
    camera.close()


def test_no_camera_and_pictures_of_another_size_are_named() -> None:
    server = PictureServer()
    show = Show(server)
    show.start()
    with pytest.raises(LinkLost, match="gives 64 x 48 pixels, expected 640 x 480"):
        open_camera(server.url, 640, 480, 50.0, MonotonicClock())
    show.over.set()
    show.join()
    server.close()
    with pytest.raises(LinkLost, match=r"http://127\.0\.0\.1:1/"):
        open_camera("http://127.0.0.1:1/", 64, 48, 50.0, MonotonicClock())
