"""Every doubt means HOLD."""

import math

import msgspec
import pytest
from msgspec import UNSET
from msgspec.structs import replace

from robot.estimate import estimate
from robot.gate.model import Rating
from robot.gate.verdict import judge
from robot.types import Inputs
from tests.robot.good_tick import CONFIG, NOW_NS, good_inputs, good_memory, seconds

MODEL = replace(CONFIG, gate=replace(CONFIG.gate, policy="model"))


class Says:
    """A gate that gives one rating, whatever it is asked."""

    def __init__(self, *rating):
        self.rating = Rating(*rating)

    def rate(self, *features):
        return self.rating


def verdict(inputs=None, memory=None, config=CONFIG, gate=None):
    inputs, memory = inputs or good_inputs(), memory or good_memory()
    return judge(inputs, estimate(inputs, memory, config), memory.aim, memory, config, gate)


def test_when_everything_holds_it_fires():
    assert verdict().fire, verdict().reasons
    assert verdict(config=MODEL, gate=Says(0.9, 0.8, True)).fire


@pytest.mark.parametrize(("change", "reason"), [
    ({"armed": False}, "not armed"), ({"homed": False}, "not homed"), ({"awaiting": True}, "mark the last shot"),
    ({"request_t_ns": 0}, "waiting for the fire button"), ({"feed_t_ns": NOW_NS}, "clearing"),
    ({"steady_t_ns": 0}, "only just arrived"), ({"last_sighting": None}, "never seen"),
])
def test_each_interlock_of_the_memory_holds(change, reason):
    spoilt = verdict(memory=replace(good_memory(), **change))
    assert not spoilt.fire and any(reason in line for line in spoilt.reasons)


def spoil_motor(**change):
    inputs = good_inputs()
    return replace(inputs, flywheels=(inputs.flywheels[0], replace(inputs.flywheels[1], **change)))


def spoil_angle(**change):
    inputs = good_inputs()
    return replace(inputs, hood_angle=replace(inputs.hood_angle, **change))


@pytest.mark.parametrize(("inputs", "reason"), [
    (spoil_motor(t_ns=0), "never answered"), (spoil_motor(t_ns=NOW_NS - seconds(0.2)), "silent for 0.20 s"),
    (spoil_motor(t_ns=NOW_NS + seconds(1)), "silent"), (spoil_motor(heartbeat_t_ns=NOW_NS - seconds(1)), "heartbeat"),
    (spoil_motor(axis_error=0x01000000), "watchdog expired"), (spoil_motor(axis_state=1), "not under control"),
    (spoil_motor(velocity_rad_s=0.0), "wheels at"), (spoil_motor(velocity_rad_s=math.nan), "wheels at nan"),
    (replace(good_inputs(), faults=("CAN lost: adapter gone",)), "CAN lost"),
    (replace(good_inputs(), hood_angle=None), "hood encoder has never answered"),
    (replace(good_inputs(), hood_angle=replace(good_inputs().hood_angle, magnet_ok=False)), "magnet"),
    (replace(good_inputs(), hood_angle=replace(good_inputs().hood_angle, t_ns=1)), "hood encoder silent"),
    (spoil_motor(errors_t_ns=0), "flywheel motor 2 has said nothing of its errors yet"),
    (spoil_motor(errors_t_ns=NOW_NS - seconds(1.01)), "flywheel motor 2 has said nothing of its errors for 1.01 s"),
    (spoil_motor(bus_v=math.inf), "flywheel motor 2 reads what is no number"),
    (spoil_angle(faults_t_ns=0), "hood encoder has said nothing of its faults yet"),
    (spoil_angle(faults_t_ns=NOW_NS - seconds(0.3)), "hood encoder has said nothing of its faults for 0.30 s"),
    (replace(good_inputs(), hood_motor=replace(good_inputs().hood_motor, position_rad=0.0)), "its screw"),
])
def test_each_reading_that_fails_holds_and_says_so(inputs, reason):
    spoilt = verdict(inputs)
    assert not spoilt.fire and any(reason in line for line in spoilt.reasons), spoilt.reasons


@pytest.mark.parametrize(("rating", "reason"), [
    ((0.9, 0.2, True), "20% likely"), ((0.9, 0.9, False), "outside"), ((None, None, True), "no number"),
    ((0.9, math.nan, True), "no number"),
    ((0.9, 0.9, False, 1.7), "outside what it was trained on (novelty 1.70)"),
])
def test_the_model_can_hold(rating, reason):
    spoilt = verdict(config=MODEL, gate=Says(*rating))
    assert not spoilt.fire and any(reason in line for line in spoilt.reasons)


@pytest.mark.parametrize("change", [{"distance_m": math.nan}, {"distance_m": math.inf}, {"distance_m": -1.0},
                                    {"distance_m": 21.0}, {"sigma_m": math.nan}])
def test_a_target_that_is_nowhere_holds(change):
    """The aim stands from before, so that only the distance itself can tell."""
    memory = good_memory()
    spoilt = verdict(memory=replace(memory, last_sighting=replace(memory.last_sighting, **change)))
    assert len(spoilt.reasons) == 1 and spoilt.reasons[0].startswith("target seen ")


def test_what_a_recording_does_not_say_is_not_asked():
    """Recordings from before errors and faults had stamps of their own give the verdicts that they gave."""
    assert verdict(spoil_motor(errors_t_ns=UNSET)).fire and verdict(spoil_angle(faults_t_ns=UNSET)).fire
    inputs = spoil_angle(faults_t_ns=UNSET)
    row = msgspec.json.encode(inputs)
    assert b"faults_t_ns" not in row and b"errors_t_ns" not in row
    assert msgspec.json.decode(row, type=Inputs) == inputs


def test_a_missing_model_holds():
    assert verdict(config=MODEL).reasons == ("no gate model loaded",)


def test_a_model_that_raises_holds():
    class Breaks:
        def rate(self, *features):
            raise RuntimeError("out of memory")

    assert verdict(config=MODEL, gate=Breaks()).reasons == ("model failed: RuntimeError",)
