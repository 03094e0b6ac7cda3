"""One tick of advice about a launcher that another program drives.

The tick is pure, like truearc.robot.tick, so a replay is exact. Its verdict comes from truearc.robot.verdict, without
the interlocks for motors that truearc does not drive. FIRE means that every key is fresh and plausible, the wheels are
steady, the aim file (if any) has a set point for this distance, and the model agrees with the present state of the
launcher, whether or not that state is the set point.
"""

from msgspec import UNSET
from msgspec.structs import replace

from truearc.hw.protocols import NS
from truearc.hw.reason import Reason
from truearc.robot import aim as aiming
from truearc.robot import reasons as because
from truearc.robot.aim_file import NO_AIMS, Aims
from truearc.robot.config.schema import Config
from truearc.robot.control import RELEASED
from truearc.robot.estimate import estimate, remember
from truearc.robot.gate import Gate
from truearc.robot.types import Aim, Estimate, Inputs, Memory, Shot, Tick, Verdict, Watched
from truearc.robot.verdict import judge_model, judge_motion, judge_target, no_aim

ADVICE = "advice"                     # what the session's header says
WHEELS, HOOD, DISTANCE, BATTERY = "wheel speed", "hood angle", "distance", "battery"
BATTERY_AGE = 10.0                    # times as long as others it may stand still: it is read in steps
CALM_S = 0.5                          # after a jump nothing is believed for so long
# Most that a launcher can change by: a step at once, and a rate on top of it
SPEED_STEP, SPEED_RATE_S = 0.12, 2.5  # of the free speed; a ball takes less
HOOD_STEP_DEG, HOOD_RATE_DEG_S = 5.0, 180.0
DISTANCE_STEP_M, DISTANCE_RATE_M_S = 0.5, 8.0
BATTERY_STEP_V, BATTERY_RATE_V_S = 4.0, 20.0


def advise_step(inputs: Inputs, memory: Memory, config: Config, gate: Gate | None, aims: Aims = NO_AIMS) -> Tick:
    """Judge one tick's keys; aims: the aim files that propose set points."""
    memory, outcomes = aiming.operate(inputs, memory, config)
    memory = remember(inputs, memory, config)
    belief = estimate(inputs, memory, config)
    watched = _watch(inputs, belief, memory, config)
    memory = replace(memory, watched=watched)
    # without an aim file there is nothing to propose: the set points are where the launcher is
    aim = (aiming.aim(belief, replace(memory, armed=True), config, aims) if aims
           else Aim(max(belief.motor_ratio, 0.0), belief.hood_deg or 0.0, ADVICE))
    p_two, p_three, doubts = judge_model(aiming.as_at_rest(belief, aim), config.gate, gate)
    nowhere = [no_aim(belief, aim)] if aim.source in aiming.NOWHERE else []
    reasons = (*inputs.faults, *_stale(inputs, config), *_jumped(inputs, watched), *_settled(inputs, watched, config),
               *nowhere, *judge_target(inputs, belief, config), *judge_motion(belief, aim, config), *doubts)
    verdict = Verdict(not reasons, reasons, p_two, p_three)
    shot = _shot(inputs, belief, verdict, memory) if any(event.button == "fire" for event in inputs.buttons) else None
    if shot is not None:
        memory = replace(memory, last_shot=shot, awaiting=True, trial=shot.trial)
    return Tick(inputs, belief, aim, verdict, RELEASED, memory, shot, outcomes)


def _stale(inputs: Inputs, config: Config) -> list[Reason]:
    """Reasons from keys that are missing, or have not changed for too long."""
    angle, motor, limit_s = inputs.hood_angle, inputs.flywheels[0], config.gate.reading_age_s
    reasons = []
    for device, t_ns, oldest_s in ((WHEELS, motor.t_ns, limit_s), (HOOD, angle.t_ns if angle else 0, limit_s),
                                   (BATTERY, motor.bus_t_ns, BATTERY_AGE * limit_s)):
        age_s = (inputs.t_ns - t_ns) * NS
        if t_ns == 0:                             # where a key was not believed, that fault says why
            reasons += [] if inputs.faults else [because.DEVICE_NEVER_RECEIVED(device=device)]
        elif not 0.0 <= age_s <= oldest_s:
            reasons.append(because.DEVICE_STALE(device=device, age_s=age_s))
    return reasons


