"""What entrants get and answer, tracks and laws, learners of the residual, and the calibration."""

import math
from functools import partial

import numpy as np
import pytest

from benchmarks.compare import claim_of
from tests.proof.law import acceleration
from tests.proof.rivals.test_pysindy import sizes
from tests.sim.discover.made import at_least_squares, column, gaussian
from tests.sim.discover.straight import ASKED, NAMES, lay_straight, take_straight
from truearc.errors import InputError
from truearc.sim.discover.detect.covariates import Covariate
from truearc.sim.infer.fit import Fit
from truearc.sim.infer.launcher import Launcher
from truearc.sim.infer.likelihood.layout import Point
from truearc.sim.infer.likelihood.noise import SCATTERS
from truearc_proof import rivals as entrants
from truearc_proof.rivals.claim import (
    COLUMNS,
    Moments,
    RivalBelief,
    accelerations,
    answer_argmax,
    candidates_of,
    gravity,
    middle_of,
    usual_of,
)
from truearc_proof.rivals.residual import (
    Calibration,
    Emulator,
    Process,
    Runs,
    Trees,
    cross_validate,
    gain_of_each,
    names_of,
    sample,
    table_of,
)
from truearc_proof.truth.world import make_world

# --- claim

FINDING = {"mismatch": {"found": True, "p_value": 0.001}, "verdict": "set",
           "what": [{"term": "wind_x", "probability": 0.2}, {"term": "spin_decay", "probability": 0.7}],
           "fit": {"height_rmse_before_m": 0.05, "height_rmse_after_m": 0.04}}
N = 200


def test_a_finding_is_a_claim() -> None:
    claim = claim_of(FINDING)
    assert (claim.says_something, claim.names) == (True, ("spin_decay", "wind_x"))
    assert (claim.before_m, claim.after_m) == (0.05, 0.04)


def test_an_unknown_effect_has_no_names_and_no_better_forecast() -> None:
    claim = claim_of({**FINDING, "verdict": "unknown", "fit": {"height_rmse_before_m": 0.05,
                                                               "height_rmse_after_m": None}})
    assert claim.says_something and claim.names == () and claim.after_m == 0.05


def test_who_cannot_enter_is_told_why() -> None:
    with pytest.raises(InputError, match="no rival 'nobody'"):
        entrants.check_rivals(["argmax", "nobody"])
    assert entrants.check_rivals(["argmax", "argmax"]) == ("argmax",)


def believed(signal: float, seed: int = 0) -> RivalBelief:
    """Two terms at right angles and a shared constant; `signal` of the second is true. Refits are least squares."""
    rng = np.random.default_rng(seed)
    slopes = np.linalg.qr(np.column_stack([np.ones(N), rng.normal(size=(N, 2))]))[0][:, 1:]
    y = signal * slopes[:, 1] + rng.normal(size=N)
    evidence = at_least_squares(y, slopes, np.ones((N, 1)))
    model = Launcher(take_straight(np.zeros(N)), lay_straight(np.full(len(ASKED), 0.3)))
    point = Point.still(model.layout, N, np.zeros(len(NAMES)), np.zeros(len(SCATTERS)))
    refits = {}
    for k in range(2):
        amplitude = slopes[:, k] @ y
        made = gaussian(y - y.mean() - amplitude * slopes[:, k], np.column_stack([slopes[:, k], np.ones(N)]),
                        (column("t", "shared"), column("s0", "shared")))
        name = f"t{k}.amplitude"
        refits[name] = Fit(model, point, made, (name,), np.zeros(1), np.ones(1))
    return RivalBelief(Fit(model, point, evidence), refits)


def test_the_true_term_of_two_at_right_angles_fits_best() -> None:
    claim = answer_argmax(None, believed(8.0))
    assert claim.says_something and claim.names == ("t1", "t0") and claim.after_m is None
    scores = [float(one.scores.log_score.sum()) for one in believed(8.0).refits.values()]
    null = float(believed(8.0).fitted.scores.log_score.sum())
    assert claim.figures["gain"] == pytest.approx(max(scores) - null)


def test_it_says_something_of_nothing_too() -> None:
    assert answer_argmax(None, believed(0.0)).says_something


# --- library

VELOCITY = np.array([[7.0, 0.4, 5.0], [5.0, -0.3, -2.0], [9.0, 0.0, 1.0]])
SPIN_REV_S = 6.0                      # in the seed's convention: twice what the ball turns by
TIME_S = np.array([0.05, 0.3, 0.6])
AGE, DENSITY = 0.4, 0.03


def columns(*names: str) -> np.ndarray:
    one = np.ones(3)
    return accelerations(make_world().facts, names, Moments(VELOCITY, SPIN_REV_S * one, TIME_S, AGE * one,
                                                            DENSITY * one, *sizes(one)))


def truth(effect: str | None, amount: float) -> np.ndarray:
    """[3, 3] by the second law, drag and lift at the middle of the catalogue's priors."""
    from dataclasses import replace
    cl = middle_of("magnus")
    world = replace(make_world({effect: amount} if effect else {}), cd=middle_of("drag"), lift_slope=cl * 32.0 / 3.0)
    spin = np.array([0.0, -math.pi * SPIN_REV_S, 0.0])
    density = 1.2 * (1.0 + DENSITY * amount) if effect == "air_density" else 1.2
    used = AGE if effect == "drag_wear" else 0.0
    return np.stack([acceleration(t, v, spin, world, density, used)
                     for t, v in zip(TIME_S, VELOCITY, strict=True)])


def test_drag_lift_and_gravity_are_the_whole_law() -> None:
    both = columns("drag", "magnus") @ [middle_of("drag"), middle_of("magnus")] + gravity(make_world().facts)
    np.testing.assert_allclose(both, truth(None, 0.0), atol=1e-9)


@pytest.mark.parametrize("name", [name for name in COLUMNS if name not in ("drag", "magnus", "buoyancy")])
def test_a_column_is_the_slope_of_its_effect(name: str) -> None:
    small = 1e-5
    per = {"spin_drag": 4.0, "lift_saturation": 2.0}.get(name, 1.0)     # the catalogue's spin is twice as fast
    slope = (truth(name, small) - truth(name, 0.0)) / small
    np.testing.assert_allclose(columns(name)[..., 0] / usual_of(name), slope * per, rtol=1e-3, atol=1e-4)


def test_added_mass_is_buoyancy_once_drag_and_lift_are_free() -> None:
    change = truth("added_mass", 1e-4) - truth(None, 0.0)
    library = columns("drag", "magnus", "buoyancy").reshape(-1, 3)
    left = change.ravel() - library @ np.linalg.lstsq(library, change.ravel(), rcond=None)[0]
    assert np.abs(left).max() < 1e-3 * np.abs(change).max()


def test_what_changes_a_force_is_a_candidate_where_the_force_is_believed() -> None:
    assert candidates_of(()) == ("drag", "magnus", "buoyancy")
    assert set(candidates_of(("magnus",))) == {"drag", "buoyancy", "spin_decay", "lift_saturation"}
    assert set(candidates_of(("drag", "magnus"))) == set(COLUMNS) - {"drag", "magnus"}


# --- residual

COUNT, NOISE = 150, 0.1
LEARNERS = {"gp": Process, "boosted": partial(Trees, 0)}


def made(signal: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """(covariates [N, 4], residuals [N, 3]): the third coordinate is a sine of the second covariate."""
    rng = np.random.default_rng(seed)
    table, residuals = rng.uniform(-1.7, 1.7, (COUNT, 4)), NOISE * rng.normal(size=(COUNT, 3))
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


# --- koh

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
