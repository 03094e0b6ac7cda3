"""The doctor's small motion: what is driven, and one tick of it. No IO.

Wheels and hood are first nudged, ever harder, so that one whose sensors are dead hardly moves; what does not answer is
not driven further. Then the wheels turn up to a few percent of their free speed, and the hood creeps a few degrees up,
down to its limit switch, off it and back on it. System identification's tick drives; whatever it does not know is
watched here. Any doubt ends it, with every motor released.
"""

import math

from msgspec import UNSET
from msgspec.structs import replace

from truearc.errors import InputError
from truearc.hw.devices.registry import family_of
from truearc.hw.protocols import ButtonEvent, CameraFrame, MotorReading
from truearc.hw.reason import Reason
from truearc.robot.config.schema import Config
from truearc.robot.control import RELEASED
from truearc.robot.estimate import NS, is_fresh
from truearc.robot.gate.model import Gate
from truearc.robot.geometry import elevation_from_encoder_deg, screw_rad
from truearc.robot.motors import name_axes
from truearc.robot.reasons import (
    BOX_GONE,
    FRAMES_NOT_SENT,
    HOOD_ENCODERS_DISAGREE,
    IDENTIFY_DONE,
    IDENTIFY_RELEASED,
    text,
)
from truearc.robot.sysid.program import (
    CREEP,
    CREEP_UP_DEG,
    FLYWHEEL,
    HOOD,
    NUDGE,
    PAUSE,
    READY,
    READY_S,
    STEP,
    STILL,
    Phase,
)
from truearc.robot.sysid.tick import make_step
from truearc.robot.types import Inputs, Memory, Progress, Sent, Tick, Verdict

WHEEL_SHARE = 0.05                    # of the free speed: a finger stops a wheel that is so slow
KS_TIMES = 3.0                        # times the configured friction: more is a brake, a jam or a wrong figure
OUTPUT_SHARE = 0.05                   # of the greatest torque, where the configuration has no friction
NUDGES = 5                            # of a fifth, two fifths, ... of the greatest torque
WHEEL_NUDGE_S, HOOD_NUDGE_S, REST_S = 0.1, 0.05, 0.15
STARTED_RAD_S = 3.0                   # the wheels turn: an encoder's noise is less
SPIN_S, COAST_S = 2.0, 1.0            # at 30 rad/s2, as the emulated wheels have it, a second is enough
CREEP_DEG_S = 5.0
RISE_S, RAMP_S = 1.0, 0.5             # of the first way up, and until the hood's torque is all there
MOST_UP_DEG = 6.0                     # twice what is meant: more is a wrong reading
UNSENT_NS = 100_000_000               # a motor is told every 25 ms at least, and its watchdog waits for so long
JAM_S = 0.3                           # at full torque without motion
MOST_TURNS = 12.0                     # of a wheel: half of WHEEL_SHARE of a free speed of 800 rad/s, for the whole time


