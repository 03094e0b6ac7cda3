"""Interlocks of one tick: a lost count, another host, another place, lost presses."""

import pytest
from msgspec import UNSET
from msgspec.structs import replace

from tests.robot.alike import codes
from tests.robot.good_tick import CONFIG, DISTANCE_M, NOW_NS, good_inputs, good_memory
from tests.robot.test_rig import UNPLUGGED, bench  # noqa: F401 (a fixture)
from truearc.hw.devices import button_box as buttons
from truearc.hw.fault_codes import BOX_LINES_REFUSED, BOX_PRESSES_LOST, BOX_RESTARTED, FOREIGN_HOST
from truearc.hw.protocols import ButtonEvent
from truearc.robot import reasons as because
from truearc.robot.aim import PLACE_M
from truearc.robot.config.schema import Prescribed
from truearc.robot.control import RELEASED
from truearc.robot.estimate import remember
from truearc.robot.gate import Rating
from truearc.robot.reasons import HOOD_ENCODERS_DISAGREE, HOOD_NOT_HOMED, NOT_AT_PLACE
from truearc.robot.sysid import make_step
from truearc.robot.tick import step
from truearc.robot.types import Memory, Progress


def lost_count():
    """Inputs of a hood motor that was without power: it counts from 0 where it stands."""
    inputs = good_inputs()
    return replace(inputs, hood_motor=replace(inputs.hood_motor, position_rad=0.0))


def test_a_lost_count_keeps_its_zero_while_armed_and_homes_after():
    tick = step(lost_count(), good_memory(), CONFIG, None)
    assert not tick.verdict.fire and tick.memory.homed
    assert HOOD_ENCODERS_DISAGREE.name in codes(tick.verdict.reasons)
    disarmed = replace(good_memory(), armed=False)
    memory = remember(lost_count(), disarmed, CONFIG)
    assert not memory.homed
    tick = step(lost_count(), replace(memory, armed=True), CONFIG, None)
    assert HOOD_NOT_HOMED() in tick.verdict.reasons
    assert tick.command.hood_torque_nm == CONFIG.hood.homing_torque_nm
    disarmed = replace(good_memory(), armed=False)
    assert remember(good_inputs(), disarmed, CONFIG).homed
    for silent in (replace(lost_count(), hood_angle=None),
                   replace(lost_count(), hood_angle=replace(good_inputs().hood_angle, magnet_ok=False)),
                   replace(lost_count(), hood_motor=replace(lost_count().hood_motor, t_ns=1))):
        assert remember(silent, disarmed, CONFIG).homed


FOREIGN = FOREIGN_HOST(frame="0x02e")


def test_another_host_stops_all_and_no_hood_homes_without_encoder():
    good = step(good_inputs(), good_memory(), CONFIG, None)
    assert good.verdict.fire and good.command.flywheel_torque_nm > 0.0
    held = step(replace(good_inputs(), faults=(FOREIGN,)), good_memory(), CONFIG, None)
    assert held.command == RELEASED and FOREIGN in held.verdict.reasons and not held.verdict.fire
    assert held.memory.armed                      # it goes on when the other has fallen silent
    away = replace(good_memory(), homed=False)
    homing = step(good_inputs(), away, CONFIG, None)
    assert homing.command.hood_torque_nm == CONFIG.hood.homing_torque_nm
    deaf = step(replace(good_inputs(), hood_angle=None), away, CONFIG, None)
    assert deaf.command.hood_torque_nm == 0.0 and HOOD_NOT_HOMED() in deaf.verdict.reasons
    foreign = step(replace(good_inputs(), faults=(FOREIGN,)), away, CONFIG, None)
    assert foreign.command == RELEASED


HELD = good_memory().aim
MODEL = replace(CONFIG, gate=replace(CONFIG.gate, policy="model"))


def planned(distance_m):
    row = Prescribed(distance_m, HELD.motor_ratio, HELD.hood_deg)
    return replace(CONFIG, collect=replace(CONFIG.collect, prescribed=(row,), repeats=1000))


class Listens:
    """A gate that agrees with every shot, and keeps what it was asked."""

    def rate(self, *features):
        self.heard = features
        return Rating(0.9, 0.8, True)


def seen_from(memory, distance_m):
    return replace(memory, last_sighting=replace(memory.last_sighting,
                                                 distance_m=distance_m + CONFIG.camera.behind_exit_m))


def _stand_there(reasons):
    (reason,) = reasons
    return reason.code == NOT_AT_PLACE.name and reason.params["place_m"] == pytest.approx(5.0)


def asked(config, distance_m=DISTANCE_M, gate=None):
    """Memory after the tick of the request, which is too early to fire."""
    memory = seen_from(replace(good_memory(), aim=None, steady_t_ns=0), distance_m)
    tick = step(good_inputs(), memory, config, gate)
    assert tick.memory.aim == tick.aim and tick.aim.source == "plan" and not tick.verdict.fire
    return replace(tick.memory, steady_t_ns=good_memory().steady_t_ns)


@pytest.mark.parametrize("config", [CONFIG, planned(DISTANCE_M)])
def test_a_robot_that_moves_while_its_request_stands_does_not_fire(config):
    memory = asked(config)
    assert step(good_inputs(), memory, config, None).verdict.fire
    for moved_m in (2.5, PLACE_M + 0.001, -PLACE_M - 0.001, -2.5):
        away = step(good_inputs(), seen_from(memory, DISTANCE_M + moved_m), config, None)
        assert _stand_there(away.verdict.reasons) and away.shot is None
        assert (away.aim.motor_ratio, away.aim.hood_deg) == (HELD.motor_ratio, HELD.hood_deg)   # wheels stay at speed
        back = step(good_inputs(), seen_from(away.memory, DISTANCE_M + 0.29), config, None)
        assert back.verdict.fire and back.aim == HELD


