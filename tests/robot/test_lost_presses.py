"""A press that got lost may have been the one that disarms: no request outlives it, and the robot is disarmed."""

import pytest
from msgspec import UNSET
from msgspec.structs import replace

from tests.robot.good_tick import CONFIG, DISTANCE_M, NOW_NS, good_inputs, good_memory
from tests.robot.test_rig import UNPLUGGED, bench  # noqa: F401 (a fixture)
from truearc.hw.devices import button_box as buttons
from truearc.hw.fault_codes import BOX_LINES_REFUSED, BOX_PRESSES_LOST, BOX_RESTARTED
from truearc.hw.protocols import ButtonEvent
from truearc.robot import reasons as because
from truearc.robot.sysid import make_step
from truearc.robot.tick import step
from truearc.robot.types import Memory, Progress

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


def test_a_mark_that_was_heard_counts():
    shot = replace(tick(good_memory()).shot, distance_m=DISTANCE_M)
    memory = replace(good_memory(), awaiting=True, last_shot=shot, request_t_ns=0)
    assert [outcome.outcome for outcome in tick(memory, LOST, "three").outcomes] == ["three"]


def test_arming_ends_it_and_fire_has_to_be_pressed_again():
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
