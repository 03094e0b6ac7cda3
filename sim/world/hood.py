"""The hood: a motor on a pivot turns an acme screw, a nut on the hood rides it.

The linkage is a triangle of the hood's pivot, the motor's pivot and the nut; the screw is its changing side.
"""

import math

from truearc.sim.world.drive import step_shaft
from truearc.sim.world.options import Options

PIVOT_TO_MOTOR_M = 0.30
PIVOT_TO_NUT_M = 0.25
INCLUDED_DEG = 30.0               # angle motor-pivot-nut when the elevation is 0
LEAD_M = 0.005
LOW_DEG = 15.0                    # hard stops
HIGH_DEG = 75.0
SWITCH_DEG = 0.1                  # the limit switch closes this close to the lower stop
INERTIA_KG_M2 = 6e-5              # rotor, coupling and screw; the hood behind the screw adds less than 1e-6
COULOMB_NM = 0.02                 # thread and bearings
VISCOUS_NM_S = 1.5e-4
FLEX_FROM_RAD_S, FLEX_PER_RAD_S = 250.0, 100.0


def screw_rad(elevation_deg: float) -> float:
    """Screw angle at an elevation, 0 where the linkage would be folded flat; law of cosines."""
    included_rad = math.radians(INCLUDED_DEG + elevation_deg)
    square = PIVOT_TO_MOTOR_M**2 + PIVOT_TO_NUT_M**2 - 2.0 * PIVOT_TO_MOTOR_M * PIVOT_TO_NUT_M * math.cos(included_rad)
    return math.sqrt(square) / LEAD_M * 2.0 * math.pi


def elevation_deg(screw: float) -> float:
    """Inverse of screw_rad."""
    side_m = screw / (2.0 * math.pi) * LEAD_M
    cosine = (PIVOT_TO_MOTOR_M**2 + PIVOT_TO_NUT_M**2 - side_m**2) / (2.0 * PIVOT_TO_MOTOR_M * PIVOT_TO_NUT_M)
    return math.degrees(math.acos(cosine)) - INCLUDED_DEG


def flexed(wheel_rad_s: float) -> float:
    """How far a hood that gives way does so at a speed of the lower wheel, in units of what it does per 100 rad/s."""
    return (wheel_rad_s - FLEX_FROM_RAD_S) / FLEX_PER_RAD_S


LOW_RAD = screw_rad(LOW_DEG)
HIGH_RAD = screw_rad(HIGH_DEG)


class Hood:
    """Screw, nut with play, hood; the motor's own encoder counts from wherever it was switched on."""

    def __init__(self, start_deg: float, options: Options) -> None:
        self._half_play_deg = 0.5 * options.hood_backlash_deg
        self._offset_deg = options.hood_offset_deg
        self._screw_rad = screw_rad(start_deg)
        self._start_rad = self._screw_rad
        self.speed_rad_s = 0.0
        self.elevation_deg = start_deg

    @property
    def position_rad(self) -> float:
        """Motor angle since switch-on."""
        return self._screw_rad - self._start_rad

    @property
    def encoder_rad(self) -> float:
        """Elevation as the magnet on the hood's pivot shows it."""
        return math.radians(self.elevation_deg + self._offset_deg)

    @property
    def at_limit(self) -> bool:
        return self.elevation_deg <= LOW_DEG + SWITCH_DEG

    def step(self, torque_nm: float, dt_s: float) -> None:
        """Turn the screw; the thread is self-locking, so nothing comes back from the hood; the stops take all."""
        if self.speed_rad_s == 0.0 and abs(torque_nm) <= COULOMB_NM:
            return
        speed_rad_s, turned_rad = step_shaft(self.speed_rad_s, torque_nm, dt_s, INERTIA_KG_M2, VISCOUS_NM_S, COULOMB_NM)
        wanted_rad = self._screw_rad + turned_rad
        self._screw_rad = min(max(wanted_rad, LOW_RAD), HIGH_RAD)
        self.speed_rad_s = speed_rad_s if wanted_rad == self._screw_rad else 0.0
        nut_deg = elevation_deg(self._screw_rad)
        carried = min(max(self.elevation_deg, nut_deg - self._half_play_deg), nut_deg + self._half_play_deg)
        self.elevation_deg = min(max(carried, LOW_DEG), HIGH_DEG)
