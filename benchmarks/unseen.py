"""Forecast error of a belief on a hold-out MuJoCo session."""

import numpy as np

from truearc.robot.config.rig_spec import Rig
from truearc.sim.infer.belief import Belief, before_the_shot
from truearc.sim.physics.simulate import predict
from truearc.sim.world.season import Season


def heights_m(season: Season) -> np.ndarray:
    """Where each ball crossed the target's plane [n], in m above the floor; nan where it fell before it."""
    return np.array([np.nan if one.z_m is None else one.z_m for one in season.results])


def off_m(facts: Rig, belief: Belief, season: Season) -> float:
    """Return the RMS error in m of the heights forecast by the belief from each shot's readings."""
    shots = season.dataset.shots
    around = before_the_shot(belief.curves, facts, shots)
    told = np.asarray(predict(facts, belief.coefficients, shots, circumstances=around).height_m)
    return float(np.sqrt(np.nanmean((heights_m(season) - told)**2)))
