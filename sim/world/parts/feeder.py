"""The feeder: a geared roller that carries the waiting ball along a chute up to the wheels."""

from truearc.sim.world.parts.motor import step_shaft
from truearc.sim.world.scene import TOUCH_X_M

ROLLER_M = 0.004                  # ball travel per radian of the motor
INERTIA_KG_M2 = 3e-5              # rotor, gears, roller
VISCOUS_NM_S = 6e-4
COULOMB_NM = 0.02
CHUTE_M = 0.05                    # from where a ball waits to where it touches the wheels
MARGIN_M = 0.002                  # the nip is simulated from this far before contact
GRIP_N_S_M = 40.0                 # pull of the roller on a ball that the wheels hold back
PULL_N = 8.0
REACH_M = 0.03                    # the roller lets go this far before the line of wheel centres
RELOAD_S = 0.5                    # the hopper's next ball is there this long after the last one left

START_X_M = -TOUCH_X_M - MARGIN_M
WAIT_X_M = START_X_M - CHUTE_M


class Feeder:
    """Motor and roller; `ball_x_m` is the waiting ball's place in the nip's axes, None while there is none."""

    def __init__(self) -> None:
        self.speed_rad_s = 0.0
        self.position_rad = 0.0
        self.ball_x_m: float | None = WAIT_X_M
        self._reload_s = 0.0

    @property
    def surface_m_s(self) -> float:
        return self.speed_rad_s * ROLLER_M

    def step(self, torque_nm: float, dt_s: float) -> float | None:
        """Turn for dt_s; when the ball reaches the wheels, the part of dt_s that was left then, else None."""
        self.speed_rad_s, turned_rad = step_shaft(self.speed_rad_s, torque_nm, dt_s, INERTIA_KG_M2, VISCOUS_NM_S,
                                                  COULOMB_NM)
        self.position_rad += turned_rad
        if self._reload_s > 0.0:
            self._reload_s -= dt_s
            self.ball_x_m = WAIT_X_M if self._reload_s <= 0.0 else self.ball_x_m
        if self.ball_x_m is None:
            return None
        ahead_m = turned_rad * ROLLER_M
        place_m = max(self.ball_x_m + ahead_m, WAIT_X_M)
        if place_m < START_X_M:
            self.ball_x_m = place_m
            return None
        left_s = dt_s * (place_m - START_X_M) / ahead_m if ahead_m > 0.0 else 0.0
        self.ball_x_m = None
        return min(left_s, dt_s)

    def pull_n(self, x_m: float, velocity_m_s: float) -> float:
        """Force along the launch direction on a ball in the nip."""
        if x_m > -REACH_M:
            return 0.0
        return min(max(GRIP_N_S_M * (self.surface_m_s - velocity_m_s), -PULL_N), PULL_N)

    def expect_ball(self) -> None:
        """The ball has left: the hopper sends the next one."""
        self._reload_s = RELOAD_S

    def take_back(self, x_m: float) -> None:
        """The wheels threw the ball back into the chute."""
        self.ball_x_m = max(min(x_m, START_X_M - 1e-4), WAIT_X_M)
