"""The verdict of a tick, FIRE or HOLD. Every tick checks every interlock; a reason that cannot be ruled out means HOLD.

FIRE means that the driver requested a shot, every check passed and, with policy "model", the model agrees.
"""

import itertools
import math

from msgspec import UNSET

from truearc.hw.protocols import NS
from truearc.hw.reason import Reason
from truearc.robot import reasons as because
from truearc.robot.aim import BEYOND, NO_FILE, as_at_rest, is_moving, is_planned, speed_m_s
from truearc.robot.config.schema import Config, GateConfig
from truearc.robot.estimate import doubted_readings
from truearc.robot.gate import FEATURES, NOVELTY_LIMIT, Gate, Rating
from truearc.robot.motion import Watch
from truearc.robot.types import Aim, Estimate, Inputs, Memory, Verdict

FARTHEST_M = FEATURES[0].high         # no launcher is further from its target


def judge(inputs: Inputs, estimate: Estimate, aim: Aim, memory: Memory, config: Config, gate: Gate | None,
          watched: Watch | None = None) -> Verdict:
    """Return the verdict of one tick; `reasons` is empty exactly when `fire` is true.

    watched: the motion interlocks; None if nothing is driven.
    """
    doubts = doubted_readings(inputs, config) if watched is None else itertools.chain(*watched.doubts)
    reasons = [*_operator(memory), *inputs.faults, *([] if watched is None else watched.reasons()),
               *doubts,
               *([] if memory.homed else [because.HOOD_NOT_HOMED()]), *_launcher(inputs, estimate, aim, memory, config),
               *judge_target(inputs, estimate, config), *judge_motion(estimate, aim, config)]
    p_two, p_three, doubts = judge_model(as_at_rest(estimate, aim), config.gate, gate)
    reasons += doubts
    return Verdict(not reasons, tuple(reasons), p_two, p_three)


def only_the_model_doubts(verdict: Verdict) -> bool:
    """Return whether only the model prevents firing."""
    return bool(verdict.reasons) and all(reason.code in because.MODEL_DOUBTS for reason in verdict.reasons)


def _operator(memory: Memory) -> list[Reason]:
    reasons = []
    if not memory.armed:
        reasons.append(because.NOT_ARMED() if memory.disarmed is UNSET else
                       because.DISARMED_BY_BOX(cause=memory.disarmed))
    if memory.awaiting:
        reasons.append(because.SHOT_NOT_MARKED())
    elif memory.feed_t_ns:
        reasons.append(because.BALL_CLEARING())
    elif not memory.request_t_ns:
        reasons.append(because.FIRE_NOT_REQUESTED())
    return reasons


def _launcher(inputs: Inputs, estimate: Estimate, aim: Aim, memory: Memory, config: Config) -> list[Reason]:
    wanted = aim.motor_ratio * (config.rig.launcher.free_speed_rad_s or 0.0)
    if wanted <= 0.0:
        return [no_aim(estimate, aim)]
    reasons = [] if is_planned(aim) else [because.NO_AIM() if aim.stand_m is UNSET else
                                          because.NOT_AT_PLACE(place_m=aim.stand_m)]
    if not abs(estimate.motor_rad_s - wanted) <= config.flywheel.tolerance_rad_s:
        reasons.append(because.WHEELS_OFF_SPEED(speed_rad_s=estimate.motor_rad_s, wanted_rad_s=wanted))
    if not estimate.motor_spread_rad_s <= config.flywheel.spread_rad_s:
        reasons.append(because.FLYWHEELS_DIFFER(spread_rad_s=estimate.motor_spread_rad_s))
    reasons += _hood(estimate, aim, config)
    if not reasons and not (memory.steady_t_ns and (inputs.t_ns - memory.steady_t_ns) * NS >= config.flywheel.steady_s):
        reasons.append(because.NOT_SETTLED())
    return reasons


def no_aim(estimate: Estimate, aim: Aim) -> Reason:
    """Return why an aim has no set point."""
    if aim.source == NO_FILE.source:
        return because.AIM_FILE_MISSING()
    if aim.source == BEYOND.source and estimate.distance_m is not None:
        return because.NO_SET_POINT(distance_m=estimate.distance_m)
    return because.NO_AIM()


