"""Aim and Verdict to Command: the flywheel and hood loops, homing, and the feeder's one ball a request."""

import math

from msgspec.structs import replace

from truearc.hw.fault_codes import FOREIGN_HOST
from truearc.robot.aim import NOWHERE
from truearc.robot.config.schema import Config, PidGains
from truearc.robot.estimate import is_fresh
from truearc.robot.types import Aim, Command, Estimate, Inputs, Memory, Pid, Verdict

NS = 1e-9
RELEASED = Command(enable=False, flywheel_torque_nm=0.0, hood_torque_nm=0.0, feeder_torque_nm=0.0)


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


def control(inputs: Inputs, estimate: Estimate, aim: Aim, verdict: Verdict, memory: Memory,
            config: Config) -> tuple[Command, Memory]:
    """Torques for this tick. Disarmed, or while another host commands our motors, none gets a torque."""
    if not memory.armed or any(fault.code == FOREIGN_HOST.name for fault in inputs.faults):
        return RELEASED, replace(memory, flywheel=Pid(), hood=Pid(), feed_t_ns=0)
    flywheel, wheel_pid = _flywheel(estimate, aim, memory, config)
    hood, hood_pid = _hood(inputs, estimate, aim, memory, config)
    feed_t_ns = inputs.t_ns if verdict.fire else _still_clearing(inputs, memory, config)
    feeding = bool(feed_t_ns) and (inputs.t_ns - feed_t_ns) * NS < config.feeder.feed_s
    command = Command(True, flywheel, hood, config.feeder.torque_nm if feeding else 0.0)
    return command, replace(memory, flywheel=wheel_pid, hood=hood_pid, feed_t_ns=feed_t_ns,
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


def _hood(inputs: Inputs, estimate: Estimate, aim: Aim, memory: Memory, config: Config) -> tuple[float, Pid]:
    hood = config.hood
    if not memory.homed:              # towards the switch, but not before what can tell how far was heard
        heard = (inputs.hood_angle is not None if config.hood_encoder.is_heard
                 else is_fresh(inputs, inputs.hood_motor.t_ns, config))
        return (hood.homing_torque_nm if heard else 0.0), Pid()
    if estimate.hood_deg is None or aim.source in NOWHERE:
        return 0.0, Pid()
    wanted = min(max(aim.hood_deg, hood.low_deg), hood.high_deg)
    error = wanted - estimate.hood_deg
    push = math.copysign(hood.friction_nm, error) if abs(error) > hood.deadband_deg else 0.0
    torque, pid = step_pid(hood.pid, memory.hood, wanted, estimate.hood_deg, push,
                           hood.pid.output_low, hood.pid.output_high, 1.0 / config.tick_hz)
    # The screw locks itself: inside the deadband, once slow, nothing needs to push.
    return (0.0 if push == 0.0 and abs(pid.rate) < 1.0 else torque), pid


def _still_clearing(inputs: Inputs, memory: Memory, config: Config) -> int:
    busy = memory.feed_t_ns and (inputs.t_ns - memory.feed_t_ns) * NS < config.feeder.clear_s
    return memory.feed_t_ns if busy else 0


def _steady_since(inputs: Inputs, estimate: Estimate, aim: Aim, memory: Memory, config: Config) -> int:
    wanted = aim.motor_ratio * (config.rig.launcher.free_speed_rad_s or 0.0)
    steady = (wanted > 0.0 and estimate.hood_deg is not None
              and abs(estimate.motor_rad_s - wanted) <= config.flywheel.tolerance_rad_s
              and abs(estimate.hood_deg - aim.hood_deg) <= config.hood.tolerance_deg)
    return (memory.steady_t_ns or inputs.t_ns) if steady else 0
