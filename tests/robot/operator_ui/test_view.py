"""Ticks and messages as the page shows them: one message for every code, in the order of importance."""

import errno
import math
import os

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import UNSET
from msgspec.structs import replace

from tests.robot.good_tick import CONFIG, NOW_NS, good_inputs, good_memory, seconds
from tests.robot.samples import check, sample
from tests.robot.sparks import only_advice
from tests.robot.test_motion import AIMED, Launcher
from truearc.hw import fault_codes as hw
from truearc.hw.devices.odrive import frames as odrive
from truearc.hw.devices.spark import frames as spark
from truearc.hw.protocols import AngleReading, MotorReading
from truearc.hw.reason import FAULT, YOU, Reason
from truearc.robot import reasons as bot
from truearc.robot.aim import IDLE
from truearc.robot.estimate import estimate
from truearc.robot.gate import Rating
from truearc.robot.operator_ui.view import (
    FIRED_S,
    MESSAGES,
    RECENT,
    Glance,
    PageView,
    describe,
    find_message,
    look,
    tell,
)
from truearc.robot.recording.writer import disk_trouble
from truearc.robot.tick import step
from truearc.robot.types import Aim, Memory, Outcome, Sighting, Tick
from truearc.robot.verdict import judge

MODEL = replace(CONFIG, gate=replace(CONFIG.gate, policy="model"))
MOTOR = "flywheel motor 1"


def error(motor, *codes):
    return bot.MOTOR_ERROR(motor=motor, errors=tuple(code() for code in codes))


@pytest.mark.parametrize("code", [code for _, code in (*odrive.ERRORS, *spark.ERRORS)], ids=lambda code: code.name)
def test_every_error_of_a_motor_has_a_message(code):
    for reason in (error(MOTOR, code), error("hood motor", code, hw.ERROR_WATCHDOG_EXPIRED)):
        assert find_message(reason) is not None
    assert code.text in " ".join(tell([error(MOTOR, code)])[0].reasons)


def test_unknown_bits_and_codes_without_a_message_are_shown():
    (told,) = tell([bot.MOTOR_ERROR(motor=MOTOR, errors=odrive.errors_of(0x81000000))])
    assert told.reasons == (f"{MOTOR}: watchdog expired, error 0x80000000",)
    moon, sun = bot.IMAGE_DARK(), Reason("the_sun_is_up", {"height_deg": 12.0})
    told = tell([bot.NOT_ARMED(), moon, sun])
    assert [one.means for one in told] == [bot.text(moon), "the_sun_is_up (height_deg 12)", "Not armed"]
    assert told[0].kind == FAULT and tell(()) == ()


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EROFS, errno.EIO, errno.EDQUOT])
def test_a_disk_that_refuses_has_a_message(number):
    trouble = disk_trouble(OSError(number, os.strerror(number)))
    assert (trouble == bot.DISK_FULL()) == (number == errno.ENOSPC)
    (told,) = tell([bot.NOT_RECORDING(cause=trouble)])
    assert told.kind == FAULT and "nothing is recorded" in told.means.lower()


stamps = st.sampled_from([0, NOW_NS - seconds(0.004), NOW_NS - seconds(0.3), NOW_NS + seconds(1)])
numbers = st.floats(allow_nan=True, allow_infinity=True) | st.floats(-400, 400)
motors = st.builds(MotorReading, t_ns=stamps, position_rad=numbers, velocity_rad_s=numbers, heartbeat_t_ns=stamps,
                   axis_state=st.sampled_from([0, 1, 8]), axis_error=st.just(0) | st.integers(0, 2**32 - 1))
angles = st.none() | st.builds(AngleReading, t_ns=stamps, angle_rad=st.floats(0, 6.28), magnet_ok=st.booleans())
sightings = st.sampled_from([None, good_memory().last_sighting, replace(good_memory().last_sighting, t_ns=1)])
memories = st.builds(Memory, armed=st.booleans(), homed=st.booleans(), awaiting=st.booleans(), request_t_ns=stamps,
                     feed_t_ns=stamps, steady_t_ns=stamps, last_sighting=sightings)
