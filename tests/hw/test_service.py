"""sd_notify's datagrams, as a real socket receives them; and what a machine that must be on time grants or refuses."""

import contextlib
import socket
import sys
import threading

import pytest

from truearc.hw.real import system as realtime
from truearc.hw.real.system import ServiceManager

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


def test_without_a_manager_nothing_happens():
    manager = ServiceManager(None)
    manager.say("READY=1")
    manager.close()


def test_a_refusal_is_an_answer_in_words(monkeypatch):
    def refuse(*_):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(realtime.os, "sched_setscheduler", refuse, raising=False)
    monkeypatch.setattr(realtime.sys, "platform", "linux")
    assert realtime.ask_fifo(50) == ("real-time scheduling (SCHED_FIFO 50)", "Operation not permitted")
    with started_thread():
        assert realtime.ask_fifo_beside(50).refused == "Operation not permitted"


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


def test_elsewhere_everything_is_refused_with_the_reason(monkeypatch):
    monkeypatch.setattr(realtime.sys, "platform", "win32")
    for answer in (realtime.ask_fifo(50), realtime.ask_fifo_beside(50), realtime.ask_core(1),
                   realtime.ask_locked_memory(), *realtime.rehearse(50)):
        assert answer.refused == "this is not Linux"


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


@needs_linux
def test_a_rehearsal_changes_nothing_here():
    import os
    before = os.sched_getscheduler(0)
    asked = [answer.asked for answer in realtime.rehearse(50)]
    assert asked == ["real-time scheduling (SCHED_FIFO 50)", "locked memory"] and os.sched_getscheduler(0) == before
