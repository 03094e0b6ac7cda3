"""The program that is driven, and the tick that drives it: any fault releases the motors, and for good."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from tests.robot.alike import codes
from tests.robot.good_tick import CONFIG, HOOD_DEG, NOW_NS, good_inputs, good_memory, seconds
from truearc.errors import InputError
from truearc.hw.devices.odrive.frames import IDLE
from truearc.hw.fault_codes import CAN_BUS_OFF
from truearc.hw.protocols import ButtonEvent
from truearc.robot import reasons as because
from truearc.robot.control import RELEASED
from truearc.robot.motion import DIFFERENT
from truearc.robot.sysid import COAST, FLYWHEEL, HOME, HOOD, RAMP, READY, STEP, make_step, phases
from truearc.robot.types import Joint, Memory, MotionMemory, Progress

GONE = because.CAN_LOST(cause=CAN_BUS_OFF(bus="CAN"))

STEP_ONCE = make_step(CONFIG)
PROGRAM = phases(CONFIG)


def excite(joint, **keys):
    changed = replace(getattr(CONFIG.identify, joint), **keys)
    return replace(CONFIG, identify=replace(CONFIG.identify, **{joint: changed}))


def pressed(button):
    return (ButtonEvent(NOW_NS, 1, button),)


def first(joint, kind, sign=1):
    return next(i for i, one in enumerate(PROGRAM) if (one.joint, one.kind, one.sign) == (joint, kind, sign))


def running(phase, since_s=0.5):
    """Armed, homed, in the middle of a phase; the hood's encoder has disagreed twice before, if it does."""
    memory, one = good_memory(), PROGRAM[phase]
    asked = {"flywheel_torque_nm" if one.joint == FLYWHEEL else "hood_torque_nm": one.sign * one.torque_nm}
    motion = MotionMemory(NOW_NS - seconds(5.0), wheels=Joint(push=one.sign), hood=Joint(differ=DIFFERENT - 1), **asked)
    return Memory(armed=True, homed=True, screw_zero_rad=memory.screw_zero_rad, motion=motion,
                  identify=Progress(phase, NOW_NS - seconds(since_s)))


def tick(inputs, memory):
    return STEP_ONCE(inputs, memory, CONFIG, None)


def inputs_at(joint, rad_s, hood_deg=HOOD_DEG, buttons=()):
    inputs = good_inputs(rad_s if joint == FLYWHEEL else 0.0, hood_deg, buttons)
    if joint == HOOD:
        inputs = replace(inputs, hood_motor=replace(inputs.hood_motor, velocity_rad_s=rad_s))
    return inputs


# --- the program


def test_the_program_has_each_ramp_and_step_its_way_and_coasts():
    assert all(one.sign > 0 for one in PROGRAM if one.joint == FLYWHEEL)
    reverse = phases(excite("flywheel", reverse=True))
    assert {one.sign for one in reverse if one.joint == FLYWHEEL and one.torque_nm} == {1, -1}
    for joint, ways in ((FLYWHEEL, 1), (HOOD, 2)):
        repeats = getattr(CONFIG.identify, joint).repeats
        mine = [one for one in PROGRAM if one.joint == joint and one.kind not in (READY, HOME)]
        for kind in (RAMP, STEP):
            assert sum(one.kind == kind for one in mine) == repeats * ways
        assert [one.kind == COAST for one in mine] == [number % 2 == 0 for number in range(len(mine))]
    driven = [one for one in PROGRAM if one.joint == HOOD and one.torque_nm]
    assert driven[0].kind == HOME
    assert sum(one.sign for one in driven[1:]) == 0


@given(st.sampled_from(PROGRAM), st.floats(0.0, 1e4))
def test_no_torque_is_ever_above_what_was_configured(phase, since_s):
    asked = phase.asked_nm(since_s)
    assert abs(asked) <= phase.torque_nm and asked * phase.sign >= 0.0
    if phase.joint == FLYWHEEL:
        assert abs(asked) <= CONFIG.identify.flywheel.step_nm


