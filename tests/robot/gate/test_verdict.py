"""Everything unknown or wrong means HOLD, with these reasons. That none fires: test_no_doubt_fires."""

import math

import msgspec
import pytest
from msgspec import UNSET
from msgspec.structs import replace

from tests.robot.alike import assert_alike, codes
from tests.robot.good_tick import CONFIG, DISTANCE_M, HOOD_DEG, NOW_NS, good_inputs, good_memory, seconds
from truearc.hw import fault_codes as hw
from truearc.hw.fault_codes import BOX_PRESSES_LOST, CAN_BUS_OFF
from truearc.robot import reasons as because
from truearc.robot.aim import BEYOND, NO_FILE
from truearc.robot.estimate import estimate
from truearc.robot.gate import Rating
from truearc.robot.types import Aim, Inputs, Verdict
from truearc.robot.verdict import judge, only_the_model_doubts

LOST, GONE = BOX_PRESSES_LOST(presses=3), because.CAN_LOST(cause=CAN_BUS_OFF(bus="CAN"))
IMPLAUSIBLE, BEHIND_M = because.TARGET_IMPLAUSIBLE, CONFIG.camera.behind_exit_m
SPEED, HOOD = good_memory().aim.motor_ratio * CONFIG.rig.launcher.free_speed_rad_s, good_memory().aim.hood_deg
MODEL = replace(CONFIG, gate=replace(CONFIG.gate, policy="model"))


class Says:
    """A gate that gives one rating, whatever it is asked."""

    def __init__(self, *rating):
        self.rating = Rating(*rating)

    def rate(self, *features):
        return self.rating


class Breaks:
    def rate(self, *features):
        raise RuntimeError("out of memory")


def verdict(inputs=None, memory=None, config=CONFIG, gate=None):
    inputs, memory = inputs or good_inputs(), memory or good_memory()
    return judge(inputs, estimate(inputs, memory, config), memory.aim, memory, config, gate)


@pytest.mark.parametrize(("part", "change", "reasons"), [
    ("memory", {"armed": False}, [because.NOT_ARMED()]),
    ("memory", {"armed": False, "disarmed": LOST}, [because.DISARMED_BY_BOX(cause=LOST)]),
    ("memory", {"homed": False}, [because.HOOD_NOT_HOMED(), because.HOOD_UNKNOWN()]),
    ("memory", {"awaiting": True, "feed_t_ns": NOW_NS, "request_t_ns": 0}, [because.SHOT_NOT_MARKED()]),
    ("memory", {"feed_t_ns": NOW_NS, "request_t_ns": 0}, [because.BALL_CLEARING()]),
    ("memory", {"request_t_ns": 0}, [because.FIRE_NOT_REQUESTED()]),
    ("memory", {"armed": False, "awaiting": True}, [because.NOT_ARMED(), because.SHOT_NOT_MARKED()]),
    ("memory", {"steady_t_ns": 0}, [because.NOT_SETTLED()]),
    ("memory", {"steady_t_ns": NOW_NS - seconds(0.09)}, [because.NOT_SETTLED()]),
    ("memory", {"steady_t_ns": NOW_NS + seconds(0.09)}, [because.NOT_SETTLED()]),
    ("memory", {"last_sighting": None}, [because.TARGET_NEVER_SEEN()]),
    ("aim", {"motor_ratio": 0.0}, [because.NO_AIM()]), ("aim", {"motor_ratio": -1.0}, [because.NO_AIM()]),
    ("aim", {"motor_ratio": 0.5}, [because.WHEELS_OFF_SPEED(speed_rad_s=SPEED, wanted_rad_s=297.0)]),
    ("aim", {"motor_ratio": math.nan}, [because.WHEELS_OFF_SPEED(speed_rad_s=SPEED, wanted_rad_s=math.nan)]),
    ("aim", {"hood_deg": 60.0}, [because.HOOD_OFF_ANGLE(angle_deg=HOOD, wanted_deg=60.0)]),
    ("aim", {"stand_m": 4.0}, [because.NOT_AT_PLACE(place_m=4.0)]), ("aim", {"source": "idle"}, [because.NO_AIM()]),
    ("aim", {"motor_ratio": 0.0, "source": NO_FILE.source}, [because.AIM_FILE_MISSING()]),
    ("aim", {"motor_ratio": 0.0, "source": BEYOND.source}, [because.NO_SET_POINT(distance_m=DISTANCE_M)]),
    ("last_sighting", {"distance_m": math.nan}, IMPLAUSIBLE(distance_m=math.nan, sigma_m=0.03)),
    ("last_sighting", {"distance_m": math.inf}, IMPLAUSIBLE(distance_m=math.inf, sigma_m=0.03)),
    ("last_sighting", {"distance_m": -1.0}, IMPLAUSIBLE(distance_m=-1.0 - BEHIND_M, sigma_m=0.03)),
    ("last_sighting", {"distance_m": 21.0}, IMPLAUSIBLE(distance_m=21.0 - BEHIND_M, sigma_m=0.03)),
    ("last_sighting", {"sigma_m": math.inf}, IMPLAUSIBLE(distance_m=5.0, sigma_m=math.inf)),
    ("last_sighting", {"sigma_m": -1.0}, IMPLAUSIBLE(distance_m=5.0, sigma_m=-1.0)),
    ("last_sighting", {"distance_m": None}, because.TARGET_NEVER_SEEN()),
    ("last_sighting", {"sigma_m": None}, because.TARGET_NEVER_SEEN()),
    ("last_sighting", {"t_ns": NOW_NS - seconds(0.4)}, because.TARGET_STALE(age_s=0.4)),
    ("last_sighting", {"t_ns": NOW_NS + seconds(0.4)}, because.TARGET_STALE(age_s=-0.4))])