def plan(config: Config, hood_deg: float | None) -> tuple[Phase, ...]:
    """The whole motion. hood_deg: where the hood is, None if only homing tells; InputError where nothing can be."""
    if not all(family_of(axis).is_commanded for _, axis in name_axes(config)):
        raise InputError("--move: motors with driver \"advisory\" are another controller's to move")
    wheel, hood = config.flywheel, config.hood
    free_rad_s = config.rig.launcher.free_speed_rad_s
    if not free_rad_s:
        raise InputError("--move: rig.launcher.free_speed_rad_s is missing: it says how fast the wheels may turn")
    most_nm = min(KS_TIMES * wheel.ks_nm or OUTPUT_SHARE * abs(wheel.pid.output_high), abs(wheel.pid.output_high))
    top_rad_s = WHEEL_SHARE * free_rad_s
    program = [Phase(FLYWHEEL, READY, 1, 0.0, 0.0, top_rad_s, READY_S),
               *_nudges(FLYWHEEL, 1, most_nm, top_rad_s, WHEEL_NUDGE_S, min(STARTED_RAD_S, top_rad_s)),
               Phase(FLYWHEEL, STEP, 1, most_nm, 0.0, top_rad_s, SPIN_S),
               Phase(FLYWHEEL, PAUSE, 1, 0.0, 0.0, top_rad_s, COAST_S)]
    creep_rad_s = CREEP_DEG_S * rad_per_deg(config)
    top_rad_s, hood_nm = 2.0 * creep_rad_s, abs(hood.homing_torque_nm)
    down, travel_deg = (1 if hood.homing_torque_nm > 0.0 else -1), hood.high_deg - hood.low_deg

    def creep(sign: int, longest_s: float) -> Phase:
        return Phase(HOOD, CREEP, sign, hood_nm, hood_nm / RAMP_S, top_rad_s, longest_s, creep_rad_s)

    rest, home_s = Phase(HOOD, PAUSE, 1, 0.0, 0.0, top_rad_s, REST_S), 2.0 * travel_deg / CREEP_DEG_S
    if hood_deg is None or hood_deg < hood.high_deg - 2.0 * CREEP_UP_DEG:
        program += _nudges(HOOD, -down, hood_nm, top_rad_s, HOOD_NUDGE_S, creep_rad_s / 2.0)
        program += [creep(-down, RISE_S), rest]
    else:
        program += _nudges(HOOD, down, hood_nm, top_rad_s, HOOD_NUDGE_S, creep_rad_s / 2.0)
    return (*program, creep(down, home_s), rest, creep(-down, 2.0 * CREEP_UP_DEG / CREEP_DEG_S + RAMP_S), rest,
            creep(down, 2.0 * CREEP_UP_DEG / CREEP_DEG_S + RAMP_S), rest)


def describe(config: Config, program: tuple[Phase, ...]) -> str:
    """What will move, how far and how fast, for whoever is to allow it."""
    spin = next(phase for phase in program if phase.kind == STEP)
    creep = next(phase for phase in program if phase.kind == CREEP)
    return (f"wheels: up to {spin.top_rad_s:.0f} rad/s at the motor, with {spin.torque_nm:g} Nm for {SPIN_S:g} s at "
            "most, whatever they read\n"
            f"hood: {CREEP_UP_DEG:g} deg up, down to its limit switch, {CREEP_UP_DEG:g} deg up and down again, at "
            f"{CREEP_DEG_S:g} deg/s with {creep.torque_nm:g} Nm at most\n"
            "feeder: not at all")


def rad_per_deg(config: Config) -> float:
    """How far the hood's motor turns in a degree of elevation, in the middle of its travel."""
    middle_deg = (config.hood.low_deg + config.hood.high_deg) / 2.0
    return abs(screw_rad(middle_deg + 0.5, config.hood) - screw_rad(middle_deg - 0.5, config.hood))


