"""Scores of outcomes alone: slopes of the log-likelihood itself, flown anew, and one top wherever a climb begins."""

import numpy as np
import pytest

from truearc.sim.infer.fit import climb, fit_believed
from truearc.sim.infer.launcher import Launcher
from truearc_proof.truth.generate import shoot
from truearc_proof.truth.world import make_world

BELIEVED = ("gravity", "exit_efficiency", "drag", "magnus")
SPIN_DRAG = "spin_drag.share"


def laid_out(effects: dict[str, float], shots: int, seed: int) -> Launcher:
    return Launcher.of(shoot(make_world(effects, "L0", shots, seed)), BELIEVED)


@pytest.mark.slow
def test_scores_are_slopes_of_the_likelihood_when_all_is_flown_anew() -> None:
    model = laid_out({}, 60, 5)
    layout, middle = model.layout, model.middle()
    evidence, _ = model.linearise(middle)
    slots = np.flatnonzero(layout.in_slot)
    for k in slots.tolist():
        step = np.zeros(len(layout.columns))
        step[k] = 1e-4 * layout.columns[k].usual
        ahead, behind = (model.linearise(model.moved(middle, sign * step))[0] for sign in (1.0, -1.0))
        travelled = ahead.point[k] - behind.point[k]
        slope = (ahead.log_score - behind.log_score) / travelled
        name, size = layout.columns[k].name, layout.columns[k].usual
        assert evidence.own_score[:, k] * size == pytest.approx(slope * size, rel=1e-3, abs=1e-4), name


@pytest.mark.slow
def test_climbs_from_all_amplitudes_come_to_one_top() -> None:
    fitted = fit_believed(laid_out({"spin_drag": 0.6}, 300, 5))
    asked = fitted.model.shared_only((SPIN_DRAG,))
    change = np.zeros(len(asked.layout.columns))
    tops = []
    for amplitude in (0.0, 0.1, 0.2, 0.3):
        change[0] = amplitude
        top = climb(asked, asked.moved(fitted.point, change))
        tops.append((top.log_posterior, top.scores.point[0]))
    values, places = np.array(tops).T
    assert np.ptp(values) < 0.05 and np.ptp(places) < 0.01
