"""ODR-BINDy on flights whose law is known, against a general least-squares solver and closed forms."""

from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import multivariate_normal

from tests.proof.rivals.made import KNOWN, constant
from truearc_proof.rivals import odr_bindy
from truearc_proof.rivals.claim import usual_of


def test_a_push_is_named_with_an_interval_that_holds_it() -> None:
    claim = odr_bindy.claim_of(constant(2.0, noise_m=0.003), KNOWN)
    usual = usual_of("buoyancy")
    assert claim.says_something and claim.names == ("buoyancy", "added_mass")
    assert claim.figures["low90"] < 2.0 * usual < claim.figures["high90"] < 2.3 * usual
    assert claim.before_m is not None and claim.after_m is not None and claim.after_m < 0.5 * claim.before_m


def test_nothing_is_said_of_vacuum() -> None:
    claim = odr_bindy.claim_of(constant(0.0, noise_m=0.003), KNOWN)
    assert not claim.says_something and claim.names == () and claim.after_m == claim.before_m


def test_lost_frames_and_an_unmeasured_axis_do_not_matter() -> None:
    flights = constant(2.0, noise_m=0.003)
    real, position_m = flights.real.copy(), flights.position_m * [1.0, 0.0, 1.0]
    real[::2, 15:18] = False
    assert odr_bindy.claim_of(replace(flights, real=real, position_m=position_m), KNOWN).names[:1] == ("buoyancy",)


def test_the_optimum_is_that_of_a_general_solver(monkeypatch) -> None:
    """Positions and coefficients together, for a drag that is strong enough to bend the problem."""
    monkeypatch.setattr(odr_bindy, "choose", lambda square, pull, prior, known: odr_bindy.solve(
        square, pull, prior, np.ones(len(pull), dtype=bool)))
    flights, names, prior = constant(1.0, shots=2, noise_m=0.01), ("drag", "buoyancy"), np.array([0.3, 1.0])
    films, sigma_m = odr_bindy.film(flights), odr_bindy.noise_of(flights)
    linear = odr_bindy.linearise_at_best(flights, names, prior, 0)
    found = odr_bindy.solve(linear.square.sum(0), linear.pull.sum(0), prior, np.ones(2, dtype=bool))

    def misfit(at: np.ndarray) -> np.ndarray:
        weights, x = at[:2], at[2:].reshape(films.position_m.shape)
        h = films.step_s[:, None, None]
        law = odr_bindy._library(flights, films, names, (x[:, 2:] - x[:, :-2]) / (2.0 * h)) @ weights
        miss = np.diff(x, 2, axis=1) / h**2 - odr_bindy.laws.gravity(flights.facts) - law
        return np.concatenate([((x - films.position_m) / sigma_m).ravel(), miss.ravel() / odr_bindy.SOFT_M_S2,
                               weights / prior])

    direct = least_squares(misfit, np.concatenate([[0.0, 0.0], films.position_m.ravel()]), x_scale="jac")
    np.testing.assert_allclose(found.weights, direct.x[:2], atol=2e-3 * found.sd.min())
    sd = np.sqrt(np.diag(np.linalg.inv(direct.jac.T @ direct.jac)))[:2]
    np.testing.assert_allclose(found.sd, sd, rtol=0.02)


def test_evidence_of_a_linear_law_is_the_marginal_likelihood() -> None:
    rng = np.random.default_rng(0)
    columns, prior = rng.normal(size=(20, 3)), np.array([10.0, 1.0, 1.0])
    seen = columns @ [2.0, 0.7, 0.0] + rng.normal(size=20)
    evidence, exact = [], []
    for kept in ([True, False, False], [True, True, False], [True, True, True]):
        mask = np.array(kept)
        evidence.append(odr_bindy.solve(columns.T @ columns, columns.T @ seen, prior, mask).evidence)
        spread = (columns[:, mask] * prior[mask]**2) @ columns[:, mask].T + np.eye(20)
        exact.append(multivariate_normal(np.zeros(20), spread).logpdf(seen))
    np.testing.assert_allclose(np.diff(evidence), np.diff(exact))
    best = odr_bindy.choose(columns.T @ columns, columns.T @ seen, prior, 1)
    assert best.evidence == max(evidence)
