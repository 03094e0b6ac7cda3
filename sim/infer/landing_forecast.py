"""Forecasts of where balls come down at an opening that faces up, made from a belief before the shot.

The miss along and the miss across are normal, to first order, by what scatters from shot to shot, by the sensors'
noise and by the uncertainty of the belief; slopes are those of the fit. Shots that barely reach the rim are mixtures
over the height of their highest point, as in the likelihood.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from truearc.robot.config.rig_spec import Rig
from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.infer.belief import Belief
from truearc.sim.infer.launcher import Launcher
from truearc.sim.infer.likelihood import linearization
from truearc.sim.infer.likelihood.data import take_in
from truearc.sim.infer.likelihood.layout import lay_out
from truearc.sim.infer.likelihood.noise import FLOOR_M
from truearc.sim.infer.likelihood.outcomes import Outcomes
from truearc.sim.infer.likelihood.score_table import Array
from truearc.sim.infer.track_forecast import doubt_of

TOP = linearization.TOP


class Landings(NamedTuple):
    """Of the n shots with a launch and a distance (their `rows`): mean and standard deviation of the miss along in m,
    its derivative by the log of the exit speed, whether the ball of the mean launch comes down through the plane, and
    the observations there."""

    rows: Int[Array, " n"]
    mean_m: Float[Array, " n"]
    spread_m: Float[Array, " n"]
    per_log_speed: Float[Array, " n"]
    reached: Bool[Array, " n"]
    seen: Outcomes


def forecast_landings(rig: Rig, belief: Belief, shots: Shots, *, led: bool = False, wider: float = 1.0) -> Landings:
    """Forecast each shot from its wheel speeds (or motor_ratio), hood_deg and distance_m.

    Args:
        rig: Launcher, sensors' noise, and a target that faces up.
        belief: Coefficients, scatter and covariance; without a scatter, the usual one counts.
        shots: Settings; other columns are ignored.
        led: The robot aims beside the target by the drift, so that the mean miss across is none.
        wider: Times the spread.
    """
    settings = replace(shots, texts={"outcome": ("miss",) * len(shots)})
    data = take_in(Dataset("", rig, settings), belief.curves, fewest=1)
    layout = replace(lay_out(data, tuple(belief.coefficients), None, belief.catalogue, belief), steady=True)
    model = Launcher(data, layout).shared_only()
    point, inputs = model.believed(), len(model.layout.inputs)
    flown = linearization.fly(data, model.layout, point)
    plane, slopes = np.asarray(flown.seen.plane), np.nan_to_num(flown.slopes.plane)
    sd = np.sqrt(linearization.variance_of(data, point.log_scatter))[:, None, :model.layout.chain.deviates]
    by = np.concatenate([slopes[..., inputs:] * sd, slopes[..., :inputs] @ doubt_of(model, belief, False)], axis=2)
    rise = linearization.rise_of(wider * by, plane[:, TOP], flown.fall_s)
    by[:, 0] -= np.nan_to_num(rise[:, [2]]) * by[:, TOP]
    spread = wider * np.sqrt((by[:, :2]**2).sum(2) + FLOOR_M**2)
    across = np.stack([plane[:, 1] * (not led), spread[:, 1]], axis=1)
    reached = np.asarray(flown.seen.near) & (plane[:, TOP] > 0.0)
    return Landings(data.rows, plane[:, 0], spread[:, 0], slopes[:, 0, inputs], reached,
                    data.seen.at(plane, across, rise))
