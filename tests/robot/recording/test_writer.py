"""The recorder, in a process of its own, too: a disk that is full, read-only or hung, killed, stopped or left alone."""

import os
import signal
import sys
import threading
from contextlib import ExitStack

import numpy as np
import pytest
from msgspec.structs import replace

import truearc.cli.run_processes
import truearc.cli.run_robot
from benchmarks.kill import kill_once
from tests.robot.good_tick import CONFIG, good_inputs
from tests.robot.test_rig import Wire
from tests.robot.test_run_door import CONFIG as SHIPPED
from tests.robot.test_run_door import Box
from tests.waiting import PATIENCE_S, wait_until
from truearc.cli.main import main
from truearc.cli.run_processes import RecorderProcess
from truearc.errors import InputError
from truearc.hw.fault_codes import PROCESS_ENDED, PROCESS_KILLED
from truearc.hw.protocols import CameraFrame, Frame
from truearc.hw.real.clock import MonotonicClock
from truearc.robot.eyes import NoEyes
from truearc.robot.reasons import DISK_ERROR, DISK_UNRESPONSIVE, IMAGE_NOT_ENCODED, RECORDER_UNRESPONSIVE
from truearc.robot.recording import files
from truearc.robot.recording import writer as far_keeper
from truearc.robot.recording.files import Appender, append_trials, load_image, load_pictures
from truearc.robot.recording.reader import TickReader
from truearc.robot.recording.session import load_trials, make_header
from truearc.robot.recording.writer import MARKING_NS, SessionWriter, disk_trouble
from truearc.robot.tick import step
from truearc.robot.types import Memory, Outcome

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


posix = pytest.mark.skipif(os.name != "posix", reason="signals")


@pytest.mark.parametrize(("layout", "seed"), [*(("one", seed) for seed in range(4)),
                                              *(pytest.param("three", seed, marks=posix) for seed in range(3))])
def test_a_process_killed_at_a_random_moment_loses_no_mark_and_little_else(plain, tmp_path, layout, seed):
    """What records by itself, as fast as it can, and the control process at the robot's pace."""
    killed = kill_once(plain, tmp_path / "s", seed, "twin" if layout == "one" else "robot", layout)
    assert killed.faults == [] and killed.marks_lost == 0 and killed.lost_s <= 0.25


@pytest.fixture(autouse=True)
def patient(monkeypatch):
    monkeypatch.setattr(far_keeper, "MARK_S", PATIENCE_S)


@pytest.fixture
def process():
    with ExitStack() as wires:
        yield RecorderProcess(wires)


def test_recorder_process_ends_silently_when_closed_while_starting(monkeypatch):
    raised = []
    monkeypatch.setattr(threading, "excepthook", raised.append)
    with ExitStack() as wires:
        RecorderProcess(wires)                    # as where another wire of the run cannot be opened
    assert raised == []


@pytest.fixture
def recorder(process, tmp_path):
    return open_recorder(tmp_path / "s", process)


def open_recorder(folder, process=None):
    return open_writer(folder, process is None, None if process is None else process.open_keeper)


def test_the_files_are_those_of_one_process(process, tmp_path):
    for name, at in (("far", process), ("near", None)):
        recorder = open_recorder(tmp_path / name, at)
        for tick in ticks(300, marks=(100, 200)):
            recorder.tap(Frame(tick.inputs.t_ns, 0x29, bytes(8)), False)
            recorder.tap(Frame(0, 0x070E00C5, b"\x01", True), True)
            recorder.record(tick, None)
        recorder.keep_picture(CameraFrame(5 * MS, np.arange(480 * 640 * 3, dtype=np.uint8).reshape(480, 640, 3)))
        recorder.close()
        assert recorder.failed is None and recorder.dropped == 0, name
    assert [list(TickReader(tmp_path / name)) for name in ("far",)] == [list(TickReader(tmp_path / "near"))]
    for name in ("can0.log", "trials.jsonl", "frames/frames.jsonl", "config.json", "session.json", "telemetry.mcap"):
        assert (tmp_path / "far" / name).read_bytes() == (tmp_path / "near" / name).read_bytes(), name
    near, far = (load_image(tmp_path / name, load_pictures(tmp_path / name)[0]) for name in ("near", "far"))
    assert (near.image == far.image).all()


