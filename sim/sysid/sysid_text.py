"""Fitted numbers as text and as TOML that can be pasted into launcher.toml."""

from collections.abc import Iterable, Mapping

from truearc.robot.config.schema import Config
from truearc.robot.sysid.program import FLYWHEEL, HOOD
from truearc.sim.sysid.fit import Number, SysidFit, line
from truearc.sim.sysid.gains import Gains, flywheel_gains, hood_gains

WORDS = {"ks": "dry friction", "ks_back": "dry friction, downwards or backwards", "kv": "friction by speed",
         "kq": "friction by speed squared", "ka": "inertia", "delay_s": "delay"}
UNITS = {"nm": {"ks": "Nm", "ks_back": "Nm", "kv": "Nm s", "kq": "Nm s2", "ka": "kg m2", "delay_s": "s"},
         "v": {"ks": "V", "ks_back": "V", "kv": "V s", "kq": "V s2", "ka": "V s2", "delay_s": "s"}}
RULE = "SIMC (Skogestad 2003), closed loop as slow as the dead time"


def say_fit(fit: SysidFit) -> list[str]:
    """One line for each number, and one for what it is worth."""
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
    """The inertia of all that the motors turn, at the motor's shaft; torque is known on each motor."""
    number = fit.numbers["ka"]
    whole = Number("", number.value * motors, number.sd * motors)
    return f"  inertia of everything on the shaft: {whole.value:.5g} kg m2 {_interval(whole)} ({motors} motors)"


def make_fragment(title: str, fits: Mapping[str, SysidFit], config: Config | None, notes: Iterable[str]) -> str:
    """TOML: what was fitted as comments, and the keys that follow from it. Voltages have no place in launcher.toml."""
    parts = [f"# {title}", *(f"# {note}" for note in notes)]
    for joint, fit in fits.items():
        parts += ["", *(f"# {text}" for text in say_fit(fit))]
        if config is None:
            parts += _open_loop(fit)
        elif joint == FLYWHEEL:
            parts += ["# " + say_inertia(fit, len(config.axes.flywheels)),
                      *_flywheel(fit, flywheel_gains(fit, config))]
        elif joint == HOOD:
            parts += _hood(fit, hood_gains(fit, config))
    return "\n".join(parts) + "\n"


def _open_loop(fit: SysidFit) -> list[str]:
    ks, kv = line(fit)
    unit = fit.record.unit
    return ["[feedforward]", _key(f"ks_{unit}", ks), _key(f"kv_{unit}_s", kv),
            _key(f"ka_{unit}_s2", fit.numbers["ka"])]


def _flywheel(fit: SysidFit, gains: Gains) -> list[str]:
    ks, kv = line(fit)
    bent = ["# ks and kv: the straight line that comes nearest to the bent friction"] if fit.law.windage else []
    return [*bent, "[flywheel]", _key("ks_nm", ks), _key("kv_nm_s", kv), _key("ka_nm_s2", fit.numbers["ka"]),
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
