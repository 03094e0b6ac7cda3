"""Which tests are made, and what chance makes of them: enumeration, closed forms, invariance and the uniform law."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import kstest, norm

from tests.sim.discover.made import at_least_squares, column, gaussian
from truearc.sim.data.dataset import Shots
from truearc.sim.discover.detect import battery as bat
from truearc.sim.discover.detect.battery import Judged, Scores, efficient_scores, judge
from truearc.sim.discover.detect.covariates import Covariate, Factor
from truearc.sim.discover.detect.localization import locate
from truearc.sim.infer.likelihood.layout import groups_of
from truearc.sim.infer.likelihood.score_table import Column, ScoreTable

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


N = 200
LAUNCH = Column("launch speed", "free", "launch", "along", "1", 0.2)
FOLLOWS = Column("push in proportion to speed", "free", "flight", "along", "m/s2", 1.5, follows="speed_in_flight_m_s")
COLUMNS = (LAUNCH, FOLLOWS, column("wind_z.speed_m_s", "term"), column("drag.cd", "shared"))


def shots_of(**texts: tuple[str, ...]) -> Shots:
    n = len(next(iter(texts.values())))
    return Shots(tuple(map(str, range(n))), {}, texts)


def covariates(seed: int = 0) -> tuple[Covariate, Covariate]:
    rng = np.random.default_rng(seed)
    return tuple(Covariate(((name, rng.normal(size=N)),)) for name in ("battery_v", "distance_m"))  # type: ignore


def evidence_of(effect: np.ndarray, seed: int = 1) -> ScoreTable:
    """Launch speed moves what was seen by one deviation a unit; the term and the coefficient by random amounts."""
    rng = np.random.default_rng(seed)
    slopes = np.concatenate([np.ones((N, 1)), rng.normal(size=(N, 3))], axis=1)
    return gaussian(effect + rng.normal(size=N), slopes, COLUMNS, np.array([0.01]))


def judged_asked(asked: bat.Asked, seed: int = 0) -> bat.Judged:
    family = [test.family for test in asked.tests]
    return bat.judge(asked.scores, family, bat.ALLOWANCE, 999, seed, lambda done, note: None)


def asked_of(evidence: ScoreTable, factors: tuple[Factor, ...] = ()) -> bat.Asked:
    return bat.ask_everything(evidence, covariates(), factors, N)


def test_terms_are_asked_once_and_free_changes_over_every_shape() -> None:
    asked = asked_of(evidence_of(np.zeros(N)), (Factor("supplier", ("a", "b"), np.arange(N) % 2),))
    own = {(test.family, COLUMNS[test.column].name, bat.name_of(test, COLUMNS[test.column])) for test in asked.tests
           if test.family != bat.PATTERN}
    assert own == {(bat.TERMS, "wind_z.speed_m_s", None),
                   (bat.FREE, "push in proportion to speed", "speed_in_flight_m_s"),
                   *((bat.FREE, "launch speed", name) for name in (None, "battery_v", "distance_m", "supplier"))}
    shapes = {test.shape for test in asked.tests if isinstance(test.what, Covariate)}
    assert {"straight", "bent"} < shapes and any(shape.startswith("step at") for shape in shapes)
    assert asked.scores.psi.shape == (N + 1, len(asked.tests)) and asked.scores.kept.all()
    pairs = [test for test in asked.tests if test.family == bat.PATTERN]
    assert {test.shape for test in pairs} == {"product", "wave"}
    assert {bat.name_of(test, COLUMNS[test.column]) for test in pairs} == {"battery_v x distance_m"}


def test_what_goes_with_one_covariate_is_found_there() -> None:
    battery, _ = covariates()
    asked = asked_of(evidence_of(0.6 * battery.values))
    found = judged_asked(asked)
    best = asked.tests[int(found.p_value.argmin())]
    assert found.p_any < 0.01 and isinstance(best.what, Covariate) and best.what.name == "battery_v"
    straight = next(k for k, test in enumerate(asked.tests) if test.shape == "straight"
                    and bat.name_of(test, COLUMNS[test.column]) == "battery_v")
    assert found.amplitude[straight] == pytest.approx(0.6 * battery.values.std(), abs=0.2)


def test_what_goes_with_two_covariates_together_is_found_as_a_pattern() -> None:
    """A product of two, which is flat over either of them alone."""
    battery, distance = covariates()
    product = battery.values * distance.values
    evidence = evidence_of(2.0 * (product - product.mean()))
    asked = asked_of(evidence)
    found = judged_asked(asked)
    assert found.families["pattern"] <= 0.01 < 0.05 < min(found.families["free"], found.families["terms"])
    assert found.p_any <= 0.05
    best = asked.tests[int(found.p_value.argmin())]
    assert (best.family, best.shape) == (bat.PATTERN, "product")
    place = locate(evidence, asked, found, 0.05, N, 0)
    assert place is not None and bat.name_of(place.test, place.column) == "battery_v x distance_m"
    assert place.correction.gain.sum() > 50.0
    assert np.corrcoef(place.correction.amplitude, product)[0, 1] > 0.9


def test_many_balls_differ_by_luck_few_could_be_known() -> None:
    rows = np.arange(40)
    many, few = (shots_of(ball_id=tuple(f"b{k % count}" for k in range(40))) for count in (13, 4))
    found = groups_of(many, rows)
    assert found is not None
    what, label, count = found
    assert (what, count) == ("ball_id", 13)
    assert len(label) == 40 and label.max() == 12
    texts = np.array(many.text("ball_id"))
    assert all((label[texts == text] == label[list(many.text("ball_id")).index(text)]).all() for text in set(texts))
    assert groups_of(few, rows) is None
    assert groups_of(shots_of(ball_id=tuple(map(str, range(40)))), rows) is None       # nothing would be left to ask
    assert groups_of(shots_of(ball_id=("",) * 40), rows) is None


def test_a_big_group_and_its_crumbs_are_not_many() -> None:
    texts = ("same",) * 90 + tuple(f"b{k}" for k in range(12))
    assert groups_of(shots_of(ball_id=texts), np.arange(len(texts))) is None


def test_sessions_stand_in_for_balls() -> None:
    found = groups_of(shots_of(session=tuple(f"day{k % 12}" for k in range(60))), np.arange(60))
    assert found is not None and found[0] == "session"
