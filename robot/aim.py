"""The aim of a trial: set points from a deliberately spread plan, and the effect of the driver's buttons.

The plan is a low-discrepancy sequence, so a replay needs no random state. Speeds come from vacuum ballistics divided by
an efficiency. The driver's high and low marks correct the efficiency, as a crew does by hand when it walks shots in (a
Robbins-Monro walk on log speed: a level, and slopes in distance and elevation). If shots are prescribed, they replace
the plan.

With `aim.policy = "belief"` the set points come from the aim file, and the driver's marks correct only the level. The
buttons arm the robot, request a shot and mark its outcome.
"""

import math

from msgspec import UNSET, UnsetType
from msgspec.structs import replace

from truearc.robot.aim_file import NO_AIMS, Aims, needs_aim
from truearc.robot.config.rig_spec import Target
from truearc.robot.config.schema import Collect, Config, Prescribed
from truearc.robot.types import Aim, Estimate, Inputs, Memory, Outcome, Shot

R2 = (0.7548776662466927, 0.5698402909980532)   # additive recurrence that fills the unit square evenly
FEASIBLE_DEG = 12.0                   # launch at least this much above the line of sight to the target
STEEP = 0.5                           # a ball comes down to an opening that faces up at least this steeply: a tangent
WALK_CENTRE_M, WALK_CENTRE_DEG = 5.0, 45.0    # where the walk's slope terms vanish
WALK_SPAN_M, WALK_SPAN_DEG = 2.0, 8.0          # ... and their scale: about the spread of the trials
EXPLAINED = 0.25                      # a trim of this share of the spread explains a mark on its own side
PLACE_M = 0.3                         # a shot of the plan is fired from no further than this from its place
Walk = tuple[float, float, float]
REAIM_M = 0.1                         # an aim by an aim file is made again where the robot has moved by more than this
STILL_M_S = 0.05                      # a robot that is slower stands
PLAN, BELIEF = "plan", "belief"
IDLE = Aim(motor_ratio=0.0, hood_deg=0.0, source="idle")
NO_FILE = Aim(motor_ratio=0.0, hood_deg=0.0, source="no-aim-file")
BEYOND = Aim(motor_ratio=0.0, hood_deg=0.0, source="no-set-point")
NOWHERE = (IDLE.source, NO_FILE.source, BEYOND.source)


def config_id(trial: int, collect: Collect) -> str:
    """Return the name of the configuration that a trial uses; repeats share it."""
    return f"c{trial // collect.repeats:04d}"


def plan(trial: int, collect: Collect) -> tuple[float, float]:
    """Return the share of the feasible hood range (0-1) and the speed trim (a signed fraction) of one trial.

    Trims are denser near zero, so that misses, two-pointers and three-pointers come in similar numbers.
    """
    index = trial // collect.repeats
    hood_share = (0.5 + R2[0] * index) % 1.0
    u = 2.0 * ((0.5 + R2[1] * index) % 1.0) - 1.0
    return hood_share, collect.spread * u * abs(u)


def vacuum_speed_m_s(distance_m: float, rise_m: float, elevation_deg: float, gravity_m_s2: float) -> float | None:
    """Return the exit speed whose parabola passes through the target; None if the elevation points below it."""
    tangent = math.tan(math.radians(elevation_deg))
    drop_m = distance_m * tangent - rise_m
    if drop_m <= 0.0:
        return None
    return distance_m * math.sqrt(gravity_m_s2 * (1.0 + tangent * tangent) / (2.0 * drop_m))


def aim(estimate: Estimate, memory: Memory, config: Config, aims: Aims = NO_AIMS) -> Aim:
    """Return the set points for the current trial; IDLE while disarmed or before the target has ever been seen.

    With an aim file: NO_FILE if there is none, BEYOND if it has no set point for the distance.
    """
    target = config.rig.target
    if not memory.armed or estimate.distance_m is None or target is None:
        return IDLE
    if config.collect.prescribed:
        return _prescribed(estimate.distance_m, memory.trial, config.collect)
    if needs_aim(config):
        return _by_belief(estimate.distance_m, estimate, memory, config, aims)
    hood_deg, trim = _elevation(estimate.distance_m, target, memory.trial, config)
    rise_m = target.centre_height_m - config.rig.launcher.release_height_m
    speed = vacuum_speed_m_s(estimate.distance_m, rise_m, hood_deg, config.rig.world.gravity_m_s2)
    if speed is None:
        return IDLE
    correction = walked(add(config.collect.walk_start, memory.walk), estimate.distance_m, hood_deg)
    ratio = speed * (1.0 + trim) * math.exp(correction) / (config.collect.efficiency * surface_m_s(config))
    return Aim(motor_ratio=min(max(ratio, 0.0), 1.0), hood_deg=hood_deg, source=PLAN)


