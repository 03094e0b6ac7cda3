"""`fit` and `discover` make one and the same belief of one dataset, real ones among them."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import truearc as ta
from truearc.sim.data.dataset import Dataset
from truearc.sim.discover.investigate import discover
from truearc.sim.infer.launcher import coefficients_of, covariance_of, scatter_of
from truearc_proof.importers.set_points import import_254, import_971
from truearc_proof.truth.generate import shoot
from truearc_proof.truth.world import make_world

TERMS = ("gravity", "drag", "magnus", "exit_efficiency")
REAL: dict[str, Callable[[Path], Dataset]] = {
    "971": lambda home: import_971(home / "frc971_wheel_to_ball_speed.csv"),
    "254": lambda home: import_254(home / "frc_shot_tables.csv")}


def _check(dataset: Dataset, terms: tuple[str, ...]) -> None:
    """The belief that `fit` writes is what discovery starts from, and adopts where it finds nothing."""
    by_fit = ta.fit(dataset, terms).belief
    found = discover(dataset, terms, false_alarm=0.0)         # nothing is missing surely enough to be named
    assert found.fitted is not None
    evidence, among = found.fitted.scores.shared_only(), found.catalogue
    assert coefficients_of(evidence, terms, among) == {
        name: pytest.approx(values, rel=1e-9, abs=1e-12) for name, values in by_fit.coefficients.items()}
    assert scatter_of(evidence) == pytest.approx(by_fit.scatter, rel=1e-9)
    names, covariance = covariance_of(evidence, among)
    assert names == by_fit.names
    np.testing.assert_allclose(covariance, by_fit.covariance, rtol=1e-6, atol=1e-15)


@pytest.mark.slow
@pytest.mark.parametrize(("level", "seed"), [("L0", 3), ("L1", 4), ("L2", 5)])
def test_made_shots_have_one_belief(level: str, seed: int) -> None:
    _check(shoot(make_world({}, level, 32, seed)), TERMS)


@pytest.mark.slow
@pytest.mark.data
@pytest.mark.parametrize("name", list(REAL))
def test_real_shots_have_one_belief(data_dir: Path, name: str) -> None:
    dataset = REAL[name](data_dir / "real")
    _check(dataset, tuple(dataset.rig.believe.terms))
