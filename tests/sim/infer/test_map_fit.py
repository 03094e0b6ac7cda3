"""The fit on shots of other code, and fits pooled: against quadrature, what it recovers and what it leaves out."""

import dataclasses

import msgspec
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import halfnorm, norm

import truearc as ta
from tests.sim.infer.independent import Truth, make_dataset, make_tracks
from tests.sim.physics.rigs import GUPPY
from truearc.cli.main import main
from truearc.robot.config.rig_spec import Tracker
from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.infer.belief import load_belief
from truearc.sim.infer.fit_report import cross_validate
from truearc.sim.infer.intervals import Profile, Said, pool_normal, profile_interval
from truearc.sim.infer.launcher import MapFit, fit_map
from truearc.sim.statistics import Z90

TERMS = ("drag", "magnus", "exit_efficiency")
TRUTH = Truth()
TRUE = {"drag.cd": TRUTH.cd, "magnus.cl": TRUTH.cl, "exit_efficiency.loss": TRUTH.loss,
        "scatter.speed": TRUTH.speed_sd, "scatter.elevation_deg": TRUTH.elevation_sd_deg}


@pytest.fixture(scope="module")
def outcomes() -> MapFit:
    return fit_map(make_dataset(11, 100), TERMS)


def test_outcomes_alone_recover_what_is_behind_them(outcomes):
    assert outcomes.converged
    for name, value in TRUE.items():
        assert deviance_at(outcomes, name, value) < 9.0          # three standard errors, each
    assert outcomes.values["drag.cd"] == pytest.approx(0.5, abs=0.2)
    assert outcomes.values["magnus.cl"] == pytest.approx(0.06, abs=0.015)


def test_the_optimum_is_one_whatever_the_order_of_shots(outcomes):
    dataset = make_dataset(11, 100)
    turned = dataclasses.replace(dataset, shots=dataset.shots.take(np.arange(100)[::-1]))
    again = fit_map(turned, TERMS)
    assert list(again.values.values()) == pytest.approx(list(outcomes.values.values()), rel=1e-3)
    assert fit_map(dataset, TERMS).values == outcomes.values


def deviance_at(fit: MapFit, name: str, value: float) -> float:
    """Twice the adjusted log posterior lost with one parameter held at `value`; at most 2.706 inside its interval."""
    one = fit.sought[fit.names.index(name)]
    walk = Profile(fit, one)
    there = walk.flown(walk.at(one.at(value) - float(fit.scores.point[one.column])).change)
    return 2.0 * (there.cost - walk.ground.cost)


@pytest.mark.slow
def test_sides_and_heights_know_more(outcomes):
    def doubt(fit: MapFit) -> float:
        return fit.covariance[fit.names.index("drag.cd")][fit.names.index("drag.cd")]

    side, height = (fit_map(make_dataset(11, 100, **{what: True}), TERMS) for what in ("side", "height"))
    assert side.converged and height.converged
    assert doubt(height) < doubt(side) < doubt(outcomes)
    for fit in (side, height):
        for name, value in TRUE.items():
            assert deviance_at(fit, name, value) < 9.0


def test_profiles_end_where_the_deviance_says(outcomes):
    for name in ("drag.cd", "scatter.speed"):
        found = profile_interval(outcomes, name)
        assert found.low90 < found.value < found.high90
        for end in (found.low90, found.high90):
            assert np.sqrt(deviance_at(outcomes, name, end)) == pytest.approx(Z90, rel=0.03)
        assert found.closed and found.low_by_data and found.high_by_data


def test_a_prior_that_closes_an_interval_is_told(outcomes):
    """The angle's scatter moves heights less than the speed's: outcomes do not bound it on both sides."""
    found = profile_interval(outcomes, "scatter.elevation_deg")
    assert not (found.low_by_data and found.high_by_data)
    place = outcomes.names.index("scatter.elevation_deg")
    assert np.sqrt(outcomes.covariance[place, place]) > 0.5


