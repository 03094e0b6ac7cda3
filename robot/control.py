"""Control, which turns Aim and Verdict into a Command: flywheel and hood loops, homing, and one ball per feed request.

An axis that truearc.robot.motion has released is not enabled. An axis that is not yet under control gets no torque.
"""

import math

from msgspec import UNSET
from msgspec.structs import replace

from truearc.hw.protocols import NS
from truearc.robot.aim import NOWHERE
from truearc.robot.config.schema import Config, PidGains
from truearc.robot.estimate import is_fresh
from truearc.robot.motion import BLIND, HOMING_PER_S, SHOWN_S, SWITCH_DEG, Watch, here_deg
from truearc.robot.motors import elevation_per_rad, within_travel
from truearc.robot.types import Aim, Command, Estimate, Inputs, Memory, Pid, Verdict

RELEASED, AT_REST = Command(), Pid()
NEAR_PER_S = 10.0                     # the hood's speed limit, per degree that is left to a soft limit
# Torque beyond friction that accelerates the hood: SPARE times the friction, but at least SPARE_SHARE of the torque
# limit, because the friction may be understated. A screw of 1.5e-5 kg m2, a quarter of the shipped one, then follows
# the speed limit within 35 ms, longer than its readings lag. After STUCK_S without motion it grows, to all in RISE_S.
SPARE, SPARE_SHARE, STUCK_S, RISE_S = 2.0, 0.1, 0.05, 0.1
LEAST_SHARE = 0.1                     # of that limit, on readings that are nearly too old
YOUNG_SHARE = 0.3                     # of the age limit: a speed by which the hood may be braked


def step_pid(gains: PidGains, memory: Pid, setpoint: float, measurement: float, feedforward: float,
             low: float, high: float, dt_s: float) -> tuple[float, Pid]:
    """Advance the loop by `dt_s`; return the output within [low, high] and the loop's next memory.

    The derivative acts on the measurement, so a stepped set point gives no kick. The integral term is kept in output
    units and stands still while the output is clamped in the direction of the error.
    """
    error = setpoint - measurement
    raw_rate = (measurement - memory.measurement) / dt_s if memory.primed else 0.0
    rate = memory.rate + (raw_rate - memory.rate) * dt_s / (gains.derivative_tau_s + dt_s)
    integral = memory.integral + gains.ki * error * dt_s
    most = gains.integral_limit
    integral = -most if integral < -most else most if integral > most else integral
    wanted = feedforward + gains.kp * error + integral - gains.kd * rate
    output = low if wanted < low else high if wanted > high else wanted
    if (wanted - output) * error > 0.0:
        integral = memory.integral
    return output, Pid(integral, measurement, rate, True)


def control(inputs: Inputs, estimate: Estimate, aim: Aim, verdict: Verdict, memory: Memory, config: Config,
            watched: Watch) -> tuple[Command, Memory]:
    """Return the torques for this tick. While disarmed, no axis is enabled."""
    if not memory.armed:
        return RELEASED, replace(memory, flywheel=AT_REST, hood=AT_REST, feed_t_ns=0, motion=UNSET)
    wheels_on = watched.wheels.cause is None and not watched.is_idle
    hood_on = watched.hood.cause is None
    flywheel, wheel_pid, hood, hood_pid = 0.0, AT_REST, 0.0, AT_REST
    if wheels_on and watched.wheels_ready:
        flywheel, wheel_pid = _flywheel(estimate, aim, memory, config)
    if hood_on and watched.hood_ready and watched.hood.dropped_deg is None:
        hood, hood_pid = _hood(inputs, estimate, aim, memory, config, watched)
    feed_t_ns = inputs.t_ns if verdict.fire else memory.feed_t_ns and _still_clearing(inputs, memory, config)
    feeding = bool(feed_t_ns) and (inputs.t_ns - feed_t_ns) * NS < config.feeder.feed_s
    if feeding and not (wheels_on and hood_on and watched.feeder_on and watched.feeder_ready
                        and watched.wheels_ready and watched.hood_ready):
        feeding, feed_t_ns = False, inputs.t_ns - round(config.feeder.feed_s / NS)      # ended, not to begin again
    command = Command(wheels_on, hood_on, watched.feeder_on, flywheel, hood,
                      config.feeder.torque_nm if feeding else 0.0)
    return command, replace(memory, flywheel=wheel_pid, hood=hood_pid, feed_t_ns=feed_t_ns,
                            motion=watched.remember(flywheel, hood), failures=watched.failures[1] or UNSET,
                            wheel_failures=watched.failures[0] or UNSET, unanswered=watched.unanswered,
                            steady_t_ns=_steady_since(inputs, estimate, aim, memory, config))