def _hood(estimate: Estimate, aim: Aim, config: Config) -> list[Reason]:
    if estimate.hood_deg is None or estimate.hood_screw_deg is None:
        return [because.HOOD_UNKNOWN()]
    if not abs(estimate.hood_deg - estimate.hood_screw_deg) <= config.hood.crosscheck_deg:
        return [because.HOOD_ENCODERS_DISAGREE(encoder_deg=estimate.hood_deg, screw_deg=estimate.hood_screw_deg)]
    if not abs(estimate.hood_deg - aim.hood_deg) <= config.hood.tolerance_deg:
        return [because.HOOD_OFF_ANGLE(angle_deg=estimate.hood_deg, wanted_deg=aim.hood_deg)]
    return []


def judge_target(inputs: Inputs, estimate: Estimate, config: Config) -> list[Reason]:
    """Return reasons from a distance that is unknown, old or impossible."""
    why = {} if inputs.unseen is None else {"cause": inputs.unseen}
    if estimate.distance_m is None or estimate.distance_sigma_m is None or estimate.sighting_s is None:
        return [because.TARGET_NEVER_SEEN(**why)]
    if not 0.0 <= estimate.sighting_s <= config.gate.sighting_age_s:
        return [because.TARGET_STALE(age_s=estimate.sighting_s, **why)]
    if not 0.0 <= estimate.distance_m <= FARTHEST_M or not 0.0 <= estimate.distance_sigma_m < math.inf:
        return [because.TARGET_IMPLAUSIBLE(distance_m=estimate.distance_m, sigma_m=estimate.distance_sigma_m)]
    return []


def judge_motion(estimate: Estimate, aim: Aim, config: Config) -> list[Reason]:
    """Return reasons from the robot's motion, if reported: unknown, too fast, no set point for it, no lead taken."""
    asked = config.driving
    if asked is None:
        return []
    if estimate.toward_m_s is UNSET or estimate.bearing_deg is UNSET:
        return [because.ROBOT_SPEED_UNKNOWN()]
    if not (speed := speed_m_s(estimate)) <= asked.most_m_s:
        return [because.ROBOT_TOO_FAST(speed_m_s=speed, limit_m_s=asked.most_m_s)]
    if not is_moving(estimate):
        return []
    if aim.virtual_m is UNSET or aim.lead_deg is UNSET:
        return [because.ROBOT_MOVES(speed_m_s=speed)]
    off_deg = estimate.bearing_deg - aim.lead_deg
    return [] if abs(off_deg) <= asked.pointing_deg else [because.NOT_LED(lead_deg=aim.lead_deg, off_deg=off_deg)]


def judge_model(estimate: Estimate, config: GateConfig,
                gate: Gate | None) -> tuple[float | None, float | None, list[Reason]]:
    """Return (p_two, p_three, reasons from the model); no reasons if the policy is to collect."""
    if gate is None:
        return None, None, [] if config.policy == "collect" else [because.MODEL_MISSING()]
    if estimate.distance_m is None or estimate.hood_deg is None:
        return None, None, [] if config.policy == "collect" else [because.MODEL_NO_INPUT()]
    try:
        rating = gate.rate(estimate.distance_m, estimate.motor_ratio, estimate.hood_deg)
    except Exception as error:        # anything that onnxruntime raises is a HOLD, and the loop goes on
        return None, None, [because.MODEL_FAILED(error=type(error).__name__)]
    if config.policy == "collect":
        return rating.p_two, rating.p_three, []
    doubts = doubt_rating(rating, config.threshold)
    return rating.p_two, None if because.MODEL_NOT_FINITE() in doubts else rating.p_three, doubts


def doubt_rating(rating: Rating, threshold: float) -> list[Reason]:
    """Return the model's reasons to HOLD, none if it agrees; `threshold`: minimum p_three."""
    if not rating.in_domain:
        is_new = rating.novelty is not None and rating.novelty > NOVELTY_LIMIT
        return [because.MODEL_OUTSIDE_DOMAIN(**({"novelty": rating.novelty} if is_new else {}))]
    if rating.p_three is None or not math.isfinite(rating.p_three):
        return [because.MODEL_NOT_FINITE()]
    if not rating.p_three >= threshold:
        return [because.MODEL_BELOW_THRESHOLD(p_three=rating.p_three, threshold=threshold)]
    return []
