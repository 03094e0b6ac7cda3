"""Flipped signs and projected scores, against enumeration, closed forms, invariance and the uniform law."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import kstest, norm

from tests.sim.discover.made import at_least_squares, column, gaussian
from truearc.sim.discover.detect.battery import Judged, Scores, efficient_scores, judge
from truearc.sim.infer.likelihood.score_table import ScoreTable

ALLOWANCE = {"terms": 0.6, "free": 0.3, "pattern": 0.1}


def quiet(done: float, note: str) -> None:
    """No progress."""


def one_test(evidence: ScoreTable) -> Scores:
    n = len(evidence.rows)
    return efficient_scores(evidence, 0, np.ones((n, 1)), np.arange(n), n)


def plain(psi: np.ndarray, kappa: np.ndarray | None = None) -> Scores:
    """Scores of unit information, or kappa, to which nothing was fitted."""
    return Scores(psi, np.ones_like(psi) if kappa is None else kappa, np.ones_like(psi),
                  np.ones(psi.shape[1], dtype=bool))


def judged_of(scores: Scores, draws: int = 999, seed: int = 0, family: list[str] | None = None) -> Judged:
    names = ["terms"] * scores.psi.shape[1] if family is None else family
    return judge(scores, names, ALLOWANCE, draws, seed, quiet)


def test_amplitude_and_gain_are_those_of_least_squares() -> None:
    rng = np.random.default_rng(1)
    x, z = rng.normal(size=40), np.stack([np.ones(40), rng.normal(size=40)], axis=1)
    y = 0.7 * x + z @ [1.0, -2.0] + rng.normal(size=40)
    found = judged_of(one_test(at_least_squares(y, x[:, None], z)), 10)
    whole = np.concatenate([x[:, None], z], axis=1)
    b, rest = np.linalg.lstsq(whole, y, rcond=None)[:2]
    without = np.linalg.lstsq(z, y, rcond=None)[1]
    assert found.amplitude[0] == pytest.approx(b[0], rel=1e-10)
    assert found.gain[0] == pytest.approx(0.5 * float(without[0] - rest[0]), rel=1e-10)


def test_what_the_shared_parameters_explain_is_no_evidence() -> None:
    rng = np.random.default_rng(2)
    z = rng.normal(size=(30, 2))
    assert not one_test(at_least_squares(rng.normal(size=30), z @ [[0.3], [2.0]], z)).kept[0]


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000), tilt=st.floats(-3.0, 3.0))
def test_an_alias_added_to_the_covariate_changes_nothing(seed: int, tilt: float) -> None:
    rng = np.random.default_rng(seed)
    x, z, y = rng.normal(size=(30, 1)), rng.normal(size=(30, 2)), rng.normal(size=30)
    straight, tilted = (one_test(at_least_squares(y, x + part * z[:, :1], z)) for part in (0.0, tilt))
    assert np.allclose(straight.psi, tilted.psi, atol=1e-8)


def test_stretched_scores_have_the_spread_of_errors_that_nothing_was_fitted_to() -> None:
    """Least squares leaves residuals smaller than errors by 1 - leverage; the stretch is its inverse square root."""
    rng = np.random.default_rng(7)
    x, z = rng.normal(size=(20, 1)), rng.normal(size=(20, 3))
    leverage = np.diag(z @ np.linalg.inv(z.T @ z) @ z.T)
    scores = one_test(at_least_squares(rng.normal(size=20), x, z))
    assert np.allclose(scores.stretch[:20, 0], 1.0 / np.sqrt(1.0 - leverage))


def test_a_prior_is_one_more_observation_of_what_it_is_about() -> None:
    """A parameter that other shots measured before: the test is that of all the shots together."""
    rng = np.random.default_rng(8)
    x, z, y = rng.normal(size=(30, 1)), np.ones((30, 1)), rng.normal(size=30)
    known = 0.4, 25.0                                          # the earlier estimate, and its precision
    y_all, x_all, z_all = np.append(y, 5.0 * known[0]), np.append(x, 0.0)[:, None], np.append(z, 5.0)[:, None]
    found = np.linalg.lstsq(np.concatenate([x_all, z_all], axis=1), y_all, rcond=None)[0]
    best = np.linalg.lstsq(z_all, y_all, rcond=None)[0]
    evidence = gaussian(y - z @ best, np.concatenate([x, z], axis=1), (column("t0", "term"), column("s0", "shared")),
                        np.array([known[1]]), known[1] * (known[0] - best))
    scores = one_test(evidence)
    amplitude = scores.psi.sum(0) / scores.kappa.sum(0)
    assert amplitude[0] == pytest.approx(found[0], rel=1e-9)
    residual = y_all - z_all @ best
    apart = x_all[:, 0] - z_all[:, 0] * (z_all[:, 0] @ x_all[:, 0]) / (z_all[:, 0] @ z_all[:, 0])
    assert np.allclose(scores.psi[:, 0], residual * apart)     # the prior's own among them, last
    assert np.allclose(scores.kappa[:, 0], apart**2)


def all_signs(psi: np.ndarray) -> np.ndarray:
    """|score| in units of its spread [2^G, M] of every sign pattern; the first is what was seen."""
    return np.array([np.abs(np.array(signs) @ psi) / np.sqrt((psi**2).sum(0))
                     for signs in itertools.product((1.0, -1.0), repeat=len(psi))])


def test_p_values_alone_in_the_family_and_of_any_are_those_of_all_sign_patterns() -> None:
    rng = np.random.default_rng(3)
    psi, kappa = rng.normal(0.4, 1.0, (9, 4)), rng.uniform(0.5, 2.0, (9, 4))
    family = np.array(["terms", "terms", "terms", "free"])
    every = all_signs(psi)
    found = judged_of(plain(psi, kappa), 20_000, 4, family.tolist())
    assert np.allclose(found.statistic, every[0])
    assert np.allclose(found.p_each, (every >= every[0] - 1e-9).mean(0), atol=0.015)
    # each family's largest, its rank over its share of the allowance, and the smallest of these over all patterns
    weight = {"terms": 0.6 / 0.9, "free": 0.3 / 0.9}
    largest = {name: every[:, family == name].max(1) for name in weight}
    rank = {name: (values >= values[:, None] - 1e-9).mean(1) for name, values in largest.items()}
    least = np.minimum(*(rank[name] / weight[name] for name in weight))
    for name, value in found.families.items():
        assert value == pytest.approx(rank[name][0], abs=0.015)
    assert found.p_any == pytest.approx((least <= least[0] + 1e-12).mean(), abs=0.015)
    for k, name in enumerate(family):
        alone = (largest[name] >= every[0, k] - 1e-9).mean() / weight[name]
        assert found.p_value[k] == pytest.approx((least <= alone + 1e-12).mean(), abs=0.02)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10_000), tests=st.integers(1, 6), shots=st.integers(8, 25))
def test_a_test_is_never_likelier_among_others_than_alone(seed: int, tests: int, shots: int) -> None:
    rng = np.random.default_rng(seed)
    scores = plain(rng.standard_t(3, (shots, tests)), rng.uniform(0.1, 3.0, (shots, tests)))
    family = ["terms" if k % 2 else "free" for k in range(tests)]
    found = judged_of(scores, 199, seed, family)
    assert (found.p_value >= found.p_each - 1.0 / 200.0 - 1e-12).all()
    assert ((found.p_each > 0.0) & (found.p_value <= 1.0)).all()
    assert found.p_any == pytest.approx(found.p_value.min(), abs=1e-12)


def noise_only(rng: np.random.Generator, shots: int) -> Scores:
    """Twelve correlated tests, of nothing at all: heavy tails, unequal shots."""
    size = rng.uniform(0.2, 3.0, shots)[:, None]
    common = rng.standard_t(3, (shots, 1))
    draw = lambda count: size * (0.6 * common + rng.standard_t(3, (shots, count)))          # noqa: E731
    return plain(draw(12), np.tile(size**2, 12))


def test_under_pure_noise_p_of_any_is_uniform() -> None:
    family, found = ["terms"] * 4 + ["free"] * 3 + ["pattern"] * 5, []
    for seed in range(400):
        rng = np.random.default_rng(seed)
        scores = noise_only(rng, 25)
        # ties at 1 / 200 steps are spread out, so that the law is continuous
        p_any = judged_of(scores, 199, seed, family).p_any
        found.append(p_any - rng.uniform(0.0, 1.0 / 200.0))
    assert kstest(found, "uniform").pvalue > 1e-3


def test_the_threshold_is_that_of_the_largest_of_so_many_normal_scores() -> None:
    rng = np.random.default_rng(21)
    found = judged_of(plain(rng.normal(size=(800, 12))), 4000, 5)
    assert found.threshold("terms", 0.05) == pytest.approx(norm.isf(0.5 * (1.0 - 0.95**(1.0 / 12.0))), abs=0.1)
    assert found.threshold("free", 0.05) == np.inf
    shared = judged_of(plain(rng.normal(size=(800, 12))), 4000, 5, ["terms"] * 6 + ["free"] * 6)
    high = shared.threshold("free", 0.05)
    # from there on a test of the family is an alarm, by the probabilities themselves
    for k in range(6, 12):
        assert (shared.p_value[k] <= 0.05) == (shared.statistic[k] >= high)
    assert high > shared.threshold("terms", 0.05) > norm.isf(0.025)


def test_a_test_on_too_few_shots_is_not_made() -> None:
    x = np.zeros((40, 1))
    x[:6] = 1.0
    assert not one_test(at_least_squares(np.random.default_rng(6).normal(size=40), x, np.zeros((40, 0)))).kept[0]


def test_where_nothing_can_be_asked_nothing_is_found() -> None:
    found = judged_of(plain(np.zeros((20, 0))), 99)
    assert found.p_any == 1.0 and found.families == {} and len(found.p_value) == 0
