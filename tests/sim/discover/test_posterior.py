"""The posterior over what is missing: closed forms where everything is linear, and changes that are truly flown."""

import itertools
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from msgspec import structs
from scipy.integrate import quad
from scipy.stats import multivariate_normal, norm

from tests.sim.discover.straight import ASKED, fit_straight
from tests.sim.discover.worlds import FACTS, World, make_outcomes
from truearc.robot.config.rig_spec import Site
from truearc.sim.discover.detect.battery import ReferenceSession
from truearc.sim.discover.detect.covariates import Covariate, Factor
from truearc.sim.discover.select import posterior as post
from truearc.sim.discover.select.terms import name_terms, nats_in_range
from truearc.sim.infer.fit import fit_believed
from truearc.sim.infer.launcher import Launcher, LauncherFit
from truearc.sim.infer.likelihood.data import take_in
from truearc.sim.infer.likelihood.layout import lay_out

PLANTED = {"wind_z.speed_m_s": 1.2, "added_mass.share": 0.8}
BETWEEN = {"drag_wear.share": tuple(PLANTED)}
Prior = Callable[[np.ndarray], np.ndarray]


@pytest.fixture
def fitted() -> LauncherFit:
    """Alone, what lies between the two planted ones explains most."""
    return fit_straight(PLANTED, 5, 400, usual=dict.fromkeys(ASKED, 1.0), between=BETWEEN)


def exact_nats(fitted: LauncherFit, names: tuple[str, ...]) -> float:
    """Log Bayes factor of amplitudes ~ N(0, 1) against none: |Lambda| and the quadratic form of linear regression."""
    evidence = fitted.scores
    shared = list(range(evidence.first_shared, len(evidence.columns)))

    def half(columns: list[int], prior: np.ndarray) -> float:
        info = evidence.info.sum(0)[np.ix_(columns, columns)] + prior
        score = evidence.score.sum(0)[columns]
        score[-len(shared):] += evidence.pull
        return float(0.5 * score @ np.linalg.solve(info, score) - 0.5 * np.linalg.slogdet(info)[1])

    asked = [evidence.index(name) for name in names]
    prior = np.zeros((len(asked) + len(shared),) * 2)
    prior[:len(asked), :len(asked)] = np.eye(len(asked))
    prior[len(asked):, len(asked):] = evidence.precision
    return half([*asked, *shared], prior) - half(shared, evidence.precision)


def test_evidence_of_parts_is_that_of_linear_regression(fitted: LauncherFit) -> None:
    evidence = fitted.scores
    ones, null = np.ones((len(evidence.rows), 1)), post.log_evidence(evidence.shared_only())[0]
    for names in [(ASKED[0],), (ASKED[2], ASKED[9]), (ASKED[7], ASKED[2], ASKED[5])]:
        parts = [post.Part.of(evidence.index(name), ones, np.ones(1)) for name in names]
        nats, change, _ = post.log_evidence(post.with_parts(evidence, parts))
        assert nats - null == pytest.approx(exact_nats(fitted, names), abs=1e-3)
        assert len(change) == len(names) + len(evidence.columns) - evidence.first_shared
    projector = post.Projector(evidence)
    for name in ASKED[:4]:
        closed = projector.of(evidence.index(name), ones).nats(1.0)
        assert closed == pytest.approx(exact_nats(fitted, (name,)), abs=1e-2)


def test_the_best_pair_is_found_though_neither_leads(fitted: LauncherFit) -> None:
    naming = name_terms(fitted, lambda done, note: None)
    assert naming.leader == "drag_wear.share"
    posterior = post.weigh(fitted, naming, (), ())
    pair = posterior.likeliest_pair()
    assert pair is not None
    exact = {names: exact_nats(fitted, names) for names in itertools.combinations(ASKED, 2)}
    best = max(exact, key=lambda names: exact[names])
    assert set(pair.names) == set(best) == set(PLANTED)
    assert pair.log_evidence == pytest.approx(exact[best], abs=0.1)
    assert posterior.share("two") > 0.9 and posterior.unexplained() == 0.0
    assert posterior.probability.sum() == pytest.approx(1.0)
    assert all(posterior.inclusion()[name] > 0.9 for name in PLANTED)


def test_shapes_of_a_process_have_its_covariance() -> None:
    """Less their mean, and nothing where the covariate is unknown."""
    x = np.linspace(2.0, 6.0, 101)
    x[[4, 50]] = np.nan
    known = np.isfinite(x)
    place = np.clip((x[known] - np.percentile(x[known], 2)) / np.ptp(np.percentile(x[known], (2, 98))), 0.0, 1.0)
    for length in (0.4, 1.0):
        shapes = post.process_shapes(x, length)
        exact = np.exp(-0.5 * ((place[:, None] - place[None, :]) / length)**2)
        exact = exact - exact.mean(0) - exact.mean(1)[:, None] + exact.mean()
        np.testing.assert_allclose((shapes @ shapes.T)[np.ix_(known, known)], exact, atol=0.02)
        assert (shapes[~known] == 0.0).all()


