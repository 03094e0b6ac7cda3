"""Lateness of ticks, and what the service's watchdog is told."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from tests.robot.good_tick import CONFIG, NOW_NS, good_inputs
from tests.robot.test_rig import bench  # noqa: F401
from truearc.robot.reasons import BOX_SILENT, IMAGE_DARK
from truearc.robot.runtime import AT_MOST_US, Lateness, TimedRig, WatchedRig, first_missing
from truearc.robot.types import Command, Sent, Sighting

PERIOD_NS = 5_000_000
IDLE = Command(False, False, False, 0.0, 0.0, 0.0)
SEEN = Sighting(NOW_NS - 50_000_000, False, IMAGE_DARK())


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


def test_each_second_is_a_row_of_its_own_and_all_are_told_at_the_end():
    lateness = Lateness([].append, PERIOD_NS)
    lateness.close()
    assert lateness.lines() == []
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


class Given:
    """A rig that reads what it is given."""

    def __init__(self, *inputs):
        self.inputs = list(inputs)

    def read(self):
        return self.inputs.pop(0) if self.inputs else None

    def write(self, command):
        return Sent(command.enable_flywheel, command.enable_hood, command.enable_feeder, 0.0, 0.0, 0.0)

    def picture(self): ...


def later(inputs, tick, **changes):
    """The same, `tick` ticks on, as fresh as before."""
    by = tick * 5_000_000
    fresh = [replace(motor, t_ns=motor.t_ns + by, heartbeat_t_ns=motor.heartbeat_t_ns + by)
             for motor in (*inputs.flywheels, inputs.hood_motor, inputs.feeder)]
    angle = replace(inputs.hood_angle, t_ns=inputs.hood_angle.t_ns + by)
    return replace(inputs, t_ns=inputs.t_ns + by, flywheels=tuple(fresh[:2]), hood_motor=fresh[2], feeder=fresh[3],
                   hood_angle=angle, **changes)


def test_ready_once_then_alive_and_silent_where_it_does_not_write():
    said = []
    rig = WatchedRig(Given(*(later(good_inputs(), tick, sighting=SEEN) for tick in range(41))), CONFIG, said.append)
    while rig.read() is not None:
        rig.write(IDLE)
    assert said[0] == "READY=1\nSTATUS=running"
    assert said[1:] == ["WATCHDOG=1"] * 3                 # 0, 0.1 and 0.2 s: 41 ticks of 5 ms
    said = []
    rig = WatchedRig(Given(*(later(good_inputs(), tick, sighting=SEEN) for tick in range(100))), CONFIG, said.append)
    while rig.read() is not None:
        ...
    assert said == ["READY=1\nSTATUS=running"]


def test_not_ready_before_everything_has_been_heard():
    said = []
    deaf = replace(good_inputs(), hood_angle=None)
    rig = WatchedRig(Given(deaf, deaf, good_inputs(), replace(good_inputs(), sighting=SEEN)), CONFIG, said.append)
    while rig.read() is not None:
        rig.write(IDLE)
    assert said == ["STATUS=waiting: hood encoder", "STATUS=waiting: camera", "READY=1\nSTATUS=running", "WATCHDOG=1"]


@pytest.mark.parametrize(("changes", "missing"), [
    ({}, ""),
    ({"flywheels": "old"}, "flywheel motor 2"),
    ({"feeder": "mute"}, "feeder motor"),
    ({"hood_angle": None}, "hood encoder"),
    ({"faults": (BOX_SILENT(),)}, "button box: no heartbeat, outcomes cannot be marked")])
def test_what_is_missing_is_named(changes, missing):
    inputs = good_inputs()
    first, second = inputs.flywheels
    if changes.get("flywheels") == "old":
        changes = {"flywheels": (first, replace(second, t_ns=second.t_ns - 200_000_000))}
    if changes.get("feeder") == "mute":
        changes = {"feeder": replace(inputs.feeder, heartbeat_t_ns=0)}
    assert first_missing(replace(inputs, **changes), SEEN.t_ns, CONFIG) == missing
    for seen_ns in (None, NOW_NS - 1_000_000_000, NOW_NS + 1):            # no image, an old one, one from the future
        assert first_missing(good_inputs(), seen_ns, CONFIG) == "camera"
