"""What takes long: the sampler against the profile, a real launcher's tracks. Coverage is benchmarks/coverage.py's."""

import numpy as np
import pytest

from tests.sim.infer.independent import make_dataset
from tests.sim.physics.rigs import GUPPY
from tests.sim.thin import thinned
from truearc.cli.main import main
from truearc.sim.data.dataset import load_dataset
from truearc.sim.infer.map_fit import fit_map
from truearc.sim.infer.posterior import FEWEST_EFFECTIVE, SPLIT_R_HAT, sample, save_draws
from truearc.sim.infer.profile import profile_interval

pytestmark = pytest.mark.slow
TERMS = ("drag", "magnus", "exit_efficiency")


def test_the_sampler_agrees_with_the_profile(tmp_path):
    """Measured heights make the posterior near normal: there both must say the same. The elevation's scatter is not:
    24 shots hardly know it, and whether 300 draws of it count as mixed depends on chance and on the processor."""
    fit = fit_map(GUPPY, make_dataset(11, 24, height=True), TERMS)
    drawn = sample(fit, 300, seed=1)
    known = ("exit_efficiency.loss", "drag.cd", "magnus.cl", "scatter.speed")
    assert (drawn.r_hat[:len(known)] < SPLIT_R_HAT).all() and (drawn.effective[:len(known)] > FEWEST_EFFECTIVE).all()
    assert drawn.divergent < 10
    for index, name in enumerate(known):
        found = profile_interval(fit, name)
        assert drawn.names[index] == name
        low, high = np.quantile(drawn.draws[:, index], [0.05, 0.95])
        width = found.high90 - found.low90
        assert low == pytest.approx(found.low90, abs=0.15 * width)
        assert high == pytest.approx(found.high90, abs=0.15 * width)
    np.testing.assert_array_equal(sample(fit, 300, seed=1).draws, drawn.draws)
    assert not np.array_equal(drawn.draws[:150], drawn.draws[150:])         # two chains, each with a seed of its own
    save_draws(tmp_path / "p.npz", drawn)
    with np.load(tmp_path / "p.npz") as saved:
        assert tuple(saved["names"]) == drawn.names
        np.testing.assert_array_equal(saved["draws"], drawn.draws)


@pytest.mark.data
def test_a_real_launchers_tracks(data_dir, tmp_path):
    """Table-tennis launches whose elevation was not recorded: the wheels give the spin, the tracks all else.

    A smooth ball at these speeds has a drag coefficient of 0.4 to 0.5, and the cameras were good to millimetres.
    """
    files = [str(data_dir / "real" / name) for name in ("mpi_launches.csv", "mpi_tracks.csv")]
    assert main(["import", "mpi", *files, "-o", str(tmp_path / "mpi")]) == 0
    dataset = thinned(load_dataset(tmp_path / "mpi"))
    fit = fit_map(dataset.facts, dataset, ("drag", "magnus"))
    assert fit.converged
    assert 0.36 < fit.values["drag.cd"] < 0.5
    assert fit.values["magnus.cl"] > 0.0
    assert fit.values["tracks.noise_m"] < 0.006
