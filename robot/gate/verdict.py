"""FIRE or HOLD. Every interlock is asked every tick; a reason that cannot be ruled out is a HOLD.

FIRE means: the driver asked, everything that can be checked is known and good, and (policy "model") the model agrees.
"""

import math

from msgspec import UNSET, UnsetType

from truearc.hw.readings import AngleReading, MotorReading
from truearc.robot.config.schema import Axis, Config, GateConfig
from truearc.robot.gate.contract import FEATURES, NOVELTY_LIMIT
from truearc.robot.gate.model import Gate, Rating
from truearc.robot.motors import error_words, is_driven, name_axes
from truearc.robot.types import Aim, Estimate, Inputs, Memory, Verdict

NS = 1e-9
HEARTBEAT_S = 0.25                    # axes, and the hood's encoder, say how they are every 0.1 s; two may be lost
ERRORS_S = 1.0                        # a SPARK says its errors every 0.25 s; three may be lost
FARTHEST_M = FEATURES[0].high         # no launcher is further from its target


def judge(inputs: Inputs, estimate: Estimate, aim: Aim, memory: Memory, config: Config, gate: Gate | None) -> Verdict:
    """The verdict of one tick; `reasons` is empty exactly when `fire` is true."""
    reasons = [*_operator(memory), *inputs.faults, *doubted_readings(inputs, config),
               *([] if memory.homed else ["hood not homed"]), *_launcher(inputs, estimate, aim, memory, config),
               *_target(inputs, estimate, config)]
    p_two, p_three, doubts = _model(estimate, config.gate, gate)
    reasons += doubts
    return Verdict(not reasons, tuple(reasons), p_two, p_three)


def only_the_model_doubts(verdict: Verdict, doubt_prefix: str = "model: ") -> bool:
    """Whether the model is all that stands in the way of firing."""
    return bool(verdict.reasons) and all(reason.startswith(doubt_prefix) for reason in verdict.reasons)


def _operator(memory: Memory) -> list[str]:
    reasons = []
    if not memory.armed:
        reasons.append("not armed" if memory.disarmed is UNSET else f"not armed: the button box {memory.disarmed}")
    if memory.awaiting:
        reasons.append("mark the last shot first")
    elif memory.feed_t_ns:
        reasons.append("the last ball is still clearing")
    elif not memory.request_t_ns:
        reasons.append("waiting for the fire button")
    return reasons


def doubted_readings(inputs: Inputs, config: Config) -> list[str]:
    """What is missing, stale or reports an error among the motors and the hood's encoder, in words."""
    reasons: list[str] = []
    motors = (*inputs.flywheels, inputs.hood_motor, inputs.feeder)
    for (name, axis), motor in zip(name_axes(config), motors, strict=True):
        reasons += _motor(name, axis, motor, inputs.t_ns, config.gate)
    return reasons + _encoder(inputs.hood_angle, inputs.t_ns, config.gate)


def _encoder(angle: AngleReading | None, t_ns: int, gate: GateConfig) -> list[str]:
    if angle is None:
        return ["hood encoder has never answered"]
    if not _young(t_ns - angle.t_ns, gate.reading_age_s):
        return [f"hood encoder silent for {(t_ns - angle.t_ns) * NS:.2f} s"]
    if silence := _silence(angle.faults_t_ns, t_ns, HEARTBEAT_S):
        return [f"hood encoder has said nothing of its faults {silence}"]
    return [] if angle.magnet_ok else ["hood encoder cannot see its magnet"]


def _motor(name: str, axis: Axis, motor: MotorReading, t_ns: int, gate: GateConfig) -> list[str]:
    if motor.t_ns == 0 or motor.heartbeat_t_ns == 0:
        return [f"{name} has never answered"]
    if not _young(t_ns - motor.t_ns, gate.reading_age_s):
        return [f"{name} silent for {(t_ns - motor.t_ns) * NS:.2f} s"]
    if not _young(t_ns - motor.heartbeat_t_ns, HEARTBEAT_S):
        return [f"{name} sends no heartbeat since {(t_ns - motor.heartbeat_t_ns) * NS:.2f} s"]
    if silence := _silence(motor.errors_t_ns, t_ns, ERRORS_S):
        return [f"{name} has said nothing of its errors {silence}"]
    if not all(map(math.isfinite, (motor.position_rad, motor.velocity_rad_s, motor.current_a, motor.bus_v))):
        return [f"{name} reads what is no number"]
    if words := error_words(axis, motor):
        return [f"{name}: {', '.join(words)}"]
    if not is_driven(axis, motor):
        return [f"{name} is not under control (state {motor.axis_state})"]
    return []