def _flywheel(estimate: Estimate, aim: Aim, memory: Memory, config: Config) -> tuple[float, Pid]:
    wheel = config.flywheel
    wanted = aim.motor_ratio * (config.rig.launcher.free_speed_rad_s or 0.0)
    if wanted <= 0.0:
        return 0.0, AT_REST
    low = wheel.pid.output_low if wheel.brake else 0.0
    expected_nm = wheel.ks_nm + wheel.kv_nm_s * wanted       # at a constant speed, before any feedback
    return step_pid(wheel.pid, memory.flywheel, wanted, estimate.motor_rad_s, expected_nm, low, wheel.pid.output_high,
                    1.0 / config.tick_hz)


def _hood(inputs: Inputs, estimate: Estimate, aim: Aim, memory: Memory, config: Config,
          watched: Watch) -> tuple[float, Pid]:
    hood = config.hood
    if not memory.homed:              # towards the switch, but not before what can tell how far was heard
        heard = (inputs.hood_angle is not None if config.hood_encoder.is_heard
                 else is_fresh(inputs, inputs.hood_motor.t_ns, config))
        # once the switch has said that it is closed, its next answer is waited for without torque
        return (home(inputs, estimate, watched, config) if heard and memory.switch is UNSET else 0.0), AT_REST
    if estimate.hood_deg is None or aim.source in NOWHERE:
        return 0.0, AT_REST
    wanted, at_deg, screw_deg = within_travel(aim.hood_deg, hood), estimate.hood_deg, estimate.hood_screw_deg
    error = wanted - at_deg
    push = math.copysign(hood.friction_nm, error) if abs(error) > hood.deadband_deg else 0.0
    torque, pid = step_pid(hood.pid, memory.hood, wanted, at_deg, push,
                           hood.pid.output_low, hood.pid.output_high, 1.0 / config.tick_hz)
    # The screw locks itself: inside the deadband, once slow, nothing needs to push.
    if push == 0.0 and abs(pid.rate) < 1.0:
        return 0.0, pid
    if screw_deg is not None and (screw_deg > at_deg if torque > 0.0 else screw_deg < at_deg):
        at_deg = screw_deg            # the nearer to the soft limit counts
    left_deg = hood.high_deg - at_deg if torque > 0.0 else at_deg - hood.low_deg
    return slow_down(torque, inputs, estimate, watched, config, left_deg), pid


def home(inputs: Inputs, estimate: Estimate, watched: Watch, config: Config) -> float:
    """Return the torque toward the limit switch, within the hood's speed limit; with an encoder, not far beyond the
    switch, and slower than to a soft limit: no loop of the angle slows the hood down beforehand."""
    left_deg = math.inf if estimate.hood_deg is None else estimate.hood_deg - config.hood.low_deg + SWITCH_DEG
    return slow_down(config.hood.homing_torque_nm, inputs, estimate, watched, config, left_deg, HOMING_PER_S)