@pytest.mark.parametrize(("config", "words"), [
    (replace(CONFIG, identify=None), r"\[identify\] is missing"),
    (excite("flywheel", top_rad_s=590.0), "above rig.launcher.free_speed_rad_s"),
    (excite("hood", margin_deg=30.0), "identify.hood.margin_deg is 30: nothing is left"),
    (replace(CONFIG, identify=replace(CONFIG.identify, flywheel=replace(CONFIG.identify.flywheel, repeats=0),
                                      hood=replace(CONFIG.identify.hood, repeats=0))), "nothing would be driven")])
def test_what_the_launcher_forbids_is_refused_before_anything_moves(config, words):
    with pytest.raises(InputError, match=words):
        make_step(config)


# --- the tick


def test_nothing_moves_before_the_operator_arms():
    memory = Memory()
    for button in (None, "fire", "two", "reject"):
        out = tick(good_inputs(0.0, HOOD_DEG, pressed(button) if button else ()), memory)
        assert out.command == RELEASED and not out.verdict.fire
        memory = out.memory
    armed = tick(good_inputs(0.0, HOOD_DEG, pressed("arm")), memory)
    assert armed.command.enable_flywheel and armed.command.flywheel_torque_nm == 0.0


def test_it_waits_for_the_axes_and_gives_up_on_them():
    idle = good_inputs(0.0, HOOD_DEG)
    idle = replace(idle, flywheels=tuple(replace(one, axis_state=IDLE) for one in idle.flywheels))
    waits = tick(idle, running(0, since_s=1.0))
    assert waits.memory.identify.phase == 0
    assert waits.command.enable_flywheel and waits.command.flywheel_torque_nm == 0.0
    gives_up = tick(idle, running(0, since_s=6.0))
    assert because.MOTOR_NOT_DRIVEN.name in causes_of(gives_up) and gives_up.command == RELEASED
    goes_on = tick(good_inputs(0.0, HOOD_DEG), running(0, since_s=1.0))
    assert goes_on.memory.identify == Progress(1, NOW_NS)


def causes_of(out):
    return codes(out.memory.identify.over.params["causes"])


def wheels(inputs, **keys):
    return replace(inputs, flywheels=tuple(replace(motor, **keys) for motor in inputs.flywheels))


def one_wheel(inputs, **keys):
    return replace(inputs, flywheels=(inputs.flywheels[0], replace(inputs.flywheels[1], **keys)))


def stale(inputs, joint):
    old = NOW_NS - seconds(0.2)
    if joint == "encoder":
        return replace(inputs, hood_angle=replace(inputs.hood_angle, t_ns=old))
    if joint == "flywheel":
        return one_wheel(inputs, t_ns=old)
    return replace(inputs, **{joint: replace(getattr(inputs, joint), t_ns=old)})


@pytest.mark.parametrize(("phase", "spoil", "code"), [
    (first(FLYWHEEL, STEP), lambda i: stale(i, "flywheel"), because.DEVICE_STALE),
    (first(FLYWHEEL, STEP), lambda i: stale(i, "hood_motor"), because.DEVICE_STALE),
    (first(HOOD, STEP), lambda i: stale(i, "encoder"), because.DEVICE_STALE),
    (first(HOOD, COAST), lambda i: stale(i, "flywheel"), because.DEVICE_STALE),
    (first(HOOD, STEP), lambda i: replace(i, hood_angle=None), because.DEVICE_NEVER_RECEIVED),
    (first(FLYWHEEL, STEP), lambda i: replace(i, faults=(GONE,)), because.CAN_LOST),
    (first(FLYWHEEL, RAMP), lambda i: wheels(i, axis_error=1), because.MOTOR_ERROR),
    (first(FLYWHEEL, STEP), lambda i: wheels(i, velocity_rad_s=520.0), because.JOINT_OVERSPEED),
    (first(FLYWHEEL, STEP), lambda i: wheels(i, velocity_rad_s=math.nan), because.MOTOR_NOT_FINITE),
    (first(FLYWHEEL, STEP), lambda i: wheels(i, velocity_rad_s=-30.0), because.JOINT_BACKWARDS),
    (first(FLYWHEEL, STEP), lambda i: one_wheel(i, velocity_rad_s=70.0), because.FLYWHEELS_DIFFER),
    (first(HOOD, STEP), lambda i: replace(i, hood_motor=replace(i.hood_motor, velocity_rad_s=190.0)),
     because.JOINT_OVERSPEED),
    (first(HOOD, STEP), lambda i: replace(i, hood_motor=replace(i.hood_motor, position_rad=0.0)),
     because.HOOD_ENCODERS_DISAGREE)])