def _nudges(joint: str, sign: int, most_nm: float, top_rad_s: float, long_s: float, ends_rad_s: float) -> list[Phase]:
    nudges = []
    for number in range(1, NUDGES + 1):
        nudges += [Phase(joint, NUDGE, sign, most_nm * number / NUDGES, 0.0, top_rad_s, long_s, ends_rad_s,
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
        self._step = make_step(config, program)
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
            over = replace(progress, over=IDENTIFY_RELEASED(button="doctor"))
            tick = replace(tick, command=RELEASED, verdict=Verdict(False, (IDENTIFY_RELEASED(button="doctor"),)),
                           memory=replace(tick.memory, armed=False, identify=over))
            self.over = doubt
        elif progress.over is not None:
            self.over = self.over or ("" if progress.over.code == IDENTIFY_DONE.name else _words(progress.over))
        if self.over is not None:
            self._over_ns = self._over_ns or inputs.t_ns
            self.is_finished = (inputs.t_ns - self._over_ns) * NS > COAST_S
        return tick

    def _counted(self, inputs: Inputs) -> tuple[Reason, ...]:
        """The faults, without those of a box that is not there, and frames unsent once: motors are told again soon."""
        ignored = set[str]() if self._has_box else set(BOX_GONE)
        if any(fault.code == FRAMES_NOT_SENT.name for fault in inputs.faults):
            if inputs.t_ns - self._unsent_ns > UNSENT_NS:
                ignored.add(FRAMES_NOT_SENT.name)
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
        down = phase.sign * config.hood.homing_torque_nm > 0.0
        most_deg = MOST_UP_DEG if not down or phase.kind != CREEP else config.hood.high_deg - config.hood.low_deg + 3.0
        if not max(abs(turned_deg), abs(pivoted_deg)) <= most_deg:
            return (f"the hood has moved by {turned_deg:.1f} deg by its motor's encoder and {pivoted_deg:.1f} by its "
                    f"own, more than {most_deg:g}")
        return self._creep_doubt(inputs, phase, down, turned_deg) if phase.kind == CREEP else None

    def _creep_doubt(self, inputs: Inputs, phase: Phase, down: bool, turned_deg: float) -> str | None:
        hood, at_deg = inputs.hood_motor, hood_angle_deg(inputs, self._config)
        closed = is_fresh(inputs, hood.endstop_t_ns, self._config) and hood.endstop
        if not down and closed and turned_deg > CREEP_UP_DEG - 1.0:
            return f"the limit switch stays closed {turned_deg:.1f} deg above it"
        asked_nm = phase.asked_nm((inputs.t_ns - self._start.t_ns) * NS)
        if abs(asked_nm) < phase.torque_nm or abs(hood.velocity_rad_s) > STILL * phase.top_rad_s:
            self._still_ns = inputs.t_ns
        if (inputs.t_ns - self._still_ns) * NS <= JAM_S:
            return None
        where = "" if at_deg is None else f" at {at_deg:.1f} deg"
        return (f"the hood has stopped{where} and its limit switch stays open: is it dead, or does something jam?"
                if down else f"the hood does not move{where} with {phase.torque_nm:g} Nm: does something jam?")

    def _pivoted_deg(self, inputs: Inputs) -> float:
        """By how much the hood's own encoder has turned, 0 where there is none."""
        if inputs.hood_angle is None or self._start.hood_angle is None:
            return 0.0
        began_deg = math.degrees(self._start.hood_angle.angle_rad)
        return elevation_from_encoder_deg(inputs.hood_angle.angle_rad, self._config.hood_encoder, began_deg)


def hood_angle_deg(inputs: Inputs, config: Config) -> float | None:
    """The elevation by the hood's encoder; None where there is none that knows its zero."""
    zero_deg = config.hood_encoder.zero_deg
    if zero_deg is None or inputs.hood_angle is None or not config.hood_encoder.is_heard:
        return None
    return elevation_from_encoder_deg(inputs.hood_angle.angle_rad, config.hood_encoder, zero_deg)


def _words(over: Reason) -> str:
    """Why system identification's tick has released the motors, and of two hood encoders what to look for."""
    causes, words = over.params.get("causes"), text(over).removeprefix("identify: ")
    if isinstance(causes, tuple) and HOOD_ENCODERS_DISAGREE.name in (getattr(cause, "code", "") for cause in causes):
        return f"{words}: is one of them stuck, scaled, late or the wrong way round?"
    return words


def _runaway(name: str, motor: MotorReading, start: MotorReading, phase: Phase) -> str | None:
    turns = (motor.position_rad - start.position_rad) / math.tau
    if not abs(motor.velocity_rad_s) <= 2.0 * phase.top_rad_s:
        return f"{name} reports {motor.velocity_rad_s:.0f} rad/s; {phase.top_rad_s:.0f} are asked for at most"
    if not abs(turns) <= MOST_TURNS:
        return f"{name} has turned {turns:.0f} times, more than {MOST_TURNS:g}"
    return None
