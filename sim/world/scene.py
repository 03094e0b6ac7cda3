"""Balls and their passage between the wheels: a roller feeds a ball along a chute, and MuJoCo computes its contacts.

`scenes/` contains the two MuJoCo models: the nip (a ball between two geared wheels) and free flight.
"""

import math
from functools import cache
from importlib.resources import files
from typing import NamedTuple

import mujoco
import numpy as np

from truearc.sim.world.drive import LOWER_INERTIA_KG_M2, UPPER_GEAR, UPPER_INERTIA_KG_M2, step_shaft
from truearc.sim.world.goal import STEPS, Goal
from truearc.sim.world.options import Options

RACK = 12
RADIUS_M = 0.0889                 # of the ball for which the launcher is drawn; for others the wheels are farther apart
STIFFNESS_N_M = 8000.0            # of one squeezed side; 23 mm on each side is then 184 N

# Standard deviations at scatter_scale 1. Between balls of one rack:
MASS_SHARE = 0.015
RADIUS_SHARE = 0.003
STIFFNESS_SHARE = 0.06
# From shot to shot of one ball:
FRICTION_SHARE = 0.04             # dust, seam
SEAT_M = 0.002                    # where in the chute it lies, along the line of wheel centres
SIDE_M_S = 0.05                   # sideways drift when the wheels take it
DRAG_SHARE = 0.02                 # how its seams happen to face the air
LOWER_RADIUS_M = 0.0508
UPPER_RADIUS_M = 0.0349
COMPRESSION_M = 0.046
GAP_M = 2.0 * RADIUS_M - COMPRESSION_M
NIP_STEP_S = 2e-4
FLIGHT_STEP_S = 2.5e-3
FRICTION = 1.0
TRACTION_KG_S = 0.38              # how steeply friction rises with slip before it saturates (see below)
DAMPING_RATIO = 0.12              # of the foam, against the ball's own mass
SOFTNESS = 0.01                   # MuJoCo's impedance d: small makes a contact the plain spring that foam is
FRICTION_OVER_NORMAL = 400.0
GRAVITY_M_S2 = 9.81
VISCOSITY_PA_S = 1.8e-5

# Nominal geometry of the nip: x along the launch direction, z from lower to upper wheel, origin midway in the gap.
LOWER_Z_M = -(LOWER_RADIUS_M + GAP_M / 2.0)
UPPER_Z_M = UPPER_RADIUS_M + GAP_M / 2.0


class Gap(NamedTuple):
    """Where the wheels of a launcher for the world's balls are: heights of their axles, and x where a ball on the axis
    leaves them."""

    lower_z_m: float
    upper_z_m: float
    touch_x_m: float

    @classmethod
    def of(cls, options: Options) -> "Gap":
        wider_m = options.ball_radius_m - RADIUS_M
        lower_z_m = LOWER_Z_M - wider_m
        return cls(lower_z_m, UPPER_Z_M + wider_m,
                   math.sqrt((options.ball_radius_m + LOWER_RADIUS_M)**2 - lower_z_m**2))

    @property
    def start_x_m(self) -> float:
        return -self.touch_x_m - MARGIN_M


class Ball(NamedTuple):
    """One ball, as it is for one shot."""

    ball_id: str
    mass_kg: float
    radius_m: float
    stiffness_n_m: float
    friction_scale: float
    drag_scale: float
    seat_m: float
    side_m_s: float


