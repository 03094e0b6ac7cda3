"""The worlds' law of motion written a second time, scalar and in SI, for SciPy's DOP853."""

import math

import numpy as np
from scipy.integrate import solve_ivp

RADIUS, MASS, RHO, G = 0.0889, 0.14, 1.2, 9.81
VOLUME = 4.0 / 3.0 * math.pi * RADIUS**3


def acceleration(t, velocity, spin, world, density=RHO, used=0.0):
    """Of one ball; spin [3] in rad/s at the exit."""
    e = world.amount
    wind = np.array([e("wind_x"), e("wind_y"), e("wind_z")])
    w = velocity - wind
    speed = np.linalg.norm(w)
    omega = np.asarray(spin) * math.exp(-e("spin_decay") * t)
    s = RADIUS * np.linalg.norm(omega) / speed
    cd = (world.cd * (speed / 10.0)**e("drag_power") * (1.0 + e("drag_wear") * used)
          * (1.0 + e("drag_reynolds") * (speed / 10.0 - 1.0))
          * (1.0 + e("drag_crisis") / (1.0 + math.exp(9.0 - speed))) + e("spin_drag") * s**2)
    cl = world.lift_slope * s / (1.0 + e("lift_saturation") * s)
    pressure = 0.5 * density * math.pi * RADIUS**2 * speed**2
    # the part of the spin along the way through the air lifts nothing
    lift = cl * pressure * np.cross(omega, w) / (np.linalg.norm(omega) * speed) if np.any(omega) else 0.0 * w
    force = lift - cd * pressure * w / speed + np.array([0.0, 0.0, G * (e("buoyancy") * RHO * VOLUME - MASS)])
    return force / (MASS + e("added_mass") * 0.5 * RHO * VOLUME)


def fly_to(distance, start, velocity, spin, world, density=RHO, used=0.0):
    """(height, time) where one ball crosses x = distance, and the dense solution."""
    def plane(t, y):
        return y[0] - distance

    plane.terminal = True
    rate = lambda t, y: np.concatenate([y[3:], acceleration(t, y[3:], spin, world, density, used)])  # noqa: E731
    solved = solve_ivp(rate, (0.0, 6.0), np.concatenate([start, velocity]), "DOP853", rtol=1e-10, atol=1e-11,
                       events=plane, dense_output=True)
    return solved.y_events[0][0][2], solved.t_events[0][0], solved.sol
