"""The fitted numbers and the resulting gains, as text and as TOML to paste into launcher.toml.

The gains follow the SIMC rules (S. Skogestad, Simple analytic rules for model reduction and PID controller tuning, J.
Process Control 13 (2003) 291-309) with the closed-loop time constant equal to the dead time (tau_c = theta), for a
first-order and a double-integrating process. The dead time is the sum of the measured delay, half a reading's age, half
a tick for the held torque, and the delay of the derivative filter.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from truearc.robot.config.schema import Config
from truearc.robot.motors import screw_length_m
from truearc.robot.sysid import FLYWHEEL, HOOD
from truearc.sim.sysid.fit import Number, SysidFit, line

STEPS = 61                            # places of the hood's travel that are looked at
WORDS = {"ks": "dry friction", "ks_back": "dry friction, downwards or backwards", "kv": "friction by speed",
         "kq": "friction by speed squared", "ka": "inertia", "delay_s": "delay"}
UNITS = {"nm": {"ks": "Nm", "ks_back": "Nm", "kv": "Nm s", "kq": "Nm s2", "ka": "kg m2", "delay_s": "s"},
         "v": {"ks": "V", "ks_back": "V", "kv": "V s", "kq": "V s2", "ka": "V s2", "delay_s": "s"}}
RULE = "SIMC (Skogestad 2003), closed loop as slow as the dead time"


@dataclass(frozen=True)
class Gains:
    """A proportional, integral and derivative gain in the configuration's units, and the dead time behind them."""

    kp: float
    ki: float
    kd: float
    dead_s: float


def flywheel_gains(fit: SysidFit, config: Config) -> Gains:
    """Return gains in Nm per rad/s: kp = ka / (2 theta), integral time min(ka / kv, 8 theta)."""
    dead_s = _dead_s(fit, config)
    kp = fit.value("ka") / (2.0 * dead_s)
    kv = line(fit)[1].value
    slowest_s = 8.0 * dead_s
    return Gains(kp, kp / (min(fit.value("ka") / kv, slowest_s) if kv > 0.0 else slowest_s), 0.0, dead_s)


def hood_gains(fit: SysidFit, config: Config) -> Gains:
    """Return gains in Nm per degree, proportional and derivative; the screw is self-locking, so nothing is left to
    integrate."""
    dead_s = _dead_s(fit, config) + config.hood.pid.derivative_tau_s
    kp = fit.value("ka") * fewest_rad_per_deg(config) / (4.0 * (2.0 * dead_s) ** 2)
    return Gains(kp, 0.0, kp * 8.0 * dead_s, dead_s)


def fewest_rad_per_deg(config: Config) -> float:
    """Return the motor turns (rad) per degree of hood where they are fewest, and the loop is thus most sensitive."""
    hood = config.hood
    elevations = np.linspace(hood.low_deg, hood.high_deg, STEPS)
    lengths_m = np.array([screw_length_m(float(one), hood) for one in elevations])
    per_deg_m = float(np.min(np.diff(lengths_m) / np.diff(elevations)))
    return per_deg_m * 2.0 * math.pi / (hood.screw_lead_m * hood.screw_gear)


def _dead_s(fit: SysidFit, config: Config) -> float:
    reading_s = float(np.median(np.diff(fit.record.speed_t_s)))
    return max(fit.value("delay_s"), 0.0) + 0.5 * reading_s + 0.5 / config.tick_hz


def say_fit(fit: SysidFit) -> list[str]:
    """Return one line for each number, and one for the quality of the fit."""
    units = UNITS[fit.record.unit]
    named = {"v": {"kv": "back-EMF and friction by speed", "ka": "inertia, as voltage"}}.get(fit.record.unit, {})
    lines = [f"{fit.record.name}: {fit.moving_s:.1f} s of motion in {len(fit.runs)} "
             f"{'run' if len(fit.runs) == 1 else 'runs'}, cut into {len(fit.pieces)} pieces"]
    for number in fit.numbers.values():
        words = named.get(number.name, WORDS[number.name])
        lines.append(f"  {number.name:8s} {number.value:12.5g} {units[number.name]:6s} {_interval(number)}  {words}")
    return [*lines, f"  unseen pieces, each run simulated from its start: R^2 {fit.r2:.6f}, "
                    f"{fit.rms_rad_s:.3g} rad/s RMS"]


