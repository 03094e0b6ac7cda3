"""A tick in which everything is right, for tests that then break one thing."""

import math
from pathlib import Path

from msgspec.structs import replace

from truearc import robot
from truearc.hw.devices.odrive.frames import CLOSED_LOOP
from truearc.hw.protocols import AngleReading, ButtonEvent, MotorReading
from truearc.robot.aim import aim
from truearc.robot.config.schema import Config, load_config
from truearc.robot.estimate import estimate
from truearc.robot.motors import screw_length_m
from truearc.robot.types import Inputs, Memory, Sighting

CONFIG: Config = load_config(Path(robot.__file__).parent / "launcher.toml")
NOW_NS = 10_000_000_000
HOOD_DEG = 50.0
DISTANCE_M = 5.0


def seconds(value: float) -> int:
    return int(value * 1e9)


def good_memory() -> Memory:
    """Armed, homed, asked to fire, steady for long enough, aimed where the good inputs are."""
    memory = Memory(armed=True, homed=True, trial=3, request_t_ns=NOW_NS - seconds(0.5),
                    steady_t_ns=NOW_NS - seconds(0.5),
                    last_sighting=Sighting(NOW_NS - seconds(0.05), True, None, DISTANCE_M + CONFIG.camera.behind_exit_m,
                                           0.03, 0.0))
    held = aim(estimate(good_inputs(200.0, HOOD_DEG), memory, CONFIG), memory, CONFIG)
    return replace(memory, aim=held)


def good_inputs(motor_rad_s: float | None = None, hood_deg: float | None = None,
                buttons: tuple[ButtonEvent, ...] = ()) -> Inputs:
    """Readings that agree with the aim of good_memory(), all 4 ms old."""
    if motor_rad_s is None or hood_deg is None:
        held = good_memory().aim
        assert held is not None
        motor_rad_s = held.motor_ratio * (CONFIG.rig.launcher.free_speed_rad_s or 0.0)
        hood_deg = held.hood_deg
    stamp = NOW_NS - seconds(0.004)
    motor = MotorReading(stamp, 1.0, motor_rad_s, stamp, CLOSED_LOOP, 0, stamp, 5.0, stamp, 12.2)
    travel = screw_length_m(hood_deg, CONFIG.hood) - screw_length_m(CONFIG.hood.low_deg, CONFIG.hood)
    turned = travel / CONFIG.hood.screw_lead_m * 2 * math.pi
    angle = math.radians((hood_deg * CONFIG.hood_encoder.direction + CONFIG.hood_encoder.zero_deg) % 360)
    hood = replace(motor, position_rad=turned, velocity_rad_s=0.0, endstop_t_ns=stamp)
    return Inputs(NOW_NS, 2000, (motor, motor), hood, replace(motor, velocity_rad_s=0.0),
                  AngleReading(stamp, angle, True, 0, stamp), None, buttons, ())
