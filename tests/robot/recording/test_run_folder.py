"""Where `truearc run` records, whatever the time of day does."""

import shutil
from collections import namedtuple

import pytest

from tests.robot.good_tick import CONFIG
from truearc.cli.robot.run_robot import make_room
from truearc.robot.config.schema import InputError
from truearc.robot.recording.encoder import SessionWriter
from truearc.robot.recording.session import make_header


def test_a_clock_that_was_set_back_costs_a_number_behind_the_name(tmp_path):
    names = []
    for hour in ("10", "11", "10", "10"):                  # an hour on, and back
        folder = make_room(tmp_path / "sessions", f"2026-01-01T{hour}:00:00+00:00")
        SessionWriter(folder, make_header(CONFIG, None, None), CONFIG, None, lossless=True).close()
        names.append(folder.name)
    assert names == ["2026-01-01T100000+0000", "2026-01-01T110000+0000", "2026-01-01T100000+0000-2",
                     "2026-01-01T100000+0000-3"]


def test_a_disk_that_is_all_but_full_is_refused_before_anything_moves(tmp_path, monkeypatch):
    monkeypatch.setattr(shutil, "disk_usage", lambda path: namedtuple("usage", "free")(7 << 20))
    with pytest.raises(InputError, match="only 7 MB free; a recording needs 100 MB"):
        make_room(tmp_path, "2026-01-01T10:00:00+00:00")


def test_a_place_that_cannot_be_written_is_an_error_of_the_system(tmp_path):
    (tmp_path / "a_file").touch()
    with pytest.raises(OSError):
        make_room(tmp_path / "a_file" / "sessions", "2026-01-01T10:00:00+00:00")
