"""The doctor's small test motion: its program, one tick of it, and its findings, without I/O.

Wheels and hood are first nudged with increasing torque, so that an axis with dead sensors hardly moves; an axis that
does not respond is not driven further. Then the wheels turn at up to a few percent of their free speed, and the hood
creeps a few degrees up, down to its limit switch, off it and back onto it. The tick of system identification drives the
motion; this module adds the checks that the tick lacks. Any doubt ends the motion and releases every motor. The
direction, scale and lag of each axis and the limit switch are evaluated from the ticks of the motion.
"""

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from msgspec import UNSET
from msgspec.structs import replace

from truearc.errors import InputError
from truearc.hw.devices.family import FAILURE, AxisCheck, Finding, Heard, failure, ok, warning
from truearc.hw.devices.registry import family_of
from truearc.hw.protocols import NS, ButtonEvent, CameraFrame, MotorReading
from truearc.hw.reason import Reason
from truearc.robot import control, estimate, sysid
from truearc.robot import reasons as because
from truearc.robot.config.schema import Config
from truearc.robot.gate import Gate
from truearc.robot.motors import elevation_from_encoder_deg, elevation_from_screw_deg, name_axes, screw_rad
from truearc.robot.sysid import CREEP, FLYWHEEL, HOOD, PAUSE, STILL, Phase
from truearc.robot.types import Inputs, Memory, Progress, Sent, Tick, Verdict

# --- the motion

WHEEL_SHARE = 0.05                    # of the free speed: a finger stops a wheel that is so slow
KS_TIMES = 3.0                        # times the configured friction: more is a brake, a jam or a wrong figure
OUTPUT_SHARE = 0.05                   # of the greatest torque, where the configuration has no friction
NUDGES = 5                            # of a fifth, two fifths, ... of the greatest torque
WHEEL_NUDGE_S, HOOD_NUDGE_S, REST_S = 0.1, 0.05, 0.15
STARTED_RAD_S = 3.0                   # the wheels turn: an encoder's noise is less
SPIN_S, COAST_S = 2.0, 1.0            # at 30 rad/s2, as the emulated wheels have it, a second is enough
CREEP_DEG_S = 5.0                     # or the hood's limit, where that is less
RISE_S, RAMP_S = 1.0, 0.5             # of the first way up, and until the hood's torque is all there
MOST_UP_DEG = 6.0                     # twice what is meant: more is a wrong reading
UNSENT_NS = 100_000_000               # a motor is told each tick, and its watchdog waits for so long
JAM_S = 0.3                           # at full torque without motion
MOST_TURNS = 12.0                     # of a wheel: half of WHEEL_SHARE of a free speed of 800 rad/s, for the whole time
USUAL_RAD_S = 800.0                   # a faster wheel turns more in proportion


