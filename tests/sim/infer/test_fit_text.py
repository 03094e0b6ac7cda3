"""Sentences of a fit's report."""

from truearc.sim.infer.fit_report import CrossValidation, say_estimates, say_prediction
from truearc.sim.infer.intervals import ProfileInterval
from truearc.sim.infer.launcher import Sought

DRAG = Sought("drag.cd", "1", "drag coefficient", False, 0, 0.5, 0.5)


def test_an_estimate_that_was_all_but_impossible_is_warned_of() -> None:
    for value, warned in ((0.2, False), (1.5, False), (8.3, True), (-0.9, True)):
        one = ProfileInterval("drag.cd", value, 0.9 * value, 1.1 * value, True, True, True)
        said = list(say_estimates((one,), (DRAG,)))
        assert ("warning: drag.cd" in said[-1] and "truearc discover" in said[-1]) == warned


def test_lift_against_the_spin_is_warned_of() -> None:
    lift = Sought("magnus.cl", "1", "lift coefficient", False, 0, 0.1, 0.15)
    for value, warned in ((0.05, False), (-0.05, True)):
        one = ProfileInterval("magnus.cl", value, value - 0.01, value + 0.01, True, True, True)
        said = list(say_estimates((one,), (lift,)))
        assert any("warning: magnus.cl is below 0" in line and "clock_deg" in line for line in said) == warned


def test_a_fit_that_predicts_no_better_than_plain_shares_is_warned_of() -> None:
    for log_score, warned in ((-0.7, False), (-1.5, True)):
        said = list(say_prediction(CrossValidation(48, 48, log_score, -1.0, 0.1, 0.4, 0.4)))
        assert any("warning: on shots held out" in line and "rig.toml" in line for line in said) == warned
