"""The recorder on a disk that is really full: a small one in memory, which only root may mount."""

import errno
import subprocess
import time
from contextlib import ExitStack

import pytest

from tests.robot.good_tick import CONFIG, good_memory
from tests.robot.recording.test_writer import MS, kept_cycles, open_writer, play, ticks
from truearc.cli.run_processes import RecorderProcess
from truearc.cli.run_robot import make_room
from truearc.errors import InputError
from truearc.robot.operator_ui.aim_inbox import AimOrders
from truearc.robot.operator_ui.what_if import QuestionError
from truearc.robot.reasons import DISK_FULL, NOT_RECORDING
from truearc.robot.recording.session import load_header, load_trials, make_header
from truearc.robot.recording.upkeep import recover
from truearc.robot.recording.writer import SessionWriter
from truearc.robot.rig import RecordingRig, ReplayRig
from truearc.robot.tick import step

NO_SPACE = "No space left on device"
FULL = NOT_RECORDING(cause=DISK_FULL())


@pytest.fixture
def disk(tmp_path):
    """Half a megabyte."""
    place = tmp_path / "disk"
    place.mkdir()
    try:
        subprocess.run(["mount", "-t", "tmpfs", "-o", "size=512k", "tmpfs", str(place)], check=True,
                       capture_output=True, text=True)
    except OSError as error:
        pytest.skip(f"no disk can be mounted here: {error.strerror}")
    except subprocess.CalledProcessError as error:
        pytest.skip(f"no disk can be mounted here: {error.stderr.strip()}")
    yield place
    subprocess.run(["umount", str(place)], check=True)


def until(true, limit_s=10.0):
    end = time.monotonic() + limit_s
    while not true() and time.monotonic() < end:
        time.sleep(0.01)
    assert true()


def fill(disk):
    """Until not a byte more fits; returns the file to be deleted."""
    ballast = disk / "ballast"
    with ballast.open("wb", buffering=0) as file, pytest.raises(OSError) as caught:
        while True:
            file.write(bytes(4096))
    assert caught.value.errno == errno.ENOSPC
    return ballast


def test_it_holds_while_the_disk_is_full_and_loses_nothing_once_there_is_room(disk):
    recorder = open_writer(disk / "s")
    all_ticks = list(ticks(1400, marks=(100, 500, 1300)))
    play(recorder, all_ticks[:200])
    assert recorder.trouble() is None
    ballast = fill(disk)
    play(recorder, all_ticks[200:1200])
    inputs = RecordingRig(ReplayRig([all_ticks[0]]), recorder.trouble).read()
    assert inputs.faults == (FULL,)
    assert FULL in step(inputs, good_memory(), CONFIG, None).verdict.reasons
    ballast.unlink()
    play(recorder, all_ticks[1200:])
    assert recorder.trouble() is None
    recorder.close()
    assert recorder.failed is None and recorder.dropped == 0
    assert kept_cycles(disk / "s") == list(range(1, 1401))
    assert [trial.outcome.t_ns for trial in load_trials(disk / "s")] == [500 * MS, 2500 * MS, 6500 * MS]


def test_a_disk_that_stays_full_keeps_a_whole_beginning(disk):
    recorder = open_writer(disk / "s")
    all_ticks = list(ticks(1400, marks=(100,)))
    play(recorder, all_ticks[:200])
    until(lambda: len(kept_cycles(disk / "s")) >= 180)     # the thread that writes them is not waited for otherwise
    ballast = fill(disk)
    play(recorder, all_ticks[200:])
    recorder.close()
    assert recorder.failed.errno == errno.ENOSPC
    kept = kept_cycles(disk / "s")
    assert 180 <= len(kept) < 1400 and kept == list(range(1, len(kept) + 1))
    ballast.unlink()
    recover(disk / "s")
    assert kept_cycles(disk / "s") == kept and len(load_trials(disk / "s")) == 1


def test_a_session_begun_on_a_full_disk_holds_and_loses_nothing_once_there_is_room(disk):
    ballast = fill(disk)
    with ExitStack() as wires:
        recorder = SessionWriter(make_room(disk / "out", "2026"), make_header(CONFIG, None, None), CONFIG, None,
                                 lossless=False, open_keeper=RecorderProcess(wires).open_keeper)
        inputs = RecordingRig(ReplayRig(list(ticks(1))), recorder.trouble).read()
        assert inputs.faults == (FULL,) and not list((disk / "out").iterdir())
        all_ticks = list(ticks(1400, marks=(100, 1300)))
        play(recorder, all_ticks[:1200])
        assert recorder.trouble() == DISK_FULL()
        ballast.unlink()
        play(recorder, all_ticks[1200:])
        keeper = recorder._keeper
        until(lambda: keeper.sync() or keeper.push() or recorder.trouble() is None)     # as further ticks would
        recorder.close()
    assert recorder.failed is None and recorder.dropped == 0
    assert kept_cycles(disk / "out" / "2026") == list(range(1, 1401))
    assert len(load_trials(disk / "out" / "2026")) == 2 and load_header(disk / "out" / "2026").truearc


def test_a_session_that_is_to_hold_nothing_back_is_refused_on_a_full_disk(disk):
    ballast = fill(disk)
    with pytest.raises(InputError, match=rf"(config\.json|frames): {NO_SPACE}"):
        open_writer(disk / "s")
    assert list(disk.iterdir()) == [ballast]               # not half a session either


def test_a_page_on_a_full_disk_takes_no_order_and_makes_its_token_at_the_next_start(disk):
    (disk / "aims").mkdir()
    ballast = fill(disk)
    with pytest.raises(QuestionError, match="the token"):
        AimOrders(disk / "aims", CONFIG).keep("Bearer ", b"")
    ballast.unlink()
    with pytest.raises(QuestionError, match="the token"):
        AimOrders(disk / "aims", CONFIG).keep("Bearer ", b"")
    assert len((disk / "aims" / "token").read_text()) > 20
