"""Brushless motors behind current-controlled drivers, and shafts with Coulomb friction."""

import math
from typing import NamedTuple


class Motor(NamedTuple):
    """A brushless motor; in SI its torque constant is also its back-EMF constant (V s/rad)."""

    kt_nm_a: float
    resistance_ohm: float


def motor_of(free_speed_rad_s: float, stall_torque_nm: float, rated_v: float = 12.0) -> Motor:
    """The motor that a data sheet describes by its free speed and stall torque at `rated_v`."""
    kt_nm_a = rated_v / free_speed_rad_s
    return Motor(kt_nm_a, rated_v * kt_nm_a / stall_torque_nm)


class Drawn(NamedTuple):
    """A motor's torque and current, and the power that it takes from the supply."""

    torque_nm: float
    current_a: float
    power_w: float


FLYWHEEL = motor_of(free_speed_rad_s=594.0, stall_torque_nm=2.6)
HOOD = motor_of(free_speed_rad_s=594.0, stall_torque_nm=2.6)
FEEDER = motor_of(free_speed_rad_s=1000.0, stall_torque_nm=0.7)


def drive_motor(motor: Motor, asked_nm: float, speed_rad_s: float, bus_v: float, limit_a: float) -> Drawn:
    """Torque that a current-controlled driver gets out of a motor: asked, unless voltage or current runs out.

    The phase current lies within +-`limit_a` and within (+-bus_v - Kt w) / R. Braking power is burnt in the driver.
    """
    kt, ohm = motor
    back_v = kt * speed_rad_s
    high_a = max(0.0, min(limit_a, (bus_v - back_v) / ohm))
    low_a = min(0.0, max(-limit_a, (-bus_v - back_v) / ohm))
    current_a = min(max(asked_nm / kt, low_a), high_a)
    power_w = max(0.0, current_a * (back_v + current_a * ohm))
    return Drawn(kt * current_a, current_a, power_w)


def step_shaft(speed_rad_s: float, torque_nm: float, dt_s: float, inertia_kg_m2: float, viscous_nm_s: float,
               coulomb_nm: float) -> tuple[float, float]:
    """Turn a shaft for `dt_s` under constant torque, viscous and Coulomb friction: closed form, stops included.

    Returns the speed in rad/s afterwards and the angle in rad turned.
    """
    if speed_rad_s == 0.0:
        if abs(torque_nm) <= coulomb_nm:
            return 0.0, 0.0
        direction = math.copysign(1.0, torque_nm)
    else:
        direction = math.copysign(1.0, speed_rad_s)
    tau_s = inertia_kg_m2 / viscous_nm_s
    final_rad_s = (torque_nm - direction * coulomb_nm) / viscous_nm_s
    decay = math.exp(-dt_s / tau_s)
    reached_rad_s = final_rad_s + (speed_rad_s - final_rad_s) * decay
    if reached_rad_s * direction > 0.0 or speed_rad_s == 0.0:
        turned_rad = final_rad_s * dt_s + (speed_rad_s - final_rad_s) * tau_s * (1.0 - decay)
        return reached_rad_s, turned_rad
    stop_s = tau_s * math.log((speed_rad_s - final_rad_s) / -final_rad_s)
    turned_rad = final_rad_s * stop_s + speed_rad_s * tau_s
    speed_rad_s, after_rad = step_shaft(0.0, torque_nm, dt_s - stop_s, inertia_kg_m2, viscous_nm_s, coulomb_nm)
    return speed_rad_s, turned_rad + after_rad
