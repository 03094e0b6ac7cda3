"""The motion interlocks, which decide whether wheels and hood may be driven, and if not, why.

The interlocks are pure, like truearc.robot.tick. A missing, stale or faulty reading releases its axis until readings
have been good for RECOVER_S. A motion that contradicts the torque, or two sensors that contradict each other, release
the axis until the operator disarms and arms again; so do REPEATS releases within REPEAT_NS. Each tick compares the
readings with the torque of the previous tick. The feeder is driven only briefly; while its readings are in doubt it
gets no torque, but it is not released.
"""

import math

from msgspec import UNSET, Struct, UnsetType
from msgspec.structs import replace

from truearc.hw import fault_codes as codes
from truearc.hw.devices.registry import family_of
from truearc.hw.protocols import NS, NS_PER_S
from truearc.hw.reason import Reason
from truearc.robot import motors
from truearc.robot import reasons as because
from truearc.robot.config.schema import Config, Hood
from truearc.robot.estimate import Doubts, is_fresh
from truearc.robot.types import Estimate, Inputs, Joint, Memory, MotionMemory, Unanswered

WHEELS, HOOD, SWITCH = "wheels", "hood", "hood limit switch"
RECOVER_NS = 300_000_000              # of good readings: three heartbeats of a device, in which it would tell errors
BEAT_S = 0.35                         # of a heartbeat, where readings come: two in a row may be lost
START_NS = 500_000_000                # in which a device's old errors are cleared and it is taken over
REPEATS, REPEAT_NS = 3, 10 * NS_PER_S
# Wheels. A tuned loop overshoots by 3 % of a set point; no motor passes its free speed by itself
OVERSPEED, FREE_SPEED, PEAK_NS = 1.1, 1.05, 2 * NS_PER_S
PEAK_STEP_NS = 100_000_000            # the time of the highest set point is kept to this
DRIVING_A = 5.0                       # of Iq: twice what the shipped wheels' friction takes at full speed
SLOW_RAD_S = 30.0                     # without a set point yet: noise, or turned by hand, is no overspeed
BACKWARDS, HOOD_BACKWARDS = 0.05, 0.25            # shares of the set point and of the hood's limit, against the torque
LAG_NS = 20_000_000                   # a torque shows in readings that are so much younger: two ticks and a reading
FULL, FULL_NS = 0.8, 200_000_000      # share of the torque limit that moves every wheel, and how long it may not
SLOW, RISING = 0.05, 0.01             # shares of the set point: hardly turning, and turning faster than before
LEVEL_S = 0.05                        # a noisy speed is averaged over this, and has to rise by its noise, too
# A joint's stated friction is what just moves it; three times as much moves it unless it is jammed
HARD, HARD_NS, PUSH_NS = 3.0, 300_000_000, 460_000_000      # half a second with what the wires add
# A noisy encoder lets the torque sink below friction for some ticks; a push goes on through lulls shorter than this
LULL_NS, PUSHED_NS = 100_000_000, 20_000_000      # and when it last pushed is kept to the second
UNKNOWN = 2.0                         # times the stated friction, which sysid is to measure
MOVED_RAD = 1.0                       # of the hood motor, 0.2 degrees of the shipped hood: more than its play
# Without a hood encoder nothing else shows a motor's encoder that stands still. Until motion shows, and SHOWN_S after
# it last did, the torque is so many times the stated friction: the shipped screw, free, then goes 3 degrees in
# BLIND_NS, and one that sticks by half as much again as it rubs still breaks away
BLIND, BLIND_NS, SHOWN_S = 1.75, 250_000_000, 0.06
FAILURES = 3                          # in a row, each of which may have moved a hood whose motion is not known
# In a row, each of which may have sped up wheels that nothing shows turning: full torque takes the shipped ones to half
# of a usual set point each time, and they coast for longer than a driver needs to arm again
WHEEL_FAILURES = 2
# Torque in pieces, each shorter than an interlock's time, adds up until motion shows: of wheels, in seconds of the full
# torque, as much as two failures; of a hood whose place is not known, as much as three
WHEELS_S, HOOD_S = 0.4, 0.75
SEEN_RAD = math.radians(0.5)          # of the hood's encoder: more than its noise and play
SETTLED_NS = 2 * NS_PER_S             # armed and sound for so long: what was wrong with the hood has been mended
# Times the stated friction that moves wheels by a loop too soft for the others. From that share of the torque limit on
# it may not for PUSH_NS; by less torque for longer in proportion, in which it adds no more speed
SOFT, SOFT_SHARE = 1.5, 0.2
DIFFERENT = 3                         # readings in a row
RATE_NS = 5_000_000                   # between encoder readings, for a rate: closer ones were held up on their way
SWITCH_NS = 250_000_000               # the limit switch is read every 50 ms, and each tick where that is overdue
HOMING_TRAVEL, HOMING_TIMES = 1.1, 3.0            # times the whole travel, and the time that it takes at the limit
SWITCH_OPEN_DEG = 3.0                 # above the switch it is open
HOMING_PER_S = 6.0                    # homing's speed limit per degree left; measured: at 10 it ends too low, 3 sticks
SWITCH_DEG = 0.45                     # homing pushes no further below the switch: the encoder is off or the switch dead
LATCHING = frozenset((codes.ENCODER_STUCK.name, codes.ENCODER_MISMATCH.name, codes.SPEED_JUMPED.name))
STALLS = frozenset((because.TICKS_STALLED.name, codes.DUPLICATE_ID.name))    # waiting frames look like another device's
# What a hood's push begins with: a new one may not be as hard as one that has long moved nothing
NOT_STUCK = {"stuck_t_ns": 0, "hard_ns": 0, "pushed_t_ns": 0}
# With these no reading can be trusted to be of our device, of this moment, or ours to act on
EVERYWHERE = STALLS | {because.CAN_LOST.name, codes.FOREIGN_HOST.name}
# Latched for these, the hood may have moved further than is known: with a hood encoder, and without one
_UNSURE = frozenset((because.SWITCH_NOT_REACHED.name, because.JOINT_BACKWARDS.name, codes.ENCODER_STUCK.name,
                     codes.ENCODER_MISMATCH.name))
