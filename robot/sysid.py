"""System identification: the motion program for the flywheels and the hood, and one tick of it.

The program consists of quasistatic ramps and dynamic steps, each followed by coasting to rest. The operator arms the
motors once; any later button press releases them. Any fault releases every motor for the rest of the run. The tick is
pure, like truearc.robot.tick, so a replay is exact. Its motion interlocks are those used for launching
(truearc.robot.motion).
"""

from collections.abc import Callable
from itertools import chain

from msgspec import UNSET, Struct, UnsetType
from msgspec.structs import replace

from truearc.errors import InputError
from truearc.hw.protocols import NS
from truearc.hw.reason import Reason
from truearc.robot import reasons as because
from truearc.robot.config.schema import Config, Excite
from truearc.robot.control import RELEASED, home
from truearc.robot.estimate import doubt_axes, estimate, is_fresh, remember
from truearc.robot.gate import Gate
from truearc.robot.motion import OVERSPEED, Wanted, Watch, watch
from truearc.robot.types import Aim, Command, Estimate, Inputs, Memory, Progress, Tick, Verdict

# --- the program

READY, HOME, COAST, RAMP, STEP = "ready", "home", "coast", "ramp", "step"
# The doctor's: a short push that may move nothing; no torque for a while; slow travel of the hood, to or off its switch
NUDGE, PAUSE, CREEP = "nudge", "pause", "creep"
CREEP_UP_DEG = 3.0                    # above the switch: it closes within a fraction of a degree
FLYWHEEL, HOOD = "flywheel", "hood"
STILL = 0.02                          # times top_rad_s: it has come to rest
READY_S = 5.0                         # from arming until every axis is under control


class Phase(Struct, frozen=True):
    """One action on one joint; speeds and torques at the motor."""

    joint: str
    kind: str
    sign: int                         # +1 launches a ball or raises the hood, -1 the other way
    torque_nm: float                  # at most
    rate_nm_s: float                  # how fast the torque grows; 0 = at once
    top_rad_s: float
    longest_s: float
    ends_rad_s: float = 0.0           # a drive ends at this speed, creeping keeps to it; 0: top_rad_s
    must_turn: bool = False           # a nudge, after which nothing more is tried

    def asked_nm(self, since_s: float) -> float:
        """Return the torque this long after the phase began."""
        size_nm = min(self.torque_nm, self.rate_nm_s * since_s) if self.rate_nm_s else self.torque_nm
        return self.sign * size_nm


def phases(config: Config) -> tuple[Phase, ...]:
    """Return the whole program; InputError if [identify] is missing or exceeds the launcher's own limits."""
    if config.identify is None:
        raise InputError("[identify] is missing from the configuration: it says what may be driven, and how hard")
    wheel, hood = config.identify.flywheel, config.identify.hood
    _check(config)
    program = [Phase(FLYWHEEL, READY, 1, 0.0, 0.0, wheel.top_rad_s, READY_S)]
    if wheel.repeats:
        program += _joint(FLYWHEEL, wheel, (1, -1) if wheel.reverse else (1,))
    if hood.repeats:
        home = Phase(HOOD, HOME, -1, -config.hood.homing_torque_nm, 0.0, hood.top_rad_s, hood.longest_s)
        program += [home, *_joint(HOOD, hood, (1, -1))]
    if len(program) == 1:
        raise InputError("identify: both repeats are 0, so nothing would be driven")
    return tuple(program)


def _joint(joint: str, excite: Excite, signs: tuple[int, ...]) -> list[Phase]:
    """Coast, then for each repeat ramps each way and steps each way, so that up and down end where they began."""
    coast = Phase(joint, COAST, 1, 0.0, 0.0, excite.top_rad_s, excite.longest_s)
    made = [coast]
    for _ in range(excite.repeats):
        for kind, rate_nm_s in ((RAMP, excite.ramp_nm_s), (STEP, 0.0)):
            for sign in signs:
                made += [Phase(joint, kind, sign, excite.step_nm, rate_nm_s, excite.top_rad_s, excite.longest_s), coast]
    return made


def _check(config: Config) -> None:
    assert config.identify is not None
    wheel, hood = config.identify.flywheel, config.identify.hood
    free_rad_s = config.rig.launcher.free_speed_rad_s
    if free_rad_s and OVERSPEED * wheel.top_rad_s > free_rad_s:
        raise InputError(f"identify.flywheel.top_rad_s is {wheel.top_rad_s:g}; with {OVERSPEED - 1.0:.0%} to spare "
                         f"that is above rig.launcher.free_speed_rad_s, {free_rad_s:g}")
    if not 0.0 < 2.0 * hood.margin_deg < config.hood.high_deg - config.hood.low_deg:
        raise InputError(f"identify.hood.margin_deg is {hood.margin_deg:g}: nothing is left of the hood's travel from "
                       f"{config.hood.low_deg:g} to {config.hood.high_deg:g} degrees")


