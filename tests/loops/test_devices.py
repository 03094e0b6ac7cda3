"""The emulated robot with each motor driver and hood encoder: it shoots, it replays, and what fails is a HOLD."""

import struct
from pathlib import Path

import pytest
from msgspec.structs import replace

from benchmarks.matrix.fault import find, says
from tests.faulty_robot import parts_with
from tests.robot.encoders import COUNTING, NONE, NT4, ODRIVE, SPARK, SPARK_OWN
from tests.robot.good_tick import CONFIG as LAUNCHER
from tests.robot.sparks import ALL_SPARK, SPARK_HOOD, SPARK_WHEELS
from truearc.hw import fault_codes as hw
from truearc.robot import reasons as bot
from truearc.robot.recording.reader import TickReader
from truearc.robot.recording.replay import replay, replay_frames
from truearc.robot.recording.session import load_trials
from truearc.sim.data.recordings import shots_from_sessions
from truearc.sim.world.emulated_robot import emulate
from truearc_proof.world.faults import OVERWRITTEN, SILENT, STUCK, UNPOWERED, Fault

SECOND = 1_000_000_000
FOREVER = 1 << 62
HOMED = 5 * SECOND              # the hood has met its switch, and is on its way up
STATUS_5, STATUS_6, ESTIMATES = 0x0205B947, 0x0205B987, 6 << 5 | 9
NOT_A_NUMBER = struct.pack("<f", float("nan"))


@pytest.mark.parametrize(("config", "within_deg", "hood_sd_deg"), [
    (SPARK_HOOD, 0.15, None), (SPARK_WHEELS, 0.15, None), (ALL_SPARK, 0.15, None), (NONE, 0.15, 0.6),
    (SPARK, 0.35, 0.6), (SPARK_OWN, 0.35, 0.6), (ODRIVE, 0.15, 0.6), (COUNTING, 0.15, 0.6), (NT4, 0.15, 0.6)],
    ids=["hood", "wheels", "all", "none", "spark", "spark-own", "odrive", "counting", "nt4"])
def test_a_session_is_shot_and_replays_to_the_bit(tmp_path, config, within_deg, hood_sd_deg):
    result, = emulate(config, tmp_path / "s", trials=1, seed=3)
    trial, = load_trials(tmp_path / "s")
    assert trial.outcome.outcome in (result.outcome, "rejected") and trial.shot is not None
    assert trial.shot.hood_deg == pytest.approx(result.hood_deg, abs=within_deg)
    ticks, cut_short = replay(tmp_path / "s")
    assert ticks > 400 and cut_short is None
    again, from_wires = replay_frames(tmp_path / "s")
    assert again.ticks == ticks and from_wires.frames > ticks and not from_wires.ended
    shot = next(tick for tick, _ in TickReader(tmp_path / "s") if tick.shot)
    assert hood_sd_deg is not None or (len(shot.sent.duties) == 4 and shot.sent.flywheel_torque_nm > 0.0)
    facts = shots_from_sessions([tmp_path / "s"], "d", telemetry=False).facts
    assert hood_sd_deg is None or facts.noise.hood_deg == hood_sd_deg


