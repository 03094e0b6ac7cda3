"""Pictures over HTTP, seen by the robot's own camera code."""

import threading

import numpy as np
import pytest

from truearc.hw.emulated.camera import PictureServer
from truearc.hw.protocols import LinkLost
from truearc.hw.real.clock import MonotonicClock
from truearc.hw.real.wires import open_camera


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


def test_a_picture_of_another_size_is_refused() -> None:
    server = PictureServer()
    show = Show(server)
    show.start()
    with pytest.raises(LinkLost, match="gives 64 x 48 pixels, expected 640 x 480"):
        open_camera(server.url, 640, 480, 50.0, MonotonicClock())
    show.over.set()
    show.join()
    server.close()


def test_no_camera_is_named() -> None:
    with pytest.raises(LinkLost, match=r"http://127\.0\.0\.1:1/"):
        open_camera("http://127.0.0.1:1/", 64, 48, 50.0, MonotonicClock())
