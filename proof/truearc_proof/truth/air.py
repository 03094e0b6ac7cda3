"""What pulls and pushes on the balls in the air."""

import math

import numpy as np

from truearc_proof.truth.flight import Law
from truearc_proof.truth.launch import Launch, air_density
from truearc_proof.truth.plan import Floats, Plan
from truearc_proof.truth.world import World

REFERENCE_M_S = 10.0
CRISIS_M_S = 9.0


def start_of(launch: Launch) -> tuple[Floats, Floats, Floats]:
    """Position, velocity and spin vector [3, n] at the exit; backspin turns about the right-hand side."""
    up, left = np.radians(launch.elevation_deg), np.radians(launch.azimuth_deg)
    zero = np.zeros_like(up)
    velocity = launch.speed_m_s * np.stack([np.cos(up) * np.cos(left), np.cos(up) * np.sin(left), np.sin(up)])
    spin = launch.backspin_rad_s * np.stack([np.sin(left), -np.cos(left), zero])
    return np.stack([zero, zero, launch.height_m]), velocity, spin


def make_law(world: World, plan: Plan, spin_rad_s: Floats, gust_from_s: Floats) -> Law:
    """Acceleration of n balls: weight, drag, lift of the spin that is left, and whatever is hidden.

    spin_rad_s [3, n] at the exit; gust_from_s [n]: when the late gust, if there is one, sets in.
    """
    ball = world.facts.ball
    amount = world.amount
    per_m = air_density(world, plan) * (0.5 * math.pi * ball.radius_m**2 / ball.mass_kg)
    cd = world.cd * drag_factor(world, plan)
    rim_m_s = ball.radius_m * spin_rad_s
    displaced = world.facts.air.density_kg_m3 * (4.0 / 3.0) * math.pi * ball.radius_m**3 / ball.mass_kg
    steady = np.zeros_like(spin_rad_s)
    steady[1] = amount("seam_force") * (plan.temperature_c - 20.0) / 10.0
    steady[2] = world.facts.world.gravity_m_s2 * (amount("buoyancy") * displaced - 1.0)
    heavier = 1.0 + amount("added_mass") * 0.5 * displaced
    wind = np.array([[amount("wind_x")], [amount("wind_y")], [amount("wind_z")]])

    def law(t: float, velocity: Floats) -> Floats:
        through = velocity - wind
        if amount("late_gust"):
            through = through - np.stack([amount("late_gust") * (t >= gust_from_s), *np.zeros((2, len(gust_from_s)))])
        speed = np.sqrt(np.einsum("in,in->n", through, through))
        rim = rim_m_s * math.exp(-amount("spin_decay") * t)
        share = np.sqrt(np.einsum("in,in->n", rim, rim)) / speed
        drag = per_m * speed * (cd * _speed_factor(world, speed) + amount("spin_drag") * share**2)
        lift = per_m * world.lift_slope / (1.0 + amount("lift_saturation") * share)
        pulled: Floats = (steady - drag * through + lift * _cross(rim, through)) / heavier
        return pulled

    return law


def drag_factor(world: World, plan: Plan) -> Floats:
    """What each ball's own drag is, relative to an ordinary ball's."""
    spread = 0.05 if "balls" in world.dirt else 0.0
    return ((1.0 + world.amount("drag_wear") * plan.used) * (1.0 + spread * plan.drag_of_ball)
            * (1.0 + world.amount("supplier_drag") * plan.supplier))


def _speed_factor(world: World, speed_m_s: Floats) -> Floats | float:
    slope, step = world.amount("drag_reynolds"), world.amount("drag_crisis")
    factor: Floats | float = 1.0 + slope * (speed_m_s / REFERENCE_M_S - 1.0) if slope else 1.0
    return factor * (1.0 + step / (1.0 + np.exp(CRISIS_M_S - speed_m_s))) if step else factor


def _cross(a: Floats, b: Floats) -> Floats:
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
