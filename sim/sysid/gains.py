"""Gains that follow from what was fitted, by the SIMC rules.

S. Skogestad, Simple analytic rules for model reduction and PID controller tuning, J. Process Control 13 (2003)
291-309: with the closed loop as slow as the loop's dead time (tau_c = theta), for a first-order process and for a
double-integrating one. Dead time is the measured delay, half a reading's age, half a tick for which a torque is held,
and the filter of the derivative.
"""

import math
from dataclasses import dataclass

import numpy as np

from truearc.robot.config.schema import Config
from truearc.robot.geometry import screw_length_m
from truearc.sim.sysid.fit import SysidFit, line

STEPS = 61                            # places of the hood's travel that are looked at


@dataclass(frozen=True)
class Gains:
    """A proportional, integral and derivative gain in the configuration's units, and the dead time behind them."""

    kp: float
    ki: float
    kd: float
    dead_s: float


def flywheel_gains(fit: SysidFit, config: Config) -> Gains:
    """Nm per rad/s: kp = ka / (2 theta), integral time min(ka / kv, 8 theta)."""
    dead_s = _dead_s(fit, config)
    kp = fit.value("ka") / (2.0 * dead_s)
    kv = line(fit)[1].value
    slowest_s = 8.0 * dead_s
    integral_s = min(fit.value("ka") / kv, slowest_s) if kv > 0.0 else slowest_s
    return Gains(kp, kp / integral_s, 0.0, dead_s)


def hood_gains(fit: SysidFit, config: Config) -> Gains:
    """Nm per degree: proportional and derivative; the screw locks itself, so that nothing is left to integrate."""
    dead_s = _dead_s(fit, config) + config.hood.pid.derivative_tau_s
    kp = fit.value("ka") * fewest_rad_per_deg(config) / (4.0 * (2.0 * dead_s) ** 2)
    return Gains(kp, 0.0, kp * 8.0 * dead_s, dead_s)


def fewest_rad_per_deg(config: Config) -> float:
    """Motor turns (rad) that lift the hood by a degree, where that takes the fewest: there a loop is the sharpest."""
    hood = config.hood
    elevations = np.linspace(hood.low_deg, hood.high_deg, STEPS)
    lengths_m = np.array([screw_length_m(float(one), hood) for one in elevations])
    per_deg_m = float(np.min(np.diff(lengths_m) / np.diff(elevations)))
    return per_deg_m * 2.0 * math.pi / (hood.screw_lead_m * hood.screw_gear)


def _dead_s(fit: SysidFit, config: Config) -> float:
    reading_s = float(np.median(np.diff(fit.record.speed_t_s)))
    return max(fit.value("delay_s"), 0.0) + 0.5 * reading_s + 0.5 / config.tick_hz