UNKNOWN_MOTION = _UNSURE | {because.HOOD_ENCODERS_DISAGREE.name, because.HOOD_UNKNOWN.name}
UNSEEN_MOTION = _UNSURE | {because.JOINT_NOT_TURNING.name, because.HOOD_JAMMED.name}
FREE = Joint()


class Watch(Struct, frozen=True):
    """What the tick knows of motion before it decides; `ready`: under control and without errors."""

    wheels: Joint
    hood: Joint
    doubts: Doubts
    wheels_ready: bool = False
    hood_ready: bool = False
    feeder_ready: bool = False
    feeder_on: bool = False           # nothing is wrong with the bus as a whole
    armed_t_ns: int = 0
    active_t_ns: int = 0
    is_idle: bool = False
    is_short: bool = False            # the hood does not reach its set point, and is not pushed any more
    failures: tuple[int, int] = (0, 0)        # of wheels and hood, in a row, in each of which one may have moved unseen
    unanswered: Unanswered | UnsetType = UNSET
    deg_per_rad: float = 0.0          # elevation by the hood motor's angle where the hood is; 0: not worked out

    def remember(self, flywheel_torque_nm: float, hood_torque_nm: float) -> MotionMemory:
        """Return the memory for the next tick, with the torques decided in this one."""
        return MotionMemory(self.armed_t_ns, self.active_t_ns, self.is_idle, self.wheels, self.hood,
                            flywheel_torque_nm, hood_torque_nm)

    def reasons(self) -> list[Reason]:
        """Return why axes are released, for the verdict."""
        wheels, hood = self.wheels, self.hood
        if wheels.cause is None and hood.cause is None and not self.is_short and not self.is_idle:
            return []
        found = [(because.AXIS_LATCHED if joint.is_latched else because.AXIS_RELEASED)(joint=name, cause=joint.cause)
                 for name, joint in ((WHEELS, wheels), (HOOD, hood)) if joint.cause is not None]
        if self.is_short and hood.dropped_deg is not None:
            found.append(because.HOOD_PUSH_DROPPED(wanted_deg=hood.dropped_deg))
        return [*found, because.WHEELS_IDLE()] if self.is_idle else found


class Wanted(Struct, frozen=True):
    """Set points of this tick: the motor speed of the wheels, 0 for none; the hood's, None while something else moves
    it.

    `hood_top_rad_s`: highest speed of the hood motor; None for that of `[hood] max_deg_s`.
    """

    wheels_rad_s: float
    hood_deg: float | None
    hood_top_rad_s: float | None = None


