"""What earlier sessions give up: by age, by size, never the running one, never a trial."""

import os

import pytest

from tests.robot.good_tick import CONFIG
from tests.robot.recording.test_writer import open_writer, play, ticks
from truearc.cli.common import SHIPPED
from truearc.errors import InputError
from truearc.robot.config.schema import Config, RecordingConfig, parse_toml
from truearc.robot.recording.files import claim
from truearc.robot.recording.reader import TickReader
from truearc.robot.recording.session import load_session_config, load_trials
from truearc.robot.recording.upkeep import BULK, S_PER_DAY, prune, recover

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
def test_a_limit_that_cannot_be_is_named(line, words):
    with pytest.raises(InputError, match=words):
        parse_toml(f"{SHIPPED.read_text(encoding='utf-8')}\n[recording]\n{line}\n", Config, "a")