aims = st.builds(Aim, motor_ratio=st.sampled_from([0.0, 0.5]), hood_deg=numbers,
                 source=st.just("plan"), stand_m=st.sampled_from([UNSET, 4.25])) | st.just(IDLE)
ratings = st.builds(Rating, *[st.none() | st.floats(0, 1) | st.just(float("nan"))] * 2, st.booleans(),
                    st.none() | st.floats(0, 3))


class Says:
    def __init__(self, rating):
        self.rating = rating

    def rate(self, *features):
        if self.rating is None:
            raise RuntimeError("out of memory")
        return self.rating


@settings(max_examples=1500)
@given(wheels=st.tuples(motors, motors), hood=motors, feeder=motors, angle=angles, memory=memories, aim=aims,
       gate=st.none() | st.builds(Says, st.none() | ratings), config=st.sampled_from([CONFIG, MODEL]))
def test_every_reason_that_comes_out_has_a_message(wheels, hood, feeder, angle, memory, aim, gate, config):
    inputs = replace(good_inputs(), flywheels=wheels, hood_motor=replace(hood, position_rad=1.0), feeder=feeder,
                     hood_angle=angle)
    verdict = judge(inputs, estimate(inputs, memory, config), aim, memory, config, gate)
    for reason in verdict.reasons:
        assert find_message(reason) is not None, reason
        check(reason)
        assert msgspec.json.decode(msgspec.json.encode(reason), type=Reason) == reason
    told = tell(verdict.reasons)
    assert sorted(reason for one in told for reason in one.reasons) == sorted(bot.texts(verdict.reasons))
    assert bool(told) == (not verdict.fire)


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: f"{message.code.name}-{message.case}")
def test_a_message_is_met_by_its_own_reason(message):
    reason = sample(message.code, message.case)
    assert find_message(reason) is message
    (told,) = tell([reason])
    assert message.kind in (FAULT, YOU, "wait") and told.reasons == (bot.text(reason),)
    assert told.means and "{" not in told.means + told.do
    assert message.do or message.kind == "wait"


def test_what_the_driver_can_fix_comes_first_and_motors_as_one():
    told = tell([bot.NOT_ARMED(), bot.WHEELS_OFF_SPEED(speed_rad_s=312.2, wanted_rad_s=358.0),
                 bot.DEVICE_STALE(device="hood motor", age_s=0.31),
                 bot.CAN_LOST(cause=hw.CAN_ADAPTER_ERROR(bus="CAN slcan /dev/ttyACM0", detail="gone")),
                 bot.TARGET_STALE(age_s=2.1)])
    assert [one.means for one in told] == [
        "CAN adapter pulled out?", "Hood motor: no frames for 0.31 s", "Not armed", "Target out of sight for 2.1 s",
        "Wheels are not at speed: 312 of 358 rad/s"]
    assert [one.do for one in told][2:4] == ["press ARM", "turn towards the target"]
    told = tell([bot.DEVICE_STALE(device=MOTOR, age_s=0.31), bot.DEVICE_STALE(device="hood encoder", age_s=0.30),
                 error(MOTOR, hw.ERROR_WATCHDOG_EXPIRED), error("hood motor", hw.ERROR_MOTOR_OVER_TEMPERATURE),
                 error("feeder motor", hw.ERROR_SPINOUT)])
    assert [one.means for one in told] == [
        "Flywheel motor 1, hood encoder: no frames for 0.31 s",
        "Flywheel motor 1: stopped by its watchdog (no commands received)",
        "Hood motor: motor too hot", "Feeder motor: its controller reports spinout"]
    assert told[0].reasons == ("flywheel motor 1: no frames for 0.31 s", "hood encoder: no frames for 0.30 s")


UNPLUGGED = bot.CAMERA_LOST(cause=hw.CAMERA_SILENT(camera="0"))
GONE = bot.CAN_LOST(cause=hw.CAN_BUS_OFF(bus="CAN"))
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


