"""Aim and Verdict to Command: the flywheel and hood loops, homing, and the feeder's one ball a request.

An axis that truearc.robot.motion has released is not enabled; one that is not under control yet gets no torque.
"""

import math

from msgspec import UNSET
from msgspec.structs import replace

from truearc.robot.aim import NOWHERE
from truearc.robot.config.schema import Config, PidGains
from truearc.robot.estimate import is_fresh
from truearc.robot.geometry import elevation_per_rad
from truearc.robot.motion import Watch, here_deg
from truearc.robot.types import Aim, Command, Estimate, Inputs, Memory, Motion, Pid, Verdict

NS = 1e-9
RELEASED = Command()
NEAR_PER_S = 10.0                     # the hood's speed limit, per degree that is left to a soft limit
LEAST_SHARE = 0.1                     # of that limit, on readings that are nearly too old
YOUNG_SHARE = 0.3                     # of the age limit: a speed by which the hood may be braked


def step_pid(gains: PidGains, memory: Pid, setpoint: float, measurement: float, feedforward: float,
             low: float, high: float, dt_s: float) -> tuple[float, Pid]:
    """One step of `dt_s`; returns the output within [low, high] and the loop's next memory.

    The derivative acts on the measurement, so a stepped set point gives no kick. The integral term is kept in output
    units and stands still while the output is clamped in the direction of the error.
    """
    error = setpoint - measurement
    raw_rate = (measurement - memory.measurement) / dt_s if memory.primed else 0.0
    rate = memory.rate + (raw_rate - memory.rate) * dt_s / (gains.derivative_tau_s + dt_s)
    integral = memory.integral + gains.ki * error * dt_s
    integral = min(max(integral, -gains.integral_limit), gains.integral_limit)
    wanted = feedforward + gains.kp * error + integral - gains.kd * rate
    output = min(max(wanted, low), high)
    if (wanted - output) * error > 0.0:
        integral = memory.integral
    return output, Pid(integral, measurement, rate, True)


def control(inputs: Inputs, estimate: Estimate, aim: Aim, verdict: Verdict, memory: Memory, config: Config,
            watched: Watch) -> tuple[Command, Memory]:
    """Torques for this tick. Disarmed, no axis is enabled."""
    if not memory.armed:
        return RELEASED, replace(memory, flywheel=Pid(), hood=Pid(), feed_t_ns=0, motion=UNSET)
    motion = watched.motion
    wheels_on, hood_on, feeder_on = (joint.cause is None for joint in (motion.wheels, motion.hood, motion.feeder))
    wheels_ready, hood_ready, feeder_ready = watched.is_ready
    flywheel, wheel_pid = 0.0, Pid()
    if wheels_on and wheels_ready and not motion.is_idle:
        flywheel, wheel_pid = _flywheel(estimate, aim, memory, config)
    hood, hood_pid = (_hood(inputs, estimate, aim, memory, config, motion.hood.angle_deg_s,
                            motion.hood.dropped_deg is not None) if hood_on and hood_ready else (0.0, Pid()))
    feed_t_ns = inputs.t_ns if verdict.fire else _still_clearing(inputs, memory, config)
    feeding = bool(feed_t_ns) and (inputs.t_ns - feed_t_ns) * NS < config.feeder.feed_s and feeder_on and feeder_ready
    command = Command(wheels_on, hood_on, feeder_on, flywheel, hood, config.feeder.torque_nm if feeding else 0.0)
    asked = Motion(motion.armed_t_ns, motion.active_t_ns, motion.is_idle, motion.wheels, motion.hood, motion.feeder,
                   flywheel, hood)
    return command, replace(memory, flywheel=wheel_pid, hood=hood_pid, feed_t_ns=feed_t_ns, motion=asked,
                            steady_t_ns=_steady_since(inputs, estimate, aim, memory, config))


def _flywheel(estimate: Estimate, aim: Aim, memory: Memory, config: Config) -> tuple[float, Pid]:
    wheel = config.flywheel
    wanted = aim.motor_ratio * (config.rig.launcher.free_speed_rad_s or 0.0)
    if wanted <= 0.0:
        return 0.0, Pid()
    low = wheel.pid.output_low if wheel.brake else 0.0
    expected_nm = wheel.ks_nm + wheel.kv_nm_s * wanted       # at a constant speed, before any feedback
    return step_pid(wheel.pid, memory.flywheel, wanted, estimate.motor_rad_s, expected_nm, low, wheel.pid.output_high,
                    1.0 / config.tick_hz)


