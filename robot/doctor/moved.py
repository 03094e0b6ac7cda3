"""What the doctor's small motion has shown: direction, scale, lag, limit switch. Pure, of the motion's ticks."""

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from truearc.hw.devices.family import FAILURE, AxisCheck, Finding, Heard, failure, ok, warning
from truearc.hw.devices.registry import family_of
from truearc.hw.protocols import MotorReading
from truearc.robot.config.schema import Config
from truearc.robot.doctor.motion import STARTED_RAD_S, SmallMotion, hood_angle_deg
from truearc.robot.geometry import elevation_from_screw_deg
from truearc.robot.motors import name_axes
from truearc.robot.sysid.program import FLYWHEEL, HOOD, STEP, Phase
from truearc.robot.types import Sent, Tick

Numbers = npt.NDArray[np.float64]
Row = tuple[Phase, Tick, Sent]
SHARE = 0.25                          # position and speed, or two motors of one belt, may differ by this; as in a run
GRAIN_RAD = 1.0                       # and by this: readings of 10 ms at the speeds of this motion
LEAST_RAD = 0.3                       # turned by less, it has not turned
STEP_S = 0.005                        # lags are looked for in steps of this
FEW = 10                              # readings on either side of a kink
DO = "all motors are released; repair it, and do this again"
FIRST = "repair first what ended the motion"


def check_motion(config: Config, motion: SmallMotion, heard: Heard) -> Iterator[Finding]:
    """heard: all frames of it."""
    if motion.over is None:
        yield failure("motion", "ended before it was done", DO)
    elif motion.over:
        yield failure("motion", motion.over, DO)
    else:
        yield ok("motion", "all of it was done; whether wheels throw and hood rises in it, only eyes can tell")
    for name, axis in name_axes(config):
        estimates = (finding for finding in family_of(axis).examine(axis, AxisCheck(name, config.tick_hz, None), heard)
                     if finding.check == f"{name}, estimates")
        yield from (finding for finding in estimates if finding.level == FAILURE)
    yield from _check_wheels(config, [row for row in motion.rows if row[0].joint == FLYWHEEL])
    hood = [row for row in motion.rows if row[0].joint == HOOD]
    if hood:
        yield _check_turned("hood motor, motion", _readings([tick.inputs.hood_motor for _, tick, _ in hood]), None)
        yield _check_switch(hood, bool(motion.over))
        if config.hood_encoder.is_heard:
            yield from _check_hood_encoder(config, hood)


def _check_wheels(config: Config, rows: Sequence[Row]) -> Iterator[Finding]:
    limit_s = config.gate.reading_age_s / 2       # as for question and answer
    cut_s = _cut_s(rows)
    turned: dict[str, float] = {}
    for number in range(len(config.axes.flywheels)):
        name = f"flywheel motor {number + 1}"
        told = _readings([tick.inputs.flywheels[number] for _, tick, _ in rows])
        lag_s = None if cut_s is None else find_lag_s(told[0], told[2], cut_s)
        finding = _check_turned(f"{name}, motion", told, lag_s)
        if lag_s is not None and lag_s > limit_s and finding.level != FAILURE:
            finding = failure(finding.check, f"its speed follows the torque {lag_s * 1e3:.0f} ms late; firing needs "
                              f"{limit_s * 1e3:.0f} ms", "look for what holds frames back, or filters the speed")
        turned[name] = abs(_turned_rad(told))
        yield finding
    least, most = min(turned, key=turned.__getitem__), max(turned, key=turned.__getitem__)
    if turned[most] > LEAST_RAD and turned[least] < (1.0 - SHARE) * turned[most]:
        yield failure("flywheels, motion", f"{least} has turned by {turned[least]:.1f} rad, {most} by "
                      f"{turned[most]:.1f}: motors of one belt turn alike",
                      "is an encoder scaled or stuck, or the belt off?")


def _readings(motors: Sequence[MotorReading]) -> tuple[Numbers, Numbers, Numbers]:
    """Times (s), positions (rad) and speeds (rad/s) of what was heard, each once."""
    newest = {motor.t_ns: motor for motor in motors if motor.t_ns}
    told = [newest[t_ns] for t_ns in sorted(newest)]
    return (np.array([one.t_ns * 1e-9 for one in told]), np.array([one.position_rad for one in told]),
            np.array([one.velocity_rad_s for one in told]))


def _turned_rad(told: tuple[Numbers, Numbers, Numbers]) -> float:
    return float(told[1][-1] - told[1][0]) if len(told[1]) else 0.0


def _check_turned(check: str, told: tuple[Numbers, Numbers, Numbers], lag_s: float | None) -> Finding:
    """Whether positions and speeds tell of one motion, there and back for the hood."""
    times, positions, speeds = told
    if len(times) < FEW:
        return failure(check, "too few readings came", "see the other checks")
    steps = np.diff(positions)
    added = np.diff(times) * (speeds[1:] + speeds[:-1]) / 2.0
    way, added_way = float(np.abs(steps).sum()), float(np.abs(added).sum())
    do = "look at the encoder, its plug, its counts per turn and its maker's settings"
    if way < LEAST_RAD and added_way < LEAST_RAD:
        return failure(check, "neither its position nor its speed has told of any", f"if it has turned, {do}; if not, "
                       "is it blocked, or do two motors work against each other (direction)?")
    if abs(way - added_way) > SHARE * max(way, added_way) + GRAIN_RAD or steps @ added < 0.0:
        return failure(check, f"its position has moved by {way:.1f} rad, its speeds add up to {added_way:.1f}", do)
    lag = "" if lag_s is None else f"; its speed follows the torque within {max(lag_s, 0.0) * 1e3:.0f} ms"
    return ok(check, f"{way:.1f} rad by its position, {added_way:.1f} by its speeds{lag}")


