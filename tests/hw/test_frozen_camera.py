"""A camera whose driver hands out one image for ever."""

import threading

import numpy as np
import pytest

from tests.hw.conftest import SetClock
from truearc.hw.protocols import LinkLost
from truearc.hw.real.camera import SILENT_NS, CameraThread


class Capture:
    """As much of cv2.VideoCapture as is read; gives the next of `images` when asked to, the last one for ever."""

    def __init__(self, *images: int) -> None:
        self.images, self.go, self.taken = list(images), threading.Semaphore(0), threading.Semaphore(0)
        self.over = False

    def read(self):
        if self.taken_before:
            self.taken.release()                          # whoever asks again is done with the one before
        self.taken_before = True
        self.go.acquire()
        if self.over:
            return False, None
        return True, np.full((8, 8, 3), self.images.pop(0) if len(self.images) > 1 else self.images[0], np.uint8)

    taken_before = False

    def next(self) -> None:
        self.go.release()
        assert self.taken.acquire(timeout=20.0)

    def get(self, number: int) -> float:
        return 0.0

    def release(self) -> None: ...


def test_an_image_that_comes_again_is_none_and_a_camera_that_gives_no_other_is_lost() -> None:
    clock, capture = SetClock(), Capture(10, 20, 20)
    camera = CameraThread(capture, clock, "still")
    for _ in range(2):
        capture.next()
        assert camera.read() is not None
    for _ in range(5):
        clock.t_ns += SILENT_NS // 6
        capture.next()
        assert camera.read() is None
    clock.t_ns += SILENT_NS
    with pytest.raises(LinkLost, match="camera still: repeats the same frame"):
        camera.read()
    capture.images = [30]
    capture.next()
    assert camera.read() is not None
    capture.over = True
    for _ in range(20):
        capture.go.release()
    camera.close()