def _hood(inputs: Inputs, estimate: Estimate, aim: Aim, memory: Memory, config: Config, encoder_deg_s: float,
          dropped: bool) -> tuple[float, Pid]:
    hood = config.hood
    if not memory.homed:              # towards the switch, but not before what can tell how far was heard
        heard = (inputs.hood_angle is not None if config.hood_encoder.is_heard
                 else is_fresh(inputs, inputs.hood_motor.t_ns, config))
        return (home(inputs, estimate, encoder_deg_s, config) if heard else 0.0), Pid()
    if estimate.hood_deg is None or aim.source in NOWHERE or dropped:
        return 0.0, Pid()
    wanted = min(max(aim.hood_deg, hood.low_deg), hood.high_deg)
    error = wanted - estimate.hood_deg
    push = math.copysign(hood.friction_nm, error) if abs(error) > hood.deadband_deg else 0.0
    torque, pid = step_pid(hood.pid, memory.hood, wanted, estimate.hood_deg, push,
                           hood.pid.output_low, hood.pid.output_high, 1.0 / config.tick_hz)
    # The screw locks itself: inside the deadband, once slow, nothing needs to push.
    if push == 0.0 and abs(pid.rate) < 1.0:
        return 0.0, pid
    screw_deg = estimate.hood_deg if estimate.hood_screw_deg is None else estimate.hood_screw_deg
    left_deg = (hood.high_deg - max(estimate.hood_deg, screw_deg) if torque > 0.0 else
                min(estimate.hood_deg, screw_deg) - hood.low_deg)
    return slow_down(torque, inputs, estimate, encoder_deg_s, config, left_deg), pid


def home(inputs: Inputs, estimate: Estimate, encoder_deg_s: float, config: Config) -> float:
    """Torque toward the limit switch, within the hood's speed limit."""
    return slow_down(config.hood.homing_torque_nm, inputs, estimate, encoder_deg_s, config, math.inf)


def slow_down(torque_nm: float, inputs: Inputs, estimate: Estimate, encoder_deg_s: float, config: Config,
              left_deg: float) -> float:
    """A hood torque that keeps to `[hood] max_deg_s`, and to less near a soft limit, beyond which it is 0, or on
    readings that grow old.

    What the torque has beyond friction fades linearly to nothing at the limit, and brakes beyond it: the speed then
    settles like a first-order lag. The faster of screw and encoder counts. It brakes by a young speed alone.

    Args:
        encoder_deg_s: Rate of the hood's encoder.
        left_deg: Elevation left to the soft limit in the direction of the torque.
    """
    if left_deg <= 0.0 or torque_nm == 0.0:
        return 0.0
    hood, t_ns, old_s = config.hood, inputs.t_ns, config.gate.reading_age_s
    speed_age_s = age_s = (t_ns - inputs.hood_motor.t_ns) * NS
    if inputs.hood_angle is not None and config.hood_encoder.is_heard:
        age_s = max(age_s, (t_ns - inputs.hood_angle.t_ns) * NS)
    sign = math.copysign(1.0, torque_nm)
    screw_deg_s = inputs.hood_motor.velocity_rad_s * elevation_per_rad(here_deg(estimate, hood), hood)
    rate_deg_s = max(sign * screw_deg_s, sign * encoder_deg_s)
    limit_deg_s = min(hood.max_deg_s, NEAR_PER_S * left_deg) * max(1.0 - age_s / old_s, LEAST_SHARE)
    size_nm = abs(torque_nm)
    spare_nm = max(abs(hood.pid.output_high if torque_nm > 0.0 else hood.pid.output_low) - hood.friction_nm, 0.0)
    most_nm = hood.friction_nm + spare_nm * (1.0 - rate_deg_s / limit_deg_s)
    if most_nm < 0.0:                 # only what the screw itself does is braked
        braked_nm = hood.friction_nm + spare_nm * (1.0 - sign * screw_deg_s / limit_deg_s)
        most_nm = max(min(braked_nm, 0.0), -size_nm) if speed_age_s < YOUNG_SHARE * old_s else 0.0
    return sign * min(size_nm, most_nm)


def _still_clearing(inputs: Inputs, memory: Memory, config: Config) -> int:
    busy = memory.feed_t_ns and (inputs.t_ns - memory.feed_t_ns) * NS < config.feeder.clear_s
    return memory.feed_t_ns if busy else 0


def _steady_since(inputs: Inputs, estimate: Estimate, aim: Aim, memory: Memory, config: Config) -> int:
    wanted = aim.motor_ratio * (config.rig.launcher.free_speed_rad_s or 0.0)
    steady = (wanted > 0.0 and estimate.hood_deg is not None
              and abs(estimate.motor_rad_s - wanted) <= config.flywheel.tolerance_rad_s
              and abs(estimate.hood_deg - aim.hood_deg) <= config.hood.tolerance_deg)
    return (memory.steady_t_ns or inputs.t_ns) if steady else 0
