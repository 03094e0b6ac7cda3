"""The recordings of `truearc reproduce`: made once, used again, refused when they are of something else."""

import pytest

from tests.proof.reproduce.pools import CONFIG
from truearc.errors import InputError
from truearc.robot.config.overrides import with_plan
from truearc.robot.config.schema import Prescribed
from truearc.robot.recording.replay import replay
from truearc.robot.recording.session import load_trials
from truearc_proof.reproduce.collect import DONE, Recording, make_record

PLAN = with_plan(CONFIG, (Prescribed(4.0, 0.5, 47.0),), 1)


def record(folder, recordings):
    return make_record(folder, None, 1, lambda what: lambda done, note: None)(recordings, "test")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recorded")
    return folder, record(folder, [Recording("one", PLAN, 1, 7)])


def test_a_recording_has_its_ticks_and_marks_and_replays(recorded):
    folder, sessions = recorded
    assert sessions == [folder / "one"]
    assert len(load_trials(sessions[0])) == 1 and replay(sessions[0])[0] > 100


def test_it_is_not_made_twice(recorded):
    folder, sessions = recorded
    before = (sessions[0] / "telemetry.mcap").stat().st_mtime_ns
    assert record(folder, [Recording("one", PLAN, 1, 7)]) == sessions
    assert (sessions[0] / "telemetry.mcap").stat().st_mtime_ns == before


@pytest.mark.parametrize("other", [Recording("one", PLAN, 1, 8), Recording("one", PLAN, 2, 7),
                                   Recording("one", with_plan(CONFIG, (), 1), 1, 7)])
def test_one_of_something_else_is_never_taken_for_it(recorded, other):
    with pytest.raises(InputError, match="one: recorded with other settings"):
        record(recorded[0], [other])


def test_one_that_was_broken_off_is_recorded_anew(recorded):
    folder, sessions = recorded
    whole = (sessions[0] / "telemetry.mcap").read_bytes()
    (sessions[0] / DONE).unlink()
    (sessions[0] / "telemetry.mcap").write_bytes(whole[:1000])
    record(folder, [Recording("one", PLAN, 1, 7)])
    assert (sessions[0] / "telemetry.mcap").read_bytes() == whole


def test_sessions_recorded_by_other_processes_are_known_again(tmp_path):
    """Worker processes get configurations by pickle, in which a default is an equal value and another object."""
    recordings = [Recording(name, CONFIG, 1, seed) for name, seed in (("one", 7), ("two", 8))]
    sessions = make_record(tmp_path, None, 2, lambda what: lambda done, note: None)(recordings, "test")
    assert [len(load_trials(session)) for session in sessions] == [1, 1]
