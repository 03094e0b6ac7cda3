"""Kennedy and O'Hagan's calibration of simulators whose error is known."""

import numpy as np
import pytest

from truearc_proof.rivals.residual import Calibration, Emulator, Runs, sample

STEPS = 2_000
SEEN, HELD = np.linspace(0.0, 1.0, 12)[:, None], np.array([[0.15], [0.55], [0.8]])


@pytest.fixture(scope="module")
def emulator() -> Emulator:
    """Of y = 4 theta sin(2 x), theta from 0 to 1."""
    rng = np.random.default_rng(0)
    x, theta = rng.uniform(0.0, 1.0, (2, 60, 1))
    x[:2], theta[:2] = [[0.0], [1.0]], [[0.0], [1.0]]
    return Emulator(Runs(x, theta, (4.0 * theta * np.sin(2.0 * x)).ravel()))


def test_the_emulator_is_its_simulator(emulator: Emulator) -> None:
    mean, covariance = emulator.at(emulator.scaled(HELD), np.array([0.3]))
    np.testing.assert_allclose(emulator.middle + emulator.unit * mean, 1.2 * np.sin(2.0 * HELD[:, 0]), atol=5e-3)
    assert np.sqrt(np.diag(covariance)).max() < 5e-3


def test_a_right_simulator_gets_its_parameter_back(emulator: Emulator) -> None:
    noise = 0.02 * np.random.default_rng(1).normal(size=len(SEEN))
    found = Calibration(emulator, SEEN, 2.4 * np.sin(2.0 * SEEN[:, 0]) + noise, steps=STEPS)
    low, _, high = found.theta90[0]
    assert low < 0.6 < high < low + 0.3
    error = found.discrepancy(HELD)
    assert (error.low90 < 0.0).all() and (error.high90 > 0.0).all()


def test_what_a_wrong_simulator_lacks_is_forecast_between_the_data(emulator: Emulator) -> None:
    truth = [2.4 * np.sin(2.0 * x[:, 0]) + np.cos(5.0 * x[:, 0]) for x in (SEEN, HELD)]
    both = [Calibration(emulator, SEEN, truth[0], free, steps=STEPS).forecast(HELD) for free in (True, False)]
    off = [np.abs(each.mean - truth[1]).max() for each in both]
    assert off[0] < 0.1 < 0.5 < off[1]
    assert (both[0].low90 < truth[1]).all() and (truth[1] < both[0].high90).all()


def test_the_chain_samples_a_normal_distribution() -> None:
    covariance = np.array([[4.0, 1.5], [1.5, 1.0]])
    inverse = np.linalg.inv(covariance)
    drawn = sample(lambda at: float(-0.5 * at @ inverse @ at), np.array([3.0, 3.0]), np.random.default_rng(0), 40_000)
    np.testing.assert_allclose(drawn.mean(0), 0.0, atol=0.2)
    np.testing.assert_allclose(np.cov(drawn.T), covariance, rtol=0.2)
