"""The two MuJoCo models of `scenes/`: the nip (a ball between two geared wheels) and free flight."""

import math
from functools import cache
from importlib.resources import files

import mujoco
import numpy as np

from truearc.sim.world.options import Options
from truearc.sim.world.parts.balls import RADIUS_M, Ball

LOWER_RADIUS_M = 0.0508
UPPER_RADIUS_M = 0.0349
UPPER_GEAR = 0.5625
COMPRESSION_M = 0.046
GAP_M = 2.0 * RADIUS_M - COMPRESSION_M
LOWER_INERTIA_KG_M2 = 2.2e-3      # wheel, shaft, belt and both rotors
UPPER_INERTIA_KG_M2 = 1.3e-3
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
