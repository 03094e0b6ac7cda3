"""One writer at a time, also where one was killed and its solver was not."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.proof.playing import prove
from truearc.errors import InputError
from truearc_proof.rounds import Room, alone

PLAY = [sys.executable, "-m", "truearc", "prove", "--worlds", "3", "--level", "L0", "--shots", "12", "--engines",
        "numpy", "--seed", "3", "--processes", "1", "--quiet", "--out"]
PATIENCE_S = 300.0


def wait_for(there: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not there():
        assert time.monotonic() < deadline
        time.sleep(0.05)


def is_free(root: Path) -> bool:
    try:
        with alone(root):
            return True
    except InputError:
        return False


def test_a_second_writer_is_told_so_and_the_lock_goes_with_its_holder(tmp_path: Path) -> None:
    program = ("from pathlib import Path; from truearc_proof.rounds import alone\n"
               f"with alone(Path({str(tmp_path)!r})): pass")
    with alone(tmp_path):
        done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
        assert "is being played by another process" in done.stderr
    subprocess.run([sys.executable, "-c", program], check=True)


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="kill -9")
def test_a_round_whose_player_was_killed_is_left_to_its_solver_and_then_goes_on(tmp_path: Path) -> None:
    room = Room(tmp_path / "round")
    player = subprocess.Popen([*PLAY, str(room.root)], stdout=subprocess.DEVNULL)
    try:                              # the first of three is claimed: the solver is at work on the others
        wait_for(lambda: room.ledger.exists() and b'"claimed"' in room.ledger.read_bytes())
    finally:
        player.send_signal(signal.SIGKILL)
        player.wait()
    assert not is_free(room.root)
    wait_for(lambda: is_free(room.root))
    done = prove(room.root, "solve", "--processes", "1", "--quiet")
    assert done.returncode == 0, done.stderr
    assert [list(steps) for steps in room.steps().values()] == [["sealed", "claimed"]] * 3


@pytest.mark.slow
def test_who_takes_up_a_round_that_is_being_solved_is_refused(tmp_path: Path) -> None:
    (tmp_path / "ledger.jsonl").touch()
    with alone(tmp_path):
        for role in (["seal", "--seed", "1"], ["solve"], ["answer"], ["grade"]):
            done = prove(tmp_path, *role)
            assert done.returncode == 2 and "played by another process" in done.stderr, done.stderr
