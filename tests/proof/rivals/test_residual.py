"""Learners of residuals on residuals whose law is known."""

from functools import partial

import numpy as np
import pytest

from truearc.sim.discover.detect.covariates import Covariate
from truearc_proof.rivals.residual import Process, Trees, cross_validate, gain_of_each, names_of, table_of

N, NOISE = 150, 0.1
LEARNERS = {"gp": Process, "boosted": partial(Trees, 0)}


def made(signal: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """(covariates [N, 4], residuals [N, 3]): the third coordinate is a sine of the second covariate."""
    rng = np.random.default_rng(seed)
    table, residuals = rng.uniform(-1.7, 1.7, (N, 4)), NOISE * rng.normal(size=(N, 3))
    residuals[:, 2] += signal * np.sin(2.0 * table[:, 1])
    return table, residuals


@pytest.mark.parametrize("name", LEARNERS)
def test_a_sine_of_one_covariate_is_learnt_and_leant_on(name: str) -> None:
    table, residuals = made(0.5)
    foretold = cross_validate(table, residuals, LEARNERS[name])
    left = np.std(residuals[:, 2] - foretold[:, 2])
    assert gain_of_each(residuals, foretold).mean() > 0.2
    assert left < {"gp": 1.3, "boosted": 2.2}[name] * NOISE      # of 0.36 before
    assert LEARNERS[name]().fit(table, residuals).leaning().argmax() == 1


@pytest.mark.parametrize("name", LEARNERS)
def test_noise_about_nothing_is_not_foretold(name: str) -> None:
    gains = [gain_of_each(made(0.0, seed)[1], cross_validate(*made(0.0, seed), LEARNERS[name])).mean()
             for seed in range(2)]
    assert max(gains) < 0.02


def test_gain_is_the_share_of_squared_error() -> None:
    residuals = np.array([[1.0, 2.0, 3.0], [-1.0, -2.0, -3.0]])
    np.testing.assert_allclose(gain_of_each(residuals, residuals), 1.0)
    np.testing.assert_allclose(gain_of_each(residuals, np.zeros_like(residuals)), 0.0)
    np.testing.assert_allclose(gain_of_each(residuals, 0.5 * residuals), 0.75)


@pytest.mark.parametrize(("column", "terms"), [("temperature_c", ("air_density",)),
                                               ("shots_of_ball", ("drag_wear", "ball_wear")),
                                               ("battery_v", ("battery_sag",)), ("distance_m", ())])
def test_only_covariates_that_terms_follow_are_named(column: str, terms: tuple[str, ...]) -> None:
    covariates = [Covariate(((name, np.zeros(3)),)) for name in ("hood_deg", column)]
    assert names_of(covariates, np.array([0.1, 0.7])) == terms


def test_unknown_covariates_stand_at_their_mean() -> None:
    table = table_of([Covariate((("a", np.array([1.0, np.nan, 3.0])),)), Covariate((("b", np.ones(3)),))], np.arange(3))
    np.testing.assert_allclose(table, [[-1.0, 0.0], [0.0, 0.0], [1.0, 0.0]])