def say_inertia(fit: SysidFit, motors: int) -> str:
    """Report the inertia of everything that the motors turn, at the motor's shaft; torque is known for each motor."""
    number = fit.numbers["ka"]
    whole = Number("", number.value * motors, number.sd * motors)
    return f"  inertia of everything on the shaft: {whole.value:.5g} kg m2 {_interval(whole)} ({motors} motors)"


def make_gains(fits: Mapping[str, SysidFit], config: Config | None) -> str:
    """Return TOML to paste: the keys that follow from the fits. Voltages have no place in launcher.toml."""
    parts = []
    for joint, fit in fits.items():
        if config is None:
            parts.append(_open_loop(fit))
        elif joint == FLYWHEEL:
            parts.append(_flywheel(fit, flywheel_gains(fit, config)))
        elif joint == HOOD:
            parts.append(_hood(fit, hood_gains(fit, config)))
    return "\n\n".join(map("\n".join, parts)) + "\n"


def make_fragment(title: str, fits: Mapping[str, SysidFit], config: Config | None, notes: Iterable[str]) -> str:
    """Return TOML: the gains to paste, then as comments what was fitted, and from what."""
    parts = []
    for joint, fit in fits.items():
        parts += ["", *(f"# {text}" for text in say_fit(fit))]
        if config is not None and joint == FLYWHEEL:
            parts.append("# " + say_inertia(fit, len(config.axes.flywheels)))
    origin = ["", f"# {title}", *(f"# {note}" for note in notes)]
    return make_gains(fits, config) + "\n".join([*parts, *origin]) + "\n"


def _open_loop(fit: SysidFit) -> list[str]:
    ks, kv = line(fit)
    unit = fit.record.unit
    return ["[feedforward]", _key(f"ks_{unit}", ks), _key(f"kv_{unit}_s", kv), _key(f"ka_{unit}_s2", fit.numbers["ka"])]


def _flywheel(fit: SysidFit, gains: Gains) -> list[str]:
    ks, kv = line(fit)
    bent = ["# ks and kv: the straight line that comes nearest to the bent friction"] if fit.law.windage else []
    return ["[flywheel]", *bent, _key("ks_nm", ks), _key("kv_nm_s", kv), _key("ka_nm_s2", fit.numbers["ka"]),
            *_pid("flywheel", gains)]


def _hood(fit: SysidFit, gains: Gains) -> list[str]:
    up, down = (fit.numbers.get(name) for name in ("ks", "ks_back"))
    known = [one.value for one in (up, down) if one is not None]
    said = ", ".join(f"{way} {one.value:.4g}" for way, one in (("up", up), ("down", down)) if one is not None)
    return ["[hood]", f"friction_nm = {sum(known) / len(known):.4g}".ljust(38) + f"# mean of {said}",
            *_pid("hood", gains)]


def _pid(joint: str, gains: Gains) -> list[str]:
    return ["", f"# suggested: {RULE}, {gains.dead_s * 1e3:.1f} ms", f"[{joint}.pid]",
            *(f"{name} = {value:.4g}" for name, value in (("kp", gains.kp), ("ki", gains.ki), ("kd", gains.kd)))]


def _key(key: str, number: Number) -> str:
    return f"{key} = {number.value:.5g}".ljust(38) + f"# {_interval(number)}"


def _interval(number: Number) -> str:
    return f"(90 %: {number.low90:.5g} to {number.high90:.5g})"
