"""The electric drive: battery, brushless motors with current-controlled drivers, belt-driven wheels, and the hood.

The hood's motor is mounted on a pivot and turns an acme screw, which moves a nut on the hood. The linkage is a triangle
formed by the hood's pivot, the motor's pivot and the nut; the screw is the side of variable length.
"""

import math
from typing import NamedTuple

from truearc.sim.world.options import Options

CHARGE_C = 18.0 * 3600.0          # 18 Ah, lead acid
FALL_V = 1.2                      # open-circuit voltage lost from full to empty
STANDING_W = 20.0                 # computer, radio, ring light
UPPER_GEAR = 0.5625
LOWER_INERTIA_KG_M2 = 2.2e-3      # wheel, shaft, belt and both rotors
UPPER_INERTIA_KG_M2 = 1.3e-3
INERTIA_KG_M2 = LOWER_INERTIA_KG_M2 + UPPER_GEAR**2 * UPPER_INERTIA_KG_M2     # seen at the lower wheel = motor shaft
COULOMB_NM = 0.04                 # bearings, belt
VISCOUS_NM_S = 1.6e-4
WINDAGE_NM_S2 = 3.5e-7


class Battery:
    """A battery feeding every motor driver over the same wires."""

    def __init__(self, options: Options) -> None:
        self._start_v = options.battery_start_v
        self._resistance_ohm = options.battery_resistance_ohm
        self._drop_v_per_shot = options.battery_drop_v_per_shot
        self._used_c = 0.0
        self.shots = 0                # made with it
        self.bus_v = self._start_v

    @property
    def open_circuit_v(self) -> float:
        return self._start_v - FALL_V * self._used_c / CHARGE_C - self._drop_v_per_shot * self.shots

    def draw(self, power_w: float, dt_s: float) -> None:
        """Deliver power for dt_s: the bus sits where U (E - U) / R equals it, at worst at maximum power transfer."""
        emf_v = self.open_circuit_v
        root = emf_v * emf_v - 4.0 * self._resistance_ohm * (power_w + STANDING_W)
        self.bus_v = 0.5 * (emf_v + math.sqrt(max(root, 0.0)))
        self._used_c += (power_w + STANDING_W) / self.bus_v * dt_s


class Motor(NamedTuple):
    """A brushless motor; in SI its torque constant is also its back-EMF constant (V s/rad)."""

    kt_nm_a: float
    resistance_ohm: float


def motor_of(free_speed_rad_s: float, stall_torque_nm: float, rated_v: float = 12.0) -> Motor:
    """Return the motor with a data sheet's free speed and stall torque at `rated_v`."""
    kt_nm_a = rated_v / free_speed_rad_s
    return Motor(kt_nm_a, rated_v * kt_nm_a / stall_torque_nm)


class Drawn(NamedTuple):
    """A motor's torque and current, and the power that it draws from the supply."""

    torque_nm: float
    current_a: float
    power_w: float


FLYWHEEL = motor_of(free_speed_rad_s=594.0, stall_torque_nm=2.6)
HOOD = motor_of(free_speed_rad_s=594.0, stall_torque_nm=2.6)
FEEDER = motor_of(free_speed_rad_s=1000.0, stall_torque_nm=0.7)


def drive_motor(motor: Motor, asked_nm: float, speed_rad_s: float, bus_v: float, limit_a: float) -> Drawn:
    """Return the torque of a current-controlled motor: as requested, unless voltage or current is insufficient.

    The phase current lies within +-`limit_a` and within (+-bus_v - Kt w) / R. Braking power is dissipated in the
    driver.
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


class Belt:
    """Speed and angle of the motor shaft, which is the lower wheel's."""

    def __init__(self, options: Options) -> None:
        self._inertia_kg_m2 = INERTIA_KG_M2 * options.flywheel_inertia_scale
        self.speed_rad_s = 0.0
        self.position_rad = 0.0

    def step(self, torque_nm: float, dt_s: float) -> None:
        """Turn freely; windage is linearised within one step."""
        viscous = VISCOUS_NM_S + WINDAGE_NM_S2 * abs(self.speed_rad_s)
        self.speed_rad_s, turned_rad = step_shaft(self.speed_rad_s, torque_nm, dt_s, self._inertia_kg_m2, viscous,
                                                  COULOMB_NM)
        self.position_rad += turned_rad

    def loss_nm(self) -> float:
        """Return the friction torque at the present speed, against the motion, for the time that the nip turns the
        wheels."""
        speed = self.speed_rad_s
        coulomb_nm = COULOMB_NM * min(max(speed, -1.0), 1.0)
        return -(coulomb_nm + VISCOUS_NM_S * speed + WINDAGE_NM_S2 * abs(speed) * speed)

    def turn(self, speed_rad_s: float, dt_s: float) -> None:
        """Take over the speed after the nip."""
        self.position_rad += 0.5 * (self.speed_rad_s + speed_rad_s) * dt_s
        self.speed_rad_s = speed_rad_s