def _cut_s(rows: Sequence[Row]) -> float | None:
    """When the torque of the fast turn ended; None where it never came, or nothing is known of what followed."""
    driven = [tick.inputs.t_ns for phase, tick, sent in rows if phase.kind == STEP and sent.flywheel_torque_nm > 0.0]
    after = [tick.inputs.t_ns for _, tick, _ in rows if driven and tick.inputs.t_ns > driven[-1]]
    return after[0] * 1e-9 if len(after) > FEW else None


def find_lag_s(times: Numbers, speeds: Numbers, cut_s: float) -> float | None:
    """How long after a torque's end the speed bends, by least squares of two lines; None where it does not."""
    if not len(speeds) or speeds.max() < STARTED_RAD_S:
        return None
    near = (times > cut_s - 0.3) & (times < cut_s + 0.7) & (speeds > 0.3 * speeds.max())
    t, v = times[near] - cut_s, speeds[near]
    best: tuple[float, float, float] | None = None        # misfit, lag, how much the slope falls
    for lag_s in np.arange(-0.02, 0.6, STEP_S):
        if min(np.sum(t < lag_s), np.sum(t > lag_s)) < FEW // 2:
            continue
        lines = np.column_stack([np.ones_like(t), t, np.maximum(t - lag_s, 0.0)])
        shape = np.linalg.lstsq(lines, v, rcond=None)[0]
        misfit = float(np.sum((lines @ shape - v)**2))
        if best is None or misfit < best[0]:
            best = misfit, float(lag_s), float(shape[2])
    return best[1] if best is not None and best[2] < 0.0 else None


def _check_switch(rows: Sequence[Row], was_ended: bool) -> Finding:
    """Whether the hood's limit switch closed, opened above it, and closed again."""
    check, states = "hood motor, limit switch", list[bool]()
    for _, tick, _ in rows:
        if tick.inputs.hood_motor.endstop_t_ns:
            closed = tick.inputs.hood_motor.endstop
            states += [closed] if not states or states[-1] != closed else []
    if states[-3:] == [True, False, True]:
        return ok(check, "closes and opens")
    told = "was told as " + ", then ".join("closed" if state else "open" for state in states)
    if was_ended or not states:
        return warning(check, f"{told if states else 'was not told'} when the motion ended", FIRST)
    return failure(check, f"{told}; it should close, open and close again", "look at the switch, its plug and polarity")


def _check_hood_encoder(config: Config, rows: Sequence[Row]) -> Iterator[Finding]:
    """Whether it follows the screw, and how late, once homing has told where the screw is."""
    check, memory = "hood encoder, motion", rows[-1][1].memory
    if not memory.homed:
        yield warning(check, "not compared with the screw: the hood was not homed", FIRST)
        return
    told = [(tick.inputs.hood_motor.t_ns * 1e-9, tick.inputs.hood_motor.position_rad - memory.screw_zero_rad,
             tick.inputs.hood_angle.t_ns * 1e-9, angle_deg) for _, tick, _ in rows
            if tick.inputs.hood_angle is not None and (angle_deg := _angle_deg(tick, config)) is not None]
    screw_s, turned_rad, angle_s, angles_deg = (np.array(column) for column in zip(*told, strict=True))
    screw_deg = np.array([elevation_from_screw_deg(turned, config.hood) or math.nan for turned in turned_rad])
    lag_s = _find_shift_s(screw_s, screw_deg, angle_s, angles_deg)
    off_deg = float(np.max(np.abs(np.interp(angle_s - lag_s, screw_s, screw_deg) - angles_deg)))
    way_deg = float(np.ptp(angles_deg))
    if not off_deg <= config.hood.crosscheck_deg:
        yield failure(check, f"differs from the screw by {off_deg:.1f} deg over {way_deg:.0f} deg",
                      "look at its zero_deg and direction, and at the screw's lead and gear in [hood]")
    elif lag_s > config.gate.reading_age_s / 2:
        yield failure(check, f"follows the screw {lag_s * 1e3:.0f} ms late; firing needs "
                      f"{config.gate.reading_age_s * 500:.0f} ms", "look for what holds its frames back")
    else:
        yield ok(check, f"follows the screw within {off_deg:.1f} deg over {way_deg:.0f} deg")


def _angle_deg(tick: Tick, config: Config) -> float | None:
    """By the encoder; one that homing zeroes is known from then on."""
    return hood_angle_deg(tick.inputs, config) if config.hood_encoder.zero_deg is not None else tick.estimate.hood_deg


def _find_shift_s(screw_s: Any, screw_deg: Any, angle_s: Any, angles_deg: Any) -> float:
    """By how much angles come later than the screw's, a constant difference aside."""
    shifts = np.arange(-0.1, 0.4, STEP_S)
    misfits = [float(np.var(np.interp(angle_s - shift, screw_s, screw_deg) - angles_deg)) for shift in shifts]
    return float(shifts[int(np.argmin(misfits))])
