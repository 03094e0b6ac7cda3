"""A hood whose motor has lost count: what the screw says is not believed again before it has been homed."""

from msgspec.structs import replace

from tests.robot.alike import codes
from tests.robot.good_tick import CONFIG, good_inputs, good_memory
from truearc.robot.estimate import remember
from truearc.robot.reasons import HOOD_ENCODERS_DISAGREE, HOOD_NOT_HOMED
from truearc.robot.tick import step


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


def test_a_screw_that_agrees_or_cannot_be_asked_keeps_its_zero():
    disarmed = replace(good_memory(), armed=False)
    assert remember(good_inputs(), disarmed, CONFIG).homed
    for silent in (replace(lost_count(), hood_angle=None),
                   replace(lost_count(), hood_angle=replace(good_inputs().hood_angle, magnet_ok=False)),
                   replace(lost_count(), hood_motor=replace(lost_count().hood_motor, t_ns=1))):
        assert remember(silent, disarmed, CONFIG).homed
