"""The paper's Eq. 1-14 again, from the paper alone: angles in the plane, SciPy's DOP853. No import of
truearc.sim.physics."""

import math
from typing import NamedTuple

from scipy.integrate import solve_ivp

MASS_KG, RADIUS_M, DENSITY_KG_M3, GRAVITY_M_S2 = 0.14, 0.0889, 1.2, 9.81
FREE_SPEED_RAD_S, LOWER_RADIUS_M, UPPER_RADIUS_M, UPPER_GEAR = 594.0, 0.0508, 0.0349, 9 / 16
RELEASE_M = 0.75


class Reference(NamedTuple):
    height_m: float                   # nan where not reached
    time_s: float
    end: str                          # "plane", "floor", "turn" or "aloft"
    steepness: float                  # |tan| of the flight angle at the plane: how far an error in x moves the height


def exit_of(motor_ratio: float) -> tuple[float, float]:
    """Eq. 11 and 12: (v0 in m/s, s in rev/s)."""
    lower_m_s = motor_ratio * FREE_SPEED_RAD_S * LOWER_RADIUS_M
    upper_m_s = motor_ratio * FREE_SPEED_RAD_S * UPPER_GEAR * UPPER_RADIUS_M
    return (upper_m_s + lower_m_s) / 2, (lower_m_s - upper_m_s) / (2 * math.pi * RADIUS_M)


def integrate(distance_m, motor_ratio, hood_deg, cd, cl, release_m=RELEASE_M, limit_s=120.0) -> Reference:
    """Fly one configuration; whichever comes first of plane, floor and turning back ends it."""
    v0, spin = exit_of(motor_ratio)
    area = math.pi * RADIUS_M**2

    def rates(_, state):
        _, _, vx, vy = state
        v = math.hypot(vx, vy)
        theta = math.atan2(vy, vx)
        lift = cl * 4 / 3 * (4 * math.pi**2 * RADIUS_M**3 * spin * DENSITY_KG_M3 * v) / MASS_KG
        drag = cd / 2 * area * v**2 * DENSITY_KG_M3 / MASS_KG
        return [vx, vy, -(lift * math.sin(theta) + drag * math.cos(theta)),
                lift * math.cos(theta) - drag * math.sin(theta) - GRAVITY_M_S2]

    def event(index, level, direction):
        def crosses(_, state):
            return state[index] - level
        crosses.terminal, crosses.direction = True, direction
        return crosses

    theta0 = math.radians(hood_deg)
    start = [0.0, release_m, v0 * math.cos(theta0), v0 * math.sin(theta0)]
    if start[2] <= 0:
        return Reference(math.nan, math.nan, "turn", math.nan)
    events = [event(0, distance_m, 1), event(1, 0.0, -1), event(2, 0.0, -1)]
    done = solve_ivp(rates, (0.0, limit_s), start, method="DOP853", rtol=1e-11, atol=1e-12, events=events,
                     max_step=0.05)
    for name, times, states in zip(("plane", "floor", "turn"), done.t_events, done.y_events, strict=True):
        if len(times):
            reached = name == "plane"
            _, y, vx, vy = states[0]
            return Reference(y if reached else math.nan, times[0], name, abs(vy / vx) if reached else math.nan)
    return Reference(math.nan, math.nan, "aloft", math.nan)