def plan(config: Config, hood_deg: float | None) -> tuple[Phase, ...]:
    """Return the whole motion. hood_deg: the hood's position, None if only homing can tell; InputError if nothing
    can."""
    if not all(family_of(axis).is_commanded for _, axis in name_axes(config)):
        raise InputError("--move: motors with driver \"advisory\" are another controller's to move")
    wheel, hood = config.flywheel, config.hood
    free_rad_s = config.rig.launcher.free_speed_rad_s
    if not free_rad_s:
        raise InputError("--move: rig.launcher.free_speed_rad_s is missing: it says how fast the wheels may turn")
    most_nm = min(KS_TIMES * wheel.ks_nm or OUTPUT_SHARE * abs(wheel.pid.output_high), abs(wheel.pid.output_high))
    top_rad_s = WHEEL_SHARE * free_rad_s
    program = [Phase(FLYWHEEL, sysid.READY, 1, 0.0, 0.0, top_rad_s, sysid.READY_S),
               *_nudges(FLYWHEEL, 1, most_nm, top_rad_s, WHEEL_NUDGE_S, min(STARTED_RAD_S, top_rad_s)),
               Phase(FLYWHEEL, sysid.STEP, 1, most_nm, 0.0, top_rad_s, SPIN_S),
               Phase(FLYWHEEL, PAUSE, 1, 0.0, 0.0, top_rad_s, COAST_S)]
    creep_deg_s = min(CREEP_DEG_S, hood.max_deg_s)
    creep_rad_s = creep_deg_s * rad_per_deg(config)
    top_rad_s, hood_nm = 2.0 * creep_rad_s, -hood.homing_torque_nm

    def creep(sign: int, longest_s: float) -> Phase:
        return Phase(HOOD, CREEP, sign, hood_nm, hood_nm / RAMP_S, top_rad_s, longest_s, creep_rad_s)

    rest = Phase(HOOD, PAUSE, 1, 0.0, 0.0, top_rad_s, REST_S)
    home_s = 2.0 * (hood.high_deg - hood.low_deg) / creep_deg_s
    may_rise = hood_deg is None or hood_deg < hood.high_deg - 2.0 * sysid.CREEP_UP_DEG
    program += _nudges(HOOD, 1 if may_rise else -1, hood_nm, top_rad_s, HOOD_NUDGE_S, creep_rad_s / 2.0)
    program += [creep(1, RISE_S), rest] if may_rise else []
    creep_s = 2.0 * sysid.CREEP_UP_DEG / creep_deg_s + RAMP_S
    return (*program, creep(-1, home_s), rest, creep(1, creep_s), rest, creep(-1, creep_s), rest)


def describe(config: Config, program: tuple[Phase, ...]) -> str:
    """Describe what will move, how far and how fast, for the person who must allow it."""
    spin = next(phase for phase in program if phase.kind == sysid.STEP)
    creep, up_deg = next(phase for phase in program if phase.kind == CREEP), sysid.CREEP_UP_DEG
    return (f"wheels: up to {spin.top_rad_s:.0f} rad/s at the motor, with {spin.torque_nm:g} Nm for {SPIN_S:g} s at "
            "most, whatever they read\n"
            f"hood: {up_deg:g} deg up, down to its limit switch, {up_deg:g} deg up and down again, at "
            f"{min(CREEP_DEG_S, config.hood.max_deg_s):g} deg/s with {creep.torque_nm:g} Nm at most\n"
            "feeder: not at all")


def rad_per_deg(config: Config) -> float:
    """Return how far the hood's motor turns per degree of elevation, in the middle of its travel."""
    middle_deg = (config.hood.low_deg + config.hood.high_deg) / 2.0
    return abs(screw_rad(middle_deg + 0.5, config.hood) - screw_rad(middle_deg - 0.5, config.hood))


def _nudges(joint: str, sign: int, most_nm: float, top_rad_s: float, long_s: float, ends_rad_s: float) -> list[Phase]:
    nudges = []
    for number in range(1, NUDGES + 1):
        nudges += [Phase(joint, sysid.NUDGE, sign, most_nm * number / NUDGES, 0.0, top_rad_s, long_s, ends_rad_s,
                         number == NUDGES), Phase(joint, PAUSE, 1, 0.0, 0.0, top_rad_s, REST_S)]
    return nudges


