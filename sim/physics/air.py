"""Numbers of a rig that several laws of the air contain: how much the air weighs against the ball."""

import math

from truearc.robot.config.rig_spec import Rig


def drag_per_m(rig: Rig) -> float:
    """Return rho A / 2 m in 1/m: the deceleration per drag coefficient and speed squared (the paper's Eq. 3)."""
    return 0.5 * (math.pi * rig.ball.radius_m**2) * rig.air.density_kg_m3 / rig.ball.mass_kg


def displaced_share(rig: Rig) -> float:
    """Return the mass of the air that the ball displaces as a share of the ball's."""
    return rig.air.density_kg_m3 * (4.0 / 3.0 * math.pi * rig.ball.radius_m**3) / rig.ball.mass_kg
