"""An aim that is held is for one place: a robot that has moved since it was asked to fire holds until it is back."""

import pytest
from msgspec.structs import replace

from tests.robot.good_tick import CONFIG, DISTANCE_M, good_inputs, good_memory
from truearc.robot.aim import PLACE_M
from truearc.robot.config.schema import Prescribed
from truearc.robot.gate import Rating
from truearc.robot.reasons import NOT_AT_PLACE
from truearc.robot.tick import step

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
