"""Where `truearc run` records, whatever the time of day does."""

import errno
import os
import shutil
from collections import namedtuple
from functools import partial
from pathlib import Path

import pytest

from tests.robot.good_tick import CONFIG
from tests.robot.recording.test_writer import kept_cycles, play, ticks
from truearc.cli.run_robot import make_room
from truearc.robot.reasons import DISK_FULL
from truearc.robot.recording import files
from truearc.robot.recording.session import load_trials, make_header
from truearc.robot.recording.writer import LaneKeeper, SessionWriter


def test_a_clock_that_was_set_back_costs_a_number_behind_the_name(tmp_path):
    names = []
    for hour in ("10", "11", "10", "10"):                  # an hour on, and back
        folder = make_room(tmp_path / "sessions", f"2026-01-01T{hour}:00:00+00:00")
        SessionWriter(folder, make_header(CONFIG, None, None), CONFIG, None, lossless=True).close()
        names.append(folder.name)
    assert names == ["2026-01-01T100000+0000", "2026-01-01T110000+0000", "2026-01-01T100000+0000-2",
                     "2026-01-01T100000+0000-3"]


def test_a_disk_that_is_all_but_full_is_warned_of(tmp_path, monkeypatch, capsys):
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