def test_a_marked_trial_is_on_disk_when_its_tick_is_over(recorder, tmp_path):
    for tick in ticks(50, marks=(10, 20)):
        recorder.record(tick, None)
        assert len(load_trials(tmp_path / "s")) == (tick.inputs.cycle > 10) + (tick.inputs.cycle > 20)
    recorder.close()


@posix
def test_a_killed_recorder_is_told_at_once_and_loses_no_marked_trial(process, recorder, tmp_path):
    some = list(ticks(400, marks=(50, 150, 250)))
    play(recorder, some[:200])
    wait_until(lambda: len(load_trials(tmp_path / "s")) == 2)
    assert recorder.trouble() is None and not recorder.is_over()
    os.kill(process.child.pid, signal.SIGKILL)
    wait_until(lambda: recorder.trouble() == PROCESS_KILLED(process="recorder", signal=9), 1.0)
    play(recorder, some[200:])                             # and nothing waits for it
    wait_until(recorder.is_over)
    recorder.close()
    assert str(recorder.failed) == "the recorder process ended (signal 9)" and recorder.dropped > 0
    assert [trial.outcome.trial for trial in load_trials(tmp_path / "s")] == [0, 1, 2]
    kept = kept_cycles(tmp_path / "s")
    assert kept == list(range(1, len(kept) + 1)) and len(kept) <= 200


@posix
def test_a_run_whose_recorder_is_gone_waits_for_the_mark_of_a_shot_that_is_out_but_not_for_ever(process, recorder):
    out = [replace(tick, memory=replace(tick.memory, awaiting=True)) for tick in ticks(20)]
    os.kill(process.child.pid, signal.SIGKILL)
    wait_until(process.child.is_gone)
    play(recorder, out[:10])
    assert not recorder.is_over()
    play(recorder, [replace(out[10], inputs=replace(out[10].inputs, t_ns=MARKING_NS + 45 * MS))])
    assert recorder.is_over()
    play(recorder, ticks(1))
    assert recorder.is_over()
    recorder.close()


@posix
def test_a_stopped_recorder_does_not_answer_and_goes_on_with_nothing_lost(process, recorder, tmp_path, monkeypatch):
    monkeypatch.setattr(far_keeper, "MARK_S", 0.01)
    some = list(ticks(3000, marks=(50, 1000)))
    play(recorder, some[:200])
    os.kill(process.child.pid, signal.SIGSTOP)
    wait_until(lambda: recorder.trouble() == RECORDER_UNRESPONSIVE(), 3.0)
    play(recorder, some[200:])                             # far more than a pipe holds; only the mark is waited for
    assert not recorder.is_over()
    os.kill(process.child.pid, signal.SIGCONT)

    def is_well():
        recorder._keeper.push()
        return recorder.trouble() is None

    wait_until(is_well)
    recorder.close()
    assert recorder.failed is None and recorder.dropped == 0
    assert kept_cycles(tmp_path / "s") == list(range(1, 3001)) and len(load_trials(tmp_path / "s")) == 2


@posix
def test_a_recorder_that_never_goes_on_is_killed_and_its_trials_are_put_down(process, recorder, tmp_path, monkeypatch):
    monkeypatch.setattr(far_keeper, "CLOSE_S", 0.3)
    some = list(ticks(300, marks=(50, 200)))
    play(recorder, some[:100])
    os.kill(process.child.pid, signal.SIGSTOP)
    monkeypatch.setattr(far_keeper, "MARK_S", 0.01)
    play(recorder, some[100:])
    recorder.close()
    assert "the recorder does not respond" in str(recorder.failed)
    assert [trial.outcome.trial for trial in load_trials(tmp_path / "s")] == [0, 1]


