"""Two wheels on one belt with two motors on its shaft, while no ball is between them."""

from truearc.sim.world.options import Options
from truearc.sim.world.parts.motor import step_shaft
from truearc.sim.world.scene import LOWER_INERTIA_KG_M2, UPPER_GEAR, UPPER_INERTIA_KG_M2

INERTIA_KG_M2 = LOWER_INERTIA_KG_M2 + UPPER_GEAR**2 * UPPER_INERTIA_KG_M2     # seen at the lower wheel = motor shaft
COULOMB_NM = 0.04                 # bearings, belt
VISCOUS_NM_S = 1.6e-4
WINDAGE_NM_S2 = 3.5e-7


class Belt:
    """Speed and angle of the motor shaft, which is the lower wheel's."""

    def __init__(self, options: Options) -> None:
        self._inertia_kg_m2 = INERTIA_KG_M2 * options.flywheel_inertia_scale
        self.speed_rad_s = 0.0
        self.position_rad = 0.0

    def step(self, torque_nm: float, dt_s: float) -> None:
        """Turn freely; windage is taken as linear within one step."""
        viscous = VISCOUS_NM_S + WINDAGE_NM_S2 * abs(self.speed_rad_s)
        self.speed_rad_s, turned_rad = step_shaft(self.speed_rad_s, torque_nm, dt_s, self._inertia_kg_m2, viscous,
                                                  COULOMB_NM)
        self.position_rad += turned_rad

    def loss_nm(self) -> float:
        """Friction torque at the present speed, against the motion; for the time that the nip turns the wheels."""
        speed = self.speed_rad_s
        coulomb_nm = COULOMB_NM * min(max(speed, -1.0), 1.0)
        return -(coulomb_nm + VISCOUS_NM_S * speed + WINDAGE_NM_S2 * abs(speed) * speed)

    def turn(self, speed_rad_s: float, dt_s: float) -> None:
        """Take over the speed that the nip left."""
        self.position_rad += 0.5 * (self.speed_rad_s + speed_rad_s) * dt_s
        self.speed_rad_s = speed_rad_s
