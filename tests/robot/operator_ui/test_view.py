"""Ticks as the page shows them."""

import math

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import UNSET
from msgspec.structs import replace

from tests.robot.good_tick import CONFIG, NOW_NS, good_inputs, good_memory, seconds
from tests.robot.operator_ui.test_driver_messages import aims, angles, memories, motors, numbers
from truearc.hw.fault_codes import CAMERA_SILENT, CAN_BUS_OFF
from truearc.robot import reasons as because
from truearc.robot.operator_ui.view import FIRED_S, RECENT, Glance, PageView, describe, look
from truearc.robot.tick import step
from truearc.robot.types import Memory, Outcome, Sighting, Tick

UNPLUGGED = because.CAMERA_LOST(cause=CAMERA_SILENT(camera="0"))
GONE = because.CAN_LOST(cause=CAN_BUS_OFF(bus="CAN"))
GOOD = step(good_inputs(), good_memory(), CONFIG, None)
READY = step(good_inputs(), replace(good_memory(), request_t_ns=0), CONFIG, None)


def seen(*ticks, recording="monday") -> PageView:
    glance = Glance()
    for tick in ticks:
        glance = look(glance, tick)
    return describe(glance, ticks[-1], CONFIG, recording)


def line(view, title, name):
    return next(one for block in view.blocks if block.title.startswith(title) for one in block.lines
                if one.name == name)


def test_fire_and_hold_are_the_verdict_s():
    assert GOOD.verdict.fire and (seen(GOOD).state, seen(GOOD).tone, seen(GOOD).told) == ("FIRE", "fire", ())
    ready = seen(READY)
    assert (ready.state, ready.tone, [one.do for one in ready.told]) == ("HOLD", "ready", ["press FIRE"])
    idle = seen(step(good_inputs(), Memory(), CONFIG, None))
    assert (idle.state, idle.tone, idle.told[0].do) == ("HOLD", "you", "press ARM")
    lost = seen(step(replace(good_inputs(), faults=(UNPLUGGED,)), good_memory(), CONFIG, None))
    assert (lost.state, lost.tone, lost.told[0].means) == ("HOLD", "fault", "No pictures from the camera")


def next_tick(after_s, **change):
    t_ns = NOW_NS + seconds(after_s)
    good = good_inputs()

    def young(reading):
        stamps = [name for name in ("t_ns", "heartbeat_t_ns", "faults_t_ns", "errors_t_ns")
                  if getattr(reading, name, UNSET) is not UNSET]
        return replace(reading, **dict.fromkeys(stamps, t_ns))

    inputs = replace(good, t_ns=t_ns, flywheels=tuple(map(young, good.flywheels)), hood_motor=young(good.hood_motor),
                     feeder=young(good.feeder), hood_angle=young(good.hood_angle), **change)
    return step(inputs, GOOD.memory, CONFIG, None)


def test_fire_stays_on_the_tile_for_as_long_as_one_can_read_it_and_no_fault_comes_up():
    soon, later = next_tick(FIRED_S - 0.1), next_tick(FIRED_S + 0.1)
    assert not soon.verdict.fire and (seen(GOOD, soon).state, seen(GOOD, later).state) == ("FIRE", "HOLD")
    assert seen(GOOD, soon).told[0].means == "The last shot is not marked"
    assert seen(GOOD, next_tick(0.1, faults=(GONE,))).state == "HOLD"
    disarmed = replace(soon, memory=replace(soon.memory, armed=False))
    assert seen(GOOD, disarmed).state == "HOLD"


def test_numbers_have_their_units_and_what_stands_in_the_way_is_marked():
    slow = replace(good_inputs(), flywheels=tuple(replace(motor, velocity_rad_s=312.0)
                                                  for motor in good_inputs().flywheels))
    view = seen(step(slow, good_memory(), CONFIG, None))
    assert line(view, "Aim", "distance").value == "5.00 ± 0.03 m"
    wheels = line(view, "Aim", "wheels")
    assert wheels.value == "312 of 359 rad/s" and not wheels.ok and line(seen(READY), "Aim", "wheels").ok
    assert line(view, "Aim", "hood").value == "48.5 of 48.5°" and line(view, "Aim", "p(three)").value == "–"
    assert line(view, "Robot", "battery").value == "12.2 V" and line(view, "Robot", "armed").ok
    rated = replace(READY, verdict=replace(READY.verdict, p_two=0.12, p_three=0.81))
    assert (line(seen(rated), "Aim", "p(three)").value, line(seen(rated), "Aim", "p(two)").value) == ("81%", "12%")


