"""Armed, no motor gets a torque while another host commands them, nor the hood before its encoder was heard."""

from msgspec.structs import replace

from tests.robot.good_tick import CONFIG, good_inputs, good_memory
from truearc.hw.fault_codes import FOREIGN_HOST
from truearc.robot.control import RELEASED
from truearc.robot.reasons import HOOD_NOT_HOMED
from truearc.robot.tick import step

FOREIGN = FOREIGN_HOST(frame="0x02e")


def test_another_host_stops_every_motor_and_holds():
    good = step(good_inputs(), good_memory(), CONFIG, None)
    assert good.verdict.fire and good.command.flywheel_torque_nm > 0.0
    held = step(replace(good_inputs(), faults=(FOREIGN,)), good_memory(), CONFIG, None)
    assert held.command == RELEASED and FOREIGN in held.verdict.reasons and not held.verdict.fire
    assert held.memory.armed                      # it goes on when the other has fallen silent


def test_the_hood_is_not_homed_before_its_encoder_was_heard():
    away = replace(good_memory(), homed=False)
    homing = step(good_inputs(), away, CONFIG, None)
    assert homing.command.hood_torque_nm == CONFIG.hood.homing_torque_nm
    deaf = step(replace(good_inputs(), hood_angle=None), away, CONFIG, None)
    assert deaf.command.hood_torque_nm == 0.0 and HOOD_NOT_HOMED() in deaf.verdict.reasons
    foreign = step(replace(good_inputs(), faults=(FOREIGN,)), away, CONFIG, None)
    assert foreign.command == RELEASED