def watch(inputs: Inputs, estimate: Estimate, wanted: Wanted, memory: Memory, config: Config,
          doubts: Doubts) -> Watch:
    """Update the interlocks with this tick's readings; `doubts` are the doubts about them."""
    if not memory.armed:
        return Watch(FREE, FREE, doubts)
    t_ns = inputs.t_ns
    last = memory.motion
    if last is UNSET:                 # wheels may still turn from before
        turning_rad_s = min(motor.velocity_rad_s for motor in inputs.flywheels)
        last = MotionMemory(t_ns, t_ns, wheels=Joint(push_rad_s=turning_rad_s, push_t_ns=t_ns))
    axes, wheels, hood, cause, why = config.axes, last.wheels, last.hood, None, None
    deg_per_rad = (motors.elevation_per_rad(here_deg(estimate, config.hood), config.hood)
                   if last.hood_torque_nm else 0.0)
    # another controller's motors are not moved by our torques, nor released by us
    owns_wheels = family_of(axes.flywheels[0]).is_commanded      # all of them, or none
    owns_hood = family_of(axes.hood).is_commanded
    if owns_wheels:
        wheels, cause = _wheels(inputs, wanted.wheels_rad_s, wheels, last.flywheel_torque_nm, config)
    if owns_hood:
        top_rad_s = wanted.hood_top_rad_s or (config.hood.max_deg_s / deg_per_rad if deg_per_rad else math.inf)
        hood, why = _hood(inputs, estimate, wanted, top_rad_s, memory, hood, last.hood_torque_nm, config)
    of_wheels, of_hood, of_feeder = doubts
    everywhere, by_axis = _sorted_faults(inputs) if inputs.faults else (None, _NO_FAULTS)
    uncounted = t_ns - last.armed_t_ns < START_NS or (
        bool(inputs.faults) and any(fault.code in STALLS for fault in inputs.faults))
    wheels_ready, doubt = _doubt(of_wheels, _is_starting(wheels, t_ns)) if of_wheels else _NO_DOUBT
    if owns_wheels and (doubt or cause or wheels.cause or inputs.faults):
        passing, latching = by_axis[0]
        wheels = _follow(wheels, latching or cause, everywhere or doubt or passing, t_ns, uncounted)
    switch = None if memory.homed else _switch_doubt(inputs)
    hood_ready, doubt = _doubt(of_hood, _is_starting(hood, t_ns)) if of_hood else _NO_DOUBT
    if owns_hood and (doubt or why or hood.cause or switch or inputs.faults):
        passing, latching = by_axis[1]
        hood = _follow(hood, latching or why, everywhere or doubt or switch or passing, t_ns, uncounted)
    wheels = wheels if wheels.taken_t_ns or wheels.cause is not None else replace(wheels, taken_t_ns=t_ns)
    hood = hood if hood.taken_t_ns or hood.cause is not None else replace(hood, taken_t_ns=t_ns)
    unanswered, wheels, hood = (
        _add_up(inputs, estimate.hood_deg, wanted.wheels_rad_s, memory, last, wheels, hood, config)
        if memory.unanswered is not UNSET or wheels.stuck_t_ns or (
            last.hood_torque_nm and not (memory.homed and config.hood_encoder.is_heard)) else (UNSET, wheels, hood))
    # UNSET is false
    hood, failed = (_counted(hood, last, memory, t_ns, config) if hood.is_latched or memory.failures else (hood, 0))
    wheels, failed_wheels = (_counted_wheels(wheels, last.wheels, inputs, wanted.wheels_rad_s, memory)
                             if wheels.is_latched or memory.wheel_failures else (wheels, 0))
    feeder_ready = not of_feeder and by_axis[2] == (None, None)
    seen, idle_s = memory.last_sighting, config.flywheel.idle_s
    active_t_ns = last.active_t_ns
    if memory.request_t_ns:
        active_t_ns = t_ns
    elif seen is not None and active_t_ns < seen.t_ns <= t_ns:
        active_t_ns = seen.t_ns
    is_short = (hood.dropped_deg is not None and estimate.hood_deg is not None
                and not abs(estimate.hood_deg - hood.dropped_deg) <= config.hood.tolerance_deg)
    return Watch(wheels, hood, doubts, wheels_ready, hood_ready, feeder_ready, everywhere is None, last.armed_t_ns,
                 active_t_ns, idle_s > 0.0 and (t_ns - active_t_ns) * NS > idle_s, is_short,
                 (failed_wheels, failed), unanswered, deg_per_rad)


# --- faults and doubts

ByAxis = tuple[tuple[Reason | None, Reason | None], ...]         # of each, a fault that passes and one that latches
_NO_FAULTS: ByAxis = ((None, None),) * 3


def _sorted_faults(inputs: Inputs) -> tuple[Reason | None, ByAxis]:
    """(fault that stops all axes, faults of each axis)."""
    found: list[list[Reason | None]] = [[None, None] for _ in range(3)]
    everywhere = None
    for fault in inputs.faults:
        if fault.code in EVERYWHERE:
            everywhere = fault
        motor = str(fault.params.get("motor", ""))
        if motor and fault.code != codes.SPARK_NOT_DRIVING.name:      # with that one nothing is driven anyway
            axis = 0 if motor.startswith("flywheel") else 1 if motor.startswith("hood") else 2
            found[axis][fault.code in LATCHING] = fault
    return everywhere, tuple((one[0], one[1]) for one in found)


_NO_DOUBT: tuple[bool, Reason | None] = (True, None)
BEATS = frozenset((because.DEVICE_HEARTBEAT_STALE.name, because.DEVICE_FAULTS_STALE.name))


def _doubt(doubts: list[Reason], starting: bool) -> tuple[bool, Reason | None]:
    """(ready for torque, doubt that releases the axis).

    A device that is not under control yet must stay enabled to come under control, without torque; so must one whose
    old errors are being cleared after arming. A heartbeat that withholds the ball need not withhold the torque yet.
    """
    ready = True
    for reason in doubts:
        if reason.code in BEATS and 0.0 <= float(reason.params["age_s"]) <= BEAT_S:     # type: ignore[arg-type]
            continue
        ready = False
        if reason.code != because.MOTOR_NOT_DRIVEN.name and not (starting and reason.code == because.MOTOR_ERROR.name):
            return False, reason
    return ready, None


def _is_starting(joint: Joint, t_ns: int) -> bool:
    return not joint.taken_t_ns or t_ns - joint.taken_t_ns < START_NS


