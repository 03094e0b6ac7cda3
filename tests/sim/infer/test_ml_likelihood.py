"""The likelihood against brute force: Monte Carlo of other code's flights, dense normals, finite differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from tests.sim.infer import independent
from tests.sim.infer.independent import Truth
from tests.sim.physics import reference
from tests.sim.physics.rigs import GUPPY
from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.infer.likelihood.launch_inputs import EXIT_SPEED_SD_M_S
from truearc.sim.infer.likelihood.observations import gather
from truearc.sim.infer.likelihood.outcome_likelihood import LAPSE
from truearc.sim.infer.likelihood.shot_likelihood import (
    Points,
    derivatives,
    log_likelihood,
    narrow,
    objective,
    outcome_table,
)
from truearc.sim.infer.likelihood.track_data import TrackData
from truearc.sim.infer.likelihood.track_likelihood import linear, log_det_and_inverse
from truearc.sim.infer.parameters import make_model

TERMS = ("drag", "magnus", "exit_efficiency")
NO_POINTS = Points(np.zeros((0, 3)), np.zeros((0, 4)))
TRUTH = Truth(speed_sd=0.02, elevation_sd_deg=0.5)


def _at(model, truth: Truth) -> np.ndarray:
    values = {"drag.cd": truth.cd, "magnus.cl": truth.cl, "exit_efficiency.loss": truth.loss,
              "scatter.speed": truth.speed_sd, "scatter.elevation_deg": truth.elevation_sd_deg}
    return np.array([one.u(values[one.name]) for one in model.sought])


def test_outcomes_are_those_of_many_real_shots():
    """20 000 shots at each of six configurations by other code; the model's normal heights are not theirs exactly."""
    rng = np.random.default_rng(5)
    configuration = independent.configurations(rng, TRUTH, 6)
    shots = Shots(tuple("abcdef"), dict(zip(("distance_m", "hood_deg", "motor_ratio"), configuration, strict=True)),
                  {"outcome": ("miss",) * 6})
    evidence = gather(GUPPY, Dataset("d", GUPPY, shots)).evidence
    model = make_model(GUPPY, TERMS)
    said = np.asarray(outcome_table(model, evidence, NO_POINTS, _at(model, TRUTH)))
    many = 20_000
    for row in range(6):
        columns = [np.full(many, column[row]) for column in configuration]
        words = np.array(independent.outcomes(independent.fired(rng, TRUTH, *columns)))
        share = np.array([(words == word).mean() for word in ("miss", "two", "three")])
        clean = (said[row] - LAPSE / 3) / (1 - LAPSE)
        np.testing.assert_allclose(clean, share, atol=0.015 + 4 * 0.5 / np.sqrt(many))
    assert said.max() - said.min() > 0.5             # the six are different enough to mean something


def test_gradient_and_hessian_are_those_of_finite_differences():
    dataset = independent.make_dataset(3, 40, side=True)
    evidence = gather(GUPPY, dataset).evidence
    model, weight = make_model(GUPPY, TERMS), np.ones(40)
    u = _at(model, Truth()) + 0.1
    _, gradient, hessian = derivatives(model, evidence, NO_POINTS, weight, u)
    step = 1e-4
    for index in range(len(u)):
        ends = [u + sign * step * np.eye(len(u))[index] for sign in (1.0, -1.0)]
        values = [float(objective(model, evidence, NO_POINTS, weight, end)) for end in ends]
        assert gradient[index] == pytest.approx((values[0] - values[1]) / (2 * step), rel=1e-5, abs=1e-5)
        slopes = [np.asarray(derivatives(model, evidence, NO_POINTS, weight, end)[1]) for end in ends]
        np.testing.assert_allclose(hessian[index], (slopes[0] - slopes[1]) / (2 * step), rtol=1e-4, atol=1e-3)


