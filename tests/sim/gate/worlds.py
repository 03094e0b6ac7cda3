"""Shots of a launcher that the belief has slightly wrong, flown by SciPy's DOP853 and not by truearc.sim.physics."""

from tests.sim.infer.independent import Truth, make_dataset
from truearc.sim.data.dataset import Dataset
from truearc.sim.infer.belief import point_belief

BELIEF = point_belief({"drag": {"cd": 0.55}, "magnus": {"cl": 0.05}, "exit_efficiency": {"loss": 0.22}})
TRUTH = Truth(0.5, 0.06, 0.25, 0.015, 0.4)


def make_shots(seed: int, count: int) -> Dataset:
    return make_dataset(seed, count, TRUTH, side=True)
