"""Every doubt means HOLD, and says so in these words. That none fires: test_no_doubt_fires."""

import math

import msgspec
import pytest
from msgspec import UNSET
from msgspec.structs import replace

from tests.robot.good_tick import CONFIG, DISTANCE_M, HOOD_DEG, NOW_NS, good_inputs, good_memory, seconds
from truearc.robot.estimate import estimate
from truearc.robot.gate.model import Rating
from truearc.robot.gate.verdict import judge, only_the_model_doubts
from truearc.robot.types import Aim, Inputs, Sighting, Verdict

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


def test_when_everything_holds_it_fires():
    assert verdict().fire, verdict().reasons
    assert verdict(config=MODEL, gate=Says(0.9, 0.8, True)).fire


@pytest.mark.parametrize(("change", "reasons"), [
    ({"armed": False}, ["not armed"]),
    ({"armed": False, "disarmed": "lost presses"}, ["not armed: the button box lost presses"]),
    ({"homed": False}, ["hood not homed", "hood angle unknown"]),
    ({"awaiting": True, "feed_t_ns": NOW_NS, "request_t_ns": 0}, ["mark the last shot first"]),
    ({"feed_t_ns": NOW_NS, "request_t_ns": 0}, ["the last ball is still clearing"]),
    ({"request_t_ns": 0}, ["waiting for the fire button"]),
    ({"armed": False, "awaiting": True}, ["not armed", "mark the last shot first"]),
    ({"steady_t_ns": 0}, ["wheels and hood only just arrived"]),
    ({"steady_t_ns": NOW_NS - seconds(0.09)}, ["wheels and hood only just arrived"]),
    ({"steady_t_ns": NOW_NS + seconds(0.09)}, ["wheels and hood only just arrived"]),
    ({"last_sighting": None}, ["target never seen"]),
])
def test_each_interlock_of_the_memory_holds(change, reasons):
    assert verdict(memory=replace(good_memory(), **change)).reasons == tuple(reasons)


@pytest.mark.parametrize(("change", "reasons"), [
    ({"motor_ratio": 0.0}, ["no aim"]), ({"motor_ratio": -1.0}, ["no aim"]),
    ({"motor_ratio": 0.5}, ["wheels at 359 rad/s, wanted 297"]),
    ({"motor_ratio": math.nan}, ["wheels at 359 rad/s, wanted nan"]),
    ({"hood_deg": 60.0}, ["hood at 48.5 deg, wanted 60.0"]),
    ({"source": "stand at 4.00 m"}, ["stand at 4.00 m"]),
])
def test_an_aim_that_is_not_met_holds(change, reasons):
    memory = good_memory()
    assert verdict(memory=replace(memory, aim=replace(memory.aim, **change))).reasons == tuple(reasons)


def test_a_launcher_whose_free_speed_nobody_knows_has_no_aim():
    rig = replace(CONFIG.rig, launcher=replace(CONFIG.rig.launcher, free_speed_rad_s=None))
    assert verdict(good_inputs(0.0, HOOD_DEG), config=replace(CONFIG, rig=rig)).reasons == ("no aim",)


def test_an_aim_however_slow_is_one():
    memory = replace(good_memory(), aim=replace(good_memory().aim, motor_ratio=0.5 / 594.0))
    assert verdict(good_inputs(0.5, good_memory().aim.hood_deg), memory).reasons == ()


def test_a_sighting_is_young_enough_to_the_last_nanosecond():
    """A quarter of a second, which is exact as a float."""
    memory = good_memory()
    config = replace(CONFIG, gate=replace(CONFIG.gate, sighting_age_s=0.25))
    for age_ns, fires in ((250_000_000, True), (250_000_001, False)):
        seen = replace(memory.last_sighting, t_ns=NOW_NS - age_ns)
        assert verdict(memory=replace(memory, last_sighting=seen), config=config).fire is fires


def test_what_the_launcher_is_not_steady_at_is_not_said_to_be_new():
    """That wheels and hood only just arrived is said of those that have."""
    memory = replace(good_memory(), steady_t_ns=0, aim=replace(good_memory().aim, hood_deg=60.0))
    assert verdict(memory=memory).reasons == ("hood at 48.5 deg, wanted 60.0",)


def spoil_motor(**change):
    inputs = good_inputs()
    return replace(inputs, flywheels=(inputs.flywheels[0], replace(inputs.flywheels[1], **change)))


def spoil_angle(**change):
    inputs = good_inputs()
    return replace(inputs, hood_angle=replace(inputs.hood_angle, **change))


WHEEL, ENCODER = "flywheel motor 2", "hood encoder"