@pytest.mark.parametrize(("spoilt", "motor"), [
    ("flywheels", "Flywheel motor 1, flywheel motor 2"), ("hood_motor", "Hood motor"), ("feeder", "Feeder motor")])
def test_an_axis_that_leaves_control_is_a_fault_once_it_had_time(spoilt: str, motor: str):
    def leave(inputs):
        readings = getattr(inputs, spoilt)
        idle = (tuple(replace(one, axis_state=1) for one in readings) if isinstance(readings, tuple)
                else replace(readings, axis_state=1))
        return replace(inputs, **{spoilt: idle})

    launcher, glance, tones = Launcher(), Glance(), []
    launcher.arm()
    for spoil, lasts_s in ((leave, 0.3), (lambda inputs: inputs, 3.0), (leave, 5.0)):
        launcher.spoil, tone = spoil, set()
        begins = len(launcher.ticks)
        launcher.run(lasts_s)
        for tick in launcher.ticks[begins:]:
            glance = look(glance, tick)
            view = describe(glance, tick, AIMED, "monday")
            tone.add(view.tone)
        tones.append(tone)
    assert "fault" not in tones[0] | tones[1] and view.tone == "fault" and tones[2] == {"fault"}
    assert view.told[0].means == f"{motor}: its controller does not drive it"
    assert "Ready" not in "".join(one.means for one in view.told)
    theirs = describe(glance, launcher.ticks[-1], only_advice("odrive"), "monday")
    assert f"{motor}: released" in [one.means for one in theirs.told]      # another program's motor is not ours to take


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
                  sighting=Sighting(NOW_NS - seconds(0.02), False, bot.IMAGE_BRIGHT()), faults=(bot.BOX_SILENT(),))
    view = seen(step(old, replace(good_memory(), last_sighting=None), CONFIG, None))
    links = {one.name: (one.value, one.ok) for block in view.blocks[-1:] for one in block.lines}
    assert links == {"flywheel motor 1": ("4 ms / 4 ms", True), "flywheel motor 2": ("4 ms / 4 ms", True),
                     "hood motor": ("2.5 s / 4 ms", False), "feeder motor": ("4 ms / never", False),
                     "hood encoder": ("never", False), "camera": ("20 ms", True), "button box": ("gone", False)}
    assert line(view, "Aim", "target").value == "never seen: " + bot.text(bot.IMAGE_BRIGHT())
    blind = step(replace(good_inputs(), sighting=Sighting(NOW_NS, False, bot.IMAGE_DARK())),
                 replace(good_memory(), last_sighting=None), CONFIG, None)
    after = step(good_inputs(), replace(good_memory(), last_sighting=None), CONFIG, None)
    assert line(seen(blind, after), "Aim", "target").value == "never seen: " + bot.text(bot.IMAGE_DARK())


@pytest.mark.parametrize(("recording", "faults", "value", "ok"), [
    ("monday", (), "monday", True), ("", (), "nothing is recorded", False),
    ("monday", (bot.NOT_RECORDING(cause=bot.DISK_FULL()),), "not recording: no space left on the disk", False)])
def test_whether_it_is_recorded(recording, faults, value, ok):
    view = seen(step(replace(good_inputs(), faults=faults), good_memory(), CONFIG, None), recording=recording)
    assert (line(view, "Robot", "recording").value, line(view, "Robot", "recording").ok) == (value, ok)


def fired(trial) -> Tick:
    return replace(GOOD, shot=replace(GOOD.shot, trial=trial))


def marked(trial, outcome, *reasons) -> Tick:
    return replace(READY, outcomes=(Outcome(trial, NOW_NS, outcome, reasons),))


def test_shots_and_marks_of_the_session_newest_first():
    view = seen(fired(0), marked(0, "three"), fired(1), marked(1, "two"),
                marked(2, "held", bot.TARGET_NEVER_SEEN()), fired(3))
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
