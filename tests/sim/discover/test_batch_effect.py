"""Adoption is judged with the random effects of a session's balls at zero: linear-Gaussian sessions in closed form."""

from dataclasses import replace

import numpy as np
import pytest

from tests.sim.discover.made import column, gaussian
from truearc.sim.discover.investigate import ball_effects, usual_gain, usual_score
from truearc.sim.infer.likelihood.score_table import ScoreTable

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