def test_a_prescribed_place_is_the_lists_and_not_where_fire_was_pressed():
    config = planned(DISTANCE_M)
    memory = asked(config, DISTANCE_M + 0.2)
    reasons = step(good_inputs(), seen_from(memory, DISTANCE_M + 0.35), config, None).verdict.reasons
    assert _stand_there(reasons)
    assert step(good_inputs(), seen_from(memory, DISTANCE_M - 0.29), config, None).verdict.fire


def test_a_model_is_asked_at_the_distance_of_the_tick():
    """So that an aim that is held may be fired with from elsewhere where the model agrees, but not a prescribed one."""
    gate = Listens()
    memory = asked(MODEL, gate=gate)
    assert memory.aim_place_m is None
    assert step(good_inputs(), seen_from(memory, 7.5), MODEL, gate).verdict.fire
    assert gate.heard[0] == pytest.approx(7.5)
    listed = replace(planned(DISTANCE_M), gate=MODEL.gate)
    away = step(good_inputs(), seen_from(asked(listed, gate=gate), 7.5), listed, gate)
    assert _stand_there(away.verdict.reasons)


LOST = BOX_PRESSES_LOST(presses=2)
WHATS = pytest.mark.parametrize("what", [LOST, BOX_RESTARTED()])


def pressed(*names):
    return tuple(ButtonEvent(NOW_NS, seq, name) for seq, name in enumerate(names))


def tick(memory, missed=None, *names):
    return step(replace(good_inputs(buttons=pressed(*names)), missed=missed), memory, CONFIG, None)


@WHATS
def test_neither_the_request_nor_the_arming_outlives_it(what):
    assert tick(good_memory()).verdict.fire
    at_once = tick(good_memory(), what)
    later = tick(at_once.memory)
    for one in (at_once, later):
        assert one.verdict.reasons[:2] == (because.DISARMED_BY_BOX(cause=what), because.FIRE_NOT_REQUESTED())
        assert not one.command.enable_flywheel and not one.memory.armed and not one.memory.request_t_ns


@WHATS
@pytest.mark.parametrize("button", ["arm", "fire", "two"])
def test_what_is_pressed_in_the_same_tick_does_not_arm(what, button):
    """It was pressed by a driver who believed that the press before had been heard."""
    for armed in (True, False):
        out = tick(replace(good_memory(), armed=armed), what, button)
        assert not out.memory.armed and not out.memory.request_t_ns and out.memory.disarmed == what


def test_a_heard_mark_counts_and_arming_ends_what_lost_presses_began():
    shot = replace(tick(good_memory()).shot, distance_m=DISTANCE_M)
    memory = replace(good_memory(), awaiting=True, last_shot=shot, request_t_ns=0)
    assert [outcome.outcome for outcome in tick(memory, LOST, "three").outcomes] == ["three"]
    armed = tick(tick(good_memory(), BOX_RESTARTED()).memory, None, "arm")
    assert armed.memory.armed and armed.memory.disarmed is UNSET
    assert because.FIRE_NOT_REQUESTED() in armed.verdict.reasons
    asked = tick(replace(armed.memory, steady_t_ns=good_memory().steady_t_ns), None, "fire")
    assert asked.verdict.fire


@WHATS
def test_identifying_is_ended_by_it_for_any_press_would_end_it(what):
    for since_ns, over in ((NOW_NS - 1, because.IDENTIFY_RELEASED_BY_BOX(cause=what)), (0, None)):
        memory = Memory(armed=bool(since_ns), identify=Progress(0, since_ns))
        out = make_step(CONFIG)(replace(good_inputs(buttons=pressed("arm")), missed=what), memory, CONFIG, None)
        assert out.memory.identify.over == over and not out.command.enable_flywheel


# --- on the wire


def test_what_the_numbers_say_was_missed_is_told_to_the_tick(bench):  # noqa: F811
    _, box, _, rig = bench
    told = []
    for line in (buttons.make_press(6, "fire"), buttons.make_heartbeat(6), buttons.make_heartbeat(7), b"",
                 buttons.make_press(8, "fire"), buttons.make_heartbeat(0), b""):
        box.data = line
        told.append(rig.read().missed)
    assert told == [None, None, BOX_PRESSES_LOST(presses=1), None, None, BOX_RESTARTED(), None]


@pytest.mark.parametrize("then", [buttons.make_heartbeat(6), buttons.make_press(7, "fire")])
def test_a_press_that_was_not_understood_holds_until_the_next_number_has_told(bench, then):  # noqa: F811
    _, box, _, rig = bench
    box.data = buttons.make_press(6, "fire")
    assert rig.read().faults == ()
    box.data = buttons.make_press(7, "arm").replace(b"m", b"n")
    (refused,) = rig.read().faults
    assert refused.code == BOX_LINES_REFUSED.name and refused.params["lines"] == 1
    assert [rig.read().faults for _ in range(3)] == [(because.BOX_PRESS_UNCERTAIN(),)] * 3
    box.data = then
    assert rig.read().faults == ()


def test_so_does_a_box_that_was_pulled_out(bench):  # noqa: F811
    _, box, _, rig = bench
    box.data = buttons.make_press(6, "fire")
    rig.read()
    box.lost = True
    assert rig.read().faults == (because.BOX_LOST(cause=UNPLUGGED),)
    box.lost = False
    assert rig.read().faults == (because.BOX_PRESS_UNCERTAIN(),)
    box.data = buttons.make_heartbeat(7)                   # that of "arm", while it was out
    inputs = rig.read()
    assert inputs.faults == (inputs.missed,) == (BOX_PRESSES_LOST(presses=1),)