def test_each_interlock_of_memory_aim_and_target_holds(part, change, reasons):
    """The aim stands from before, so that only the sighting itself can tell where there is no target."""
    memory = good_memory()
    spoilt = replace(memory, **(change if part == "memory" else {part: replace(getattr(memory, part), **change)}))
    assert_alike(verdict(memory=spoilt).reasons, reasons if isinstance(reasons, list) else [reasons])


def test_an_aim_needs_a_free_speed_and_may_be_slow():
    rig = replace(CONFIG.rig, launcher=replace(CONFIG.rig.launcher, free_speed_rad_s=None))
    assert verdict(good_inputs(0.0, HOOD_DEG), config=replace(CONFIG, rig=rig)).reasons == (because.NO_AIM(),)
    memory = replace(good_memory(), aim=replace(good_memory().aim, motor_ratio=0.5 / 594.0))
    assert verdict(good_inputs(0.5, good_memory().aim.hood_deg), memory).reasons == ()


def test_young_sightings_outlast_an_image_and_old_aims_are_not_new():
    memory = good_memory()
    config = replace(CONFIG, gate=replace(CONFIG.gate, sighting_age_s=0.25))
    for age_ns, fires in ((250_000_000, True), (250_000_001, False)):
        seen = replace(memory.last_sighting, t_ns=NOW_NS - age_ns)
        assert verdict(memory=replace(memory, last_sighting=seen), config=config).fire is fires
    assert verdict(replace(good_inputs(), unseen=UNSEEN)).fire
    memory = replace(good_memory(), steady_t_ns=0, aim=replace(good_memory().aim, hood_deg=60.0))
    assert_alike(verdict(memory=memory).reasons, [because.HOOD_OFF_ANGLE(angle_deg=HOOD, wanted_deg=60.0)])


def spoil_motor(**change):
    inputs = good_inputs()
    return replace(inputs, flywheels=(inputs.flywheels[0], replace(inputs.flywheels[1], **change)))


def spoil_angle(**change):
    inputs = good_inputs()
    return replace(inputs, hood_angle=replace(inputs.hood_angle, **change))


