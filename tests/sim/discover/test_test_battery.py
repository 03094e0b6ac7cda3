"""Which tests are made: groups with random effects, shapes of free changes, patterns of two covariates."""

import numpy as np
import pytest

from tests.sim.discover.made import column, gaussian
from truearc.sim.data.dataset import Shots
from truearc.sim.discover.detect import battery as bat
from truearc.sim.discover.detect.covariates import Covariate, Factor
from truearc.sim.discover.detect.localization import locate
from truearc.sim.infer.likelihood.layout import groups_of
from truearc.sim.infer.likelihood.score_table import Column, ScoreTable

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


def judged_of(asked: bat.Asked, seed: int = 0) -> bat.Judged:
    family = [test.family for test in asked.tests]
    return bat.judge(asked.scores, family, bat.ALLOWANCE, 999, seed, lambda done, note: None)


def asked_of(evidence: ScoreTable, factors: tuple[Factor, ...] = ()) -> bat.Asked:
    return bat.ask_everything(evidence, covariates(), factors, N, 3)


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
    found = judged_of(asked)
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
    found = judged_of(asked)
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