@pytest.mark.parametrize(("config", "device", "fault", "signs"), [
    (LAUNCHER, "hood_encoder", Fault(SILENT, 2 * SECOND, FOREVER, frame_id=0x070E0185),
     says(bot.DEVICE_FAULTS_STALE, device="hood encoder")),
    (LAUNCHER, "camera", Fault(SILENT, 0, FOREVER), says(bot.TARGET_NEVER_SEEN)),
    (SPARK_HOOD, "hood", Fault(OVERWRITTEN, 0, FOREVER, frame_id=0x02052603, at=0, data=b"\x18"),
     says(hw.SPARK_FIRMWARE_UNSUPPORTED, motor="hood motor", version="24.1.0")),
    (SPARK_WHEELS, "flywheel_b", Fault(UNPOWERED, 2 * SECOND, 3 * SECOND),
     says(bot.MOTOR_ERROR, motor="flywheel motor 2", errors=(hw.ERROR_HAS_RESET(),))),
    (SPARK_WHEELS, "flywheel_a", Fault(SILENT, 2 * SECOND, FOREVER, frame_id=0x0205B84B),
     says(bot.DEVICE_FAULTS_STALE, device="flywheel motor 1")),
    (SPARK, "hood_encoder", Fault(SILENT, HOMED, FOREVER), says(bot.DEVICE_STALE, device="hood encoder")),
    (SPARK, "hood_encoder", Fault(SILENT, HOMED, FOREVER, STATUS_6),
     says(bot.DEVICE_FAULTS_STALE, device="hood encoder")),
    (SPARK, "hood_encoder", Fault(STUCK, HOMED, FOREVER), says(bot.HOOD_ENCODERS_DISAGREE)),
    (SPARK, "hood_encoder", Fault(OVERWRITTEN, HOMED, FOREVER, STATUS_5, at=4, data=NOT_A_NUMBER),
     says(bot.BAD_FRAME, cause=says(hw.FRAME_VALUE, value="nan"))),
    (SPARK, "hood_encoder", Fault(OVERWRITTEN, HOMED, FOREVER, STATUS_5, at=4, data=struct.pack("<f", 47.0)),
     says(bot.BAD_FRAME, cause=says(hw.FRAME_VALUE, signal="position_rev"))),
    (SPARK, "hood_encoder", Fault(OVERWRITTEN, HOMED, FOREVER, STATUS_5, at=4, data=struct.pack("<f", 0.6)),
     says(bot.HOOD_ENCODERS_DISAGREE)),
    (SPARK, "hood_encoder", Fault(OVERWRITTEN, HOMED, FOREVER, STATUS_6, at=4, data=b"\x01"), says(bot.MAGNET_LOST)),
    (SPARK, "hood_encoder", Fault(OVERWRITTEN, 0, FOREVER, 0x02052607, at=0, data=b"\x18"),
     says(hw.SPARK_FIRMWARE_UNSUPPORTED, motor="hood encoder")),
    (ODRIVE, "hood_encoder", Fault(SILENT, HOMED, FOREVER), says(bot.DEVICE_STALE, device="hood encoder")),
    (ODRIVE, "hood_encoder", Fault(OVERWRITTEN, HOMED, FOREVER, ESTIMATES, at=0, data=NOT_A_NUMBER),
     says(bot.BAD_FRAME, cause=says(hw.FRAME_VALUE, value="nan"))),
    (ODRIVE, "hood_encoder", Fault(STUCK, HOMED, FOREVER), says(bot.HOOD_ENCODERS_DISAGREE)),
    (COUNTING, "hood_encoder", Fault(UNPOWERED, HOMED, HOMED + SECOND // 10), says(bot.HOOD_ENCODERS_DISAGREE))])
def test_a_device_that_fails_is_a_hold_that_says_why(tmp_path, config, device, fault, signs):
    homes_first = device == "hood_encoder" and config is not LAUNCHER
    config = replace(config, gate=replace(config.gate, request_s=5.0 if homes_first else 2.0))
    results = emulate(config, tmp_path / "s", trials=1 if homes_first else 2, seed=5,
                      **parts_with({device: (fault,)}))
    assert [result for result in results if result.fed_t_ns > fault.begin_ns + SECOND // 2] == []
    held = [reason for trial in load_trials(tmp_path / "s") for reason in trial.outcome.reasons]
    refused = [reason for tick, _ in TickReader(tmp_path / "s") for reason in tick.inputs.faults]
    assert held and find(signs, [*held, *(refused if homes_first else ())]), held
    assert replay(tmp_path / "s")[1] is None
    assert replay_frames(tmp_path / "s")[1].ended == ""


@pytest.mark.parametrize("fault", [Fault(SILENT, 3 * SECOND, 3 * SECOND + SECOND // 5),
                                   Fault(UNPOWERED, 3 * SECOND, 3 * SECOND + SECOND // 2)], ids=["gap", "restart"])
def test_without_an_encoder_a_lost_count_is_homed_again_before_it_fires(tmp_path: Path, fault: Fault) -> None:
    results = emulate(NONE, tmp_path / "s", trials=2, seed=3, **parts_with({"hood": (fault,)}))
    ticks = [tick for tick, _ in TickReader(tmp_path / "s")]
    lost = next(k for k, tick in enumerate(ticks) if tick.inputs.t_ns > fault.begin_ns and not tick.memory.homed)
    assert 0 <= ticks[lost].inputs.t_ns - fault.begin_ns < SECOND // 5
    assert bot.HOOD_NOT_HOMED() in ticks[lost].verdict.reasons
    again = next(tick for tick in ticks[lost:] if tick.memory.homed)
    assert again.inputs.hood_motor.endstop and again.inputs.t_ns - fault.begin_ns > SECOND // 5
    fired = [tick for tick in ticks if tick.verdict.fire]
    assert all(tick.memory.homed for tick in fired) and fired[-1].inputs.t_ns > again.inputs.t_ns
    assert results[-1].hood_deg == pytest.approx(fired[-1].estimate.hood_deg, abs=0.15)
    assert replay(tmp_path / "s")[1] is None
