"""Datagrams of sd_notify on a real socket, grants and refusals of real time, and exposures of V4L2 cameras."""

import contextlib
import socket
import sys
import threading

import cv2
import numpy as np
import pytest

from truearc.hw.fault_codes import CAMERA_EXPOSURE_AUTOMATIC, CAMERA_EXPOSURE_WRONG
from truearc.hw.protocols import LinkLost
from truearc.hw.real import system as realtime
from truearc.hw.real.system import ServiceManager
from truearc.hw.real.wires import SILENT_NS, CameraThread, lock_exposure

needs_unix = pytest.mark.skipif(sys.platform == "win32", reason="AF_UNIX datagrams: POSIX only")
needs_linux = pytest.mark.skipif(sys.platform != "linux", reason="real-time scheduling is asked of Linux only")


@needs_unix
@pytest.mark.parametrize("abstract", [False, pytest.param(True, marks=needs_linux)])
def test_messages_arrive_one_datagram_each(tmp_path, abstract):
    address = f"@truearc-{tmp_path.name}-{id(tmp_path)}" if abstract else str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        systemd.bind("\0" + address[1:] if abstract else address)
        systemd.settimeout(5.0)
        manager = ServiceManager(address)
        manager.say("READY=1\nSTATUS=running")
        manager.say("WATCHDOG=1")
        manager.close()
        manager.close()
        manager.say("WATCHDOG=1")                         # after the end: nothing
        assert [systemd.recv(100) for _ in range(3)] == [b"READY=1\nSTATUS=running", b"WATCHDOG=1", b"STOPPING=1"]
        systemd.setblocking(False)
        with pytest.raises(BlockingIOError):
            systemd.recv(100)


@needs_unix
def test_a_manager_that_does_not_listen_stops_nobody(tmp_path):
    ServiceManager(str(tmp_path / "nobody")).say("WATCHDOG=1")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        systemd.bind(str(tmp_path / "notify"))
        manager = ServiceManager(str(tmp_path / "notify"))
        for _ in range(10_000):                           # far more than its queue holds: never blocks
            manager.say("WATCHDOG=1")


def test_a_refusal_is_an_answer_in_words_and_everything_is_elsewhere(monkeypatch):
    def refuse(*_):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(realtime.os, "sched_setscheduler", refuse, raising=False)
    monkeypatch.setattr(realtime.sys, "platform", "linux")
    assert realtime.ask_fifo(50) == ("real-time scheduling (SCHED_FIFO 50)", "Operation not permitted")
    with started_thread():
        assert realtime.ask_fifo_beside(50).refused == "Operation not permitted"
    monkeypatch.setattr(realtime.sys, "platform", "win32")
    for answer in (realtime.ask_fifo(50), realtime.ask_fifo_beside(50), realtime.ask_core(1),
                   realtime.ask_locked_memory(), *realtime.rehearse(50)):
        assert answer.refused == "this is not Linux"


@contextlib.contextmanager
def started_thread():
    over = threading.Event()
    thread = threading.Thread(target=over.wait)
    thread.start()
    yield thread
    over.set()
    thread.join()


@needs_linux
def test_other_threads_are_asked_for_below_the_loops_own(monkeypatch):
    asked = {}
    monkeypatch.setattr(realtime.os, "sched_setscheduler", lambda tid, policy, param: asked.update({tid: param}))
    with started_thread() as thread:
        assert realtime.ask_fifo_beside(50).refused == ""
        assert asked[thread.native_id].sched_priority == 49 and threading.get_native_id() not in asked


@needs_linux
def test_a_core_that_is_there_is_granted_and_one_that_is_not_is_refused():
    import os
    before = os.sched_getaffinity(0)
    try:
        core = min(before)
        assert realtime.ask_core(core).refused == "" and os.sched_getaffinity(0) == {core}
    finally:
        os.sched_setaffinity(0, before)
    assert realtime.ask_core(100_000).refused and os.sched_getaffinity(0) == before


@needs_linux
def test_memory_is_not_locked_under_a_limit(monkeypatch):
    import resource
    monkeypatch.setattr(resource, "getrlimit", lambda _: (8 << 20, 8 << 20))
    monkeypatch.setattr(realtime.os, "geteuid", lambda: 1000)
    assert realtime.ask_locked_memory().refused == "only 8192 KiB are allowed"


S = 1_000_000_000