class SmallMotion:
    """What one tick does, for truearc.robot.runtime.run; and its Recorder. It begins with the first tick.

    has_box: whether a button box is there, each button of which ends it. over: why it ended; "" once all was done, None
    before. is_finished: that was long enough ago to have seen the motors coast. rows: every tick, with its phase.
    """

    def __init__(self, config: Config, program: tuple[Phase, ...], has_box: bool) -> None:
        self.over: str | None = None
        self.rows: list[tuple[Phase, Tick, Sent]] = []
        self._config, self._program, self._has_box = config, program, has_box
        self._step = sysid.make_step(config, program)
        self._rad_per_deg = rad_per_deg(config)
        self._phase = -1
        self._start: Inputs
        self._still_ns = self._over_ns = 0
        self._unsent_ns = -UNSENT_NS
        self.is_finished = False

    def __call__(self, inputs: Inputs, memory: Memory, config: Config, gate: Gate | None) -> Tick:
        begun = memory.identify is not UNSET
        if not begun:
            inputs = replace(inputs, buttons=(ButtonEvent(inputs.t_ns, 0, "arm"),), missed=None)
        inputs = replace(inputs, faults=self._counted(inputs))
        tick = self._step(inputs, memory, config, gate)
        progress = tick.memory.identify
        assert isinstance(progress, Progress)
        doubt = self._doubt(inputs, progress) if begun and progress.over is None else None
        if doubt is not None:
            why = because.IDENTIFY_RELEASED(button="doctor")
            tick = replace(tick, command=control.RELEASED, verdict=Verdict(False, (why,)),
                           memory=replace(tick.memory, armed=False, identify=replace(progress, over=why)))
            self.over = doubt
        elif progress.over is not None:
            self.over = self.over or ("" if progress.over.code == because.IDENTIFY_DONE.name else _words(progress.over))
        if self.over is not None:
            self._over_ns = self._over_ns or inputs.t_ns
            self.is_finished = (inputs.t_ns - self._over_ns) * NS > COAST_S
        return tick

    def _counted(self, inputs: Inputs) -> tuple[Reason, ...]:
        """The faults, without those of a box that is not there, and frames unsent once: motors are told again soon."""
        ignored = set[str]() if self._has_box else set(because.BOX_GONE)
        if any(fault.code == because.FRAMES_NOT_SENT.name for fault in inputs.faults):
            if inputs.t_ns - self._unsent_ns > UNSENT_NS:
                ignored.add(because.FRAMES_NOT_SENT.name)
            self._unsent_ns = inputs.t_ns
        return tuple(fault for fault in inputs.faults if fault.code not in ignored)

    def record(self, tick: Tick, sent: Sent) -> None:
        progress = tick.memory.identify
        assert isinstance(progress, Progress)
        self.rows.append((self._program[progress.phase], tick, sent))

    def keep_picture(self, picture: CameraFrame) -> None: ...

    def _doubt(self, inputs: Inputs, progress: Progress) -> str | None:
        """What must not happen, and that system identification's tick does not know; None while all is well."""
        if progress.phase != self._phase:
            self._phase, self._start, self._still_ns = progress.phase, inputs, inputs.t_ns
        phase = self._program[progress.phase]
        if phase.joint == HOOD:
            return self._hood_doubt(inputs, phase)
        for number, (motor, start) in enumerate(zip(inputs.flywheels, self._start.flywheels, strict=True), 1):
            if doubt := _runaway(f"flywheel motor {number}", motor, start, phase):
                return doubt
        return None

    def _hood_doubt(self, inputs: Inputs, phase: Phase) -> str | None:
        hood, config = inputs.hood_motor, self._config
        turned_rad = hood.position_rad - self._start.hood_motor.position_rad
        turned_deg, pivoted_deg = turned_rad / self._rad_per_deg, self._pivoted_deg(inputs)
        most_deg = config.hood.high_deg - config.hood.low_deg + 3.0
        if phase.sign > 0 or phase.kind != CREEP:
            most_deg = MOST_UP_DEG
        if not max(abs(turned_deg), abs(pivoted_deg)) <= most_deg:
            return (f"the hood has moved by {turned_deg:.1f} deg by its motor's encoder and {pivoted_deg:.1f} by its "
                    f"own, more than {most_deg:g}")
        return self._creep_doubt(inputs, phase, turned_deg) if phase.kind == CREEP else None

    def _creep_doubt(self, inputs: Inputs, phase: Phase, turned_deg: float) -> str | None:
        hood, at_deg = inputs.hood_motor, hood_angle_deg(inputs, self._config)
        closed = estimate.is_fresh(inputs, hood.endstop_t_ns, self._config) and hood.endstop
        if phase.sign > 0 and closed and turned_deg > sysid.CREEP_UP_DEG - 1.0:
            return f"the limit switch stays closed {turned_deg:.1f} deg above it"
        asked_nm = phase.asked_nm((inputs.t_ns - self._start.t_ns) * NS)
        if abs(asked_nm) < phase.torque_nm or abs(hood.velocity_rad_s) > STILL * phase.top_rad_s:
            self._still_ns = inputs.t_ns
        if (inputs.t_ns - self._still_ns) * NS <= JAM_S:
            return None
        where = "" if at_deg is None else f" at {at_deg:.1f} deg"
        if phase.sign < 0:
            return f"the hood has stopped{where} and its limit switch stays open: is it dead, or does something jam?"
        return f"the hood does not move{where} with {phase.torque_nm:g} Nm: does something jam?"

    def _pivoted_deg(self, inputs: Inputs) -> float:
        """By how much the hood's own encoder has turned, 0 where there is none."""
        if inputs.hood_angle is None or self._start.hood_angle is None:
            return 0.0
        began_deg = math.degrees(self._start.hood_angle.angle_rad)
        return elevation_from_encoder_deg(inputs.hood_angle.angle_rad, self._config.hood_encoder, began_deg)