def _by_belief(distance_m: float, estimate: Estimate, memory: Memory, config: Config, aims: Aims) -> Aim:
    file = aims.get(memory.aim_sha256 or "")
    if file is None:
        return NO_FILE
    asked = config.driving
    toward, left = estimate.toward_m_s, estimate.leftward_m_s
    moving = None if asked is None or toward is UNSET or left is UNSET else file.moving(
        distance_m, toward, left, asked.delay_s)
    if moving is None and is_moving(estimate):
        return BEYOND
    point = file.at(distance_m) if moving is None else moving.point
    trim = 0.0 if moving is None else moving.trim
    correction = memory.walk[0]
    ratio = 0.0 if point is None else point.motor_ratio * math.exp(correction + trim)
    if point is None or not 0.0 < ratio <= 1.0:
        return BEYOND
    if moving is None:
        return Aim(ratio, point.hood_deg, BELIEF, correction=correction, lead_deg=point.lead_deg)
    return Aim(ratio, point.hood_deg, BELIEF, correction=correction, lead_deg=point.lead_deg + moving.lead_deg,
               virtual_m=moving.virtual_m, trim=trim)


def is_moving(estimate: Estimate) -> bool:
    """Return whether the robot is known to be moving."""
    return speed_m_s(estimate) > STILL_M_S


def speed_m_s(estimate: Estimate) -> float:
    """Return the speed of the robot; 0 if unknown."""
    toward, left = estimate.toward_m_s, estimate.leftward_m_s
    return 0.0 if toward is UNSET or left is UNSET else math.hypot(toward, left)


def as_at_rest(estimate: Estimate, aim: Aim) -> Estimate:
    """Return the same throw from a robot at rest, the only kind of shot that the gate can rate."""
    if aim.virtual_m is UNSET or aim.trim is UNSET:
        return estimate
    return replace(estimate, distance_m=aim.virtual_m, motor_ratio=estimate.motor_ratio * math.exp(-aim.trim))


def place_m(distance_m: float | None, memory: Memory, config: Config) -> float | None:
    """Return the distance that the current trial's aim, made at `distance_m`, is for.

    None if a model rates every shot: it rates the distance of the tick, wherever the aim was made.
    """
    row = _row(memory.trial, config.collect)
    if row is not None:
        return row.distance_m
    return distance_m if config.gate.policy == "collect" or needs_aim(config) else None


def is_left(held: Aim, place_m: float | UnsetType | None, distance_m: float | None) -> bool:
    """Return whether the robot has left the place that an aim from an aim file is for, so that it must aim again."""
    return (held.source == BELIEF and isinstance(place_m, float) and distance_m is not None
            and not abs(distance_m - place_m) <= REAIM_M)


def from_here(held: Aim, place_m: float | UnsetType | None, distance_m: float | None) -> Aim:
    """Return a held aim for a robot that may have moved since; away from its place the aim must not be fired."""
    if place_m is None or place_m is UNSET or distance_m is None or abs(distance_m - place_m) <= PLACE_M:
        return held
    return Aim(held.motor_ratio, held.hood_deg, held.source, place_m)


def is_planned(aim: Aim) -> bool:
    """Return whether an aim may be fired from where the robot is."""
    return aim.source in (PLAN, BELIEF) and aim.stand_m is UNSET


def _prescribed(distance_m: float, trial: int, collect: Collect) -> Aim:
    """The set points of the list, made ready from wherever the robot stands."""
    row = _row(trial, collect)
    if row is None:
        return IDLE
    return from_here(Aim(row.motor_ratio, row.hood_deg, PLAN), row.distance_m, distance_m)


def _row(trial: int, collect: Collect) -> Prescribed | None:
    index = trial // collect.repeats
    return collect.prescribed[index] if index < len(collect.prescribed) else None


def surface_m_s(config: Config) -> float:
    """Return the mean surface speed of the wheels at the motors' free speed (Eq. 11 of the paper)."""
    wheels, free, total = config.rig.launcher.wheel, config.rig.launcher.free_speed_rad_s or 0.0, 0.0
    for wheel in wheels:
        total += wheel.radius_m * wheel.gear * free
    return total / len(wheels)


def walked(walk: Walk, distance_m: float, hood_deg: float) -> float:
    """Return the log speed correction at a distance and launch elevation."""
    levers = _levers(distance_m, hood_deg)
    return walk[0] * levers[0] + walk[1] * levers[1] + walk[2] * levers[2]