# --- one tick

POLICY = "identify"                   # what the session's header says
LIMIT_SHARE = 0.5                     # of the hood's margin: nearer to an end of its travel everything is let go


def make_step(config: Config,
              program: tuple[Phase, ...] | None = None) -> Callable[[Inputs, Memory, Config, Gate | None], Tick]:
    """Return the function of one tick, for truearc.robot.runtime.run. program: None for that of [identify]; InputError
    if the configuration has none."""
    program = program or phases(config)

    def step(inputs: Inputs, memory: Memory, config: Config, gate: Gate | None) -> Tick:
        progress = Progress() if isinstance(memory.identify, UnsetType) else memory.identify
        memory, progress = _operate(inputs, memory, progress)
        memory = remember(inputs, memory, config)
        belief = estimate(inputs, memory, config)
        watched = _watch(inputs, belief, memory, progress, program, config)
        progress = _advance(inputs, belief, memory, progress, program, config, watched)
        memory = replace(memory, armed=memory.armed and progress.over is None, identify=progress, motion=UNSET)
        command = RELEASED
        if memory.armed:
            command = _command(inputs, belief, progress, program, config, watched)
            memory = replace(memory, motion=watched.remember(command.flywheel_torque_nm, command.hood_torque_nm))
        return Tick(inputs, belief, Aim(0.0, belief.hood_deg or 0.0, POLICY),
                    Verdict(False, (say(progress, program),)), command, memory)

    return step


def say(progress: Progress, program: tuple[Phase, ...]) -> Reason:
    """Describe the state of the program, for the operator and the record."""
    if progress.over is not None:
        return progress.over
    if not progress.since_t_ns:
        return because.IDENTIFY_WAITING()
    phase = program[progress.phase]
    if phase.kind == READY:
        return because.IDENTIFY_STARTING()
    return because.IDENTIFY_RUNNING(joint=phase.joint, phase=phase.kind, sign=phase.sign, number=progress.phase,
                                    last=len(program) - 1)


def _operate(inputs: Inputs, memory: Memory, progress: Progress) -> tuple[Memory, Progress]:
    if inputs.missed is not None:     # any button lets go, so that a press that got lost does, too
        begun = bool(progress.since_t_ns) and progress.over is None
        over = because.IDENTIFY_RELEASED_BY_BOX(cause=inputs.missed)
        return memory, replace(progress, over=over) if begun else progress
    for event in inputs.buttons:
        if progress.over is not None:
            break
        if progress.since_t_ns:
            progress = replace(progress, over=because.IDENTIFY_RELEASED(button=event.button))
        elif event.button == "arm":
            memory, progress = replace(memory, armed=True), replace(progress, since_t_ns=inputs.t_ns)
    return memory, progress


def _watch(inputs: Inputs, belief: Estimate, memory: Memory, progress: Progress, program: tuple[Phase, ...],
           config: Config) -> Watch:
    """The interlocks of motion, for the joint that is driven."""
    phase = program[progress.phase]
    on_wheels = phase.joint == FLYWHEEL
    wanted = Wanted(phase.top_rad_s if on_wheels else 0.0, None, None if on_wheels else phase.top_rad_s)
    return watch(inputs, belief, wanted, memory, config, doubt_axes(inputs, config))


def _advance(inputs: Inputs, belief: Estimate, memory: Memory, progress: Progress, program: tuple[Phase, ...],
             config: Config, watched: Watch) -> Progress:
    if progress.over is not None or not progress.since_t_ns:
        return progress
    phase, since_s = program[progress.phase], (inputs.t_ns - progress.since_t_ns) * NS
    doubts = [*inputs.faults, *chain(*watched.doubts)]
    doubts += [joint.cause for joint in (watched.wheels, watched.hood)
               if joint.cause is not None and joint.cause not in doubts]
    if phase.kind == READY:
        if doubts and since_s < phase.longest_s:
            return progress
    else:
        doubts += _trespasses(inputs, belief, phase, config)
    speed = _speed(inputs, belief, phase.joint)
    late = since_s >= phase.longest_s
    if late:
        doubts += _overdue(phase, speed)
    if doubts:
        return replace(progress, over=because.IDENTIFY_STOPPED(causes=tuple(doubts)))
    if not late and not _is_over(inputs, belief, memory, phase, speed, config):
        return progress
    if progress.phase + 1 == len(program):
        return replace(progress, over=because.IDENTIFY_DONE())
    return Progress(progress.phase + 1, inputs.t_ns)


