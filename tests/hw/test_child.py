"""A process beside ours: what is told of its start and its end, and that it never outlives us."""

import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from truearc.hw.fault_codes import CAMERA_NOT_OPENED, PIPE_ENDED, PROCESS_ENDED, PROCESS_KILLED
from truearc.hw.protocols import LinkLost
from truearc.hw.real import processes as module
from truearc.hw.real.clock import make_pauses_s
from truearc.hw.real.processes import Child, Inbox, Outbox

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


def until(true, limit_s=20.0):
    end = time.monotonic() + limit_s
    while not true() and time.monotonic() < end:
        time.sleep(0.005)
    assert true()


def test_it_works_until_it_is_closed():
    child = Child("test", wait_over, (), restarts=False, mortal=True)
    assert child.trouble
    child.wait()
    assert child.trouble is None and child.pid and not child.is_gone()
    child.close(10.0)
    assert child.trouble == PROCESS_ENDED(process="test", exit_code=0)


def test_why_it_cannot_start_is_told():
    child = Child("test", refuse, (NO_CAMERA,), restarts=False, mortal=False)
    with pytest.raises(LinkLost, match=r"^camera 0: cannot be opened$") as lost:
        child.wait()
    assert lost.value.reason == NO_CAMERA
    child.close(10.0)


def test_one_that_falls_before_its_first_word_is_told():
    child = Child("test", fall, (), restarts=False, mortal=False)
    with pytest.raises(LinkLost, match=r"the test process ended \(exit code 3\)"):
        child.wait()
    until(child.is_gone)
    child.close(10.0)


@posix
def test_one_that_is_killed_is_told_at_once_and_started_again():
    child = Child("test", wait_over, (), restarts=True, mortal=True)
    child.wait()
    first = child.pid
    os.kill(first, signal.SIGKILL)
    until(lambda: child.trouble, 1.0)
    assert child.trouble == PROCESS_KILLED(process="test", signal=9)
    until(lambda: not child.trouble)
    assert child.pid != first and child.starts == 2 and not child.is_gone()
    child.close(10.0)


def test_one_that_cannot_start_again_is_asked_ever_more_seldom():
    child = Child("test", once, (), restarts=True, mortal=True)
    until(lambda: child.trouble == NOT_AGAIN)
    child.close(10.0)
    pauses = make_pauses_s(module.FIRST_S, module.LONGEST_S)
    assert [next(pauses) for _ in range(6)] == pytest.approx([0.2, 0.4, 0.8, 1.6, 3.2, 5.0])


@posix
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_what_ends_the_group_does_not_end_it(name):
    child = Child("test", wait_over, (), restarts=False, mortal=True)
    child.wait()
    os.kill(child.pid, getattr(signal, name))
    time.sleep(0.2)
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
from tests.hw.test_child import {work}
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
    until(lambda: not is_running(pid))


def is_running(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z" if Path(
            "/proc/self").exists() else os.kill(pid, 0) is None
    except (FileNotFoundError, ProcessLookupError):
        return False


def test_the_module_never_forks():
    assert module.CONTEXT.get_start_method() == "spawn"


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
