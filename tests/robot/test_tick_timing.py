"""How late ticks come, against counts made by hand; and what the rig says of a clock that oversleeps."""

import msgspec
from hypothesis import given
from hypothesis import strategies as st

from tests.robot.good_tick import CONFIG
from tests.robot.test_rig import bench  # noqa: F401
from truearc.robot.processes.tick_timing import AT_MOST_US, Lateness, TimedRig
from truearc.robot.recording.session import LATENESS, make_header
from truearc.robot.recording.writer import SessionWriter
from truearc.robot.types import Command

PERIOD_NS = 5_000_000


def test_each_second_is_a_row_of_its_own_and_all_are_told_at_the_end():
    seconds = []
    lateness = Lateness(seconds.append, PERIOD_NS)
    for tick in range(400):
        lateness.note(tick * PERIOD_NS, {150: 7_000_000, 250: 60_000}.get(tick, 20_000))
    lateness.close()
    lateness.close()                                      # nothing new: nothing more
    assert [sum(second.counts) for second in seconds] == [200, 200]
    assert [second.worst_us for second in seconds] == [7000.0, 60.0]
    assert seconds[0].counts == (199, 0, 0, 0, 0, 0, 0, 1, 0, 0) and seconds[1].counts[:2] == (199, 1)
    assert lateness.lines()[0] == ("ticks came late by at most 0.05 ms (half of them), 0.05 ms (99 of 100), 7.00 ms "
                                   "(all); 1 of 400 by a whole tick or more")
    assert [line.split()[2:4] for line in lateness.lines()[1:]] == [["ms", "398"], ["ms", "1"], ["ms", "1"]]


@given(late_ns=st.lists(st.integers(0, 10**11), min_size=1))
def test_every_tick_is_counted_once_where_it_belongs(late_ns):
    seconds = []
    lateness = Lateness(seconds.append, PERIOD_NS)
    for tick, late in enumerate(late_ns):
        lateness.note(tick * PERIOD_NS, late)
    lateness.close()
    for index, edge in enumerate(AT_MOST_US):
        assert sum(sum(second.counts[:index + 1]) for second in seconds) == sum(ns <= edge * 1000 for ns in late_ns)
    assert sum(sum(second.counts) for second in seconds) == len(late_ns)
    assert max(second.worst_us for second in seconds) == max(late_ns) / 1000


def test_nothing_is_told_of_no_ticks():
    lateness = Lateness([].append, PERIOD_NS)
    lateness.close()
    assert lateness.lines() == []


def test_the_rig_knows_how_late_a_tick_came(bench):  # noqa: F811
    _, _, clock, rig = bench
    seconds = []
    lateness = Lateness(seconds.append, PERIOD_NS)
    timed = TimedRig(rig, lateness)
    timed.read()
    timed.read()
    assert rig.late_ns == 0
    clock.t_ns += 12_000_000                              # a tick that took 12 ms: the next was due after 5
    timed.read()
    assert rig.late_ns == 7_000_000
    timed.read()
    assert rig.late_ns == 0                               # skipped, not made up for
    lateness.close()
    assert sum(seconds[0].counts) == 4 and seconds[0].worst_us == 7000.0
    assert timed.write(Command(False, False, False, 0.0, 0.0, 0.0)).enable_hood is False


def test_rows_are_written_into_the_session(tmp_path):
    writer = SessionWriter(tmp_path / "s", make_header(CONFIG, None, None), CONFIG, None, lossless=False)
    lateness = Lateness(writer.keep_lateness, PERIOD_NS)
    for tick in range(201):
        lateness.note(tick * PERIOD_NS, 1000)
    lateness.close()
    writer.close()
    rows = [msgspec.json.decode(line) for line in (tmp_path / "s" / LATENESS).read_bytes().splitlines()]
    assert [sum(row["counts"]) for row in rows] == [200, 1] and rows[0]["at_most_us"] == list(AT_MOST_US)