def test_held_out_outcomes_are_predicted_better_than_by_their_shares(outcomes):
    score = cross_validate(outcomes)
    assert score.shots == 100
    assert score.groups > 95         # random configurations
    assert score.log_score > score.share_log_score + 2 * score.gain_se
    assert score.accuracy > score.share_accuracy


def test_outcomes_of_one_kind_are_cross_validated_too(outcomes):
    scores = outcomes.scores
    missed = np.where(scores.plane.seen.classes == 0.0, 0.0, np.nan)
    plane = dataclasses.replace(scores.plane, seen=dataclasses.replace(scores.plane.seen, classes=missed))
    fitted = dataclasses.replace(outcomes.fitted, scores=dataclasses.replace(scores, plane=plane))
    score = cross_validate(dataclasses.replace(outcomes, fitted=fitted))
    assert score.shots == np.isfinite(missed).sum() > 5


@pytest.mark.slow
def test_tracks_recover_coefficients_scatter_and_noise():
    tracks = make_tracks(21, 12)
    fit = fit_map(tracks, TERMS)
    assert fit.converged
    assert fit.fitted.model.data.used == {"tracks": 12}
    for name, value in (TRUE | {"track_scale.share": 0.0, "track_tilt.angle_deg": 0.0}).items():
        assert deviance_at(fit, name, value) < 9.0
    assert fit.fitted.model.data.scatter.sigma_m[[0, 2]] == pytest.approx(0.012, rel=0.1)
    assert "track_scale.share" not in fit.belief.names
    rig = msgspec.structs.replace(GUPPY, tracker=Tracker(calibrated=True))
    sure = fit_map(dataclasses.replace(tracks, facts=rig), TERMS)
    assert sure.values["drag.cd"] == pytest.approx(0.5, abs=0.06)
    doubts = [one.covariance[one.names.index("drag.cd"), one.names.index("drag.cd")] for one in (fit, sure)]
    assert doubts[1] < 0.7 * doubts[0]


@pytest.mark.slow
def test_thrown_balls_need_no_launcher():
    rig = msgspec.structs.replace(GUPPY, launcher=msgspec.structs.replace(GUPPY.launcher, wheel=()))
    fit = fit_map(dataclasses.replace(make_tracks(22, 8, wheels=False), facts=rig), ("drag",))
    assert fit.converged
    assert fit.names == ("drag.cd", "track_scale.share", "track_tilt.angle_deg", "track_clock.share")
    assert deviance_at(fit, "drag.cd", 0.5) < 9.0
    assert fit.belief.scatter == {}


def test_nothing_to_fit_to_is_bad_input():
    shots = Shots(("a",), {"distance_m": np.array([4.0]), "hood_deg": np.array([45.0])}, {"outcome": ("two",)})
    with pytest.raises(ta.InputError, match=r"^shots: there is nothing to fit to.*: no launch speed: motor_ratio"):
        fit_map(Dataset("d", GUPPY, shots), TERMS)
    with pytest.raises(ta.InputError, match="no term 'dragg'"):
        fit_map(make_dataset(1, 20), ("dragg",))


def test_one_height_that_is_a_slip_moves_nothing():
    """A height of 30 m among 60: as if it had not been recorded."""
    dataset = make_dataset(11, 60, height=True)
    height_m = dataset.shots.numbers["miss_height_m"].copy()
    clean = fit_map(dataclasses.replace(dataset, shots=dataset.shots.take(np.arange(1, 60))), TERMS).values
    height_m[0] = 30.0
    slipped = dataclasses.replace(dataset.shots, numbers=dataset.shots.numbers | {"miss_height_m": height_m})
    found = fit_map(dataclasses.replace(dataset, shots=slipped), TERMS).values
    assert list(found.values()) == pytest.approx(list(clean.values()), rel=0.05)


def test_a_fit_starts_far_from_its_heights_and_still_fits_them_all():
    """No height may be written off as a slip because the prior's centre is far from it."""
    dataset = make_dataset(12, 60, dataclasses.replace(TRUTH, loss=0.5), height=True)
    fit = fit_map(dataset, TERMS)
    assert deviance_at(fit, "exit_efficiency.loss", 0.5) < 9.0


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
