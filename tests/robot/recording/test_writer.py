"""The recorder when the disk is full, read-only or hung, and when its process is killed."""

import errno
import threading

import numpy as np
import pytest
from msgspec.structs import replace

from benchmarks.kill import kill_once
from tests.robot.good_tick import CONFIG, good_inputs
from truearc.errors import InputError
from truearc.hw.protocols import CameraFrame
from truearc.robot.reasons import DISK_ERROR, DISK_UNRESPONSIVE, IMAGE_NOT_ENCODED
from truearc.robot.recording import files
from truearc.robot.recording.files import Appender
from truearc.robot.recording.reader import TickReader
from truearc.robot.recording.session import load_trials, make_header
from truearc.robot.recording.writer import LaneKeeper, SessionWriter, disk_trouble
from truearc.robot.tick import step
from truearc.robot.types import Memory, Outcome

resource = pytest.importorskip("resource")        # POSIX
MS = 1_000_000


def open_writer(folder, lossless=True, open_keeper=None):
    return SessionWriter(folder, make_header(CONFIG, None, None), CONFIG, None, lossless, open_keeper)


def ticks(count, marks=()):
    """Ticks of a 200 Hz loop; trial n is marked at tick marks[n]."""
    inputs = good_inputs()
    for number in range(count):
        tick = step(replace(inputs, t_ns=number * 5 * MS, cycle=number + 1), Memory(), CONFIG, None)
        outcomes = tuple(Outcome(trial, number * 5 * MS, "two") for trial, at in enumerate(marks) if at == number)
        yield replace(tick, outcomes=outcomes)


def play(recorder, some_ticks):
    for tick in some_ticks:
        recorder.record(tick, None)


def kept_cycles(folder):
    return [tick.inputs.cycle for tick, _ in TickReader(folder)]


def test_a_disk_that_turned_read_only_is_told_and_leaves_what_was_there(tmp_path, monkeypatch):
    recorder = open_writer(tmp_path / "s")
    play(recorder, ticks(200, marks=(50,)))

    def refuse(self):
        raise OSError(errno.EROFS, "Read-only file system")

    monkeypatch.setattr(Appender, "flush", refuse)
    play(recorder, ticks(200, marks=(20,)))
    assert recorder.trouble() == DISK_ERROR(detail="Read-only file system")
    recorder.close()
    assert isinstance(recorder.failed, OSError) and recorder.failed.errno == errno.EROFS
    assert kept_cycles(tmp_path / "s") == list(range(1, len(kept_cycles(tmp_path / "s")) + 1))
    assert len(kept_cycles(tmp_path / "s")) >= 150 and len(load_trials(tmp_path / "s")) == 1


def test_a_disk_that_hangs_never_stops_the_tick_and_is_told(tmp_path, monkeypatch):
    hung, sync = threading.Event(), Appender.sync
    flush = Appender.flush
    monkeypatch.setattr(Appender, "flush", lambda self: (hung.wait(), flush(self))[1])
    monkeypatch.setattr(Appender, "sync", lambda self: (hung.wait(), sync(self))[1])
    recorder = open_writer(tmp_path / "s", lossless=False)
    play(recorder, ticks(300))
    assert recorder.trouble() is None
    play(recorder, list(ticks(1000))[300:])                # returns: nothing waits for the disk
    assert recorder.trouble() == DISK_UNRESPONSIVE()
    hung.set()
    recorder.close()
    assert recorder.failed is None and kept_cycles(tmp_path / "s") == list(range(1, 1001))


def test_what_a_lane_cannot_take_is_counted(tmp_path, monkeypatch):
    hung, flush = threading.Event(), Appender.flush
    monkeypatch.setattr(Appender, "flush", lambda self: (hung.wait(), flush(self))[1])
    recorder = open_writer(tmp_path / "s", False, lambda *what: LaneKeeper(*what, False, longest=3))
    play(recorder, ticks(500))
    assert recorder.dropped > 0
    hung.set()
    recorder.close()


def test_an_image_that_cannot_be_kept_is_told_and_the_next_one_is_kept(tmp_path):
    recorder = open_writer(tmp_path / "s")
    recorder.keep_picture(CameraFrame(5 * MS, np.zeros((0, 0, 3), np.uint8)))
    recorder.keep_picture(CameraFrame(6 * MS, np.zeros((8, 8, 3), np.uint8)))
    recorder.close()
    assert [path.name for path in sorted((tmp_path / "s" / "frames").iterdir())] == ["000000006.png", "frames.jsonl"]


def test_an_image_that_no_encoder_takes_is_a_reason_with_its_name(tmp_path, monkeypatch):
    monkeypatch.setattr(files.cv2, "imencode", lambda *_: (False, None))
    recorder = open_writer(tmp_path / "s")
    recorder.keep_picture(CameraFrame(6 * MS, np.zeros((8, 8, 3), np.uint8)))
    recorder.close()
    assert disk_trouble(recorder.failed) == IMAGE_NOT_ENCODED(file="000000006.png")


def test_a_folder_that_cannot_be_made_is_named_before_anything_moves(tmp_path, monkeypatch):
    def refuse(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(files.os, "fsync", refuse)
    with pytest.raises(InputError, match=r"config\.json: No space left on device"):
        open_writer(tmp_path / "s")


@pytest.mark.parametrize("seed", range(4))
def test_a_recorder_killed_at_a_random_moment_loses_no_mark_and_little_else(plain, tmp_path, seed):
    killed = kill_once(plain, tmp_path / "s", seed, "twin")
    assert killed.faults == []
    assert killed.marks_lost == 0
    assert killed.lost_s <= 0.25