WHEEL, ENCODER = "flywheel motor 2", "hood encoder"


@pytest.mark.parametrize(("inputs", "reasons"), [
    (spoil_motor(t_ns=0), [because.DEVICE_NEVER_RECEIVED(device=WHEEL)]),
    (spoil_motor(heartbeat_t_ns=0), [because.DEVICE_NEVER_RECEIVED(device=WHEEL)]),
    (spoil_motor(t_ns=NOW_NS - seconds(0.2)), [because.DEVICE_STALE(device=WHEEL, age_s=0.2)]),
    (spoil_motor(t_ns=NOW_NS + seconds(1)), [because.DEVICE_STALE(device=WHEEL, age_s=-1.0)]),
    (spoil_motor(heartbeat_t_ns=NOW_NS - seconds(0.26)), [because.DEVICE_HEARTBEAT_STALE(device=WHEEL, age_s=0.26)]),
    (spoil_motor(errors_t_ns=0), [because.DEVICE_FAULTS_NEVER_RECEIVED(device=WHEEL)]),
    (spoil_motor(errors_t_ns=NOW_NS - seconds(1.01)), [because.DEVICE_FAULTS_STALE(device=WHEEL, age_s=1.01)]),
    (spoil_motor(errors_t_ns=NOW_NS + seconds(1.01)), [because.DEVICE_FAULTS_STALE(device=WHEEL, age_s=-1.01)]),
    (spoil_motor(bus_v=math.inf), [because.MOTOR_NOT_FINITE(motor=WHEEL)]),
    (spoil_motor(axis_error=0x01000200), [
        because.MOTOR_ERROR(motor=WHEEL, errors=(hw.ERROR_DC_BUS_UNDER_VOLTAGE(), hw.ERROR_WATCHDOG_EXPIRED()))]),
    (spoil_motor(axis_state=1), [because.MOTOR_NOT_DRIVEN(motor=WHEEL, state=1)]),
    (spoil_motor(velocity_rad_s=0.0), [
        because.WHEELS_OFF_SPEED(speed_rad_s=SPEED / 2.0, wanted_rad_s=SPEED),
        because.FLYWHEELS_DIFFER(spread_rad_s=SPEED)]),
    (spoil_motor(velocity_rad_s=math.nan), [
        because.MOTOR_NOT_FINITE(motor=WHEEL), because.WHEELS_OFF_SPEED(speed_rad_s=math.nan, wanted_rad_s=SPEED)]),
    (replace(good_inputs(), faults=(GONE,)), [GONE]),
    (replace(good_inputs(), hood_angle=None), [because.DEVICE_NEVER_RECEIVED(device=ENCODER), because.HOOD_UNKNOWN()]),
    (spoil_angle(t_ns=1), [because.DEVICE_STALE(device=ENCODER, age_s=10.0)]),
    (spoil_angle(t_ns=NOW_NS + seconds(0.01)), [because.DEVICE_STALE(device=ENCODER, age_s=-0.01)]),
    (spoil_angle(faults_t_ns=0), [because.DEVICE_FAULTS_NEVER_RECEIVED(device=ENCODER)]),
    (spoil_angle(faults_t_ns=NOW_NS - seconds(0.3)), [because.DEVICE_FAULTS_STALE(device=ENCODER, age_s=0.3)]),
    (spoil_angle(magnet_ok=False), [because.MAGNET_LOST()]),
    (replace(good_inputs(), hood_motor=replace(good_inputs().hood_motor, position_rad=0.0)),
     [because.HOOD_ENCODERS_DISAGREE(encoder_deg=HOOD, screw_deg=15.0)])])
def test_each_reading_that_fails_holds_and_says_so(inputs, reasons):
    assert_alike(verdict(inputs).reasons, reasons)


OUTSIDE = because.MODEL_OUTSIDE_DOMAIN()


