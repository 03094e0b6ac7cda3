"""The PID loop against closed forms."""

import math

from hypothesis import given
from hypothesis import strategies as st

from truearc.robot.config.schema import PidGains
from truearc.robot.control import step_pid
from truearc.robot.types import Pid

DT = 0.005


def gains(kp=0.0, ki=0.0, kd=0.0, tau=0.0, limit=10.0):
    return PidGains(kp=kp, ki=ki, kd=kd, derivative_tau_s=tau, integral_limit=limit, output_low=-1.0, output_high=1.0)


def test_first_order_plants_settle_where_algebra_says():
    # dx/dt = u - x with u = kp (r - x): x -> kp/(1+kp) r
    pid, x = Pid(), 0.0
    for _ in range(4000):
        u, pid = step_pid(gains(kp=4.0), pid, 0.5, x, 0.0, -10.0, 10.0, DT)
        x += DT * (u - x)
    assert math.isclose(x, 0.5 * 4.0 / 5.0, rel_tol=1e-6)
    pid, x = Pid(), 0.0
    for _ in range(8000):
        u, pid = step_pid(gains(kp=2.0, ki=1.0), pid, 0.5, x, 0.0, -10.0, 10.0, DT)
        x += DT * (u - x)
    assert math.isclose(x, 0.5, abs_tol=1e-6)


def test_the_derivative_is_filtered_and_has_no_kick():
    _, pid = step_pid(gains(kd=1.0), Pid(), 0.0, 1.0, 0.0, -10.0, 10.0, DT)
    output, _ = step_pid(gains(kd=1.0), pid, 100.0, 1.0, 0.0, -10.0, 10.0, DT)
    assert output == 0.0
    pid, tau, x = Pid(), 0.05, 0.0
    _, pid = step_pid(gains(tau=tau), pid, 0.0, x, 0.0, -1.0, 1.0, DT)
    for _ in range(round(tau / DT)):
        x += 3.0 * DT
        _, pid = step_pid(gains(tau=tau), pid, 0.0, x, 0.0, -1.0, 1.0, DT)
    assert math.isclose(pid.rate / 3.0, 1.0 - math.exp(-1.0), abs_tol=0.03)


def test_the_integral_does_not_wind_up_while_the_output_is_clamped():
    pid = Pid()
    for _ in range(2000):
        output, pid = step_pid(gains(kp=1.0, ki=1.0), pid, 10.0, 0.0, 0.0, -1.0, 1.0, DT)
        assert output == 1.0
    assert pid.integral == 0.0


@given(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.floats(-5, 5), st.floats(-5, 0), st.floats(0, 5))
def test_the_output_never_leaves_its_limits(setpoint, measurement, feedforward, low, high):
    output, pid = step_pid(gains(kp=3.0, ki=2.0, kd=0.1, tau=0.01, limit=0.4), Pid(0.2, 0.0, 0.0, True), setpoint,
                           measurement, feedforward, low, high, DT)
    assert low <= output <= high
    assert abs(pid.integral) <= 0.4
