"""A process beside ours: its start and its end are reported, it never outlives us, and its newest values come whole."""

import multiprocessing
import os
import signal
import socket
import struct
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.waiting import wait_until
from truearc.hw.fault_codes import CAMERA_NOT_OPENED, PIPE_ENDED, PROCESS_ENDED, PROCESS_KILLED
from truearc.hw.protocols import LinkLost
from truearc.hw.real import processes as module
from truearc.hw.real.clock import make_pauses_s
from truearc.hw.real.processes import Capacity, Child, Inbox, Outbox, Slots, make_shared

ROOT = Path(__file__).parents[2]
posix = pytest.mark.skipif(os.name != "posix", reason="signals")


NO_CAMERA, NOT_AGAIN = CAMERA_NOT_OPENED(camera="0"), CAMERA_NOT_OPENED(camera="1")


def wait_over(line, is_first):
    line.say(None)
    while not line.is_over(1.0):
        pass


def refuse(line, is_first, words):
    line.say(words)


def fall(line, is_first):
    sys.exit(3)


def stand_then_hang(line, is_first):
    line.say(None)
    time.sleep(1000.0)


def once(line, is_first):
    line.say(None if is_first else NOT_AGAIN)


def test_it_works_until_closed_and_why_it_cannot_start_is_told():
    child = Child("test", wait_over, (), restarts=False, mortal=True)
    assert child.trouble
    child.wait()
    assert child.trouble is None and child.pid and not child.is_gone()
    child.close(10.0)
    assert child.trouble == PROCESS_ENDED(process="test", exit_code=0)
    child = Child("test", refuse, (NO_CAMERA,), restarts=False, mortal=False)
    with pytest.raises(LinkLost, match=r"^camera 0: cannot be opened$") as lost:
        child.wait()
    assert lost.value.reason == NO_CAMERA
    child.close(10.0)
    child = Child("test", fall, (), restarts=False, mortal=False)
    with pytest.raises(LinkLost, match=r"the test process ended \(exit code 3\)"):
        child.wait()
    wait_until(child.is_gone)
    child.close(10.0)
    child = Child("test", once, (), restarts=True, mortal=True)
    wait_until(lambda: child.trouble == NOT_AGAIN)
    child.close(10.0)
    pauses = make_pauses_s(module.FIRST_S, module.LONGEST_S)
    assert [next(pauses) for _ in range(6)] == pytest.approx([0.2, 0.4, 0.8, 1.6, 3.2, 5.0])


@posix
def test_one_that_is_killed_is_told_at_once_and_started_again():
    child = Child("test", wait_over, (), restarts=True, mortal=True)
    child.wait()
    first = child.pid
    os.kill(first, signal.SIGKILL)
    wait_until(lambda: child.trouble, 1.0)
    assert child.trouble == PROCESS_KILLED(process="test", signal=9)
    wait_until(lambda: not child.trouble)
    assert child.pid != first and child.starts == 2 and not child.is_gone()
    child.close(10.0)


@posix
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_what_ends_the_group_does_not_end_it(name):
    child = Child("test", wait_over, (), restarts=False, mortal=True)
    child.wait()
    os.kill(child.pid, getattr(signal, name))
    time.sleep(0.1)
    assert child.trouble is None
    child.close(10.0)


@posix
def test_one_that_hangs_is_killed_when_it_is_to_end():
    child = Child("test", stand_then_hang, (), restarts=True, mortal=False)
    child.wait()
    child.close(0.2)
    assert child.trouble == PROCESS_KILLED(process="test", signal=9)


PARENT = """
import os, signal, sys
from truearc.hw.real.processes import Child
from truearc.hw.real.processes import Inbox, Outbox
from tests.hw.test_processes import {work}
if __name__ == "__main__":
    child = Child("test", {work}, (), restarts=True, mortal={mortal})
    child.wait()
    print(child.pid, flush=True)
    os.kill(os.getpid(), signal.SIGKILL)
"""


@posix
@pytest.mark.parametrize(("work", "mortal"), [("wait_over", False), pytest.param(
    "stand_then_hang", True, marks=pytest.mark.skipif(sys.platform != "linux", reason="asks Linux"))])