def test_a_change_since_home_is_weighed_as_a_joint_normal_model_says() -> None:
    """Scores there ~ N(J' m, J'), here ~ N(J (m + c), J); m and, if there is a change, c ~ N(0, sd^2)."""
    rng = np.random.default_rng(4)
    roots = rng.normal(size=(2, 3, 3))
    here, there = (root @ root.T + 0.5 * np.eye(3) for root in roots)
    sd, scores = 0.7, rng.normal(size=6) * 2.0

    def joint(changed: bool) -> float:
        cross = sd**2 * here @ there
        own = here + (1.0 + changed) * sd**2 * here @ here
        covariance = np.block([[own, cross], [cross.T, there + sd**2 * there @ there]])
        return float(multivariate_normal.logpdf(scores, np.zeros(6), covariance))

    nats = post.Projected(scores[:3], here).nats_since(post.Projected(scores[3:], there), sd)
    assert nats == pytest.approx(joint(True) - joint(False), abs=1e-9)


def with_free(fitted: LauncherFit, name: str) -> LauncherFit:
    """One of the columns is a free change."""
    columns = tuple(replace(one, kind="free") if one.name == name else one for one in fitted.scores.columns)
    return replace(fitted, scores=replace(fitted.scores, columns=columns))


@pytest.mark.parametrize(("wave", "unexplained"), [(1.0, True), (0.0, False)])
def test_a_change_that_goes_with_a_covariate_is_unexplained(wave: float, unexplained: bool) -> None:
    """Its column's amplitude is a wave over the covariate; or a term is at work, the same in all shots."""
    name = "release_height.above_m"
    place = np.random.default_rng(0).uniform(size=300)
    fitted = fit_straight({"wind_z.speed_m_s": 0.0 if unexplained else 0.9}, 2, 300,
                          varying={name: wave * np.sin(2.0 * np.pi * place)})
    fitted = with_free(fitted, name)
    covariate = Covariate((("humidity", place),))
    posterior = post.weigh(fitted, name_terms(fitted, lambda done, note: None), (covariate,), ())
    assert (posterior.unexplained() > 0.9) == unexplained
    first = post.families_of(fitted.scores, (covariate,), ())[0]
    assert first.column == name and first.what is covariate
    assert (first.nats > 5.0) == unexplained
    if not unexplained:
        assert next(iter(posterior.inclusion())) == "wind_z.speed_m_s"


def test_an_unexplained_change_counts_by_what_home_did_not_show() -> None:
    """The same wave in both sessions is no change; one that home lacks is."""
    name, place = "release_height.above_m", np.random.default_rng(0).uniform(size=300)
    covariate = Covariate((("humidity", place),))

    def session(wave: float, seed: int) -> LauncherFit:
        varying = {name: wave * np.sin(2.0 * np.pi * place)}
        return with_free(fit_straight({}, seed, 300, varying=varying), name)

    here = session(1.0, 2)
    alike, without_it = (ReferenceSession(session(wave, 7), {"humidity": place}) for wave in (1.0, 0.0))
    alone, same, new = (post.families_of(here.scores, (covariate,), (), home)[0].nats
                        for home in (None, alike, without_it))
    # the difference of two equal samples has twice the variance of one: half the nats
    assert alone > 20.0 and same < 3.0 and new == pytest.approx(0.5 * alone, rel=0.2)
    assert post.weigh(here, name_terms(here, lambda done, note: None), (covariate,), (), alike).unexplained() < 0.9


def test_a_term_whose_size_differs_from_group_to_group_is_named() -> None:
    """That it is not the same for all is no proof against its name."""
    ball = np.arange(300) % 4
    size = np.array([0.4, 1.6, 0.9, 2.2])[ball]
    fitted = with_free(fit_straight({}, 2, 300, varying={"wind_z.speed_m_s": size}), "release_height.above_m")
    factor = Factor("ball_id", ("a", "b", "c", "d"), ball)
    posterior = post.weigh(fitted, name_terms(fitted, lambda done, note: None), (), (factor,))
    assert posterior.share("varies") > 0.9 and posterior.unexplained() < 0.1
    assert posterior.inclusion()["wind_z.speed_m_s"] > 0.9


