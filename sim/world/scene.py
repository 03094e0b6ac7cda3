"""The balls, and the two MuJoCo models of `scenes/`: the nip (a ball between two geared wheels) and free flight."""

import math
from functools import cache
from importlib.resources import files
from typing import NamedTuple

import mujoco
import numpy as np

from truearc.sim.world.drive import LOWER_INERTIA_KG_M2, UPPER_GEAR, UPPER_INERTIA_KG_M2
from truearc.sim.world.options import Options

RACK = 12
MASS_KG = 0.14
RADIUS_M = 0.0889
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
TOUCH_X_M = math.sqrt((RADIUS_M + LOWER_RADIUS_M) ** 2 - LOWER_Z_M**2)    # where a ball on the axis leaves the wheels


class Ball(NamedTuple):
    """One ball as it is for one shot."""

    ball_id: str
    mass_kg: float
    radius_m: float
    stiffness_n_m: float
    friction_scale: float
    drag_scale: float
    seat_m: float
    side_m_s: float


class Rack:
    """Balls come in a shuffled order, all of them before any comes again; each wears as it is used."""

    def __init__(self, seed: int, options: Options) -> None:
        self._seed = seed
        self._options = options
        draws = np.random.default_rng([seed, 1]).standard_normal((RACK, 3)) * options.scatter_scale
        self._draws = np.clip(draws, -3.0, 3.0)
        self._used = [0] * RACK

    def ball(self, shot: int) -> Ball:
        """The ball that shot number `shot` (from 0) will be, as worn as it is now."""
        number = self._number(shot)
        options = self._options
        mass, radius, stiffness = self._draws[number]
        used = self._used[number]
        noise = np.clip(np.random.default_rng([self._seed, 2, shot]).standard_normal(4), -3.0, 3.0)
        friction, seat, side, drag = noise * options.scatter_scale
        warm = max(0.2, 1.0 + options.stiffness_per_c * (options.temperature_c - 20.0))
        return Ball(
            ball_id=f"ball{number + 1:02d}",
            mass_kg=MASS_KG * options.ball_mass_scale * float(1.0 + MASS_SHARE * mass),
            radius_m=RADIUS_M * options.ball_radius_scale * float(1.0 + RADIUS_SHARE * radius)
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
        """The ball of that shot has gone through the wheels."""
        self._used[self._number(shot)] += 1

    def _number(self, shot: int) -> int:
        order = np.random.default_rng([self._seed, 3, shot // RACK]).permutation(RACK)
        return int(order[shot % RACK])


def air_density_kg_m3(options: Options) -> float:
    """Density at the option's temperature, at the same pressure."""
    return options.air_density_kg_m3 * 293.15 / (273.15 + options.temperature_c)


def make_nip(ball: Ball, options: Options, gravity_m_s2: np.ndarray, wind_m_s: np.ndarray) -> mujoco.MjModel:
    """The launcher's wheels and one ball, in the nip's own axes (gravity and wind are given in those).

    Joints in order: lower and upper wheel (positive drives the ball out), then the ball's six. A contact is a spring
    of the foam's stiffness in N/m: with direct solref (-k, -b) and small impedance d MuJoCo gives the force
    m (k r + b dr/dt). Tangentially it gives a traction proportional to slip, at most friction x normal force.
    """
    k_per_s2 = ball.stiffness_n_m / ball.mass_kg
    scale = options.flywheel_inertia_scale
    xml = _scene("nip.xml").format(
        step=NIP_STEP_S, impratio=FRICTION_OVER_NORMAL, lower_z=LOWER_Z_M, upper_z=UPPER_Z_M, lower_r=LOWER_RADIUS_M,
        upper_r=UPPER_RADIUS_M, lower_j=LOWER_INERTIA_KG_M2 * scale, upper_j=UPPER_INERTIA_KG_M2 * scale,
        gear=UPPER_GEAR, mu=FRICTION * ball.friction_scale, k=-k_per_s2, b=-2.0 * DAMPING_RATIO * math.sqrt(k_per_s2),
        bt=-TRACTION_KG_S * ball.friction_scale / ball.mass_kg, d=SOFTNESS, ball=_ball(ball, options))
    return _compiled(xml, options, gravity_m_s2, wind_m_s)


def make_flight(ball: Ball, options: Options) -> mujoco.MjModel:
    """One ball in the air, in field axes: x towards the target, y left, z up."""
    wind_m_s = np.array([options.wind_x_m_s, options.wind_y_m_s, options.wind_z_m_s])
    xml = _scene("flight.xml").format(step=FLIGHT_STEP_S, ball=_ball(ball, options))
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


def _ball(ball: Ball, options: Options) -> str:
    # MuJoCo's drag is C rho A v^2, without the customary half.
    return _scene("ball.xml").format(
        mass=ball.mass_kg, inertia=0.4 * ball.mass_kg * ball.radius_m**2, radius=ball.radius_m,
        blunt=0.5 * options.drag_coefficient * ball.drag_scale, angular=options.spin_drag_coefficient,
        magnus=options.magnus_coefficient)


@cache
def _scene(name: str) -> str:
    return (files("truearc.sim.world") / "scenes" / name).read_text(encoding="utf-8")
