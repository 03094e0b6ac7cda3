"""The grid's coarse best pair: one more start for a maximum a posteriori fit."""

from truearc.robot.config.rig_spec import Rig
from truearc.robot.config.schema import InputError
from truearc.sim.data.dataset import Dataset
from truearc.sim.paper.grid_fit import fit_grid
from truearc.sim.physics.simulate import THREE

GRID_STEP = 0.05


def grid_start(rig: Rig, dataset: Dataset) -> dict[str, dict[str, float]]:
    """Return {term: {parameter: value}} of the coarse grid's best pair; empty where the grid cannot run."""
    if rig.target is None or THREE not in dataset.shots.text("outcome"):
        return {}
    try:
        return fit_grid(rig, dataset.shots, GRID_STEP).coefficients
    except InputError:
        return {}