def test_probabilities_are_counted_by_what_hypotheses_hold() -> None:
    x = Covariate((("x", np.arange(200.0)),))
    free = post.families_of(with_free(fit_straight({}, 1), ASKED[0]).scores, (x,), ())
    found = post.Hypotheses((post.Hypothesis(("a.x",), None, 0.0, 0.0), post.Hypothesis(("a.x", "b.x"), None, 0.0, 0.0),
                       post.Hypothesis(("b.x",), free[0], 0.0, 0.0), post.Hypothesis((), free[0], 0.0, 0.0)),
                      np.array([0.4, 0.3, 0.2, 0.1]), {})
    assert found.inclusion() == pytest.approx({"a.x": 0.7, "b.x": 0.3})
    assert found.held_by(["b.x"]) == pytest.approx(0.3) and found.held_by(["a.x", "b.x"]) == pytest.approx(0.7)
    assert found.inclusion(beside=True) == pytest.approx({"a.x": 0.7, "b.x": 0.5})
    assert found.held_by(["b.x"], beside=True) == pytest.approx(0.5)
    assert found.likeliest_change() is found.hypotheses[2] and found.likeliest_change("b.x") is found.hypotheses[2]
    assert found.likeliest_change("a.x") is None
    assert found.unexplained() == pytest.approx(0.3)
    assert [found.share(kind) for kind in ("one", "two", "both", "unexplained")] == pytest.approx([0.4, 0.3, 0.2, 0.1])


@pytest.mark.parametrize(("name", "usual", "prior"), [
    ("spin_decay.rate_per_s", 0.4, lambda x: np.where(x > 0.0, 2.0, 0.0)),
    ("release_height.above_m", 0.04, lambda x: np.ones_like(x)),
    ("spin_drag.share", 0.3, lambda x: np.where(x > 0.0, 1.8, 0.2))])
def test_an_amplitudes_own_prior_is_integrated_as_scipy_does(name: str, usual: float, prior: Prior) -> None:
    """By its range, the side that nature prefers, and sizes of half, one, two and four times the usual one."""
    fitted = fit_straight({}, 1)
    for amplitude, sd in ((0.8 * usual, 0.2 * usual), (0.0, 0.3 * usual), (-0.2 * usual, 0.3 * usual)):
        def ratio(x: float, amplitude: float = amplitude, sd: float = sd) -> float:
            wide = np.mean([norm.pdf(x, 0.0, size * usual) for size in (0.5, 1.0, 2.0, 4.0)])
            return float(norm.pdf(x, amplitude, sd) * prior(np.array(x)) * wide / norm.pdf(x, 0.0, usual))

        expected = quad(ratio, amplitude - 8 * sd, amplitude + 8 * sd, points=[0.0], limit=200)[0]
        assert nats_in_range(fitted, name, amplitude, sd, usual) == pytest.approx(np.log(expected), abs=0.03)


def test_what_a_law_gives_is_believed_near_one() -> None:
    fitted = fit_straight({}, 1)
    at_law, far = (nats_in_range(fitted, "added_mass.share", amplitude, 0.1, 1.0) for amplitude in (1.0, -0.6))
    assert at_law > 1.0 and far < -10.0


BELIEVED = ("gravity", "drag", "magnus")


def fit_drifting(drift: float) -> tuple[LauncherFit, post.Part]:
    """Launches grow faster by this share from first to last shot; the part is a curve of the speed over time."""
    dataset = make_outcomes(World(measured=True, speed_drift=drift), 80, 4)
    intake = take_in(dataset)
    fitted = fit_believed(Launcher(intake, lay_out(intake, BELIEVED)))
    shapes = post.process_shapes(dataset.shots.number("t_s")[intake.rows], 1.0)
    return fitted, post.Part.of(fitted.scores.index("launch speed"), shapes, np.full(shapes.shape[1], 0.03))


@pytest.mark.slow
def test_a_small_change_is_worth_flown_what_the_table_says_and_no_change_costs() -> None:
    for drift in (0.0, 0.03):
        fitted, part = fit_drifting(drift)
        evidence = fitted.scores
        table = post.log_evidence(post.with_parts(evidence, [part]))[0] - post.log_evidence(evidence.shared_only())[0]
        found = post.flown(fitted, part)
        assert found is not None and found.log_evidence == pytest.approx(table, abs=0.6)
        assert found.log_evidence < 0.0 if drift == 0.0 else found.log_evidence > 5.0


def test_in_a_closed_hall_wind_is_a_draught() -> None:
    dataset = make_outcomes(World(), 12, 1)
    hall = replace(dataset, facts=structs.replace(FACTS, site=Site(indoor=True)))
    usual = [{column.name: column.usual for column in lay_out(take_in(one), BELIEVED).columns}
             for one in (dataset, hall)]
    assert [each["wind_x.speed_m_s"] for each in usual] == [0.8, 0.2]
    assert usual[0]["hood_offset.angle_deg"] == usual[1]["hood_offset.angle_deg"]