class Rack:
    """Balls in shuffled order, each used once before any is used again; each wears with use."""

    def __init__(self, seed: int, options: Options) -> None:
        self._seed = seed
        self._options = options
        draws = np.random.default_rng([seed, 1]).standard_normal((RACK, 3)) * options.scatter_scale
        self._draws = np.clip(draws, -3.0, 3.0)
        self._used = [0] * RACK

    def ball(self, shot: int) -> Ball:
        """Return the ball of shot number `shot` (from 0), with its present wear."""
        number = self._number(shot)
        options = self._options
        mass, radius, stiffness = self._draws[number]
        used = self._used[number]
        noise = np.clip(np.random.default_rng([self._seed, 2, shot]).standard_normal(4), -3.0, 3.0)
        friction, seat, side, drag = noise * options.scatter_scale
        warm = max(0.2, 1.0 + options.stiffness_per_c * (options.temperature_c - 20.0))
        return Ball(
            ball_id=f"ball{number + 1:02d}",
            mass_kg=options.ball_mass_kg * options.ball_mass_scale * float(1.0 + MASS_SHARE * mass),
            radius_m=options.ball_radius_m * options.ball_radius_scale * float(1.0 + RADIUS_SHARE * radius)
            * (1.0 - options.wear_radius_per_shot) ** used,
            stiffness_n_m=STIFFNESS_N_M * options.ball_stiffness_scale * float(1.0 + STIFFNESS_SHARE * stiffness)
            * warm * (1.0 - options.wear_stiffness_per_shot) ** used,
            friction_scale=options.ball_friction_scale * float(1.0 + FRICTION_SHARE * friction)
            * (1.0 - options.wear_friction_per_shot) ** used,
            drag_scale=float(1.0 + DRAG_SHARE * drag),
            seat_m=float(SEAT_M * seat),
            side_m_s=float(SIDE_M_S * side),
        )

    def use(self, shot: int) -> None:
        """Note that the ball of that shot has gone through the wheels."""
        self._used[self._number(shot)] += 1

    def _number(self, shot: int) -> int:
        return int(np.random.default_rng([self._seed, 3, shot // RACK]).permutation(RACK)[shot % RACK])


def air_density_kg_m3(options: Options) -> float:
    """Return the density at the option's temperature, at the same pressure."""
    return options.air_density_kg_m3 * 293.15 / (273.15 + options.temperature_c)


def make_nip(ball: Ball, options: Options, gravity_m_s2: np.ndarray, wind_m_s: np.ndarray) -> mujoco.MjModel:
    """Return the launcher's wheels and one ball, in the nip's own axes (also used for gravity and wind).

    Joints in order: lower and upper wheel (positive drives the ball out), then the ball's six. A contact is a spring
    of the foam's stiffness in N/m: with direct solref (-k, -b) and small impedance d MuJoCo gives the force
    m (k r + b dr/dt). Tangentially it gives a traction proportional to slip, at most friction x normal force.
    """
    k_per_s2 = ball.stiffness_n_m / ball.mass_kg
    scale, gap = options.flywheel_inertia_scale, Gap.of(options)
    xml = _scene("nip.xml").format(
        step=NIP_STEP_S, impratio=FRICTION_OVER_NORMAL, lower_z=gap.lower_z_m, upper_z=gap.upper_z_m,
        lower_r=LOWER_RADIUS_M, upper_r=UPPER_RADIUS_M, lower_j=LOWER_INERTIA_KG_M2 * scale,
        upper_j=UPPER_INERTIA_KG_M2 * scale,
        gear=UPPER_GEAR, mu=FRICTION * ball.friction_scale, k=-k_per_s2, b=-2.0 * DAMPING_RATIO * math.sqrt(k_per_s2),
        bt=-TRACTION_KG_S * ball.friction_scale / ball.mass_kg, d=SOFTNESS, ball=_ball(ball, options))
    return _compiled(xml, options, gravity_m_s2, wind_m_s)


def make_flight(ball: Ball, options: Options, goal: Goal | None = None) -> mujoco.MjModel:
    """Return one ball in the air, in field axes: x towards the target, y left, z up. It bounces off the goal."""
    wind_m_s = np.array([options.wind_x_m_s, options.wind_y_m_s, options.wind_z_m_s])
    xml = _scene("flight.xml").format(step=FLIGHT_STEP_S / (1 if goal is None else STEPS),
                                      ball=_ball(ball, options, touches=goal is not None),
                                      goal="" if goal is None else goal.xml())
    return _compiled(xml, options, np.array([0.0, 0.0, -GRAVITY_M_S2]), wind_m_s)


def _compiled(xml: str, options: Options, gravity_m_s2: np.ndarray, wind_m_s: np.ndarray) -> mujoco.MjModel:
    """The model of the XML, with gravity and air.

    Of the ellipsoid's added mass MuJoCo computes only the gyroscopic part, which is therefore left out: on a sphere it
    would be a spurious force -1/2 rho V omega x v, twice the Magnus force and against it.
    """
    model = mujoco.MjModel.from_xml_string(xml)
    model.opt.gravity[:], model.opt.wind[:] = gravity_m_s2, wind_m_s
    model.opt.density = air_density_kg_m3(options)
    model.opt.viscosity = VISCOSITY_PA_S if model.opt.density else 0.0
    model.geom_fluid[:, 6:] = 0.0
    return model


def _ball(ball: Ball, options: Options, touches: bool = False) -> str:
    # MuJoCo's drag is C rho A v^2, without the customary half.
    return _scene("ball.xml").format(
        mass=ball.mass_kg, inertia=0.4 * ball.mass_kg * ball.radius_m**2, radius=ball.radius_m,
        blunt=0.5 * options.drag_coefficient * ball.drag_scale, angular=options.spin_drag_coefficient,
        magnus=options.magnus_coefficient, touches=int(touches))


@cache
def _scene(name: str) -> str:
    return (files("truearc.sim.world") / "scenes" / name).read_text(encoding="utf-8")


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


class Feeder:
    """Motor and roller; `ball_x_m` is the waiting ball's place in the nip's axes, None while there is none."""

    def __init__(self, options: Options | None = None) -> None:
        self.speed_rad_s = 0.0
        self.position_rad = 0.0
        self._start_x_m = Gap.of(options or Options()).start_x_m
        self._wait_x_m = self._start_x_m - CHUTE_M
        self.ball_x_m: float | None = self._wait_x_m
        self._reload_s = 0.0

    @property
    def surface_m_s(self) -> float:
        return self.speed_rad_s * ROLLER_M

    def step(self, torque_nm: float, dt_s: float) -> float | None:
        """Turn for dt_s; return the part of dt_s left when the ball reaches the wheels, else None."""
        self.speed_rad_s, turned_rad = step_shaft(self.speed_rad_s, torque_nm, dt_s, INERTIA_KG_M2, VISCOUS_NM_S,
                                                  COULOMB_NM)
        self.position_rad += turned_rad
        if self._reload_s > 0.0:
            self._reload_s -= dt_s
            self.ball_x_m = self._wait_x_m if self._reload_s <= 0.0 else self.ball_x_m
        if self.ball_x_m is None:
            return None
        ahead_m = turned_rad * ROLLER_M
        place_m = max(self.ball_x_m + ahead_m, self._wait_x_m)
        if place_m < self._start_x_m:
            self.ball_x_m = place_m
            return None
        left_s = dt_s * (place_m - self._start_x_m) / ahead_m if ahead_m > 0.0 else 0.0
        self.ball_x_m = None
        return min(left_s, dt_s)

    def pull_n(self, x_m: float, velocity_m_s: float) -> float:
        """Return the force along the launch direction on a ball in the nip."""
        if x_m > -REACH_M:
            return 0.0
        return min(max(GRIP_N_S_M * (self.surface_m_s - velocity_m_s), -PULL_N), PULL_N)

    def expect_ball(self) -> None:
        """Note that the ball has left: the hopper sends the next one."""
        self._reload_s = RELOAD_S

    def take_back(self, x_m: float) -> None:
        """Note that the wheels threw the ball back into the chute."""
        self.ball_x_m = max(min(x_m, self._start_x_m - 1e-4), self._wait_x_m)


class Released(NamedTuple):
    """A ball's state as it leaves, in the caller's axes."""

    position_m: np.ndarray
    velocity_m_s: np.ndarray
    spin_rad_s: np.ndarray


def rotate_from_launch(vector: np.ndarray, elevation_rad: float) -> np.ndarray:
    """Rotate from the nip's axes (x along the launch, z across the gap) to x horizontal, z up."""
    cos, sin = math.cos(elevation_rad), math.sin(elevation_rad)
    return np.array([cos * vector[0] - sin * vector[2], vector[1], sin * vector[0] + cos * vector[2]])


class Nip:
    """Wheels and ball during contact; `wheel_rad_s` is the lower wheel's, which is the motors'."""

    def __init__(self, ball: Ball, options: Options, elevation_rad: float, wheel_rad_s: float, feed_m_s: float,
                 step_s: float = NIP_STEP_S) -> None:
        """`step_s`: of MuJoCo, at most about so long."""
        gravity = rotate_from_launch(np.array([0.0, 0.0, -GRAVITY_M_S2]), -elevation_rad)
        blowing = np.array([options.wind_x_m_s, options.wind_y_m_s, options.wind_z_m_s])
        wind = rotate_from_launch(np.zeros(3) if options.wind_above_m else blowing, -elevation_rad)
        self.ball = ball
        self._step_s = step_s
        self.elevation_rad = elevation_rad
        self._model = make_nip(ball, options, gravity, wind)
        self._data = data = mujoco.MjData(self._model)
        self._start_x_m = Gap.of(options).start_x_m
        data.qpos[2:5] = (self._start_x_m, 0.0, ball.seat_m)
        data.qvel[:5] = (wheel_rad_s, UPPER_GEAR * wheel_rad_s, feed_m_s, ball.side_m_s, 0.0)
        self._touched = False
        self.released: Released | None = None
        self.thrown_back = False

    @property
    def wheel_rad_s(self) -> float:
        return float(self._data.qvel[0])

    @property
    def x_m(self) -> float:
        return float(self._data.qpos[2])

    def step(self, torque_nm: float, feeder: Feeder, dt_s: float) -> float:
        """Advance by dt_s or until the ball has left; return the part of dt_s that is left (0 while it is still
        here)."""
        model, data = self._model, self._data
        steps = max(1, round(dt_s / self._step_s))
        model.opt.timestep = dt_s / steps
        data.qfrc_applied[0] = torque_nm
        for done in range(1, steps + 1):
            data.qfrc_applied[2] = feeder.pull_n(data.qpos[2], data.qvel[2])
            mujoco.mj_step(model, data)
            if self._gone():
                return dt_s * (steps - done) / steps
        return 0.0

    def _gone(self) -> bool:
        data = self._data
        if data.ncon:
            self._touched = True
            return False
        if data.qpos[2] > 0.0 and self._touched:
            self.released = self._release()
            return True
        self.thrown_back = bool(data.qpos[2] < self._start_x_m - 0.002)
        return self.thrown_back

    def _release(self) -> Released:
        data = self._data
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, data.qpos[5:9])
        return Released(data.qpos[2:5].copy(), data.qvel[2:5].copy(), turn.reshape(3, 3) @ data.qvel[5:8])