def test_each_link_has_its_age_and_the_newest_sighting_is_kept():
    old = replace(good_inputs(), hood_motor=replace(good_inputs().hood_motor, t_ns=NOW_NS - seconds(2.5)),
                  feeder=replace(good_inputs().feeder, heartbeat_t_ns=0), hood_angle=None,
                  sighting=Sighting(NOW_NS - seconds(0.02), False, because.IMAGE_BRIGHT()),
                  faults=(because.BOX_SILENT(),))
    view = seen(step(old, replace(good_memory(), last_sighting=None), CONFIG, None))
    links = {one.name: (one.value, one.ok) for block in view.blocks[-1:] for one in block.lines}
    assert links == {"flywheel motor 1": ("4 ms / 4 ms", True), "flywheel motor 2": ("4 ms / 4 ms", True),
                     "hood motor": ("2.5 s / 4 ms", False), "feeder motor": ("4 ms / never", False),
                     "hood encoder": ("never", False), "camera": ("20 ms", True), "button box": ("gone", False)}
    assert line(view, "Aim", "target").value == "never seen: " + because.text(because.IMAGE_BRIGHT())
    blind = step(replace(good_inputs(), sighting=Sighting(NOW_NS, False, because.IMAGE_DARK())),
                 replace(good_memory(), last_sighting=None), CONFIG, None)
    after = step(good_inputs(), replace(good_memory(), last_sighting=None), CONFIG, None)
    assert line(seen(blind, after), "Aim", "target").value == "never seen: " + because.text(because.IMAGE_DARK())


@pytest.mark.parametrize(("recording", "faults", "value", "ok"), [
    ("monday", (), "monday", True), ("", (), "nothing is recorded", False),
    ("monday", (because.NOT_RECORDING(cause=because.DISK_FULL()),), "not recording: no space left on the disk", False),
])
def test_whether_it_is_recorded(recording, faults, value, ok):
    view = seen(step(replace(good_inputs(), faults=faults), good_memory(), CONFIG, None), recording=recording)
    assert (line(view, "Robot", "recording").value, line(view, "Robot", "recording").ok) == (value, ok)


def fired(trial) -> Tick:
    return replace(GOOD, shot=replace(GOOD.shot, trial=trial))


def marked(trial, outcome, *reasons) -> Tick:
    return replace(READY, outcomes=(Outcome(trial, NOW_NS, outcome, reasons),))


def test_shots_and_marks_of_the_session_newest_first():
    view = seen(fired(0), marked(0, "three"), fired(1), marked(1, "two"),
                marked(2, "held", because.TARGET_NEVER_SEEN()), fired(3))
    lines = [(one.name, one.value) for block in view.blocks if block.title == "Shots" for one in block.lines]
    assert lines == [("this session", "3 fired: 1 held, 1 three, 1 two"), ("3 from 5.00 m", "not marked yet"),
                     ("2", "held: Target not seen yet"), ("1 from 5.00 m", "two"), ("0 from 5.00 m", "three")]
    view = seen(fired(0), marked(0, "three"), marked(0, "rejected"))
    assert line(view, "Shots", "this session").value == "1 fired: 1 rejected"
    assert line(view, "Shots", "0 from 5.00 m").value == "rejected"
    glance = Glance()
    for trial in range(300):
        glance = look(look(glance, fired(trial)), marked(trial, "two"))
    assert glance.shots == 300 and glance.outcomes == {"two": 300} and len(glance.recent) == RECENT
    assert glance.seq == 600


@settings(max_examples=500)
@given(wheels=st.tuples(motors, motors), hood=motors, angle=angles, memory=memories, aim=aims, number=numbers)
def test_whatever_a_tick_holds_can_be_shown_and_never_as_fire_against_the_verdict(wheels, hood, angle, memory, aim,
                                                                                  number):
    inputs = replace(good_inputs(), flywheels=wheels, hood_angle=angle, hood_motor=replace(hood, position_rad=1.0))
    tick = replace(step(inputs, memory, CONFIG, None), aim=aim)
    tick = replace(tick, estimate=replace(tick.estimate, distance_m=number, battery_v=number, sighting_s=number))
    view = seen(tick)
    assert msgspec.json.decode(msgspec.json.encode(view), type=PageView) == view
    assert (view.state == "FIRE") == tick.verdict.fire
    assert view.told or tick.verdict.fire
    assert all(one.value for block in view.blocks for one in block.lines) and math.isfinite(view.t_robot_s)