def slow_down(torque_nm: float, inputs: Inputs, estimate: Estimate, watched: Watch, config: Config,
              left_deg: float, near_per_s: float = NEAR_PER_S) -> float:
    """Return a hood torque that respects `[hood] max_deg_s`, and less near a soft limit, beyond which it is 0, or on
    old readings.

    What the torque has beyond friction fades linearly to nothing at the limit, and brakes beyond it: the speed then
    settles like a first-order lag. The faster of screw and encoder counts; only a young speed of the screw is braked.
    There is little of it, so that the lag of the readings makes no light screw swing, and more while nothing moves.
    Where only the motor's own encoder shows motion, there is next to none until it does.

    Args:
        watched: What the interlocks know of the hood.
        left_deg: Elevation left to the soft limit in the direction of the torque.
        near_per_s: Speed limit per degree that is left.
    """
    if left_deg <= 0.0 or torque_nm == 0.0:
        return 0.0
    hood, joint, t_ns, old_s = config.hood, watched.hood, inputs.t_ns, config.gate.reading_age_s
    motor, angle = inputs.hood_motor, inputs.hood_angle
    speed_age_s = age_s = (t_ns - motor.t_ns) * NS
    if angle is not None and config.hood_encoder.is_heard and angle.t_ns < motor.t_ns:
        age_s = (t_ns - angle.t_ns) * NS
    sign = 1.0 if torque_nm > 0.0 else -1.0
    deg_per_rad = watched.deg_per_rad or elevation_per_rad(here_deg(estimate, hood), hood)
    # Comparisons: in CPython 3.11 min or max of two numbers is a call of 0.2 us
    screw_deg_s, encoder_deg_s = sign * motor.velocity_rad_s * deg_per_rad, sign * joint.angle_deg_s
    rate_deg_s = encoder_deg_s if encoder_deg_s > screw_deg_s else screw_deg_s
    limit_deg_s, near_deg_s, share = hood.max_deg_s, near_per_s * left_deg, 1.0 - age_s / old_s
    limit_deg_s = (near_deg_s if near_deg_s < limit_deg_s else limit_deg_s) * (
        LEAST_SHARE if share < LEAST_SHARE else share)
    size_nm, friction_nm = abs(torque_nm), hood.friction_nm
    if not config.hood_encoder.is_heard and (t_ns - joint.moved_t_ns) * NS > SHOWN_S:
        size_nm = min(size_nm, BLIND * friction_nm)
    most = hood.pid.output_high if torque_nm > 0.0 else -hood.pid.output_low
    spare_nm, least_nm = SPARE * friction_nm, SPARE_SHARE * most
    spare_nm = least_nm if least_nm > spare_nm else spare_nm
    if joint.stuck_t_ns and (still_s := (t_ns - joint.stuck_t_ns) * NS - STUCK_S) > 0.0:
        spare_nm += size_nm * still_s / RISE_S
    most_nm = friction_nm + spare_nm * (limit_deg_s - rate_deg_s) / hood.max_deg_s
    if most_nm < 0.0:
        braked_nm = friction_nm + spare_nm * (limit_deg_s - screw_deg_s) / hood.max_deg_s
        most_nm = max(min(braked_nm, 0.0), -size_nm) if speed_age_s < YOUNG_SHARE * old_s else 0.0
    return sign * (most_nm if most_nm < size_nm else size_nm)


def _still_clearing(inputs: Inputs, memory: Memory, config: Config) -> int:
    busy = (inputs.t_ns - memory.feed_t_ns) * NS < config.feeder.clear_s
    return memory.feed_t_ns if busy else 0


def _steady_since(inputs: Inputs, estimate: Estimate, aim: Aim, memory: Memory, config: Config) -> int:
    wanted = aim.motor_ratio * (config.rig.launcher.free_speed_rad_s or 0.0)
    steady = (wanted > 0.0 and estimate.hood_deg is not None
              and abs(estimate.motor_rad_s - wanted) <= config.flywheel.tolerance_rad_s
              and abs(estimate.hood_deg - aim.hood_deg) <= config.hood.tolerance_deg)
    return (memory.steady_t_ns or inputs.t_ns) if steady else 0