@pytest.mark.parametrize(("rating", "reason", "said"), [
    ((0.9, 0.2, True), because.MODEL_BELOW_THRESHOLD(p_three=0.2, threshold=0.3), (0.9, 0.2)),
    ((0.9, 0.8, False), OUTSIDE, (0.9, 0.8)), ((0.9, 0.8, False, 1.0), OUTSIDE, (0.9, 0.8)),
    ((0.9, 0.8, False, 1.7), because.MODEL_OUTSIDE_DOMAIN(novelty=1.7), (0.9, 0.8)),
    ((0.9, None, True), because.MODEL_NOT_FINITE(), (0.9, None)),
    ((0.9, math.nan, True), because.MODEL_NOT_FINITE(), (0.9, None))])
def test_the_model_can_hold(rating, reason, said):
    assert verdict(config=MODEL, gate=Says(*rating)) == Verdict(False, (reason,), *said)


def test_a_model_is_told_what_was_measured_if_there_is_anything():
    class Listens(Says):
        def rate(self, *features):
            self.heard = features
            return self.rating

    gate = Listens(0.9, 0.8, True)
    verdict(good_inputs(200.0, HOOD_DEG), gate=gate)
    assert gate.heard == pytest.approx((DISTANCE_M, 200.0 / 594.0, HOOD_DEG))
    unseen = replace(good_memory(), last_sighting=None)
    assert verdict(memory=unseen, gate=Breaks()).reasons == (because.TARGET_NEVER_SEEN(),)
    assert verdict(memory=unseen, config=MODEL, gate=Breaks()).reasons == (
        because.TARGET_NEVER_SEEN(), because.MODEL_NO_INPUT())
    blind = verdict(replace(good_inputs(), hood_angle=None), config=MODEL, gate=Breaks())
    assert blind.reasons == (
        because.DEVICE_NEVER_RECEIVED(device=ENCODER), because.HOOD_UNKNOWN(), because.MODEL_NO_INPUT())


@pytest.mark.parametrize("config", [CONFIG, MODEL])
def test_a_model_that_raises_holds(config):
    failed = because.MODEL_FAILED(error="RuntimeError")
    assert verdict(config=config, gate=Breaks()) == Verdict(False, (failed,), None, None)


@pytest.mark.parametrize(("reasons", "alone"), [
    ((), False), ((OUTSIDE,), True), ((OUTSIDE, because.MODEL_BELOW_THRESHOLD(p_three=0.2, threshold=0.3)), True),
    ((OUTSIDE, because.NOT_ARMED()), False), ((because.NOT_ARMED(),), False), ((because.MODEL_MISSING(),), False)])
def test_whether_only_the_model_doubts(reasons, alone):
    assert only_the_model_doubts(Verdict(not reasons, reasons)) is alone


@pytest.mark.parametrize(("inputs", "memory"), [
    (spoil_motor(t_ns=NOW_NS - 100_000_000), None), (spoil_motor(t_ns=NOW_NS), None),
    (spoil_motor(heartbeat_t_ns=NOW_NS - 250_000_000), None), (spoil_motor(errors_t_ns=NOW_NS - 1_000_000_000), None),
    (spoil_angle(t_ns=NOW_NS - 100_000_000), None), (spoil_angle(faults_t_ns=NOW_NS - 250_000_000), None),
    (None, replace(good_memory(), steady_t_ns=NOW_NS - 100_000_000)),
    (None, replace(good_memory(), last_sighting=replace(good_memory().last_sighting, t_ns=NOW_NS))),
    (None, replace(good_memory(), last_sighting=replace(good_memory().last_sighting, sigma_m=0.0))),
    (None, replace(good_memory(), last_sighting=replace(good_memory().last_sighting, distance_m=0.2))),
    (None, replace(good_memory(), last_sighting=replace(good_memory().last_sighting, distance_m=20.2)))])
def test_what_is_just_within_its_limit_may_fire(inputs, memory):
    assert verdict(inputs, memory).reasons == ()


