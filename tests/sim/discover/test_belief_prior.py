"""A session's posterior is the next one's prior, number by number on its own scale; and whether it has changed."""

from dataclasses import replace

import numpy as np
import pytest

from tests.sim.discover.made import column, gaussian
from tests.sim.discover.straight import ASKED, lay_straight
from truearc.sim.discover.detect.battery import PIECES, Scores, efficient_scores
from truearc.sim.infer.belief import Belief, point_belief
from truearc.sim.infer.likelihood.layout import inform, may_have_moved, widened
from truearc.sim.infer.likelihood.score_table import Column, ScoreTable
from truearc.sim.physics.term import to_scale

COLUMNS: tuple[Column, ...] = tuple(column(name, "shared") for name in (
    "drag.cd", "exit_efficiency.loss", "hood_offset.angle_deg", "scatter.speed", "scatter.elevation_rad",
    "track_scale.share"))
CENTRE, SD = np.array([0.4, 0.1, 0.0, -4.0, -5.0, 0.0]), np.array([0.3, 0.2, 1.0, 1.0, 1.0, 0.05])
LAYOUT = replace(lay_straight(np.ones(len(ASKED))), columns=COLUMNS, precision=np.diag(SD**-2.0), centre=CENTRE)
NAMES = ("hood_offset.angle_deg", "drag.cd", "scatter.elevation_deg", "exit_efficiency.loss")
ROOT = np.random.default_rng(3).normal(size=(4, 4)) * 0.1


@pytest.fixture
def belief() -> Belief:
    coefficients = {"drag": {"cd": 0.5}, "exit_efficiency": {"loss": 0.2}, "hood_offset": {"angle_deg": -1.5}}
    return Belief(coefficients, {"speed": 0.02, "elevation_deg": 0.4}, NAMES, ROOT @ ROOT.T)


def test_what_is_believed_is_the_centre_and_its_doubt_the_prior(belief: Belief) -> None:
    told = inform(LAYOUT, belief)
    centre, precision = told.centre, told.precision
    assert centre == pytest.approx([0.5, 0.2, -1.5, np.log(0.02), np.log(np.radians(0.4)), 0.0])
    # draws on the belief's scales, taken to the columns' units by the scales themselves
    step = 1e-6
    by_unit = [(to_scale(scale, value + step) - to_scale(scale, value - step)) / (2.0 * step)
               for scale, value in (("linear", -1.5), ("log", 0.5), ("linear", 0.0), ("left", 0.2))]
    expected = ROOT @ ROOT.T / np.outer(by_unit, by_unit)
    found = np.linalg.inv(precision)
    order = [2, 0, 4, 1]                                     # NAMES among COLUMNS
    assert found[np.ix_(order, order)] == pytest.approx(expected, rel=1e-4, abs=1e-7)
    # what the belief knows exactly, or not at all, is as wide as before
    assert found[3, 3] == pytest.approx(SD[3]**2) and found[5, 5] == pytest.approx(SD[5]**2)
    assert found[3, order] == pytest.approx(np.zeros(4), abs=1e-9)
    assert [column.name for column in told.columns if column.told] == [COLUMNS[k].name for k in (0, 1, 2, 4)]


def test_a_belief_may_take_a_combination_for_exact(belief: Belief) -> None:
    """Two numbers known only by their sum: no precision is infinite."""
    root = ROOT[:, :1]
    told = inform(LAYOUT, replace(belief, covariance=root @ root.T))
    assert np.isfinite(told.precision).all() and np.linalg.eigvalsh(told.precision).min() > 0.0
    assert told.centre[0] == pytest.approx(0.5)


def test_only_what_a_belief_doubts_can_have_changed(belief: Belief) -> None:
    assert may_have_moved(belief, "drag.cd") == pytest.approx(0.3 * 0.5 * 0.35)        # the catalogue's 0.35 on the log
    assert may_have_moved(belief, "scatter.speed") is None
    assert may_have_moved(belief, "magnus.cl") is None
    assert may_have_moved(point_belief(belief.coefficients), "drag.cd") is None
    assert may_have_moved(None, "drag.cd") is None


def test_a_number_that_may_have_changed_is_known_worse_by_as_much() -> None:
    root = np.random.default_rng(4).normal(size=(3, 3))
    covariance = root @ root.T + np.eye(3)
    expected = covariance + np.diag([0.0, 0.25, 4.0])
    assert np.linalg.inv(widened(np.linalg.inv(covariance), [(1, 0.5), (2, 2.0)])) == pytest.approx(expected)


def test_priors_that_hang_together_are_as_many_observations_as_they_are() -> None:
    """The same as rows of data with the same information, whatever combinations those are of."""
    rng = np.random.default_rng(5)
    slopes = rng.normal(size=(30, 3))
    y = rng.normal(size=30)
    rows, told = rng.normal(size=(2, 2)), np.array([0.7, -1.1])            # two observations of the shared two
    columns = (column("asked"), column("a", "shared"), column("b", "shared"))
    plain = gaussian(y, slopes, columns)
    informed = replace(plain, precision=rows.T @ rows, pull=rows.T @ told)
    weights, each = np.ones((30, 1)), np.arange(30)
    found = efficient_scores(informed, 0, weights, each, 30)
    more = gaussian(np.concatenate([y, told]), np.concatenate([slopes, np.column_stack([np.zeros(2), rows])]), columns)
    whole = efficient_scores(more, 0, np.ones((32, 1)), np.arange(32), 32)
    assert found.psi.sum() == pytest.approx(whole.psi.sum())
    assert found.kappa.sum() == pytest.approx(whole.kappa.sum())
    assert found.psi[:30] == pytest.approx(whole.psi[:30]) and found.kappa[:30] == pytest.approx(whole.kappa[:30])


def leaning(told: bool, pull: float) -> ScoreTable:
    """One asked and one shared column that pull the same way, of the latter a prior with a standard deviation of 1 / 20
    that lies `pull` / 400 off."""
    columns = (column("asked"), replace(column("a", "shared"), told=told))
    return replace(gaussian(np.zeros(30), np.ones((30, 2)), columns), precision=np.array([[400.0]]),
                   pull=np.array([pull]))


def ask(evidence: ScoreTable) -> Scores:
    return efficient_scores(evidence, 0, np.ones((30, 1)), np.arange(30), 30)


def test_what_a_session_told_is_split_without_loss() -> None:
    """So that a test which rests on it has signs to flip: as many pieces as it takes, which add up to the same."""
    split, whole = ask(leaning(True, 30.0)), ask(leaning(False, 30.0))
    assert len(split.psi) == 30 + PIECES and len(whole.psi) == 31
    assert split.psi[30:].sum() == pytest.approx(whole.psi[30, 0])
    assert split.kappa[30:].sum() == pytest.approx(whole.kappa[30, 0])
    # the prior's share of a score is its error, here 30 / 20 standard deviations
    assert abs(whole.psi[30, 0]) == pytest.approx(1.5 * np.sqrt(whole.kappa[30, 0]))


@pytest.mark.parametrize("pull", [0.0, 60.0])
def test_pieces_spread_as_the_error_that_was_stated(pull: float) -> None:
    """Whatever the error happened to be: its pieces' squares add up to about its variance, not to its square."""
    scores = ask(leaning(True, pull))
    assert (scores.psi[30:]**2).sum() == pytest.approx(scores.kappa[30:].sum(), rel=0.5)