def hood_angle_deg(inputs: Inputs, config: Config) -> float | None:
    """Return the elevation from the hood's encoder; None without one that knows its zero."""
    zero_deg = config.hood_encoder.zero_deg
    if zero_deg is None or inputs.hood_angle is None or not config.hood_encoder.is_heard:
        return None
    return elevation_from_encoder_deg(inputs.hood_angle.angle_rad, config.hood_encoder, zero_deg)


def _words(over: Reason) -> str:
    """Why system identification's tick has released the motors, and of two hood encoders what to look for."""
    causes, words = over.params.get("causes"), because.text(over).removeprefix("identify: ")
    if isinstance(causes, tuple) and any(getattr(cause, "code", "") == because.HOOD_ENCODERS_DISAGREE.name
                                         for cause in causes):
        return f"{words}: is one of them stuck, scaled, late or the wrong way round?"
    return words


def _runaway(name: str, motor: MotorReading, start: MotorReading, phase: Phase) -> str | None:
    turns = (motor.position_rad - start.position_rad) / math.tau
    if not abs(motor.velocity_rad_s) <= 2.0 * phase.top_rad_s:
        return f"{name} reports {motor.velocity_rad_s:.0f} rad/s; {phase.top_rad_s:.0f} are asked for at most"
    most = MOST_TURNS * max(phase.top_rad_s / (WHEEL_SHARE * USUAL_RAD_S), 1.0)
    if not abs(turns) <= most:
        return f"{name} has turned {turns:.0f} times, more than {most:.0f}"
    return None


# --- what it has shown

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
    """Return the findings from the motion; heard: all of its frames."""
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
        turned[name] = abs(float(told[1][-1] - told[1][0])) if len(told[1]) else 0.0
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
        return failure(check, "neither its position nor its speed shows any motion", f"if it has turned, {do}; if not, "
                       "is it blocked, or do two motors work against each other (direction)?")
    if abs(way - added_way) > SHARE * max(way, added_way) + GRAIN_RAD or steps @ added < 0.0:
        return failure(check, f"its position has moved by {way:.1f} rad, its speeds add up to {added_way:.1f}", do)
    lag = "" if lag_s is None else f"; its speed follows the torque within {max(lag_s, 0.0) * 1e3:.0f} ms"
    return ok(check, f"{way:.1f} rad by its position, {added_way:.1f} by its speeds{lag}")


def _cut_s(rows: Sequence[Row]) -> float | None:
    """When the torque of the fast turn ended; None where it never came, or nothing is known of what followed."""
    driven = [tick.inputs.t_ns for phase, tick, sent in rows
              if phase.kind == sysid.STEP and sent.flywheel_torque_nm > 0.0]
    after = [tick.inputs.t_ns for _, tick, _ in rows if driven and tick.inputs.t_ns > driven[-1]]
    return after[0] * 1e-9 if len(after) > FEW else None


def find_lag_s(times: Numbers, speeds: Numbers, cut_s: float) -> float | None:
    """Return how long after a torque's end the speed bends, by a least-squares fit of two lines; None if it does
    not."""
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
    told = "was reported as " + ", then ".join("closed" if state else "open" for state in states)
    if was_ended or not states:
        return warning(check, f"{told if states else 'was not reported'} when the motion ended", FIRST)
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
