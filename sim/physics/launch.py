"""Wheels to ball: exit speed and spin (the paper's Eq. 11 and 12), and no-slip for any number of wheels."""

import math
from typing import Any, NamedTuple

import numpy as np

from truearc.robot.config.rig_spec import Rig


class Exit(NamedTuple):
    """The ball as it leaves; numpy or JAX arrays of one shape."""

    speed_m_s: Any
    elevation_rad: Any                # above horizontal
    spin_rev_s: Any                   # backspin positive
    above_m: Any = 0.0                # of the rig's release height

    def take(self, rows: Any) -> "Exit":
        """Those lanes; a number that all lanes share stays as it is."""
        return Exit(*(part if np.ndim(part) == 0 else part[rows] for part in self))


def exit_opposed(rig: Rig, upper_m_s: Any, lower_m_s: Any, hood_deg: Any) -> Exit:
    """Eq. 11 and 12 from the surface speeds of the two wheels."""
    spin_rev_s = (lower_m_s - upper_m_s) / (2.0 * math.pi * rig.ball.radius_m)
    return Exit((upper_m_s + lower_m_s) / 2.0, hood_deg * (math.pi / 180.0), spin_rev_s)


def exit_no_slip(rig: Rig, wheel_surface_m_s: Any) -> tuple[Any, Any]:
    """Exit speed and spin of a ball that rolls on all wheels without slip, in least squares.

    wheel_surface_m_s: [n, wheels] in the rig's order, positive drives the ball out. Returns speed [n] in m/s and spin
    [n, 3] in rad/s, right-handed about (exit direction, left, up across the exit direction); backspin is about -left.
    Solves v + R (w x n_i).e = u_i. Among solutions it takes the smallest v^2 + (R w)^2: spin along the exit
    direction is 0, and a lone wheel rolls the ball as if against a wall opposite to it.
    """
    surface_m_s = np.asarray(wheel_surface_m_s, dtype=float)
    clock_rad = np.radians([wheel.clock_deg for wheel in rig.launcher.wheel])
    # n_i = cos(clock) up - sin(clock) left, so (n_i x e) = cos(clock) left + sin(clock) up
    rows = np.stack([np.ones_like(clock_rad), np.cos(clock_rad), np.sin(clock_rad)], axis=1)
    solved = surface_m_s @ np.linalg.pinv(rows, rcond=1e-9).T
    spin_rad_s = np.concatenate([np.zeros_like(solved[:, :1]), solved[:, 1:] / rig.ball.radius_m], axis=1)
    return solved[:, 0], spin_rad_s


def is_opposed(rig: Rig) -> bool:
    """Whether the paper's Eq. 11 and 12 apply to this rig."""
    return sorted(round(wheel.clock_deg % 360.0, 6) for wheel in rig.launcher.wheel) == [0.0, 180.0]