def _command(inputs: Inputs, belief: Estimate, progress: Progress, program: tuple[Phase, ...], config: Config,
             watched: Watch) -> Command:
    phase = program[progress.phase]
    asked_nm = phase.asked_nm((inputs.t_ns - progress.since_t_ns) * NS)
    if phase.kind == HOME:
        asked_nm = home(inputs, belief, watched, config)
    elif phase.kind == CREEP and _speed(inputs, belief, phase.joint) * phase.sign >= phase.ends_rad_s:
        asked_nm = 0.0
    return Command(True, True, True, asked_nm if phase.joint == FLYWHEEL else 0.0,
                   asked_nm if phase.joint == HOOD else 0.0, 0.0)


def _speed(inputs: Inputs, belief: Estimate, joint: str) -> float:
    return belief.motor_rad_s if joint == FLYWHEEL else inputs.hood_motor.velocity_rad_s


def _trespasses(inputs: Inputs, belief: Estimate, phase: Phase, config: Config) -> list[Reason]:
    """What must not happen in any phase."""
    speed = _speed(inputs, belief, phase.joint)
    reasons = []
    if not belief.motor_spread_rad_s <= config.flywheel.spread_rad_s:
        reasons.append(because.FLYWHEELS_DIFFER(spread_rad_s=belief.motor_spread_rad_s))
    return reasons + (_hood(belief, phase, speed, config) if phase.joint == HOOD else [])


def _hood(belief: Estimate, phase: Phase, speed: float, config: Config) -> list[Reason]:
    if phase.kind in (HOME, NUDGE, PAUSE, CREEP):
        return []
    if belief.hood_deg is None or belief.hood_screw_deg is None:
        return [because.HOOD_UNKNOWN()]
    low_deg, high_deg = _window(config, LIMIT_SHARE)
    slow = STILL * phase.top_rad_s
    if (belief.hood_deg > high_deg and speed > slow) or (belief.hood_deg < low_deg and speed < -slow):
        return [because.HOOD_AT_LIMIT(angle_deg=belief.hood_deg)]
    return []


def _window(config: Config, share: float) -> tuple[float, float]:
    """The hood's travel less this share of the margin at each end."""
    assert config.identify is not None
    margin_deg = share * config.identify.hood.margin_deg
    return config.hood.low_deg + margin_deg, config.hood.high_deg - margin_deg


def _is_over(inputs: Inputs, belief: Estimate, memory: Memory, phase: Phase, speed: float, config: Config) -> bool:
    if phase.kind == READY:
        return True                   # every reading is there and fresh
    if phase.kind == HOME:
        return memory.homed
    if phase.kind == COAST:
        return abs(speed) <= STILL * phase.top_rad_s
    if phase.kind == PAUSE:
        return False
    if phase.kind == CREEP:
        return _has_crept(inputs, belief, phase, config)
    fast = speed * phase.sign >= (phase.ends_rad_s or phase.top_rad_s)
    return fast or (phase.joint == HOOD and phase.kind != NUDGE and _at_end(belief, phase, config))


def _has_crept(inputs: Inputs, belief: Estimate, phase: Phase, config: Config) -> bool:
    """On the switch; or, where it is known how high that is, off it."""
    if phase.sign < 0:
        return inputs.hood_motor.endstop and is_fresh(inputs, inputs.hood_motor.endstop_t_ns, config)
    screw_deg = belief.hood_screw_deg
    return screw_deg is not None and abs(screw_deg - config.hood.low_deg) >= CREEP_UP_DEG


def _at_end(belief: Estimate, phase: Phase, config: Config) -> bool:
    low_deg, high_deg = _window(config, 1.0)
    assert belief.hood_deg is not None            # _hood has asked
    return belief.hood_deg >= high_deg if phase.sign > 0 else belief.hood_deg <= low_deg


def _overdue(phase: Phase, speed: float) -> list[Reason]:
    """Driving may last as long as it may; not so what ought to have come to an end."""
    if phase.kind == PAUSE or (phase.kind == NUDGE and not phase.must_turn):
        return []
    if phase.kind == HOME or (phase.kind == CREEP and phase.sign < 0):
        return [because.SWITCH_NOT_REACHED(limit_s=phase.longest_s)]
    if phase.kind == COAST and abs(speed) > STILL * phase.top_rad_s:
        return [because.JOINT_STILL_TURNING(joint=phase.joint, limit_s=phase.longest_s)]
    if phase.torque_nm and abs(speed) <= STILL * phase.top_rad_s:
        return [because.JOINT_NOT_TURNING(joint=phase.joint, torque_nm=phase.torque_nm)]
    return []