def _follow(joint: Joint, latching: Reason | None, passing: Reason | None, t_ns: int, uncounted: bool) -> Joint:
    """The joint released, latched or taken up again."""
    if joint.is_latched:
        return joint
    if latching is not None and latching.code == because.HOOD_JAMMED.name and joint.jams <= 1:
        latching, passing = None, latching        # one retry
    if latching is not None:
        return Joint(latching, True)
    if passing is not None:
        if joint.cause is not None:
            return joint if joint.cause == passing and not joint.good_t_ns else replace(joint, cause=passing,
                                                                                         good_t_ns=0)
        newest, oldest = joint.releases_t_ns
        recent = (newest, oldest) if uncounted else (t_ns, newest)
        if not uncounted and oldest and t_ns - oldest < REPEAT_NS:
            return Joint(because.RELEASED_REPEATEDLY(count=REPEATS, window_s=REPEAT_NS * NS, cause=passing), True)
        return replace(joint, cause=passing, good_t_ns=0, releases_t_ns=recent, push=0, stuck_t_ns=0, hard_t_ns=0,
                       hard_ns=0, pushed_t_ns=0, differ=0, homing_t_ns=0, began_t_ns=0, began_rad=0.0,
                       began_screw_rad=0.0)
    if joint.cause is None:
        return joint
    if not joint.good_t_ns:
        return replace(joint, good_t_ns=t_ns)
    return replace(joint, cause=None, good_t_ns=0) if t_ns - joint.good_t_ns >= RECOVER_NS else joint


def _add_up(inputs: Inputs, hood_deg: float | None, wanted_rad_s: float, memory: Memory, last: MotionMemory,
            wheels: Joint, hood: Joint, config: Config) -> tuple[Unanswered | UnsetType, Joint, Joint]:
    """The torque that no motion has answered yet, with that of the last tick; the joints, latched where it is much."""
    tick_s, most_nm, asked_nm = 1.0 / config.tick_hz, config.flywheel.pid.output_high, last.flywheel_torque_nm
    before = Unanswered() if memory.unanswered is UNSET else memory.unanswered
    wheels_s = before.wheels_s
    if wheels.stuck_t_ns or asked_nm >= FULL * most_nm:
        wheels_s += abs(asked_nm) / most_nm * tick_s
    has_risen = last.wheels.slow_t_ns and wheels.slow_t_ns == inputs.t_ns
    if wanted_rad_s > 0.0 and (has_risen or min([motor.velocity_rad_s for motor in inputs.flywheels])
                               >= SLOW * wanted_rad_s):
        wheels_s = 0.0
    hood_s, at_rad, is_blind = before.hood_s, before.hood_rad, not config.hood_encoder.is_heard
    if abs(last.hood_torque_nm) > config.hood.friction_nm and (is_blind or not memory.homed):
        near_deg_s = math.inf if hood_deg is None else HOMING_PER_S * (hood_deg - config.hood.low_deg + SWITCH_DEG)
        hood_s += tick_s * max(min(near_deg_s / config.hood.max_deg_s, 1.0), 0.0)     # slow near the switch
    angle_rad = None if inputs.hood_angle is None or is_blind else inputs.hood_angle.angle_rad
    at_rad = angle_rad if at_rad is None else at_rad
    if hood.moved_t_ns == inputs.t_ns if angle_rad is None or at_rad is None else abs(angle_rad - at_rad) > SEEN_RAD:
        hood_s, at_rad = 0.0, None
    if wheels_s >= WHEELS_S and not wheels.is_latched and (memory.wheel_failures or 0) < WHEEL_FAILURES:
        wheels = Joint(because.JOINT_NOT_TURNING(joint=WHEELS, torque_nm=asked_nm), True)
    if hood_s >= HOOD_S and not hood.is_latched and (memory.failures or 0) < FAILURES:
        hood = Joint(because.JOINT_NOT_TURNING(joint=HOOD, torque_nm=last.hood_torque_nm), True)
    return Unanswered(wheels_s, hood_s, at_rad) if wheels_s or hood_s else UNSET, wheels, hood


def _counted(hood: Joint, last: MotionMemory, memory: Memory, t_ns: int, config: Config) -> tuple[Joint, int]:
    """The hood and how many times in a row it was latched while it may have moved unseen: after FAILURES for good."""
    failures, is_blind, before = memory.failures, not config.hood_encoder.is_heard, last.hood
    if failures is UNSET:
        failures = 0
    if failures and (hood.moved_t_ns > 1 if is_blind else
                     memory.homed and hood.cause is None and t_ns - last.armed_t_ns > SETTLED_NS):
        failures = 0
    if hood.is_latched and not before.is_latched and hood.cause is not None:
        codes = _codes_of(hood.cause)
        failures += bool(codes & UNSEEN_MOTION and before.moved_t_ns <= 1 if is_blind else codes & UNKNOWN_MOTION)
    if failures >= FAILURES and not hood.is_latched:
        return Joint(because.HOOD_GIVEN_UP(count=failures), True), failures
    return hood, failures


