"""One PID loop, pure: clamped output, conditional anti-windup, filtered derivative on the measurement."""

from truearc.robot.config.schema import PidGains
from truearc.robot.types import Pid


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