class Gated:
    """A capture that gives one image whenever the test lets it, stamped by the driver."""

    def __init__(self, stamps_ms: list[float], shades: list[int] | None = None) -> None:
        self.go, self.given = threading.Semaphore(0), threading.Semaphore(0)
        self.stamps_ms, self.shades = stamps_ms, shades or list(range(1, len(stamps_ms) + 1))
        self.count = 0
        self.released = False

    def read(self):
        self.given.release()                               # the image before this one has been kept
        self.go.acquire(timeout=5.0)
        self.count += 1
        if self.count > len(self.stamps_ms):
            return False, None
        return True, np.full((4, 6, 3), self.shades[self.count - 1], np.uint8)

    def get(self, _property: int) -> float:
        return self.stamps_ms[self.count - 1]

    def release(self) -> None:
        self.released = True

    def give(self, count: int = 1) -> None:
        for _ in range(count):
            self.go.release()
            self.given.acquire(timeout=5.0)


@pytest.fixture
def gated(clock):
    clock.t_ns = 10 * S
    capture = Gated([9_950.0, 9_960.0, 3.0, 99_000.0])
    camera = CameraThread(capture, clock, "gated", exposure_s=0.02)
    capture.given.acquire(timeout=5.0)
    yield capture, camera
    capture.go.release(50)
    camera.close()
    assert capture.released


def test_only_the_newest_image_is_kept_and_read_once(gated) -> None:
    capture, camera = gated
    assert camera.read() is None
    capture.give(2)
    assert camera.read().image[0, 0, 0] == 2
    assert camera.read() is None


def test_the_stamp_is_mid_exposure_by_the_drivers_clock_when_that_is_ours(gated) -> None:
    capture, camera = gated
    capture.give()
    assert camera.read().t_ns == 9_960_000_000              # driver's 9.950 s and half of 20 ms
    capture.give(2)
    assert camera.read().t_ns == 10 * S                     # 3 ms is another clock: when it was received
    capture.give()
    assert camera.read().t_ns == 10 * S                     # nothing comes from the future


def test_a_camera_that_gives_nothing_is_lost_after_two_seconds(gated, clock) -> None:
    _, camera = gated
    clock.t_ns += 2 * S
    assert camera.read() is None
    clock.t_ns += 1
    with pytest.raises(LinkLost, match=r"gated.*no images"):
        camera.read()


def test_an_image_that_comes_again_is_none_and_a_camera_that_gives_no_other_is_lost(clock) -> None:
    capture = Gated([0.0] * 8, [10, 20, 20, 20, 20, 20, 20, 30])
    camera = CameraThread(capture, clock, "still")
    capture.given.acquire(timeout=5.0)
    for _ in range(2):
        capture.give()
        assert camera.read() is not None
    for _ in range(5):
        clock.t_ns += SILENT_NS // 6
        capture.give()
        assert camera.read() is None
    clock.t_ns += SILENT_NS
    with pytest.raises(LinkLost, match="camera still: repeats the same frame"):
        camera.read()
    capture.give()
    assert camera.read() is not None
    capture.go.release(50)
    camera.close()


class Obeys:
    """A camera that takes settings only after some images, or some of them never."""

    def __init__(self, after: int, deaf: tuple[int, ...] = ()) -> None:
        self.images, self.after, self.deaf = 0, after, deaf
        self.now = {cv2.CAP_PROP_AUTO_EXPOSURE: 3.0, cv2.CAP_PROP_EXPOSURE: 156.0}

    def set(self, key: int, value: float) -> bool:
        if self.images >= self.after and key not in self.deaf:
            self.now[key] = round(value)
        return True

    def get(self, key: int) -> float:
        return self.now[key]

    def read(self):
        self.images += 1
        return True, np.zeros((2, 2, 3), np.uint8)


@pytest.mark.parametrize("after", [0, 5])
def test_exposure_is_set_and_read_back(after):
    capture = Obeys(after)
    assert lock_exposure(capture, 0.0032, "0") is None
    assert capture.now == {cv2.CAP_PROP_AUTO_EXPOSURE: 1.0, cv2.CAP_PROP_EXPOSURE: 32.0} and capture.images == after


def test_an_exposure_that_is_not_kept_is_told():
    automatic = lock_exposure(Obeys(0, (cv2.CAP_PROP_AUTO_EXPOSURE,)), 0.003, "0")
    assert automatic == CAMERA_EXPOSURE_AUTOMATIC(camera="0")
    other = lock_exposure(Obeys(0, (cv2.CAP_PROP_EXPOSURE,)), 0.003, "0")
    assert other.code == CAMERA_EXPOSURE_WRONG.name
    assert (other.params["exposure_s"], other.params["wanted_s"]) == pytest.approx((0.0156, 0.003), abs=1e-4)