def _counted_wheels(wheels: Joint, before: Joint, inputs: Inputs, wanted_rad_s: float,
                    memory: Memory) -> tuple[Joint, int]:
    """Count how many times in a row the wheels were latched while nothing showed them turning; after WHEEL_FAILURES
    they stay latched."""
    failures = 0 if memory.wheel_failures is UNSET else memory.wheel_failures
    if min([motor.velocity_rad_s for motor in inputs.flywheels]) >= SLOW * wanted_rad_s > 0.0:
        failures = 0
    elif wheels.is_latched and not before.is_latched and wheels.cause is not None:
        failures += bool(_codes_of(wheels.cause) & UNSEEN_MOTION)
    if failures >= WHEEL_FAILURES and not wheels.is_latched:
        return Joint(because.WHEELS_GIVEN_UP(count=failures), True), failures
    return wheels, failures


def _codes_of(cause: Reason) -> set[str]:
    """Return the codes of a reason and of what is behind it."""
    return {cause.code, getattr(cause.params.get("cause"), "code", "")}


# --- wheels

def _wheels(inputs: Inputs, wanted_rad_s: float, joint: Joint, asked_nm: float,
            config: Config) -> tuple[Joint, Reason | None]:
    """The wheels' memory and what is wrong with their motion."""
    t_ns = inputs.t_ns
    joint = _with_peak(joint, wanted_rad_s, t_ns)
    if joint.cause is not None:
        return joint, None
    fastest = slowest = inputs.flywheels[0].velocity_rad_s
    for motor in inputs.flywheels:
        speed = motor.velocity_rad_s
        if speed > fastest:
            fastest = speed
        elif speed < slowest:
            slowest = speed
    if asked_nm < 0.0:                # turned the other way, or braked: all signs change
        fastest, slowest = -slowest, -fastest
    joint = _with_push(joint, asked_nm, slowest if asked_nm >= 0.0 else -slowest,
                       inputs.flywheels[0].t_ns, t_ns)
    peak, free = joint.peak_rad_s, config.rig.launcher.free_speed_rad_s or math.inf
    if fastest > FREE_SPEED * free or -slowest > FREE_SPEED * free:
        return joint, because.JOINT_OVERSPEED(joint=WHEELS, speed_rad_s=fastest, factor=FREE_SPEED, top_rad_s=free)
    if fastest > OVERSPEED * peak and fastest > min(BACKWARDS * free, SLOW_RAD_S) and (
            asked_nm != 0.0 or _is_driven(inputs, config)
            or slowest > joint.push_rad_s + BACKWARDS * peak):
        return joint, because.JOINT_OVERSPEED(joint=WHEELS, speed_rad_s=fastest, factor=OVERSPEED, top_rad_s=peak)
    if joint.push and slowest < -BACKWARDS * peak and slowest < joint.push * joint.push_rad_s - BACKWARDS * peak:
        return joint, because.JOINT_BACKWARDS(joint=WHEELS)
    if asked_nm < 0.0 and slowest < 0.0:
        return joint, None            # braked
    return _turning(joint, slowest, wanted_rad_s, abs(asked_nm), t_ns, config)


def _with_peak(joint: Joint, wanted_rad_s: float, t_ns: int) -> Joint:
    """Keep the highest set point of the last seconds, and the highest since it was one."""
    if wanted_rad_s >= joint.peak_rad_s:
        known = wanted_rad_s == joint.peak_rad_s and t_ns - joint.peak_t_ns < PEAK_STEP_NS
        return joint if known else replace(joint, peak_rad_s=wanted_rad_s, peak_t_ns=t_ns, next_rad_s=0.0)
    if t_ns - joint.peak_t_ns > PEAK_NS:
        still = joint.next_rad_s if t_ns - joint.next_t_ns <= PEAK_NS else 0.0
        return replace(joint, peak_rad_s=max(still, wanted_rad_s), peak_t_ns=joint.next_t_ns if still > wanted_rad_s
                       else t_ns, next_rad_s=wanted_rad_s, next_t_ns=t_ns)
    if wanted_rad_s >= joint.next_rad_s and (wanted_rad_s > joint.next_rad_s
                                             or t_ns - joint.next_t_ns >= PEAK_STEP_NS):
        return replace(joint, next_rad_s=wanted_rad_s, next_t_ns=t_ns)
    return joint