@pytest.mark.parametrize(("inputs", "reasons"), [
    (spoil_motor(t_ns=0), [f"{WHEEL} has never answered"]),
    (spoil_motor(heartbeat_t_ns=0), [f"{WHEEL} has never answered"]),
    (spoil_motor(t_ns=NOW_NS - seconds(0.2)), [f"{WHEEL} silent for 0.20 s"]),
    (spoil_motor(t_ns=NOW_NS + seconds(1)), [f"{WHEEL} silent for -1.00 s"]),
    (spoil_motor(heartbeat_t_ns=NOW_NS - seconds(0.26)), [f"{WHEEL} sends no heartbeat since 0.26 s"]),
    (spoil_motor(errors_t_ns=0), [f"{WHEEL} has said nothing of its errors yet"]),
    (spoil_motor(errors_t_ns=NOW_NS - seconds(1.01)), [f"{WHEEL} has said nothing of its errors for 1.01 s"]),
    (spoil_motor(errors_t_ns=NOW_NS + seconds(1.01)), [f"{WHEEL} has said nothing of its errors for -1.01 s"]),
    (spoil_motor(bus_v=math.inf), [f"{WHEEL} reads what is no number"]),
    (spoil_motor(axis_error=0x01000200), [f"{WHEEL}: bus under voltage, watchdog expired"]),
    (spoil_motor(axis_state=1), [f"{WHEEL} is not under control (state 1)"]),
    (spoil_motor(velocity_rad_s=0.0), ["wheels at 180 rad/s, wanted 359",
                                       "flywheel motors differ by 359 rad/s: belt?"]),
    (spoil_motor(velocity_rad_s=math.nan), [f"{WHEEL} reads what is no number", "wheels at nan rad/s, wanted 359"]),
    (replace(good_inputs(), faults=("CAN lost: adapter gone",)), ["CAN lost: adapter gone"]),
    (replace(good_inputs(), hood_angle=None), [f"{ENCODER} has never answered", "hood angle unknown"]),
    (spoil_angle(t_ns=1), [f"{ENCODER} silent for 10.00 s"]),
    (spoil_angle(t_ns=NOW_NS + seconds(0.01)), [f"{ENCODER} silent for -0.01 s"]),
    (spoil_angle(faults_t_ns=0), [f"{ENCODER} has said nothing of its faults yet"]),
    (spoil_angle(faults_t_ns=NOW_NS - seconds(0.3)), [f"{ENCODER} has said nothing of its faults for 0.30 s"]),
    (spoil_angle(magnet_ok=False), [f"{ENCODER} cannot see its magnet"]),
    (replace(good_inputs(), hood_motor=replace(good_inputs().hood_motor, position_rad=0.0)),
     ["hood encoder says 48.5 deg, its screw 15.0"]),
])
def test_each_reading_that_fails_holds_and_says_so(inputs, reasons):
    assert verdict(inputs).reasons == tuple(reasons)


OUTSIDE = "model: outside what it was trained on"


@pytest.mark.parametrize(("rating", "reason", "said"), [
    ((0.9, 0.2, True), "model: three points 20% likely, 30% needed", (0.9, 0.2)),
    ((0.9, 0.8, False), OUTSIDE, (0.9, 0.8)), ((0.9, 0.8, False, 1.0), OUTSIDE, (0.9, 0.8)),
    ((0.9, 0.8, False, 1.7), f"{OUTSIDE} (novelty 1.70)", (0.9, 0.8)),
    ((0.9, None, True), "model gives no number", (0.9, None)),
    ((0.9, math.nan, True), "model gives no number", (0.9, None)),
])
def test_the_model_can_hold(rating, reason, said):
    assert verdict(config=MODEL, gate=Says(*rating)) == Verdict(False, (reason,), *said)


def test_what_the_model_thinks_is_kept_where_it_is_not_asked_and_where_it_agrees():
    assert verdict(gate=Says(0.9, 0.1, False)) == Verdict(True, (), 0.9, 0.1)
    assert verdict(config=MODEL, gate=Says(0.9, 0.8, True)) == Verdict(True, (), 0.9, 0.8)
    assert verdict(config=MODEL, gate=Says(0.9, 0.3, True)).fire           # exactly at the threshold


def test_a_model_is_told_what_was_measured():
    class Listens(Says):
        def rate(self, *features):
            self.heard = features
            return self.rating

    gate = Listens(0.9, 0.8, True)
    verdict(good_inputs(200.0, HOOD_DEG), gate=gate)
    assert gate.heard == pytest.approx((DISTANCE_M, 200.0 / 594.0, HOOD_DEG))


def test_with_nothing_to_rate_the_model_is_not_asked():
    """Collecting, that is no reason of its own."""
    unseen = replace(good_memory(), last_sighting=None)
    assert verdict(memory=unseen, gate=Breaks()).reasons == ("target never seen",)
    assert verdict(memory=unseen, config=MODEL, gate=Breaks()).reasons == ("target never seen", "nothing to rate")
    blind = verdict(replace(good_inputs(), hood_angle=None), config=MODEL, gate=Breaks())
    assert blind.reasons == ("hood encoder has never answered", "hood angle unknown", "nothing to rate")