UNSEEN = because.SEVERAL_TARGETS(count=2)


@pytest.mark.parametrize(("sighting", "reason"), [
    (None, because.TARGET_NEVER_SEEN(cause=UNSEEN)),
    (replace(good_memory().last_sighting, t_ns=NOW_NS - seconds(0.4)), 
     because.TARGET_STALE(age_s=0.4, cause=UNSEEN))])
def test_a_target_out_of_sight_holds_with_what_the_newest_image_showed(sighting, reason):
    memory = replace(good_memory(), last_sighting=sighting)
    held = verdict(replace(good_inputs(), unseen=UNSEEN), memory).reasons
    assert_alike([one for one in held if one.code == reason.code], [reason])


def test_what_a_recording_does_not_say_is_not_asked():
    """Recordings from before errors and faults had stamps of their own give the verdicts that they gave."""
    assert verdict(spoil_motor(errors_t_ns=UNSET)).fire and verdict(spoil_angle(faults_t_ns=UNSET)).fire
    inputs = spoil_angle(faults_t_ns=UNSET)
    row = msgspec.json.encode(inputs)
    assert b"faults_t_ns" not in row and b"errors_t_ns" not in row
    assert msgspec.json.decode(row, type=Inputs) == inputs


def test_a_model_is_needed_and_what_it_thinks_is_kept():
    assert verdict(config=MODEL).reasons == (because.MODEL_MISSING(),)
    assert verdict(gate=Says(0.9, 0.1, False)) == Verdict(True, (), 0.9, 0.1)
    assert verdict(config=MODEL, gate=Says(0.9, 0.8, True)) == Verdict(True, (), 0.9, 0.8)
    assert verdict(config=MODEL, gate=Says(0.9, 0.3, True)).fire           # exactly at the threshold


def test_what_is_exactly_at_a_limit_of_the_launcher_may_fire():
    """Figures that are exact as floats: 297 rad/s are wanted; 3 and 5 rad/s, 1.5 and 0.25 degrees are allowed."""
    memory = replace(good_memory(), aim=Aim(0.5, 50.0, "plan"))
    config = replace(CONFIG, hood=replace(CONFIG.hood, tolerance_deg=0.25))
    believed = replace(estimate(good_inputs(), memory, config), motor_rad_s=300.0, motor_spread_rad_s=5.0,
                       hood_deg=50.25, hood_screw_deg=48.75)
    assert judge(good_inputs(), believed, memory.aim, memory, config, None).reasons == ()
    for past, code in (({"motor_rad_s": 300.001}, because.WHEELS_OFF_SPEED),
                       ({"motor_spread_rad_s": 5.001}, because.FLYWHEELS_DIFFER),
                        ({"hood_deg": 50.2501, "hood_screw_deg": 49.0}, because.HOOD_OFF_ANGLE),
                        ({"hood_screw_deg": 48.749}, because.HOOD_ENCODERS_DISAGREE)):
        held = judge(good_inputs(), replace(believed, **past), memory.aim, memory, config, None)
        assert codes(held.reasons) == [code.name]


def test_inputs_of_another_robot_are_no_verdict():
    inputs = good_inputs()
    with pytest.raises(ValueError, match="shorter"):
        verdict(replace(inputs, flywheels=inputs.flywheels[:1]))


@pytest.mark.parametrize("inputs", [
    spoil_motor(t_ns=NOW_NS - 100_000_001), spoil_motor(heartbeat_t_ns=NOW_NS - 250_000_001),
    spoil_motor(errors_t_ns=NOW_NS - 1_000_000_001), spoil_angle(t_ns=NOW_NS - 100_000_001),
    spoil_angle(faults_t_ns=NOW_NS - 250_000_001), spoil_motor(t_ns=NOW_NS + 1), spoil_angle(faults_t_ns=NOW_NS + 1)])
def test_a_nanosecond_past_its_limit_nothing_fires(inputs):
    assert len(verdict(inputs).reasons) == 1