def _turning(joint: Joint, slowest: float, wanted_rad_s: float, asked_nm: float, t_ns: int,
             config: Config) -> tuple[Joint, Reason | None]:
    """Whether the slower of the wheels' motors answers to a torque that must turn it."""
    friction_nm, most_nm = config.flywheel.ks_nm, config.flywheel.pid.output_high
    full = asked_nm >= FULL * most_nm
    is_hard, longest_ns = full or asked_nm > HARD * friction_nm > 0.0, FULL_NS if full else PUSH_NS
    if not is_hard and slowest < SLOW * wanted_rad_s and asked_nm > max(SOFT * friction_nm, 0.0):
        is_hard, longest_ns = True, round(PUSH_NS * max(1.0, SOFT_SHARE * most_nm / asked_nm))
    if is_hard or joint.slow_t_ns:
        joint, noisy = _level(joint, slowest, wanted_rad_s, is_hard, longest_ns, t_ns, config)
        if noisy:
            return joint, because.JOINT_NOT_TURNING(joint=WHEELS, torque_nm=asked_nm)
    if not is_hard or slowest >= SLOW * wanted_rad_s:
        return (replace(joint, stuck_t_ns=0, hard_t_ns=0) if joint.stuck_t_ns else joint), None
    if not joint.stuck_t_ns or slowest > joint.stuck_at + RISING * wanted_rad_s:
        return replace(joint, stuck_t_ns=t_ns, hard_t_ns=t_ns if full else 0, stuck_at=slowest), None
    if full != bool(joint.hard_t_ns):
        joint = replace(joint, hard_t_ns=t_ns if full else 0)
    if (full and t_ns - joint.hard_t_ns >= FULL_NS) or t_ns - joint.stuck_t_ns >= max(longest_ns, PUSH_NS):
        return joint, because.JOINT_NOT_TURNING(joint=WHEELS, torque_nm=asked_nm)
    return joint, None


def _level(joint: Joint, slowest: float, wanted_rad_s: float, is_hard: bool, longest_ns: int, t_ns: int,
           config: Config) -> tuple[Joint, bool]:
    """The averages of a speed under a torque that must turn it, and whether they have not risen for `longest_ns`.

    A peak of an encoder's noise is no rise: its average has to rise by its own mean deviation from the readings, too.
    """
    if not is_hard:
        if joint.slow_t_ns:
            joint = replace(joint, slow_t_ns=0, slow_rad_s=0.0, level_rad_s=0.0, noise_rad_s=0.0)
        return joint, False
    part = 1.0 / (1.0 + LEVEL_S * config.tick_hz)
    level = joint.level_rad_s + part * (slowest - joint.level_rad_s)
    noise = joint.noise_rad_s + part * (abs(slowest - level) - joint.noise_rad_s)
    since_ns, was = joint.slow_t_ns, joint.slow_rad_s
    if not since_ns or level >= SLOW * wanted_rad_s or level > was + RISING * wanted_rad_s + noise:
        since_ns, was = t_ns, level
    joint = replace(joint, slow_t_ns=since_ns, slow_rad_s=was, level_rad_s=level, noise_rad_s=noise)
    return joint, t_ns - since_ns >= longest_ns


def _is_driven(inputs: Inputs, config: Config) -> bool:
    """Whether a flywheel motor reports that it drives, whatever it was asked."""
    return any(motor.current_a > DRIVING_A and is_fresh(inputs, motor.current_t_ns, config)
               and family_of(axis).signs_current
               for axis, motor in zip(config.axes.flywheels, inputs.flywheels, strict=True))


# --- hood

def _hood(inputs: Inputs, estimate: Estimate, wanted: Wanted, limit_rad_s: float, memory: Memory,
          joint: Joint, asked_nm: float, config: Config) -> tuple[Joint, Reason | None]:
    """The hood's memory and what is wrong with its motion; `limit_rad_s`: of its motor's speed, while it is driven."""
    joint, differing = _compared(inputs, estimate, memory, joint, asked_nm, config)
    if joint.cause is not None:
        return joint, None
    motor, speed = inputs.hood_motor, inputs.hood_motor.velocity_rad_s
    before, joint = joint.push, _with_push(joint, asked_nm, speed, motor.t_ns, inputs.t_ns)
    if before * joint.push < 0:
        joint = replace(joint, **NOT_STUCK)
    if joint.differ >= DIFFERENT:
        return joint, differing
    if joint.push:
        along_rad_s, back_rad_s = joint.push * speed, HOOD_BACKWARDS * limit_rad_s
        if along_rad_s > motors.HOOD_OVERSPEED * limit_rad_s:
            return joint, because.JOINT_OVERSPEED(joint=HOOD, speed_rad_s=speed, factor=motors.HOOD_OVERSPEED,
                                                  top_rad_s=limit_rad_s)
        if along_rad_s < -back_rad_s and along_rad_s < joint.push * joint.push_rad_s - back_rad_s:
            return joint, because.JOINT_BACKWARDS(joint=HOOD)
    screw_deg = estimate.hood_screw_deg
    if motor.endstop and screw_deg is not None and screw_deg > config.hood.low_deg + SWITCH_OPEN_DEG and is_fresh(
            inputs, motor.endstop_t_ns, config):
        return joint, because.SWITCH_STUCK(angle_deg=screw_deg)
    joint, cause = _moving(inputs, wanted.hood_deg, memory, joint, asked_nm, config)
    if cause is not None or (memory.homed and not joint.homing_t_ns):
        return joint, cause
    return _homing(inputs, estimate.hood_deg, wanted.hood_top_rad_s, memory, joint, asked_nm, config)


