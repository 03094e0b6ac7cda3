"""Flipped signs and projected scores, against enumeration, closed forms and invariance."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.discover.evidence import Channel, Evidence
from sim.discover.statistics import Scores, efficient_scores, flip_signs

CHANNEL = Channel("push", "flight", "vertical", "m/s2", ("up", "down"))


def quiet(done: float, note: str) -> None:
    """No progress."""


def linear_model(y: np.ndarray, x: np.ndarray, z: np.ndarray) -> Evidence:
    """y = b x + z theta + unit normal, one row a shot; theta at its least-squares value under b = 0."""
    theta = np.linalg.lstsq(z, y, rcond=None)[0]
    left = y - z @ theta
    columns = np.concatenate([x[:, None], z], axis=1)
    p = z.shape[1]
    return Evidence("tracks", np.arange(len(y)), (CHANNEL,), tuple(f"t{k}" for k in range(p)), columns * left[:, None],
                    columns[:, :, None] * columns[:, None, :], np.zeros(p), np.zeros(p), -0.5 * left**2)


def one_test(evidence: Evidence, cluster: np.ndarray | None = None) -> Scores:
    n = len(evidence.rows)
    label = np.arange(n) if cluster is None else cluster
    return efficient_scores(evidence, 0, np.ones((n, 1)), label, int(label.max()) + 1)


def test_amplitude_and_gain_are_those_of_least_squares() -> None:
    rng = np.random.default_rng(1)
    x, z = rng.normal(size=40), np.stack([np.ones(40), rng.normal(size=40)], axis=1)
    y = 0.7 * x + z @ [1.0, -2.0] + rng.normal(size=40)
    flips = flip_signs(one_test(linear_model(y, x, z)), 10, 0, quiet)
    whole = np.concatenate([x[:, None], z], axis=1)
    b, rest = np.linalg.lstsq(whole, y, rcond=None)[:2]
    without = np.linalg.lstsq(z, y, rcond=None)[1]
    assert flips.amplitude[0] == pytest.approx(b[0], rel=1e-10)
    assert flips.gain[0] == pytest.approx(0.5 * float(without[0] - rest[0]), rel=1e-10)


def test_what_the_shared_parameters_explain_is_no_evidence() -> None:
    rng = np.random.default_rng(2)
    z = rng.normal(size=(30, 2))
    scores = one_test(linear_model(rng.normal(size=30), z @ [0.3, 2.0], z))
    assert not scores.kept[0]


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000), tilt=st.floats(-3.0, 3.0))
def test_an_alias_added_to_the_covariate_changes_nothing(seed: int, tilt: float) -> None:
    rng = np.random.default_rng(seed)
    x, z, y = rng.normal(size=30), rng.normal(size=(30, 2)), rng.normal(size=30)
    plain = one_test(linear_model(y, x, z))
    tilted = one_test(linear_model(y, x + tilt * z[:, 0], z))
    assert np.allclose(plain.psi, tilted.psi, atol=1e-8)


def test_stretched_scores_have_the_spread_of_errors_that_nothing_was_fitted_to() -> None:
    """Least squares leaves residuals smaller than errors by 1 - leverage; the stretch is its inverse square root."""
    rng = np.random.default_rng(7)
    x, z = rng.normal(size=20), rng.normal(size=(20, 3))
    scores = one_test(linear_model(rng.normal(size=20), x, z))
    leverage = np.diag(z @ np.linalg.inv(z.T @ z) @ z.T)
    assert np.allclose(scores.stretch[:, 0], 1.0 / np.sqrt(1.0 - leverage))


def test_p_values_are_those_of_all_sign_patterns() -> None:
    rng = np.random.default_rng(3)
    psi = rng.normal(0.4, 1.0, (9, 3))
    kappa = rng.uniform(0.5, 2.0, (9, 3))

    def statistic(scores: np.ndarray) -> np.ndarray:
        b = scores.sum(0) / kappa.sum(0)
        return np.abs(scores.sum(0)) / np.sqrt(((scores - b * kappa)**2).sum(0))

    seen = statistic(psi)
    all_signs = np.array([statistic(np.array(signs)[:, None] * psi) for signs in
                          itertools.product((-1.0, 1.0), repeat=9)])
    each = (all_signs >= seen - 1e-9).mean(0)
    family = (all_signs.max(1)[:, None] >= seen - 1e-9).mean(0)
    flips = flip_signs(Scores(psi, kappa, np.ones_like(psi), np.ones(3, dtype=bool)), 20_000, 4, quiet)
    assert np.allclose(flips.statistic, seen)
    assert np.allclose(flips.p_each, each, atol=0.015)
    assert np.allclose(flips.p_family, family, atol=0.015)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10_000), tests=st.integers(1, 6), clusters=st.integers(8, 25))
def test_a_test_is_never_likelier_in_the_family_than_alone(seed: int, tests: int, clusters: int) -> None:
    rng = np.random.default_rng(seed)
    scores = Scores(rng.standard_t(3, (clusters, tests)), rng.uniform(0.1, 3.0, (clusters, tests)),
                    np.ones((clusters, tests)), np.ones(tests, dtype=bool))
    flips = flip_signs(scores, 199, seed, quiet)
    assert (flips.p_family >= flips.p_each - 1e-12).all()
    assert ((flips.p_each > 0.0) & (flips.p_family <= 1.0)).all()


def test_shots_of_one_cluster_count_once() -> None:
    """Every shot copied five times adds nothing when the copies are one cluster, and a lot when they are not."""
    rng = np.random.default_rng(5)
    x, y = np.ones(12), rng.normal(0.25, 1.0, 12)
    none = np.zeros((12, 0))
    single = flip_signs(one_test(linear_model(y, x, none)), 4000, 0, quiet)
    copies = linear_model(np.repeat(y, 5), np.repeat(x, 5), np.zeros((60, 0)))
    held = flip_signs(one_test(copies, np.repeat(np.arange(12), 5)), 4000, 0, quiet)
    loose = flip_signs(one_test(copies), 4000, 0, quiet)
    assert held.statistic[0] == pytest.approx(single.statistic[0])
    assert held.p_each[0] == pytest.approx(single.p_each[0], abs=0.03)
    assert loose.statistic[0] > 1.8 * held.statistic[0]


def test_a_test_on_too_few_clusters_is_not_made() -> None:
    x = np.zeros(40)
    x[:6] = 1.0
    assert not one_test(linear_model(np.random.default_rng(6).normal(size=40), x, np.zeros((40, 0)))).kept[0]
