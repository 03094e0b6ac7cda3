"""Messages of the page: one for every code, in the order of importance."""

import errno
import os

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import UNSET
from msgspec.structs import replace

from tests.robot.good_tick import CONFIG, NOW_NS, good_inputs, good_memory, seconds
from tests.robot.samples import check, sample
from truearc.hw import fault_codes as hw
from truearc.hw.devices.odrive import frames as odrive
from truearc.hw.devices.spark import frames as spark
from truearc.hw.protocols import AngleReading, MotorReading
from truearc.hw.reason import FAULT, YOU, Reason
from truearc.robot import reasons as bot
from truearc.robot.aim import IDLE
from truearc.robot.estimate import estimate
from truearc.robot.gate import Rating
from truearc.robot.operator_ui.view import MESSAGES, find_message, tell
from truearc.robot.recording.writer import disk_trouble
from truearc.robot.types import Aim, Memory
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
seen = st.sampled_from([None, good_memory().last_sighting, replace(good_memory().last_sighting, t_ns=1)])
memories = st.builds(Memory, armed=st.booleans(), homed=st.booleans(), awaiting=st.booleans(), request_t_ns=stamps,
                     feed_t_ns=stamps, steady_t_ns=stamps, last_sighting=seen)
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