@pytest.mark.parametrize("config", [CONFIG, MODEL])
def test_a_model_that_raises_holds(config):
    assert verdict(config=config, gate=Breaks()) == Verdict(False, ("model failed: RuntimeError",), None, None)


@pytest.mark.parametrize(("reasons", "alone"), [
    ((), False), (("model: outside",), True), (("model: outside", "model: more"), True),
    (("model: outside", "not armed"), False), (("not armed",), False), (("no gate model loaded",), False)])
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
    (None, replace(good_memory(), last_sighting=replace(good_memory().last_sighting, distance_m=20.2))),
])
def test_what_is_just_within_its_limit_may_fire(inputs, memory):
    assert verdict(inputs, memory).reasons == ()


@pytest.mark.parametrize(("change", "reason"), [
    ({"distance_m": math.nan}, "target seen nan m away, give or take 0.0"),
    ({"distance_m": math.inf}, "target seen inf m away, give or take 0.0"),
    ({"distance_m": -1.0}, "target seen -1.2 m away, give or take 0.0"),
    ({"distance_m": 21.0}, "target seen 20.8 m away, give or take 0.0"),
    ({"sigma_m": math.inf}, "target seen 5.0 m away, give or take inf"),
    ({"sigma_m": -1.0}, "target seen 5.0 m away, give or take -1.0"),
    ({"distance_m": None}, "target never seen"), ({"sigma_m": None}, "target never seen"),
    ({"t_ns": NOW_NS - seconds(0.4)}, "target last seen 0.4 s ago"),
    ({"t_ns": NOW_NS + seconds(0.4)}, "target last seen -0.4 s ago"),
])
def test_a_target_that_is_nowhere_holds(change, reason):
    """The aim stands from before, so that only the sighting itself can tell."""
    memory = good_memory()
    spoilt = verdict(memory=replace(memory, last_sighting=replace(memory.last_sighting, **change)))
    assert spoilt.reasons == (reason,)


UNSEEN = "2 things in view look like the target"


@pytest.mark.parametrize(("sighting", "reason"), [
    (None, f"target never seen ({UNSEEN})"),
    (replace(good_memory().last_sighting, t_ns=NOW_NS - seconds(0.4)), f"target last seen 0.4 s ago ({UNSEEN})"),
])
def test_a_target_out_of_sight_holds_with_what_the_newest_image_showed(sighting, reason):
    memory = replace(good_memory(), last_sighting=sighting)
    assert reason in verdict(replace(good_inputs(), unseen=UNSEEN), memory).reasons


def test_an_image_without_a_target_alone_is_no_reason_while_the_last_sighting_is_young():
    assert verdict(replace(good_inputs(), unseen=UNSEEN)).fire


def test_recordings_from_before_say_no_more_than_they_said():
    refused = replace(good_inputs(), sighting=Sighting(NOW_NS, False, UNSEEN))
    row = msgspec.json.encode(refused)
    assert b"unseen" not in row
    old = replace(good_memory(), last_sighting=replace(good_memory().last_sighting, t_ns=NOW_NS - seconds(0.4)))
    assert verdict(msgspec.json.decode(row, type=Inputs), old).reasons == ("target last seen 0.4 s ago",)


def test_what_a_recording_does_not_say_is_not_asked():
    """Recordings from before errors and faults had stamps of their own give the verdicts that they gave."""
    assert verdict(spoil_motor(errors_t_ns=UNSET)).fire and verdict(spoil_angle(faults_t_ns=UNSET)).fire
    inputs = spoil_angle(faults_t_ns=UNSET)
    row = msgspec.json.encode(inputs)
    assert b"faults_t_ns" not in row and b"errors_t_ns" not in row
    assert msgspec.json.decode(row, type=Inputs) == inputs


def test_a_missing_model_holds():
    assert verdict(config=MODEL).reasons == ("no gate model loaded",)


def test_what_is_exactly_at_a_limit_of_the_launcher_may_fire():
    """Figures that are exact as floats: 297 rad/s are wanted; 3 and 5 rad/s, 1.5 and 0.25 degrees are allowed."""
    memory = replace(good_memory(), aim=Aim(0.5, 50.0, "plan"))
    config = replace(CONFIG, hood=replace(CONFIG.hood, tolerance_deg=0.25))
    believed = replace(estimate(good_inputs(), memory, config), motor_rad_s=300.0, motor_spread_rad_s=5.0,
                       hood_deg=50.25, hood_screw_deg=48.75)
    assert judge(good_inputs(), believed, memory.aim, memory, config, None).reasons == ()
    for past, words in (({"motor_rad_s": 300.001}, "wheels at 300"), ({"motor_spread_rad_s": 5.001}, "belt?"),
                        ({"hood_deg": 50.2501, "hood_screw_deg": 49.0}, "hood at"),
                        ({"hood_screw_deg": 48.749}, "screw")):
        held = judge(good_inputs(), replace(believed, **past), memory.aim, memory, config, None)
        assert len(held.reasons) == 1 and words in held.reasons[0]


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
