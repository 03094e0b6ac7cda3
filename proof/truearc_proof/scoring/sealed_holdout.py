"""Sealed hold-out shots of a concealed world, which no solver gets: errors of a belief's forecasts of them.

They follow from the sealed world alone (another season of the same robot, with balls and random effects of its own), so
that the seal commits to them as well.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from truearc.sim.data.dataset import Dataset
from truearc.sim.data.shot_conditions import circumstances_of
from truearc.sim.infer.belief import Belief, along
from truearc.sim.infer.likelihood.data import every_column
from truearc.sim.physics.simulate import opening_of, predict
from truearc_proof.truth.generate import play
from truearc_proof.truth.world import make_world
from truearc_proof.worlds.data_quality import dirty_plan
from truearc_proof.worlds.generate_data import play_robot
from truearc_proof.worlds.sampling_plan import MUJOCO, NUMPY, Drawn

APART = 1 << 41                       # of its seeds from those of the world's own season, and of its follow-up's


class Unseen(NamedTuple):
    """The season as the robot's sensors have it, and how high above the opening's centre each ball came [n], in m; nan
    where it never got to the plane."""

    dataset: Dataset
    above_m: np.ndarray


def shoot_unseen(drawn: Drawn) -> Unseen | None:
    """Shoot the hold-out season; None for an external world, which only its maker can shoot."""
    seed = drawn.seed + APART
    if drawn.engine == NUMPY:
        world = make_world(drawn.effects, drawn.level, drawn.shots, drawn.seed, drawn.dirt)
        season = play(replace(world, seed=seed))
        return Unseen(season.dataset, season.flown.arrival.height_m - _centre_m(season.dataset)
                      - world.amount("target_height"))
    if drawn.engine != MUJOCO:
        return None
    played = play_robot(drawn, seed, dirty_plan(drawn.dirt, seed, drawn.shots))
    height_m = np.array([np.nan if one.z_m is None else one.z_m for one in played.results])
    return Unseen(played.dataset, height_m - _centre_m(played.dataset))


def off_m(belief: Belief, unseen: Unseen) -> float:
    """Return the RMS error in m of the belief's forecasts of heights above the opening's centre.

    A ball that it lets fall short is forecast at the floor. Shots that truly fell short do not count.
    """
    dataset, n = unseen.dataset, len(unseen.dataset.shots)
    around = along(belief.curves, circumstances_of(dataset), every_column(dataset), n)
    centre_m = opening_of(dataset.facts, belief.coefficients, None, around).centre_m
    height_m = np.asarray(predict(dataset.facts, belief.coefficients, dataset.shots, circumstances=around).height_m)
    told_m = np.where(np.isfinite(height_m), height_m, 0.0) - centre_m
    return float(np.sqrt(np.nanmean((unseen.above_m - told_m)**2)))


def _centre_m(dataset: Dataset) -> float:
    """Of the opening, by rig.toml."""
    assert dataset.facts.target is not None
    return dataset.facts.target.centre_height_m
