"""The picture of a table of set points."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from truearc.sim.aim.snippets import RPM
from truearc.sim.report import new_panels


def draw_aim(rows: Sequence[Any], refused: Sequence[tuple[float, str]]) -> Figure:
    """Hood angle, motor speed with the band in which half of the points are left, and probabilities, over distance."""
    figure, (hood, speed, chance) = new_panels(7.0, 7.0, 3, sharex=True)
    x = np.array([row.distance_m for row in rows])
    hood.plot(x, [row.hood_deg for row in rows], "o-", color="#1b5e9b", markersize=3)
    hood.set_ylabel("hood, deg")
    speed.fill_between(x, [row.slowest_rad_s * RPM for row in rows], [row.fastest_rad_s * RPM for row in rows],
                       color="#9cc4e4", label="at least half of the points")
    speed.plot(x, [row.motor_rad_s * RPM for row in rows], "o-", color="#1b5e9b", markersize=3, label="set point")
    speed.set_ylabel("motor, rpm")
    speed.legend(frameon=False)
    threes = [row.p_three for row in rows]
    chance.plot(x, [row.p_two for row in rows], color="#d9822b", label="two or three points" if any(threes) else "hit")
    if any(threes):
        chance.plot(x, threes, color="#2b8a3e", label="three points")
    chance.set(ylim=(0.0, 1.02), ylabel="probability", xlabel="distance, m")
    chance.legend(frameon=False)
    for distance_m, _ in refused:
        for axes in (hood, speed, chance):
            axes.axvline(distance_m, color="#b02a37", linewidth=1, linestyle=":")
    return figure
