"""A recorded session as the log of a robot program that has never heard of truearc: other names, units and rates."""

import json
from pathlib import Path

from truearc.robot.recording.reader import TickReader
from truearc.robot.recording.session import load_session_config, load_trials
from truearc.robot.types import Tick
from truearc_frc.wpilog import WpilogWriter, make_payload

# name -> (kind, unit in the metadata)
SIGNALS = {
    "/Shooter/FlywheelVelocityRadPerSec": ("float", "rad/s"),
    "/RealOutputs/Shooter/FlywheelSetpointRadPerSec": ("float", "rad/s"),
    "/Shooter/FlywheelCurrentAmps": ("float", "A"),
    "/Hood/PivotPositionRad": ("float", "rad"),
    "/RealOutputs/Hood/GoalRad": ("float", "rad"),
    "/RealOutputs/Vision/DistanceToHubMeters": ("float", ""),
    "/SystemStats/BatteryVoltage": ("float", "V"),
    "/RealOutputs/Feeder/Running": ("bool", ""),
    "/RealOutputs/ShotResult": ("text", ""),
    "/DriverStation/MatchTime": ("float", "s")}
RADIAN = 57.29577951308232


def write_stranger_log(session: Path, path: Path, feeder: bool = True, every: int = 1) -> None:
    """feeder: whether the log has its signal; every: ticks between samples. A value is logged when it changes."""
    config = load_session_config(session)
    free = config.rig.launcher.free_speed_rad_s or 1.0
    names = {name: said for name, said in SIGNALS.items() if feeder or "Feeder" not in name}
    trials = sorted(load_trials(session), key=lambda trial: trial.outcome.t_ns)
    said: dict[str, bytes] = {}
    with path.open("wb") as file:
        log = WpilogWriter(file, "AdvantageKit")
        numbers = {name: log.start(name, kind, _metadata(unit), 0) for name, (kind, unit) in names.items()}
        for count, (tick, _) in enumerate(TickReader(session)):
            t_us = tick.inputs.t_ns // 1000
            values = _values(tick, free) if count % every == 0 else {}
            while trials and trials[0].outcome.t_ns <= tick.inputs.t_ns:
                log.append(numbers["/RealOutputs/ShotResult"], t_us, trials.pop(0).outcome.outcome.encode())
            for name, value in values.items():
                payload = make_payload(names[name][0], value) if name in names else None
                if payload is not None and value is not None and said.get(name) != payload:
                    said[name] = payload
                    log.append(numbers[name], t_us, payload)
        for trial in trials:
            log.append(numbers["/RealOutputs/ShotResult"], trial.outcome.t_ns // 1000, trial.outcome.outcome.encode())


def _metadata(unit: str) -> str:
    return json.dumps({"source": "AdvantageKit", **({"unit": unit} if unit else {})})


def _values(tick: Tick, free: float) -> dict[str, float | bool | None]:
    seen = tick.estimate
    return {
        "/Shooter/FlywheelVelocityRadPerSec": seen.motor_rad_s,
        "/RealOutputs/Shooter/FlywheelSetpointRadPerSec": tick.aim.motor_ratio * free,
        "/Shooter/FlywheelCurrentAmps": tick.inputs.flywheels[0].current_a,
        "/Hood/PivotPositionRad": None if seen.hood_deg is None else seen.hood_deg / RADIAN,
        "/RealOutputs/Hood/GoalRad": tick.aim.hood_deg / RADIAN,
        "/RealOutputs/Vision/DistanceToHubMeters": seen.distance_m,
        "/SystemStats/BatteryVoltage": seen.battery_v,
        "/RealOutputs/Feeder/Running": tick.command.feeder_torque_nm > 0.0,
        "/DriverStation/MatchTime": tick.inputs.t_ns * 1e-9,
    }
