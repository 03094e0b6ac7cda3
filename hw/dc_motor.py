"""Torque to duty and back, for drivers that take a share of the bus voltage instead of a torque.

A permanent-magnet motor in a steady state: v = R i + K w and T = K i, brushless ones behind their commutation alike
(any textbook; MuJoCo's note on its DC motor, eq. 1 and 2). A data sheet's stall torque and free speed at its rated
voltage are K^2 w_free / R and v_rated / K when the current that turns the free motor is neglected, so that

    T = T_stall (duty v_bus / v_rated - w / w_free).
"""

from msgspec import Struct


class DcMotor(Struct, frozen=True):
    """Data sheet values of a motor, at the shaft that the torques are of."""

    stall_torque_nm: float
    free_speed_rad_s: float
    rated_v: float


def duty_for(motor: DcMotor, torque_nm: float, velocity_rad_s: float, bus_v: float) -> float:
    """The duty that gives this torque now, or the nearest there is in [-1, 1]; `bus_v` must be above 0."""
    share = torque_nm / motor.stall_torque_nm + velocity_rad_s / motor.free_speed_rad_s
    return min(max(share * motor.rated_v / bus_v, -1.0), 1.0)


def torque_of(motor: DcMotor, duty: float, velocity_rad_s: float, bus_v: float) -> float:
    """The torque, in Nm, that a duty gives; the inverse of `duty_for` where that did not have to give in."""
    return motor.stall_torque_nm * (duty * bus_v / motor.rated_v - velocity_rad_s / motor.free_speed_rad_s)
