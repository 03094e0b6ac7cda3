"""Sentences of a fit's report."""

from truearc.sim.infer.fit_text import say_estimates
from truearc.sim.infer.parameters import Sought
from truearc.sim.infer.profile import ProfileInterval
from truearc.sim.physics.scales import LOG
from truearc.sim.physics.term import Prior

DRAG = Sought("drag.cd", "1", Prior(LOG, 0.5, 0.7, "of balls"), "drag coefficient")


def test_an_estimate_that_was_all_but_impossible_is_warned_of() -> None:
    for value, warned in ((0.2, False), (1.5, False), (8.3, True), (0.05, True)):
        one = ProfileInterval("drag.cd", value, 0.9 * value, 1.1 * value, True, True, True)
        said = list(say_estimates((one,), (DRAG,)))
        assert ("warning: drag.cd" in said[-1] and "truearc discover" in said[-1]) == warned
