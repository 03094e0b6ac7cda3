"""What adoption is judged by: points of hold-out shots against shots really aimed, random effects of balls at zero."""

from dataclasses import replace

import numpy as np
import pytest

from tests.sim.discover.made import column, gaussian
from truearc.robot.config.rig_spec import Target
from truearc.sim.data.dataset import Shots
from truearc.sim.discover.investigate import ball_effects, usual_gain, usual_score
from truearc.sim.discover.select.simulations import HoldOut, ShotPoints, points_of
from truearc.sim.infer.likelihood.heights import see_heights
from truearc.sim.infer.likelihood.outcomes import Outcomes
from truearc.sim.infer.likelihood.score_table import ScoreTable

THREE_M, TWO_M, SCATTER_M = 0.07, 0.35, 0.08
TARGET = Target(2.44, three_half_height_m=THREE_M, two_half_height_m=TWO_M)


def see(height_m: np.ndarray, measured: bool = False, side: bool = True) -> Outcomes:
    """The observations of heights above the centre."""
    size = np.abs(height_m)
    outcome = np.where(size <= THREE_M, "three", np.where(size <= TWO_M, "two", "miss"))
    sides = np.where((outcome == "three") | (not side), "", np.where(height_m < 0.0, "low", "high"))
    shots = Shots(tuple(map(str, range(len(height_m)))),
                  {"miss_height_m": height_m if measured else np.full(len(height_m), np.nan)},
                  {"outcome": tuple(outcome.tolist()), "side": tuple(sides.tolist())})
    return see_heights(shots, TARGET)[1]


def scored(miss_m: np.ndarray) -> np.ndarray:
    return np.where(np.abs(miss_m) <= THREE_M, 3.0, np.where(np.abs(miss_m) <= TWO_M, 2.0, 0.0))


def season(n: int = 20000) -> tuple[np.ndarray, HoldOut, HoldOut]:
    """Heights of shots, and forecasts by a belief that is wrong by 0.2 m and more where it is far, and by the truth."""
    rng = np.random.default_rng(4)
    true_m = rng.normal(0.0, 0.25, n)
    wrong_m = true_m + 0.2 + 0.1 * rng.normal(size=n)
    height_m = true_m + SCATTER_M * rng.normal(size=n)
    return height_m, HoldOut(wrong_m, np.full(n, 0.15)), HoldOut(true_m, np.full(n, SCATTER_M))


@pytest.mark.parametrize(("measured", "limit"), [(True, 1e-12), (False, 0.12)])
def test_aimed_points_are_those_of_shots_aimed_by_the_belief(measured: bool, limit: float) -> None:
    """A ball whose motors are corrected by the belief's forecast misses by the forecast's error. By outcomes alone both
    beliefs come nearer to each other, since either may be right within a class."""
    height_m, wrong, right = season()
    seen = see(height_m, measured)
    for mine in (wrong, right):
        found = points_of(seen, mine, (wrong, right), 0.3).aimed.mean()
        assert found == pytest.approx(scored(height_m - mine.mean_m).mean(), abs=limit)


def test_the_better_belief_has_more_points_and_its_gate_fires_the_better_shots() -> None:
    height_m, wrong, right = season()
    seen = see(height_m)
    before, after = (points_of(seen, one, (wrong, right), 0.3) for one in (wrong, right))
    assert after.aimed.mean() > before.aimed.mean() + 0.3
    points = seen.points()
    assert points == pytest.approx(scored(height_m))
    assert points[after.fires].mean() > points[before.fires].mean() + 0.2


def test_worth_counts_held_balls_as_kept() -> None:
    points = ShotPoints(np.array([2.5, 2.0]), np.array([True, False]), np.array([False, True]))
    assert points.worth(0.9).tolist() == [2.5, 0.9]


SHOTS, LUCK_SD = 200, 1.0
OTHERS = replace(column("others 0", "group"), told=True)


def session(y: np.ndarray, *robot: np.ndarray) -> ScoreTable:
    """y = what the robot does + what balls of this session do (the same to each shot) + unit noise."""
    columns = (*(column(f"robot {k}", "shared") for k in range(len(robot))), OTHERS)
    slopes = np.stack([*robot, np.ones(SHOTS)], axis=1)
    return gaussian(y, slopes, columns, np.array([*[0.01] * len(robot), LUCK_SD**-2]), np.zeros(len(columns)))


def test_a_change_of_the_robot_that_balls_could_explain_is_worth_what_other_balls_would_show() -> None:
    """All shots 3 higher: effects of its balls forecast this session's own as well, the next's they do not."""
    y = 3.0 + np.random.default_rng(1).normal(size=SHOTS)
    before, after = session(y), session(y, np.ones(SHOTS))
    assert np.mean(after.held_out() - before.held_out()) == pytest.approx(0.0, abs=0.01)
    low, high = usual_gain(before, after)
    assert low < 0.5 * 3.0**2 < high     # a hundredth part goes to the balls, whose prior is narrower
    assert low > 3.0


def test_a_name_that_needs_balls_to_make_its_level_good_is_surely_worse_for_others() -> None:
    """It explains what goes with d, and moves all shots by 4, which the balls' effects must take back."""
    rng = np.random.default_rng(2)
    d = rng.normal(size=SHOTS)
    y = 0.5 * d + rng.normal(size=SHOTS)
    before, after = session(y), session(y, d + 4.0)
    assert np.mean(after.held_out() - before.held_out()) > 0.05
    assert usual_gain(before, after)[1] < 0.0


def test_where_no_earlier_balls_were_believed_nothing_is_taken_out() -> None:
    y = np.random.default_rng(3).normal(1.0, 1.0, SHOTS)
    plain = gaussian(y, np.ones((SHOTS, 1)), (column("robot", "shared"),))
    assert len(ball_effects(plain)) == 0
    assert usual_score(plain) == pytest.approx(plain.held_out())
