"""The free correction on evidence whose answer is known in closed form."""

import numpy as np
import pytest

from tests.sim.discover.made import column, gaussian
from truearc.sim.discover.detect.battery import Test
from truearc.sim.discover.detect.covariates import STEP, Covariate, Factor
from truearc.sim.discover.detect.localization import (
    Correction,
    amplitude_of,
    contrast_of,
    correct,
    size_weights,
)
from truearc.sim.infer.likelihood.score_table import ScoreTable

N = 300


def evidence_of(effect: np.ndarray, noise: np.ndarray) -> ScoreTable:
    """One unit of information a shot and no shared parameters: the score is what was seen."""
    return gaussian(effect + noise, np.ones((len(effect), 1)), (column("push"),))


def asked(what: Covariate | Factor | None) -> Test:
    return Test("free", 0, what, "straight", np.ones(N))


def test_the_same_in_every_shot_is_the_mean_and_gains_half_its_square() -> None:
    noise = np.random.default_rng(0).normal(size=N)
    found = correct(evidence_of(np.full(N, 0.8), noise), asked(None))
    assert found.amplitude == pytest.approx(np.full(N, 0.8 + noise.mean()), rel=1e-4)
    # held out: half the square of the truth, less about 1 / (2 n) for not knowing it
    assert found.gain.mean() == pytest.approx(0.5 * 0.8**2, abs=0.1)
    assert np.allclose(found.log_after - found.log_before, found.gain)


def test_a_step_is_a_step_and_no_bend() -> None:
    rng = np.random.default_rng(2)
    x = np.arange(N) / N
    after = (x > 0.4) * 1.0
    evidence = evidence_of(0.6 * after, rng.normal(size=N))
    bent, found = (correct(evidence, Test("free", 0, Covariate((("x", x),)), shape, after - after.mean()))
                   for shape in ("straight", f"{STEP}0.4"))
    jump = found.amplitude[121] - found.amplitude[119]
    assert jump == pytest.approx(0.6, abs=3.0 * np.sqrt(1.0 / 120 + 1.0 / 180))
    assert abs(bent.amplitude[121] - bent.amplitude[119]) < 0.05
    assert found.gain.sum() > bent.gain.sum()


def test_pure_noise_is_not_followed_far() -> None:
    gains = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        found = correct(evidence_of(np.zeros(N), rng.normal(size=N)), asked(Covariate((("x", rng.normal(size=N)),))))
        gains.append(found.gain.mean())
    assert np.mean(gains) < 0.0                            # on unseen shots a correction of nothing costs
    assert np.mean(gains) > -3.0 / N                       # ... about as much as its two firm coefficients


def test_groups_take_their_means() -> None:
    rng = np.random.default_rng(3)
    codes = np.arange(N) % 3
    y = np.array([0.0, 1.0, -1.0])[codes] + rng.normal(size=N)
    what = Factor("rig", ("a", "b", "c"), codes)
    found = correct(evidence_of(y, np.zeros(N)), asked(what))
    means = np.array([y[codes == k].mean() for k in range(3)])
    assert np.allclose(found.amplitude, means[codes], atol=1e-3)
    assert amplitude_of(found) == pytest.approx(np.ptp(means), abs=1e-3)


def test_the_size_of_what_has_no_name_has_an_interval_that_holds_it() -> None:
    """The mean's is known in closed form; a slope's and a step's hold the truth as often as they promise."""
    noise = np.random.default_rng(5).normal(size=N)
    found = correct(evidence_of(np.full(N, 0.8), noise), asked(None))
    size, sd = contrast_of(found, size_weights(found))
    assert size == pytest.approx(0.8 + noise.mean(), rel=1e-4) and sd == pytest.approx(N**-0.5, rel=1e-4)
    held = {"straight": 0, STEP: 0}
    for seed in range(100):
        rng = np.random.default_rng(seed)
        x = rng.permutation(np.arange(N) / (N - 1.0))
        after = (x > 0.4) * 1.0
        for shape, effect, truth in (("straight", 2.0 * x, 1.8), (f"{STEP}0.4", after, 1.0)):
            asks = Test("free", 0, Covariate((("x", x),)), shape, after - after.mean())
            size, sd = _size(correct(evidence_of(effect, rng.normal(size=N)), asks))
            held["straight" if shape == "straight" else STEP] += abs(size - truth) < 1.645 * sd
    assert all(82 <= count <= 96 for count in held.values()), held


def _size(found: Correction) -> tuple[float, float]:
    size, sd = contrast_of(found, size_weights(found))
    assert size == pytest.approx(amplitude_of(found), rel=1e-6)
    return size, sd