def _compared(inputs: Inputs, estimate: Estimate, memory: Memory, joint: Joint, asked_nm: float,
              config: Config) -> tuple[Joint, Reason | None]:
    """Count encoder readings in a row that disagree with the screw at their own time; keep the encoder's rate.

    Until the switch says where the screw is, their changes since the last reading before the hood was driven are
    compared.
    """
    angle, motor, encoder_deg = inputs.hood_angle, inputs.hood_motor, estimate.hood_deg
    if angle is None or not config.hood_encoder.is_heard or angle.t_ns == joint.angle_t_ns:
        return joint, None
    rate = _rate_deg_s(angle.t_ns, encoder_deg, joint, config)
    differ, reads_deg = 0, encoder_deg or 0.0
    screw_deg: float | None = reads_deg
    if is_fresh(inputs, angle.t_ns, config) and is_fresh(inputs, motor.t_ns, config):
        then_rad = motor.position_rad - motor.velocity_rad_s * (motor.t_ns - angle.t_ns) * NS
        if memory.homed:
            screw_deg = motors.elevation_from_screw_deg(then_rad - memory.screw_zero_rad, config.hood)
        else:
            if (asked_nm == 0.0 and joint.began_t_ns <= 0) or not joint.began_t_ns:
                joint = replace(joint, began_t_ns=-angle.t_ns, began_rad=angle.angle_rad, began_screw_rad=then_rad)
            if asked_nm != 0.0 or joint.began_t_ns > 0:
                joint = replace(joint, began_t_ns=abs(joint.began_t_ns))
                reads_deg, screw_deg = _since_began(angle.angle_rad, then_rad, encoder_deg, joint, config)
        if screw_deg is None or not abs(reads_deg - screw_deg) <= config.hood.crosscheck_deg:
            differ = joint.differ + 1
    if memory.homed and joint.began_t_ns:
        joint = replace(joint, began_t_ns=0, began_rad=0.0, began_screw_rad=0.0)
    joint = replace(joint, differ=differ, angle_t_ns=angle.t_ns, angle_deg=encoder_deg or 0.0, angle_deg_s=rate)
    if differ < DIFFERENT:
        return joint, None
    if screw_deg is None:
        return joint, because.HOOD_UNKNOWN()
    return joint, because.HOOD_ENCODERS_DISAGREE(encoder_deg=reads_deg, screw_deg=screw_deg)


def _rate_deg_s(t_ns: int, encoder_deg: float | None, joint: Joint, config: Config) -> float:
    """The encoder's rate since its reading before; 0 while its zero is not known, or has just become known."""
    gap_ns = t_ns - joint.angle_t_ns
    if encoder_deg is None or (joint.began_t_ns > 0 and config.hood_encoder.zero_deg is None):
        return 0.0
    if gap_ns < RATE_NS:
        return joint.angle_deg_s
    return (encoder_deg - joint.angle_deg) / (gap_ns * NS) if joint.angle_t_ns else 0.0


def _since_began(angle_rad: float, motor_rad: float, encoder_deg: float | None, joint: Joint,
                 config: Config) -> tuple[float, float | None]:
    """Where encoder and screw say that the hood is since they are compared; changes where its zero is not known."""
    changed_deg = motors.elevation_from_encoder_deg(angle_rad, config.hood_encoder, math.degrees(joint.began_rad))
    began_deg = None if encoder_deg is None else encoder_deg - changed_deg
    reads_deg = (began_deg or 0.0) + changed_deg
    return reads_deg, _nearest_deg(reads_deg, began_deg, motor_rad - joint.began_screw_rad, config.hood)


def _nearest_deg(reads_deg: float, began_deg: float | None, turned_rad: float, hood: Hood) -> float | None:
    """Where the hood is by its screw, from where it began; from an unknown place (None), by how much it has moved,
    the nearest to `reads_deg` that is possible. None beyond the linkage."""
    places = ([hood.low_deg + (hood.high_deg - hood.low_deg) * part / 6.0 for part in range(7)] if began_deg is None
              else [min(max(began_deg, hood.low_deg), hood.high_deg)])
    moved = []
    for place_deg in places:
        at_deg = motors.elevation_from_screw_deg(motors.screw_rad(place_deg, hood) + turned_rad, hood)
        if at_deg is not None:
            moved.append((began_deg or 0.0) + at_deg - place_deg)
    return min(max(reads_deg, min(moved)), max(moved)) if moved else None