def test_it_does_not_outlive_a_parent_that_was_killed(work, mortal, tmp_path):
    program = tmp_path / "parent.py"
    program.write_text(PARENT.format(work=work, mortal=mortal))
    parent = subprocess.run([sys.executable, program], cwd=ROOT, capture_output=True, text=True,
                            env=os.environ | {"PYTHONPATH": str(ROOT)}, timeout=60.0)
    assert parent.returncode == -signal.SIGKILL, parent.stderr
    pid = int(parent.stdout)
    wait_until(lambda: not is_running(pid))


def is_running(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z" if Path(
            "/proc/self").exists() else os.kill(pid, 0) is None
    except (FileNotFoundError, ProcessLookupError):
        return False


def test_the_end_of_a_pipe_is_a_reason_after_its_last_message():
    near, far = socket.socketpair()
    sender, reader = Outbox(near), Inbox(far)
    sender.put(b"last")
    sender.close()
    assert reader.read(1.0) == [b"last"]
    with pytest.raises(LinkLost) as caught:
        reader.read(1.0)
    assert caught.value.reason == PIPE_ENDED()
    reader.close()


ROOM = Capacity(3, 100, 4 * 5 * 3)


def pair():
    memory = bytearray(ROOM.bytes)
    return Slots(memory, ROOM), Slots(memory, ROOM), memory


def image(value):
    return np.full((4, 5, 3), value, np.uint8)


def test_only_the_newest_is_read_once_whoever_writes_it():
    writer, reader, _ = pair()
    assert reader.read() is None and reader.image() is None
    for number in range(10):
        writer.put(b"%d" % number, image(number))
    assert reader.read() == b"9" and (reader.image() == 9).all()
    assert reader.read() is None and (reader.image() == 9).all()          # still there to be asked for
    writer, reader, memory = pair()
    writer.put(b"one")
    assert reader.read() == b"one"
    Slots(memory, ROOM).put(b"two")
    assert reader.read() == b"two"


def test_an_image_that_was_written_over_is_none_and_never_another():
    writer, reader, _ = pair()
    writer.put(b"first", image(1))
    assert reader.read() == b"first"
    for number in range(2, 5):
        assert (reader.image() == 1).all()
        writer.put(b"later", image(number))
    assert reader.image() is None
    assert reader.read() == b"later" and (reader.image() == 4).all()
    writer.put(b"no image")
    assert reader.read() == b"no image" and reader.image() is None


@pytest.mark.parametrize(("text", "picture"), [(b"x" * 101, None), (b"", np.zeros((5, 5, 3), np.uint8))])
def test_what_has_no_room_is_refused_and_leaves_what_was_there(text, picture):
    writer, reader, _ = pair()
    writer.put(b"small")
    with pytest.raises(ValueError, match="there is room for"):
        writer.put(text, picture)
    assert reader.read() == b"small"


@given(at=st.integers(16, ROOM.bytes - 1), to=st.integers(0, 255))
def test_a_byte_that_is_not_there_yet_is_noticed(at, to):
    writer, reader, memory = pair()
    writer.put(b"all of it", image(7))
    before, memory[at] = memory[at], to
    text, picture = reader.read(), reader.image()
    assert text in (None, b"all of it") and (picture is None or (picture == 7).all())
    if text is None:
        memory[at] = before
        assert reader.read() == b"all of it"


BIG = Capacity(2, 64, 200 * 300 * 3)


def hammer(memory, count):
    slots = Slots(memory, BIG)
    for number in range(count):
        slots.put(struct.pack("<q", number) * 8, np.full((200, 300, 3), number % 251, np.uint8))


def test_what_another_process_writes_meanwhile_is_never_torn():
    memory = make_shared(BIG.bytes)
    reader = Slots(memory, BIG)
    writer = multiprocessing.get_context("spawn").Process(target=hammer, args=(memory, 6_000))
    writer.start()
    texts = images = 0
    while writer.is_alive():
        text = reader.read()
        if text is not None:
            number = struct.unpack("<q", text[:8])[0]
            assert text == struct.pack("<q", number) * 8
            texts += 1
            picture = reader.image()
            if picture is not None:
                assert (picture == number % 251).all()
                images += 1
    writer.join()
    assert writer.exitcode == 0 and texts > 10 and images > 0