@posix
def test_what_a_stopped_recorder_cannot_be_sent_is_bounded_and_counted(process, recorder, tmp_path, monkeypatch):
    monkeypatch.setattr(far_keeper, "PENDING_BYTES", 1 << 18)
    os.kill(process.child.pid, signal.SIGSTOP)
    play(recorder, ticks(4000))
    assert process._outbox.waiting < 1 << 20 and recorder.dropped > 0
    os.kill(process.child.pid, signal.SIGCONT)
    recorder.close()
    kept = kept_cycles(tmp_path / "s")
    assert recorder.failed is None and len(kept) < 4000 and kept[:500] == list(range(1, 501))


@pytest.mark.skipif(sys.platform != "linux", reason="limits another process")
def test_a_full_disk_over_there_is_a_hold_here_and_space_made_in_time_loses_nothing(process, recorder, tmp_path):
    import resource

    pid, limit = process.child.pid, resource.RLIMIT_FSIZE
    soft, hard = resource.getrlimit(limit)
    some = list(ticks(1000, marks=(100, 900)))
    play(recorder, some[:200])
    wait_until(lambda: len(load_trials(tmp_path / "s")) == 1)
    resource.prlimit(pid, limit, (2500, hard))
    play(recorder, some[200:600])
    wait_until(lambda: recorder.trouble() == DISK_ERROR(detail="File too large"))
    resource.prlimit(pid, limit, (soft, hard))
    play(recorder, some[600:])
    wait_until(lambda: recorder.trouble() is None)
    recorder.close()
    assert recorder.failed is None
    assert kept_cycles(tmp_path / "s") == list(range(1, 1001)) and len(load_trials(tmp_path / "s")) == 2


def test_files_that_cannot_be_opened_there_are_bad_input_here(process, tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=r"file/nowhere/frames: Not a directory"):
        process.open_keeper(tmp_path / "file" / "nowhere", {})


@posix
def test_what_is_no_message_ends_the_recorder_and_is_told(process, recorder):
    process._outbox.put(b"\xc1")
    wait_until(lambda: recorder.trouble() == PROCESS_ENDED(process="recorder", exit_code=1))
    recorder.close()
    assert recorder.failed is not None


def test_half_a_row_gives_way_to_whole_ones(tmp_path):
    (tmp_path / "trials.jsonl").write_bytes(b'{"one":1}\n{"tw')
    append_trials(tmp_path, [b'{"two":2}', b'{"three":3}'])
    assert (tmp_path / "trials.jsonl").read_bytes() == b'{"one":1}\n{"two":2}\n{"three":3}\n'


@posix
def test_a_run_ends_by_itself_released_with_code_2_when_its_recorder_is_killed(tmp_path, monkeypatch, capsys):
    bus, processes = Wire(), []
    read = bus.read

    def kill_in_time():
        if len(bus.sent) > 500 and len(processes) == 1:
            processes.append(os.kill(processes[0].child.pid, signal.SIGKILL))
        return read()

    def begin(wires, *_):
        processes.append(RecorderProcess(wires))
        return processes[0]

    monkeypatch.setattr(bus, "read", kill_in_time)
    monkeypatch.setattr(truearc.cli.run_processes, "RecorderProcess", begin)
    monkeypatch.setattr(truearc.cli.run_robot, "_open_wires", lambda *_: (bus, Box(), NoEyes(), MonotonicClock()))
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    assert main(["run", "--config", SHIPPED, "--out", str(tmp_path), "--priority", "0"]) == 2
    for number, handler in before.items():
        signal.signal(number, handler)
    said = capsys.readouterr().err
    assert "the recording stopped: the recorder process ended (signal 9)" in said and "vision is process" in said
    idle = [frame.data[0] for frame in bus.sent[-8:] if frame.arbitration_id & 0x1F == 0x07]
    assert idle == [1, 1, 1, 1]                                               # every axis asked to be idle
