"""Pooled fits: the hierarchical model against quadrature and against its own draws, and fits of sessions and rigs."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import halfnorm, norm

import truearc as ta
from tests.sim.infer.independent import make_dataset
from tests.sim.thin import thinned
from truearc.cli.main import main
from truearc.sim.infer.belief import load_belief
from truearc.sim.infer.intervals import Said, pool_normal
from truearc_proof.importers.mpi import import_mpi

# Effects of coaching in eight schools and their standard errors (Rubin 1981)
EFFECT = np.array([28.0, 8.0, -3.0, 7.0, -1.0, 1.0, 18.0, 12.0])
ERROR = np.array([15.0, 10.0, 16.0, 11.0, 9.0, 11.0, 10.0, 18.0])


def said_of(value, error, centre, sd, spread):
    """[m, k] values with independent errors."""
    information = np.einsum("mk,kl->mkl", error**-2.0, np.eye(error.shape[1]))
    return Said(information, value / error**2, *(np.full(error.shape[1], one) for one in (centre, sd, spread)))


def by_quadrature(value, error, centre, sd, spread, of):
    """E[of(mean, variance of mu | tau, tau)] over the posterior of tau."""
    def given(tau):
        weight = 1.0 / (error**2 + tau**2)
        variance = 1.0 / (weight.sum() + sd**-2.0)
        mean = variance * ((weight * value).sum() + centre / sd**2)
        # the marginal of the values, mu integrated out: a normal with a shared part
        likelihood = (np.prod(norm.pdf(value, mean, np.sqrt(1.0 / weight))) * norm.pdf(mean, centre, sd)
                      * np.sqrt(2.0 * np.pi * variance))
        return likelihood * halfnorm.pdf(tau, scale=spread), mean, variance
    whole = quad(lambda tau: given(tau)[0], 0.0, 8.0 * spread, limit=200)[0]
    return quad(lambda tau: given(tau)[0] * of(*given(tau)[1:], tau), 0.0, 8.0 * spread, limit=200)[0] / whole


def test_eight_schools_are_as_by_quadrature():
    settings = (0.0, 50.0, 10.0)
    found = pool_normal(said_of(EFFECT[:, None], ERROR[:, None], *settings))
    mean, covariance = found.common
    expected = by_quadrature(EFFECT, ERROR, *settings, lambda mean, variance, tau: mean)
    second = by_quadrature(EFFECT, ERROR, *settings, lambda mean, variance, tau: mean**2 + variance)
    assert mean[0] == pytest.approx(expected, abs=0.15)
    assert covariance[0, 0] == pytest.approx(second - expected**2, rel=0.08)
    assert found.tau.mean() == pytest.approx(by_quadrature(EFFECT, ERROR, *settings, lambda mean, variance, tau: tau),
                                             rel=0.08)
    shrunk = by_quadrature(EFFECT, ERROR, *settings, lambda mean, variance, tau:
                           (EFFECT[0] * tau**2 + mean * ERROR[0]**2) / (tau**2 + ERROR[0]**2))
    assert found.own[0, 0] == pytest.approx(shrunk, abs=0.4)


def test_intervals_hold_what_is_common_and_what_is_next_in_ninety_of_a_hundred():
    rng = np.random.default_rng(3)
    common, following = [], []
    for _ in range(20):
        centre = rng.normal(0.0, 1.0, 2)
        tau = np.abs(rng.normal(0.0, 0.3, 2))
        mixing = rng.normal(size=(5, 6, 2))
        information = 40.0 * np.swapaxes(mixing, 1, 2) @ mixing
        own = centre + tau * rng.normal(size=(5, 2))
        seen = own + np.einsum("mij,mj->mi", np.linalg.cholesky(np.linalg.inv(information)), rng.normal(size=(5, 2)))
        found = pool_normal(Said(information, np.einsum("mij,mj->mi", information, seen), np.zeros(2), np.ones(2),
                                 np.full(2, 0.3)), seed=1)
        mean, covariance = found.common
        common.append(abs(mean - centre) / np.sqrt(np.diag(covariance)))
        following.append(abs(mean - (centre + tau * rng.normal(size=2))) / np.sqrt(np.diag(found.next_one)))
    for off in (common, following):
        assert 0.8 < (np.array(off) < 1.645).mean() < 0.97


@pytest.fixture(scope="module")
def weeks(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pool")
    for seed in (21, 22):
        ta.save_dataset(folder / f"d{seed}", make_dataset(seed, 32, side=True))
    return [str(folder / f"d{seed}") for seed in (21, 22)]


@pytest.fixture(scope="module")
def fits(weeks):
    return [ta.fit(ta.load_dataset(path), ["drag", "exit_efficiency"]) for path in weeks]


@pytest.mark.slow
def test_two_sessions_are_known_better_than_either(weeks, fits, tmp_path, capsys):
    out = tmp_path / "pooled.toml"
    assert main(["fit", *weeks, "--terms", "drag,exit_efficiency", "-o", str(out), "--quiet"]) == 0
    said = capsys.readouterr().out
    pooled = ta.pool(fits)
    assert said == f"{pooled}\n" and said.startswith("2 fits pooled as sessions of one rig: ")
    belief = load_belief(out)
    assert belief.names == pooled.names and {"drag.cd", "scatter.speed"} <= set(belief.names)
    rows = {row[:2]: row[2:] for row in pooled.members().rows}
    for fit in fits:
        own = next(one for one in fit.intervals if one.name == "exit_efficiency.loss")
        low, high = rows[fit.dataset.name, "exit_efficiency.loss"][4:]
        assert high - low < own.high90 - own.low90
    assert (np.diag(belief.covariance) > 0.0).all()
    assert ta.predict(fits[0].dataset, belief).rows[0][0] == fits[0].dataset.shots.shot_id[0]


@pytest.mark.slow
def test_the_same_data_do_not_count_twice(fits):
    with pytest.raises(ta.InputError, match="d21: the same data twice"):
        ta.pool([*fits, fits[0]])


@pytest.mark.slow
def test_fits_of_other_terms_are_refused(fits):
    other = ta.fit(make_dataset(23, 20), ["magnus"])
    with pytest.raises(ta.InputError, match="is fitted with gravity, magnus, d21 with gravity, drag, exit_efficiency"):
        ta.pool([fits[0], other])


@pytest.mark.data
@pytest.mark.slow
def test_thirds_of_a_real_launcher_have_one_lift(data_dir):
    """Of which each once had another lift, whose interval excluded the others'."""
    whole = thinned(import_mpi(data_dir / "real" / "mpi_launches.csv", data_dir / "real" / "mpi_tracks.csv"), 37)
    fits = [ta.fit(whole.take(list(range(start, len(whole.shots), 3))), ["gravity", "drag", "magnus"])
            for start in range(3)]
    lifts = [one for fit in fits for one in fit.intervals if one.name == "magnus.cl"]
    assert all(one.low90 < one.value < one.high90 for one in lifts)
    assert max(one.low90 for one in lifts) < min(one.high90 for one in lifts)
    assert 0.04 < np.mean([one.value for one in lifts]) < 0.06          # parabolas by hand: about 0.05
    pooled = ta.pool(fits)
    row = dict(zip(pooled.table().columns, pooled.table().rows[pooled.names.index("magnus.cl")], strict=True))
    assert min(one.value for one in lifts) < row["value"] < max(one.value for one in lifts)
    assert row["differs"] < 0.1 * row["value"]           # three thirds of one session