def step_walk(walk: Walk, side: int, shot: Shot, config: Config) -> Walk:
    """Apply one driver's mark: side -1 = passed low (more speed), +1 = passed high (less), 0 = on target (nothing).

    A mark on the side to which the speed was deliberately trimmed carries no information about the aim, nor does a mark
    of a prescribed shot. With an aim file nothing is trimmed, and only the level is corrected.
    """
    collect = config.collect
    if collect.prescribed:
        return walk
    if needs_aim(config):
        return walk[0] - config.aim.correction_step * side, walk[1], walk[2]
    _, trim = plan(shot.trial, collect)
    if side == 0 or side * trim > EXPLAINED * collect.spread:
        return walk
    levers = _levers(shot.distance_m, shot.hood_deg)
    push = -collect.walk_step * side
    return add(walk, (push * levers[0], push * levers[1], push * levers[2]))


def add(one: Walk, other: Walk) -> Walk:
    """Return the sum of two walks."""
    return one[0] + other[0], one[1] + other[1], one[2] + other[2]


def _levers(distance_m: float, hood_deg: float) -> Walk:
    return 1.0, (distance_m - WALK_CENTRE_M) / WALK_SPAN_M, (hood_deg - WALK_CENTRE_DEG) / WALK_SPAN_DEG


def _elevation(distance_m: float, target: Target, trial: int, config: Config) -> tuple[float, float]:
    collect = config.collect
    hood_share, trim = plan(trial, collect)
    rise_m = target.centre_height_m - config.rig.launcher.release_height_m
    sight_deg = math.degrees(math.atan2(rise_m, max(distance_m, 0.1)))
    if target.faces_up:               # a parabola comes down as much less steeply than it rises as sight_deg is high
        sight_deg = math.degrees(math.atan(2.0 * math.tan(math.radians(sight_deg)) + STEEP))
    low = min(max(collect.hood_low_deg, sight_deg + FEASIBLE_DEG), config.hood.high_deg)
    high = max(low, collect.hood_high_deg)
    return low + (high - low) * hood_share, trim


# to which side of the target a missed shot goes, by which the correction walks; a shot that scored moves nothing
SIDES = {"miss-low": -1, "miss-high": 1, "two": 0, "two-low": 0, "two-high": 0, "three": 0, "miss-left": 0,
         "miss-right": 0}


def operate(inputs: Inputs, memory: Memory, config: Config) -> tuple[Memory, tuple[Outcome, ...]]:
    """Apply this tick's presses in order; each outcome button marks the newest unmarked shot.

    A lost press may have been an "arm" by which the driver believes to have disarmed and may reach into the launcher;
    if it was meant to arm, it only costs a second press. So lost presses disarm the robot, whatever else was pressed
    meanwhile.
    """
    outcomes: list[Outcome] = []
    for event in inputs.buttons:
        if event.button == "arm":
            memory = replace(_let_go(memory), armed=not memory.armed, disarmed=UNSET)
        elif event.button == "accept":
            memory = _accept(inputs, memory)
        elif event.button == "fire":
            if memory.armed and not memory.awaiting and not memory.feed_t_ns:
                memory = replace(memory, request_t_ns=inputs.t_ns)
        elif event.button == "reject" and memory.last_shot is not None:
            outcomes.append(Outcome(memory.last_shot.trial, inputs.t_ns, "rejected"))
            memory = replace(memory, awaiting=False, aim=None, trial=memory.last_shot.trial + 1)
        elif event.button in SIDES and memory.awaiting and memory.last_shot is not None:
            outcomes.append(Outcome(memory.last_shot.trial, inputs.t_ns, event.button))
            memory = _answer(memory, SIDES[event.button], config)
    if inputs.aim_offer is not UNSET and inputs.aim_accept == inputs.aim_offer.sha256:
        memory = _accept(inputs, memory)
    if inputs.missed is not None:
        memory = replace(_let_go(memory), disarmed=inputs.missed)
    return memory, tuple(outcomes)


def _let_go(memory: Memory) -> Memory:
    # Disarming forgets the request: a shot asked for before must not come when the launcher is armed again.
    return replace(memory, armed=False, request_t_ns=0, steady_t_ns=0, doubt_t_ns=0, aim=None, motion=UNSET)


def _accept(inputs: Inputs, memory: Memory) -> Memory:
    # The correction was one of the aim before: what it made up for is in the new one.
    if memory.armed or inputs.aim_offer is UNSET or memory.aim_sha256 == inputs.aim_offer.sha256:
        return memory
    return replace(memory, aim_sha256=inputs.aim_offer.sha256, walk=(0.0, 0.0, 0.0))


def _answer(memory: Memory, side: int, config: Config) -> Memory:
    assert memory.last_shot is not None
    walk = step_walk(memory.walk, side, memory.last_shot, config)
    return replace(memory, awaiting=False, walk=walk, aim=None, trial=memory.last_shot.trial + 1)