def _moving(inputs: Inputs, wanted_deg: float | None, memory: Memory, joint: Joint, asked_nm: float,
            config: Config) -> tuple[Joint, Reason | None]:
    """Whether the hood moves under a torque that its stated friction cannot hold."""
    t_ns, at_rad, friction_nm = inputs.t_ns, inputs.hood_motor.position_rad, config.hood.friction_nm
    is_blind = not config.hood_encoder.is_heard
    if is_blind and (not joint.moved_t_ns or abs(at_rad - joint.moved_rad) > MOVED_RAD):
        joint = replace(joint, moved_t_ns=t_ns if joint.moved_t_ns else 1, moved_rad=at_rad)
    if joint.dropped_deg is not None and not (
            wanted_deg is not None and abs(wanted_deg - joint.dropped_deg) <= config.hood.tolerance_deg):
        joint = replace(joint, dropped_deg=None)
    if abs(asked_nm) <= (friction_nm if wanted_deg is not None or not memory.homed else UNKNOWN * friction_nm):
        ended = joint.stuck_t_ns and t_ns - joint.pushed_t_ns > LULL_NS
        return (replace(joint, **NOT_STUCK) if ended else joint), None
    hard = abs(asked_nm) > HARD * friction_nm
    moved = abs(at_rad - joint.stuck_at) > MOVED_RAD
    if not joint.stuck_t_ns or moved:
        jams = 0 if joint.stuck_t_ns and moved else joint.jams
        return replace(joint, stuck_t_ns=t_ns, hard_ns=0, pushed_t_ns=t_ns, stuck_at=at_rad, jams=jams), None
    if hard or t_ns - joint.pushed_t_ns >= PUSHED_NS:
        tick_ns = round(NS_PER_S / config.tick_hz)
        joint = replace(joint, pushed_t_ns=t_ns, hard_ns=joint.hard_ns + tick_ns * hard)
    if hard and joint.hard_ns >= HARD_NS:
        return replace(joint, jams=joint.jams + 1), because.HOOD_JAMMED(torque_nm=asked_nm)
    is_full = is_blind and (not memory.homed or abs(asked_nm) > 0.99 * BLIND * friction_nm)
    if t_ns - joint.stuck_t_ns < (BLIND_NS if is_full else PUSH_NS):
        return joint, None
    if not memory.homed:
        return joint, because.SWITCH_NOT_REACHED(limit_s=(t_ns - (joint.homing_t_ns or t_ns)) * NS)
    if wanted_deg is None or is_full or (is_blind and joint.jams):
        return joint, because.JOINT_NOT_TURNING(joint=HOOD, torque_nm=asked_nm)
    return replace(joint, dropped_deg=wanted_deg, jams=joint.jams + is_blind, **NOT_STUCK), None


def _homing(inputs: Inputs, hood_deg: float | None, top_rad_s: float | None, memory: Memory, joint: Joint,
            asked_nm: float, config: Config) -> tuple[Joint, Reason | None]:
    """Whether homing takes longer, or goes further, than from one end of the travel to the other."""
    t_ns, at_rad, hood = inputs.t_ns, inputs.hood_motor.position_rad, config.hood
    beyond = (hood_deg is not None and hood_deg <= hood.low_deg - SWITCH_DEG and joint.push == 0
              and t_ns - joint.push_t_ns > SWITCH_NS)                # undriven, the switch has had time to answer
    if memory.homed:
        return (replace(joint, homing_t_ns=0, **NOT_STUCK) if joint.homing_t_ns else joint), None
    if not joint.homing_t_ns:         # from the first torque on, whether or not every tick asks for some
        return (replace(joint, homing_t_ns=t_ns, homing_rad=at_rad) if asked_nm else joint), None
    took_s = (t_ns - joint.homing_t_ns) * NS
    travel_rad, limit_s = motors.screw_travel_rad(hood), HOMING_TIMES * (hood.high_deg - hood.low_deg) / hood.max_deg_s
    limit_s = max(limit_s, HOMING_TIMES * travel_rad / top_rad_s) if top_rad_s else limit_s
    if beyond or took_s > limit_s or abs(at_rad - joint.homing_rad) > HOMING_TRAVEL * travel_rad:
        return joint, because.SWITCH_NOT_REACHED(limit_s=took_s)
    return joint, None


def _switch_doubt(inputs: Inputs) -> Reason | None:
    """Why nothing may be driven toward the limit switch: it does not answer."""
    stamp_ns = inputs.hood_motor.endstop_t_ns
    if not stamp_ns:
        return because.DEVICE_NEVER_RECEIVED(device=SWITCH)
    age_ns = inputs.t_ns - stamp_ns
    return None if 0 <= age_ns <= SWITCH_NS else because.DEVICE_STALE(device=SWITCH, age_s=age_ns * NS)


def here_deg(estimate: Estimate, hood: Hood) -> float:
    """Return the hood's elevation within its travel; if it is unknown, the lower end."""
    known = estimate.hood_deg if estimate.hood_deg is not None else estimate.hood_screw_deg
    return hood.low_deg if known is None else motors.within_travel(known, hood)


# --- both

def _with_push(joint: Joint, asked_nm: float, speed_rad_s: float, told_t_ns: int, t_ns: int) -> Joint:
    """Note the speed at which the torque took its sign: from there it must not move further against the torque.

    Until the torque can show in the readings, what they say is still that speed; afterwards what it has gained counts.
    Without torque it only slows down.
    """
    push = (asked_nm > 0.0) - (asked_nm < 0.0)
    if push != joint.push:
        return replace(joint, push=push, push_rad_s=speed_rad_s, push_t_ns=t_ns)
    if not push:
        late = told_t_ns < joint.push_t_ns + LAG_NS and speed_rad_s > joint.push_rad_s
        return replace(joint, push_rad_s=speed_rad_s) if late else joint
    gained = push * (speed_rad_s - joint.push_rad_s)
    if (gained < 0.0 and told_t_ns < joint.push_t_ns + LAG_NS) or gained > 0.0 > push * joint.push_rad_s:
        return replace(joint, push_rad_s=speed_rad_s)
    return joint
