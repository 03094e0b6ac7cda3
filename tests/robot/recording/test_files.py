"""Files on disks that refuse, candump lines, where `truearc run` records, and what earlier sessions give up."""

import errno
import os
import shutil
from collections import namedtuple
from functools import partial
from pathlib import Path

import can
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from tests.robot.good_tick import CONFIG
from tests.robot.recording.test_writer import kept_cycles, open_writer, play, ticks
from truearc.cli.common import SHIPPED
from truearc.cli.run_robot import make_room
from truearc.errors import InputError
from truearc.hw.protocols import Frame
from truearc.robot.config.schema import RecordingConfig, load_config
from truearc.robot.reasons import DISK_BACKLOG_FULL, DISK_FULL, FILE_DELETED
from truearc.robot.recording import files
from truearc.robot.recording.files import Appender, NotKept, candump_line, claim, parse_candump
from truearc.robot.recording.reader import TickReader
from truearc.robot.recording.session import load_session_config, load_trials, make_header
from truearc.robot.recording.upkeep import BULK, S_PER_DAY, prune, recover
from truearc.robot.recording.writer import LaneKeeper, SessionWriter, disk_trouble

resource = pytest.importorskip("resource")        # POSIX


@pytest.fixture
def room():
    """A function that limits how long any file of this process may grow, lifted at the end."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    yield lambda limit: resource.setrlimit(resource.RLIMIT_FSIZE, (soft if limit is None else limit, hard))
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_what_is_on_a_full_disk_is_a_whole_beginning(tmp_path, room):
    file = Appender(tmp_path / "f", pending_bytes=1000)
    room(100)
    for number in range(1000):
        file.write(b"%05d\n" % number)
    with pytest.raises(OSError):
        file.flush()
    room(None)
    for number in range(1000, 1010):
        file.write(b"%05d\n" % number)
    with pytest.raises(NotKept, match="not kept") as caught:
        file.flush()
    assert disk_trouble(caught.value) == DISK_BACKLOG_FULL()
    file.close()
    kept = (tmp_path / "f").read_bytes().split()
    assert kept == [b"%05d" % number for number in range(len(kept))] and 100 < 6 * len(kept) < 1100


def test_a_file_is_locked_while_it_grows_and_deleted_is_trouble(tmp_path):
    file = Appender(tmp_path / "f")
    with (tmp_path / "f").open("rb") as other, pytest.raises(BlockingIOError):
        claim(other)
    with pytest.raises(FileExistsError):
        Appender(tmp_path / "f")
    file.close()
    with (tmp_path / "f").open("rb") as other:
        claim(other)
    file = Appender(tmp_path / "trials.jsonl")
    file.write(b"one\n")
    file.flush()
    (tmp_path / "trials.jsonl").unlink()
    for _ in range(2):
        file.write(b"more\n")
        with pytest.raises(NotKept, match="has been deleted") as caught:
            file.flush()
        assert disk_trouble(caught.value) == FILE_DELETED(file="trials.jsonl")
    file.close()


@st.composite
def frames(draw):
    extended, remote = draw(st.booleans()), draw(st.booleans())
    data = bytes(draw(st.integers(0, 8))) if remote else draw(st.binary(max_size=8))
    return Frame(draw(st.integers(0, 10**15)) * 1000, draw(st.integers(0, 0x1FFFFFFF if extended else 0x7FF)), data,
                 extended, remote)


@given(frame=frames(), sent=st.booleans(), t_us=st.integers(0, 10**12))
def test_a_line_says_all_of_a_frame(frame, sent, t_us):
    line = candump_line(frame, sent, t_us * 1000)
    assert parse_candump(line) == ((frame._replace(t_ns=0) if sent else frame), sent)
    assert parse_candump(line[:-1]) is None            # torn


@given(text=st.text(max_size=60))
@example(text=f"({'1' * 5001}.000000) can0 123#00 R\n")          # more digits than int takes
def test_any_other_line_is_none(text):
    assert parse_candump(text) is None


def test_a_recorded_log_is_read_alike_by_python_can(plain):
    lines = [parse_candump(line) for line in (plain / "can0.log").open()]
    messages = list(can.CanutilsLogReader(plain / "can0.log"))
    assert len(messages) == len(lines) > 3000
    for (frame, sent), message in zip(lines, messages, strict=True):
        data = bytes(message.dlc) if message.is_remote_frame else bytes(message.data)
        assert (frame.arbitration_id, frame.data, frame.is_extended, frame.is_remote) == (
            message.arbitration_id, data, message.is_extended_id, message.is_remote_frame)
        assert message.is_rx is not sent
        assert sent or frame.t_ns == round(message.timestamp * 1e6) * 1000


def test_folders_are_numbered_where_clocks_go_back_and_full_disks_told(tmp_path, monkeypatch, capsys):
    names = []
    for hour in ("10", "11", "10", "10"):                  # an hour on, and back
        folder = make_room(tmp_path / "sessions", f"2026-01-01T{hour}:00:00+00:00")
        SessionWriter(folder, make_header(CONFIG, None, None), CONFIG, None, lossless=True).close()
        names.append(folder.name)
    assert names == ["2026-01-01T100000+0000", "2026-01-01T110000+0000", "2026-01-01T100000+0000-2",
                     "2026-01-01T100000+0000-3"]
    monkeypatch.setattr(shutil, "disk_usage", lambda path: namedtuple("usage", "free")(7 << 20))
    assert make_room(tmp_path, "2026-01-01T10:00:00+00:00") == tmp_path / "2026-01-01T100000+0000"
    assert f"warning: {tmp_path}: 7 MB free, " in capsys.readouterr().err


@pytest.mark.parametrize("refused", ["config.json", "telemetry.mcap"])
def test_a_folder_that_finds_no_room_is_made_later_whole(tmp_path, monkeypatch, refused):
    """As a full disk refuses, without one: which only root may make."""
    open_path, room = Path.open, []

    def open_it(path, mode="r", *rest, **more):
        if path.name == refused and "x" in mode and not room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return open_path(path, mode, *rest, **more)

    monkeypatch.setattr(Path, "open", open_it)
    monkeypatch.setattr(files, "AGAIN", 1)
    recorder = SessionWriter(tmp_path / "s", make_header(CONFIG, None, None), CONFIG, None, lossless=False,
                             open_keeper=partial(LaneKeeper, lossless=False, waits=True))
    assert recorder.trouble() == DISK_FULL()
    some = list(ticks(600, marks=(100,)))
    play(recorder, some[:350])
    room.append(True)
    play(recorder, some[350:])
    recorder.close()
    assert recorder.failed is None and kept_cycles(tmp_path / "s") == list(range(1, 601))
    assert len(load_trials(tmp_path / "s")) == 1


NOW_S = 2e9
SIZE = 60_000_000                     # of a session's telemetry, mostly a hole


@pytest.fixture
def out(tmp_path):
    """Five sessions of 1 to 5 days ago, and things that are none; `5` is running."""
    for number in range(1, 6):
        folder = tmp_path / str(number)
        recorder = open_writer(folder)
        play(recorder, ticks(20, marks=(10,)))
        recorder.close()
        (folder / "notes.txt").write_text("a driver's own")
        (folder / "aims").mkdir()
        (folder / "frames" / "1.png").write_bytes(b"image")
        with (folder / "telemetry.mcap").open("ab") as file:
            file.truncate(SIZE)
        os.utime(folder / "telemetry.mcap", (0.0, NOW_S - (6 - number) * S_PER_DAY + 60.0))
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "telemetry.mcap").write_bytes(bytes(100))
    (tmp_path / "linked").symlink_to(tmp_path / "1")
    return tmp_path


def whole(out):
    return [name for name in "12345" if (out / name / "telemetry.mcap").exists()]


@pytest.mark.parametrize(("limits", "stay"), [
    (RecordingConfig(keep_days=2.5), "45"), (RecordingConfig(keep_days=4.0), "2345"),
    (RecordingConfig(keep_gb=0.2), "345"), (RecordingConfig(keep_gb=0.35), "12345"),
    (RecordingConfig(keep_gb=0.2, keep_days=2.5), "45"), (RecordingConfig(keep_gb=0.25, keep_days=2.5), "45"),
    (RecordingConfig(), "12345")])
def test_the_oldest_give_up_their_bulk_first(out, limits, stay):
    pruned = prune(out / "5", limits, NOW_S)
    assert whole(out) == list(stay) and [path.name for path in pruned] == [name for name in "12345" if name not in stay]
    for path in pruned:
        assert sorted(one.name for one in path.iterdir()) == ["aims", "config.json", "notes.txt", "session.json",
                                                              "trials.jsonl"]
        assert len(load_trials(path)) == 1 and load_session_config(path) == CONFIG
    assert (out / "other" / "telemetry.mcap").exists()
    assert prune(out / "5", limits, NOW_S) == []


def test_running_sessions_stay_and_a_clock_that_is_behind_deletes_none(out):
    assert prune(out / "5", RecordingConfig(keep_days=1.0), 0.0) == []
    with (out / "2" / "telemetry.mcap").open("r+b") as file:
        claim(file)
        prune(out / "1", RecordingConfig(keep_gb=0.1, keep_days=1.0), NOW_S + 1000 * S_PER_DAY)
    assert whole(out) == ["1", "2"]


@pytest.mark.parametrize("header", ["", "{", "[]"])
def test_a_session_whose_head_is_damaged_counts_and_goes_in_its_turn(out, header):
    for name in "25":
        (out / name / "session.json").write_text(header)
    assert [path.name for path in prune(out / "5", RecordingConfig(keep_gb=0.2), NOW_S)] == ["1", "2"]
    assert whole(out) == ["3", "4", "5"]
    assert {"session.json", "config.json", "trials.jsonl"} <= {path.name for path in (out / "2").iterdir()}


def test_a_session_without_head_and_telemetry_counts_and_goes_and_no_other_folder(out):
    for name, missing in (("1", ()), ("2", ("config.json",)), ("3", ("session.json",))):
        (out / name / "session.json").write_text("")
        with (out / name / "can0.log").open("ab") as file:
            file.truncate(SIZE)
        for gone in ("telemetry.mcap", *missing):
            (out / name / gone).unlink()
    assert [path.name for path in prune(out / "5", RecordingConfig(keep_gb=0.13), NOW_S)] == ["1"]
    assert not (out / "1" / "can0.log").exists() and (out / "1" / "config.json").exists()
    assert all((out / name / "can0.log").stat().st_size == SIZE for name in "23") and whole(out) == ["4", "5"]


def test_a_link_in_a_session_goes_and_what_it_names_stays(out):
    (out / "other" / "photo.png").write_bytes(b"photo")
    (out / "1" / "frames" / "1.png").unlink()
    (out / "1" / "frames" / "frames.jsonl").unlink()
    (out / "1" / "frames").rmdir()
    (out / "1" / "frames").symlink_to(out / "other")
    prune(out / "5", RecordingConfig(keep_days=1.0), NOW_S)
    assert not (out / "1" / "frames").is_symlink() and (out / "other" / "photo.png").exists()


def test_a_pruned_session_says_so_and_keeps_its_trials_when_it_is_recovered(out):
    prune(out / "5", RecordingConfig(keep_days=1.0), NOW_S)
    trials = (out / "1" / "trials.jsonl").read_bytes()
    with pytest.raises(InputError, match=r"telemetry\.mcap: .*\[recording\].*trials\.jsonl"):
        list(TickReader(out / "1"))
    assert not any((out / "1" / name).exists() for name in BULK)
    recover(out / "1")
    assert (out / "1" / "trials.jsonl").read_bytes() == trials


@pytest.mark.parametrize(("line", "words"), [
    ("keep_gb = 0.01", "recording.keep_gb"), ("keep_gb = nan", "recording.keep_gb"),
    ("keep_days = 0", "recording.keep_days"), ("keep = 1", "unknown key")])
def test_a_limit_that_cannot_be_is_named(line, words, tmp_path):
    path = tmp_path / "launcher.toml"
    path.write_text(f"{SHIPPED.read_text(encoding='utf-8')}\n[recording]\n{line}\n", encoding="utf-8")
    with pytest.raises(InputError, match=words):
        load_config(path)