def test_every_doubt_lets_go_of_everything_for_good(phase, spoil, code):
    joint = PROGRAM[phase].joint
    good = inputs_at(joint, 60.0)
    assert tick(good, running(phase)).memory.identify.over is None
    out = tick(spoil(good), running(phase))
    assert code.name in causes_of(out)
    assert out.command == RELEASED and not out.memory.armed
    assert out.verdict.reasons == (out.memory.identify.over,) and not out.verdict.fire
    again = tick(replace(good, buttons=pressed("arm")), out.memory)
    assert again.command == RELEASED and again.memory.identify == out.memory.identify


@pytest.mark.parametrize("button", ["arm", "fire", "reject", "three"])
def test_any_button_is_a_release(button):
    out = tick(inputs_at(FLYWHEEL, 60.0, buttons=pressed(button)), running(first(FLYWHEEL, STEP)))
    assert out.command == RELEASED and out.memory.identify.over == because.IDENTIFY_RELEASED(button=button)


@pytest.mark.parametrize(("hood_deg", "rad_s", "ends"), [
    (70.0, 50.0, True), (70.0, -50.0, False), (70.0, 0.0, False), (18.0, -50.0, True), (18.0, 50.0, False)])
def test_the_hood_is_let_go_where_it_would_run_into_its_end(hood_deg, rad_s, ends):
    out = tick(inputs_at(HOOD, rad_s, hood_deg), running(first(HOOD, STEP) + 1))
    assert (out.memory.identify.over is not None) == ends
    if ends:
        assert causes_of(out) == [because.HOOD_AT_LIMIT.name] and out.command == RELEASED


def test_a_phase_ends_at_its_speed_or_margin_and_the_last_in_done():
    step = first(FLYWHEEL, STEP)
    assert tick(inputs_at(FLYWHEEL, 440.0), running(step)).memory.identify.phase == step
    ended = tick(inputs_at(FLYWHEEL, 460.0), running(step))
    assert ended.memory.identify == Progress(step + 1, NOW_NS) and ended.command.flywheel_torque_nm == 0.0
    assert tick(inputs_at(FLYWHEEL, 60.0), running(step + 1)).memory.identify.phase == step + 1
    assert tick(inputs_at(FLYWHEEL, 3.0), running(step + 1)).memory.identify.phase == step + 2
    up = first(HOOD, STEP)
    assert tick(inputs_at(HOOD, 60.0, 64.0), running(up)).memory.identify.phase == up + 1
    assert tick(inputs_at(HOOD, 60.0, 50.0), running(up)).memory.identify.phase == up
    out = tick(inputs_at(HOOD, 0.0), running(len(PROGRAM) - 1))
    assert out.memory.identify.over == because.IDENTIFY_DONE() and out.command == RELEASED


@pytest.mark.parametrize(("phase", "rad_s", "reason"), [
    (first(FLYWHEEL, STEP), 1.0, because.JOINT_NOT_TURNING(joint=FLYWHEEL, torque_nm=0.3)),
    (first(FLYWHEEL, STEP) + 1, 60.0, because.JOINT_STILL_TURNING(joint=FLYWHEEL, limit_s=60.0))])
def test_what_ought_to_have_moved_or_stopped_is_an_end(phase, rad_s, reason):
    out = tick(inputs_at(FLYWHEEL, rad_s), running(phase, since_s=61.0))
    assert out.memory.identify.over == because.IDENTIFY_STOPPED(causes=(reason,)) and out.command == RELEASED


def test_only_one_joint_is_ever_driven_and_the_feeder_never():
    for index, phase in enumerate(PROGRAM):
        command = tick(inputs_at(phase.joint, 0.0), running(index, since_s=0.5)).command
        assert command.feeder_torque_nm == 0.0
        assert 0.0 in (command.flywheel_torque_nm, command.hood_torque_nm)
