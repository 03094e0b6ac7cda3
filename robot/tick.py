"""One tick: estimate -> aim -> interlocks -> verdict -> control.

A tick is pure (it uses no clock, no I/O and no randomness), so a replay is exact.
"""

from msgspec import UNSET
from msgspec.structs import replace

from truearc.hw.protocols import NS
from truearc.robot import aim as aiming
from truearc.robot.aim_file import NO_AIMS, Aims
from truearc.robot.config.schema import Config
from truearc.robot.control import control
from truearc.robot.estimate import doubt_axes, estimate, remember
from truearc.robot.gate import Gate
from truearc.robot.motion import Wanted, watch
from truearc.robot.types import Aim, Estimate, Inputs, Memory, Outcome, Shot, Tick, Verdict
from truearc.robot.verdict import judge, only_the_model_doubts


def step(inputs: Inputs, memory: Memory, config: Config, gate: Gate | None, aims: Aims = NO_AIMS) -> Tick:
    """Compute one whole tick; `memory` in the result is what the next tick starts from.

    aims: the aim files that `aim.policy = "belief"` may use.
    """
    memory, outcomes = aiming.operate(inputs, memory, config)
    memory = remember(inputs, memory, config)
    belief = estimate(inputs, memory, config)
    aim, memory = _hold_aim(belief, memory, config, aims)
    wanted = Wanted(aim.motor_ratio * (config.rig.launcher.free_speed_rad_s or 0.0), aim.hood_deg)
    watched = watch(inputs, belief, wanted, memory, config, doubt_axes(inputs, config))
    verdict = judge(inputs, belief, aim, memory, config, gate, watched)
    command, memory = control(inputs, belief, aim, verdict, memory, config, watched)
    if verdict.fire:
        shot = _shot(inputs, belief, verdict, memory, config)
        memory = replace(memory, last_shot=shot, awaiting=True, request_t_ns=0, doubt_t_ns=0)
        return Tick(inputs, belief, aim, verdict, command, memory, shot, outcomes)
    memory, held = _lapse(inputs, verdict, memory, config)
    return Tick(inputs, belief, aim, verdict, command, memory, None, outcomes + held)


def _hold_aim(belief: Estimate, memory: Memory, config: Config, aims: Aims) -> tuple[Aim, Memory]:
    # From the request on the set points stand still: what follows every noisy sighting never settles. Whether they are
    # for where the robot stands is asked in every tick.
    # On the move they follow: they belong to a velocity, too.
    stays = memory.aim is not None and not aiming.is_left(memory.aim, memory.aim_place_m, belief.distance_m)
    if memory.aim is not None and stays and not aiming.is_moving(belief):
        return aiming.from_here(memory.aim, memory.aim_place_m, belief.distance_m), memory
    aim = aiming.aim(belief, memory, config, aims)
    fresh = belief.sighting_s is not None and 0.0 <= belief.sighting_s <= config.gate.sighting_age_s
    held = memory.request_t_ns and aiming.is_planned(aim) and fresh
    if held or memory.aim is not None:
        memory = replace(memory, aim=aim if held else None,
                         aim_place_m=aiming.place_m(belief.distance_m, memory, config))
    return aim, memory


def _shot(inputs: Inputs, belief: Estimate, verdict: Verdict, memory: Memory, config: Config) -> Shot:
    assert belief.distance_m is not None and belief.distance_sigma_m is not None and belief.hood_deg is not None
    before = memory.last_shot
    return Shot(
        trial=memory.trial, t_ns=inputs.t_ns, config_id=aiming.config_id(memory.trial, config.collect),
        distance_m=belief.distance_m, distance_sigma_m=belief.distance_sigma_m, hood_deg=belief.hood_deg,
        motor_ratio=belief.motor_ratio, motor_rad_s=belief.motor_rad_s, battery_v=belief.battery_v,
        since_last_shot_s=None if before is None else (inputs.t_ns - before.t_ns) * NS,
        p_two=verdict.p_two, p_three=verdict.p_three,
        speed_m_s=aiming.speed_m_s(belief) if aiming.is_moving(belief) else UNSET)


def _lapse(inputs: Inputs, verdict: Verdict, memory: Memory, config: Config) -> tuple[Memory, tuple[Outcome, ...]]:
    """A request that is not granted in time is over; it is recorded with what stood in the way."""
    if not memory.request_t_ns:
        return memory, ()
    doubt = (memory.doubt_t_ns or inputs.t_ns) if only_the_model_doubts(verdict) else 0
    memory = replace(memory, doubt_t_ns=doubt)
    tired = (inputs.t_ns - memory.request_t_ns) * NS >= config.gate.request_s
    refused = bool(doubt) and (inputs.t_ns - doubt) * NS >= config.gate.doubt_s
    if not tired and not refused:
        return memory, ()
    held = Outcome(memory.trial, inputs.t_ns, "held", verdict.reasons)
    memory = replace(memory, request_t_ns=0, doubt_t_ns=0, aim=None, trial=memory.trial + 1)
    return memory, (held,)