PIVOT_TO_MOTOR_M = 0.30
PIVOT_TO_NUT_M = 0.25
INCLUDED_DEG = 30.0               # angle motor-pivot-nut when the elevation is 0
LEAD_M = 0.005
LOW_DEG = 15.0                    # hard stops
HIGH_DEG = 75.0
SWITCH_DEG = 0.1                  # the limit switch closes this close to the lower stop
SCREW_INERTIA_KG_M2 = 6e-5              # rotor, coupling and screw; the hood behind the screw adds less than 1e-6
HOOD_COULOMB_NM = 0.02                 # thread and bearings
SCREW_VISCOUS_NM_S = 1.5e-4
FLEX_FROM_RAD_S, FLEX_PER_RAD_S = 250.0, 100.0


def screw_rad(elevation_deg: float) -> float:
    """Return the screw angle at an elevation, 0 where the linkage would be folded flat; law of cosines."""
    included_rad = math.radians(INCLUDED_DEG + elevation_deg)
    square = PIVOT_TO_MOTOR_M**2 + PIVOT_TO_NUT_M**2 - 2.0 * PIVOT_TO_MOTOR_M * PIVOT_TO_NUT_M * math.cos(included_rad)
    return math.sqrt(square) / LEAD_M * 2.0 * math.pi


def elevation_deg(screw: float) -> float:
    """Invert screw_rad."""
    side_m = screw / (2.0 * math.pi) * LEAD_M
    cosine = (PIVOT_TO_MOTOR_M**2 + PIVOT_TO_NUT_M**2 - side_m**2) / (2.0 * PIVOT_TO_MOTOR_M * PIVOT_TO_NUT_M)
    return math.degrees(math.acos(cosine)) - INCLUDED_DEG


def flexed(wheel_rad_s: float) -> float:
    """Return how far a flexible hood bends at a speed of the lower wheel, in units of its bend per 100 rad/s."""
    return (wheel_rad_s - FLEX_FROM_RAD_S) / FLEX_PER_RAD_S


LOW_RAD = screw_rad(LOW_DEG)
HIGH_RAD = screw_rad(HIGH_DEG)


class Hood:
    """Screw, nut with play, hood; the motor's own encoder counts from its position at power-up."""

    def __init__(self, start_deg: float, options: Options) -> None:
        self._half_play_deg = 0.5 * options.hood_backlash_deg
        self._offset_deg = options.hood_offset_deg
        self._screw_rad = screw_rad(start_deg)
        self._start_rad = self._screw_rad
        self.speed_rad_s = 0.0
        self.elevation_deg = start_deg

    @property
    def position_rad(self) -> float:
        """Motor angle since power-up."""
        return self._screw_rad - self._start_rad

    @property
    def encoder_rad(self) -> float:
        """Elevation as read by the magnet on the hood's pivot."""
        return math.radians(self.elevation_deg + self._offset_deg)

    @property
    def at_limit(self) -> bool:
        return self.elevation_deg <= LOW_DEG + SWITCH_DEG

    def step(self, torque_nm: float, dt_s: float) -> None:
        """Turn the screw; the thread is self-locking, so the hood does not drive it; the stops take any load."""
        if self.speed_rad_s == 0.0 and abs(torque_nm) <= HOOD_COULOMB_NM:
            return
        speed_rad_s, turned_rad = step_shaft(self.speed_rad_s, torque_nm, dt_s, SCREW_INERTIA_KG_M2, SCREW_VISCOUS_NM_S,
                                             HOOD_COULOMB_NM)
        wanted_rad = self._screw_rad + turned_rad
        self._screw_rad = min(max(wanted_rad, LOW_RAD), HIGH_RAD)
        self.speed_rad_s = speed_rad_s if wanted_rad == self._screw_rad else 0.0
        nut_deg = elevation_deg(self._screw_rad)
        carried = min(max(self.elevation_deg, nut_deg - self._half_play_deg), nut_deg + self._half_play_deg)
        self.elevation_deg = min(max(carried, LOW_DEG), HIGH_DEG)