def _launcher(inputs: Inputs, estimate: Estimate, aim: Aim, memory: Memory, config: Config) -> list[str]:
    wanted = aim.motor_ratio * (config.rig.launcher.free_speed_rad_s or 0.0)
    if wanted <= 0.0:
        return ["no aim"]
    reasons = [] if aim.source == "plan" else [aim.source]
    if not abs(estimate.motor_rad_s - wanted) <= config.flywheel.tolerance_rad_s:
        reasons.append(f"wheels at {estimate.motor_rad_s:.0f} rad/s, wanted {wanted:.0f}")
    if not estimate.motor_spread_rad_s <= config.flywheel.spread_rad_s:
        reasons.append(f"flywheel motors differ by {estimate.motor_spread_rad_s:.0f} rad/s: belt?")
    reasons += _hood(estimate, aim, config)
    if not reasons and not (memory.steady_t_ns and (inputs.t_ns - memory.steady_t_ns) * NS >= config.flywheel.steady_s):
        reasons.append("wheels and hood only just arrived")
    return reasons


def _hood(estimate: Estimate, aim: Aim, config: Config) -> list[str]:
    if estimate.hood_deg is None or estimate.hood_screw_deg is None:
        return ["hood angle unknown"]
    if not abs(estimate.hood_deg - estimate.hood_screw_deg) <= config.hood.crosscheck_deg:
        return [f"hood encoder says {estimate.hood_deg:.1f} deg, its screw {estimate.hood_screw_deg:.1f}"]
    if not abs(estimate.hood_deg - aim.hood_deg) <= config.hood.tolerance_deg:
        return [f"hood at {estimate.hood_deg:.1f} deg, wanted {aim.hood_deg:.1f}"]
    return []


def _target(inputs: Inputs, estimate: Estimate, config: Config) -> list[str]:
    why = f" ({inputs.unseen})" if inputs.unseen else ""
    if estimate.distance_m is None or estimate.distance_sigma_m is None or estimate.sighting_s is None:
        return ["target never seen" + why]
    if not 0.0 <= estimate.sighting_s <= config.gate.sighting_age_s:
        return [f"target last seen {estimate.sighting_s:.1f} s ago" + why]
    if not 0.0 <= estimate.distance_m <= FARTHEST_M or not 0.0 <= estimate.distance_sigma_m < math.inf:
        return [f"target seen {estimate.distance_m:.1f} m away, give or take {estimate.distance_sigma_m:.1f}"]
    return []


def _model(estimate: Estimate, config: GateConfig, gate: Gate | None) -> tuple[float | None, float | None, list[str]]:
    if gate is None:
        return None, None, [] if config.policy == "collect" else ["no gate model loaded"]
    if estimate.distance_m is None or estimate.hood_deg is None:
        return None, None, [] if config.policy == "collect" else ["nothing to rate"]
    try:
        rating = gate.rate(estimate.distance_m, estimate.motor_ratio, estimate.hood_deg)
    except Exception as error:        # whatever onnxruntime may raise, the answer is HOLD and the loop goes on
        return None, None, [f"model failed: {type(error).__name__}"]
    if config.policy == "collect":
        return rating.p_two, rating.p_three, []
    if not rating.in_domain:
        return rating.p_two, rating.p_three, [_outside(rating)]
    if rating.p_three is None or not math.isfinite(rating.p_three):
        return rating.p_two, None, ["model gives no number"]
    if not rating.p_three >= config.threshold:
        return rating.p_two, rating.p_three, [f"model: three points {rating.p_three:.0%} likely, "
                                              f"{config.threshold:.0%} needed"]
    return rating.p_two, rating.p_three, []


def _outside(rating: Rating) -> str:
    far = rating.novelty is not None and rating.novelty > NOVELTY_LIMIT
    return "model: outside what it was trained on" + (f" (novelty {rating.novelty:.2f})" if far else "")


def _silence(stamp_ns: int | UnsetType, t_ns: int, limit_s: float) -> str:
    """Since when a frame that must come has not come, in words; "" when it has, and where none must."""
    if stamp_ns is UNSET:
        return ""
    if stamp_ns == 0:
        return "yet"
    return "" if _young(t_ns - stamp_ns, limit_s) else f"for {(t_ns - stamp_ns) * NS:.2f} s"


def _young(age_ns: int, limit_s: float) -> bool:
    return 0 <= age_ns * NS <= limit_s
