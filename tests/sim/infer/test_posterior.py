"""Draws of the posterior against the profile; a real launcher's tracks.."""

import dataclasses

import numpy as np
import pytest

from tests.sim.infer.independent import make_dataset
from tests.sim.thin import thinned
from truearc.cli.main import main
from truearc.sim.data.files import load_dataset
from truearc.sim.infer.map_fit import fit_map
from truearc.sim.infer.posterior import sample, save_draws
from truearc.sim.infer.profile import profile_interval

TERMS = ("drag", "magnus", "exit_efficiency")


def test_draws_agree_with_the_profile(tmp_path):
    """Measured heights make the posterior near normal: there both must say the same, but for the elevation's scatter,
    which 24 shots hardly know."""
    fit = fit_map(make_dataset(11, 24, height=True), TERMS)
    drawn = sample(fit, 2000, seed=1)
    assert drawn.converged and drawn.effective > 1000
    for name in ("exit_efficiency.loss", "drag.cd", "magnus.cl", "scatter.speed"):
        found = profile_interval(fit, name)
        low, high = np.quantile(drawn.draws[:, drawn.names.index(name)], [0.05, 0.95])
        width = found.high90 - found.low90
        assert low == pytest.approx(found.low90, abs=0.2 * width)
        assert high == pytest.approx(found.high90, abs=0.2 * width)
    np.testing.assert_array_equal(sample(fit, 2000, seed=1).draws, drawn.draws)
    assert not np.array_equal(sample(fit, 2000, seed=2).draws, drawn.draws)
    save_draws(tmp_path / "p.npz", drawn)
    with np.load(tmp_path / "p.npz") as saved:
        assert tuple(saved["names"]) == drawn.names
        np.testing.assert_array_equal(saved["draws"], drawn.draws)


def test_draws_that_a_few_proposals_make_say_so():
    fit = fit_map(make_dataset(11, 24, height=True), TERMS)
    assert not dataclasses.replace(sample(fit, 50, seed=1), effective=50.0).converged


@pytest.mark.slow
@pytest.mark.data
def test_a_real_launchers_tracks(data_dir, tmp_path):
    """Table-tennis launches whose elevation was not recorded: the wheels give the spin, the tracks all else.

    A smooth ball at these speeds has a drag coefficient of 0.4 to 0.5, and the cameras were good to millimetres; its
    importer says that they were calibrated.
    """
    files = [str(data_dir / "real" / name) for name in ("mpi_launches.csv", "mpi_tracks.csv")]
    assert main(["import", "mpi", *files, "-o", str(tmp_path / "mpi")]) == 0
    dataset = thinned(load_dataset(tmp_path / "mpi"))
    fit = fit_map(dataset, ("drag", "magnus"))
    assert fit.converged
    assert 0.36 < fit.values["drag.cd"] < 0.5
    assert fit.values["magnus.cl"] > 0.0
    assert not fit.at_limit