def test_a_measured_exit_speed_is_a_normal_reading_of_the_launch():
    ratio, seen = 0.6, 9.0
    shots = Shots(("a",), {"motor_ratio": np.array([ratio]), "hood_deg": np.array([45.0]),
                           "exit_speed_m_s": np.array([seen])}, {})
    evidence = gather(GUPPY, Dataset("d", GUPPY, shots)).evidence
    model = make_model(GUPPY, TERMS)
    u = _at(model, TRUTH)
    speed = reference.exit_of(ratio)[0] * (1 - TRUTH.loss)
    wheels = 0.5 * np.hypot(reference.LOWER_RADIUS_M, reference.UPPER_RADIUS_M) / 2 / reference.exit_of(ratio)[0]
    scatter, noise = TRUTH.speed_sd**2 + wheels**2, (EXIT_SPEED_SD_M_S / seen)**2
    off = np.log(seen / speed)
    assert float(log_likelihood(model, evidence, NO_POINTS, u)[0]) == pytest.approx(
        stats.norm.logpdf(off, 0.0, np.sqrt(scatter + noise)), rel=1e-9)
    launch = narrow(model, evidence, NO_POINTS, u)
    assert float(launch.mean[0, 0]) == pytest.approx(off * scatter / (scatter + noise), rel=1e-9)
    assert float(launch.covariance[0, 0, 0]) == pytest.approx(1 / (1 / scatter + 1 / noise), rel=1e-9)


def test_integrating_out_a_linear_flight_is_the_dense_normal():
    """Positions linear in the unknowns: the closed form must be the joint normal's, mean and covariance too."""
    rng = np.random.default_rng(7)
    flights, samples, m, noise = 3, 6, 4, 0.02
    slopes = jnp.asarray(rng.normal(size=(flights, samples, 2, m)))
    sd = np.abs(rng.normal(size=(flights, m))) + 0.1
    sd[0, 1] = 0.0                                     # an unknown that is known
    mean, at = rng.normal(size=(flights, m)), rng.normal(size=(flights, m))
    seen = rng.normal(size=(flights, samples, 2))
    mask = np.ones((flights, samples), bool)
    mask[1, 4:] = False
    data = TrackData(np.arange(flights), np.zeros((flights, samples)), seen[..., 0], seen[..., 1], mask, 0)
    got = linear(lambda d: jnp.einsum("klci,ki->klc", slopes, d), data, jnp.asarray(at), mean, sd, noise)
    for k in range(flights):
        design = np.asarray(slopes[k])[mask[k]].reshape(-1, m)
        y = seen[k][mask[k]].ravel()
        cover = design @ np.diag(sd[k]**2) @ design.T + noise**2 * np.eye(len(y))
        expected = stats.multivariate_normal.logpdf(y, design @ mean[k], cover)
        assert float(got.log_likelihood[k]) == pytest.approx(expected, rel=1e-6)
        gain = np.diag(sd[k]**2) @ design.T @ np.linalg.inv(cover)
        np.testing.assert_allclose(got.mean[k], mean[k] + gain @ (y - design @ mean[k]), atol=1e-6)
        np.testing.assert_allclose(got.covariance[k], np.diag(sd[k]**2) - gain @ design @ np.diag(sd[k]**2), atol=1e-7)


def test_small_systems_are_solved_as_numpy_does():
    factor = np.random.default_rng(0).normal(size=(20, 4, 7))
    matrix = factor @ factor.transpose(0, 2, 1)
    log_det, inverse = log_det_and_inverse(jnp.asarray(matrix))
    np.testing.assert_allclose(log_det, np.linalg.slogdet(matrix)[1], rtol=1e-12)
    np.testing.assert_allclose(inverse, np.linalg.inv(matrix), rtol=1e-8, atol=1e-10)
    slope = jax.jacfwd(lambda t: log_det_and_inverse(jnp.asarray(matrix) * jnp.exp(t))[0])(0.0)
    np.testing.assert_allclose(slope, 4.0, rtol=1e-12)