def _watch(inputs: Inputs, belief: Estimate, memory: Memory, config: Config) -> Watched:
    """The newest values, when one last jumped or was impossible, and since when the wheels' speed has been the same."""
    last = Watched() if memory.watched is UNSET else memory.watched
    free = config.rig.launcher.free_speed_rad_s or 1.0
    seen = memory.last_sighting
    newest = {
        WHEELS: (inputs.flywheels[0].t_ns, belief.motor_rad_s, last.speed_t_ns, last.speed_rad_s,
                 SPEED_STEP * free, SPEED_RATE_S * free),
        HOOD: (inputs.hood_angle.t_ns if inputs.hood_angle else 0, belief.hood_deg or 0.0, last.hood_t_ns,
               last.hood_deg, HOOD_STEP_DEG, HOOD_RATE_DEG_S),
        DISTANCE: (seen.t_ns if seen else 0, seen.distance_m or 0.0 if seen else 0.0, last.distance_t_ns,
                   last.distance_m, DISTANCE_STEP_M, DISTANCE_RATE_M_S),
        BATTERY: (inputs.flywheels[0].bus_t_ns, belief.battery_v, last.battery_t_ns, last.battery_v, BATTERY_STEP_V,
                  BATTERY_RATE_V_S)}
    # a key that is not there keeps its value, so that one which is another afterwards has jumped
    now = {name: new if new[0] else (*new[2:4], *new[2:]) for name, new in newest.items()}
    jumped = [str(fault.params["key"]) for fault in inputs.faults if fault.code == because.NT_VALUE_IMPOSSIBLE.name]
    jumped += [name for name, (t_ns, value, was_ns, was, at_once, rate) in now.items()
              if was_ns and t_ns > was_ns and not abs(value - was) <= at_once + rate * (t_ns - was_ns) * NS]
    calm = abs(belief.motor_rad_s - last.steady_rad_s) <= config.flywheel.tolerance_rad_s and last.steady_t_ns
    return Watched(*now[WHEELS][:2], *now[HOOD][:2], *now[DISTANCE][:2], *now[BATTERY][:2],
                   inputs.t_ns if jumped else last.jumped_t_ns, jumped[0] if jumped else last.jumped,
                   last.steady_t_ns if calm else inputs.t_ns, last.steady_rad_s if calm else belief.motor_rad_s)


def _jumped(inputs: Inputs, watched: Watched) -> list[Reason]:
    if any(fault.params.get("key") == watched.jumped for fault in inputs.faults):
        return []                                 # an impossible value, and that is said
    ago_s = (inputs.t_ns - watched.jumped_t_ns) * NS
    return [because.KEY_JUMPED(key=watched.jumped, ago_s=ago_s)] if watched.jumped_t_ns and ago_s <= CALM_S else []


def _settled(inputs: Inputs, watched: Watched, config: Config) -> list[Reason]:
    steady_s = (inputs.t_ns - watched.steady_t_ns) * NS
    return [] if steady_s >= config.flywheel.steady_s else [because.NOT_SETTLED()]


def _shot(inputs: Inputs, belief: Estimate, verdict: Verdict, memory: Memory) -> Shot | None:
    """The ball that the robot has fed; None where nothing is known of it."""
    if belief.distance_m is None or belief.distance_sigma_m is None or belief.hood_deg is None:
        return None
    before = memory.last_shot
    trial = memory.trial + bool(memory.awaiting)          # that one was never marked
    return Shot(trial, inputs.t_ns, f"c{trial:04d}", belief.distance_m, belief.distance_sigma_m, belief.hood_deg,
                belief.motor_ratio, belief.motor_rad_s, belief.battery_v,
                None if before is None else (inputs.t_ns - before.t_ns) * NS, verdict.p_two, verdict.p_three,
                aiming.speed_m_s(belief) if aiming.is_moving(belief) else UNSET)
