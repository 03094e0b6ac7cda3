"""The emulated robot with other motor drivers: it shoots, it replays to the bit, and what is refused holds."""

import pytest
from msgspec.structs import replace

from benchmarks.matrix.fault import find, says
from tests.faulty_robot import parts_with
from tests.robot.sparks import ALL_SPARK, SPARK_HOOD, SPARK_WHEELS, only_advice
from truearc.hw import fault_codes as hw
from truearc.hw.reason import Reason
from truearc.robot import reasons as bot
from truearc.robot.recording.reader import TickReader
from truearc.robot.recording.replay import replay, replay_frames
from truearc.robot.recording.session import CAN, load_trials
from truearc.sim.world.emulated_robot import emulate
from truearc_proof.world.faults import OVERWRITTEN, SILENT, UNPOWERED, Fault

SECOND = 1_000_000_000
FOREVER = 1 << 62


@pytest.mark.parametrize("config", [SPARK_HOOD, SPARK_WHEELS, ALL_SPARK], ids=["hood", "wheels", "all"])
def test_a_session_is_shot_and_replays_to_the_bit(tmp_path, config) -> None:
    results = emulate(config, tmp_path / "s", trials=2, seed=3)
    assert len(results) == 2
    for trial, result in zip(load_trials(tmp_path / "s"), results, strict=True):
        assert trial.outcome.outcome in (result.outcome, "rejected")
        assert trial.shot.hood_deg == pytest.approx(result.hood_deg, abs=0.15)
    ticks, cut_short = replay(tmp_path / "s")
    assert ticks > 800 and cut_short is None
    again, from_wires = replay_frames(tmp_path / "s")
    assert again.ticks == ticks and from_wires.frames > ticks and not from_wires.ended
    shot = next(tick for tick, _ in TickReader(tmp_path / "s") if tick.shot)
    assert len(shot.sent.duties) == 4 and shot.sent.flywheel_torque_nm > 0.0


def last_hold(folder) -> tuple[Reason, ...]:
    return load_trials(folder)[-1].outcome.reasons


@pytest.mark.parametrize(("config", "device", "fault", "signs"), [
    (SPARK_HOOD, "hood", Fault(OVERWRITTEN, 0, FOREVER, frame_id=0x02052603, at=0, data=b"\x18"),
     says(hw.SPARK_FIRMWARE_UNSUPPORTED, motor="hood motor", version="24.1.0")),
    (SPARK_HOOD, "hood", Fault(OVERWRITTEN, SECOND, FOREVER, frame_id=0x0205B803, at=6, data=b"\x20"),
     says(bot.MOTOR_ERROR, motor="hood motor",
          errors=(hw.ERROR_LOCKED(),))),
    (SPARK_WHEELS, "flywheel_b", Fault(UNPOWERED, 2 * SECOND, 3 * SECOND),
     says(bot.MOTOR_ERROR, motor="flywheel motor 2", errors=(hw.ERROR_HAS_RESET(),))),
    (SPARK_WHEELS, "flywheel_a", Fault(SILENT, 2 * SECOND, FOREVER, frame_id=0x0205B88B),
     says(bot.DEVICE_STALE, device="flywheel motor 1")),
    (SPARK_WHEELS, "flywheel_a", Fault(SILENT, 2 * SECOND, FOREVER, frame_id=0x0205B84B),
     says(bot.DEVICE_FAULTS_STALE, device="flywheel motor 1")),
])
def test_a_spark_that_is_not_what_it_should_be_is_a_hold_that_says_why(tmp_path, config, device, fault, signs) -> None:
    config = replace(config, gate=replace(config.gate, request_s=2.0))
    results = emulate(config, tmp_path / "s", trials=2, seed=5, **parts_with({device: (fault,)}))
    assert [result for result in results if result.fed_t_ns > fault.begin_ns + SECOND // 2] == []
    assert find(signs, last_hold(tmp_path / "s")), last_hold(tmp_path / "s")
    assert replay(tmp_path / "s")[1] is None


@pytest.mark.parametrize("listens_to", ["odrive", "spark"])
def test_beside_a_competition_controller_nothing_is_transmitted_and_nothing_moves(tmp_path, listens_to) -> None:
    config = only_advice(listens_to)
    config = replace(config, gate=replace(config.gate, request_s=1.0))
    assert emulate(config, tmp_path / "s", trials=1, seed=5) == []
    lines = (tmp_path / "s" / CAN).read_text().splitlines()
    assert len(lines) > 500 and not [line for line in lines if line.endswith(" T")]
    ticks = [tick for tick, _ in TickReader(tmp_path / "s")]
    assert any(tick.command.enable_flywheel for tick in ticks)
    assert {tick.sent.flywheel_torque_nm for tick in ticks} == {0.0}
    still = (*ticks[-1].inputs.flywheels, ticks[-1].inputs.hood_motor, ticks[-1].inputs.feeder)
    assert [motor.position_rad for motor in still] == [0.0] * 4
    assert replay(tmp_path / "s")[1] is None
