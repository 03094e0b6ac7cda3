"""Scores of outcomes alone: slopes of the log-likelihood itself, flown anew, and one top wherever a climb begins."""

import numpy as np
import pytest

from truearc.sim.infer.fit import climb, fit_believed, moved, objective, usual_spot
from truearc.sim.infer.likelihood.data import Intake, take_in
from truearc.sim.infer.likelihood.layout import ParameterLayout, groups_of, lay_out, only_shared
from truearc.sim.infer.likelihood.linearization import linearise
from truearc_proof.truth.generate import shoot
from truearc_proof.truth.world import make_world

BELIEVED = ("gravity", "exit_efficiency", "drag", "magnus")
SPIN_DRAG = "spin_drag.share"


def laid_out(effects: dict[str, float], shots: int, seed: int) -> tuple[Intake, ParameterLayout]:
    dataset = shoot(make_world(effects, "L0", shots, seed))
    intake = take_in(dataset)
    return intake, lay_out(intake, BELIEVED, groups_of(dataset.shots, intake.rows))


@pytest.mark.slow
def test_scores_are_slopes_of_the_likelihood_when_all_is_flown_anew() -> None:
    intake, layout = laid_out({}, 60, 5)
    spot = usual_spot(intake, layout)
    evidence, _ = linearise(intake, layout, spot)
    slots = np.flatnonzero(layout.in_slot)
    for k in slots.tolist():
        step = np.zeros(len(layout.columns))
        step[k] = 1e-4 * layout.columns[k].usual
        ahead, behind = (linearise(intake, layout, moved(layout, spot, sign * step))[0] for sign in (1.0, -1.0))
        travelled = ahead.point[k] - behind.point[k]
        slope = (ahead.log_score - behind.log_score) / travelled
        name, size = layout.columns[k].name, layout.columns[k].usual
        assert evidence.own_score[:, k] * size == pytest.approx(slope * size, rel=1e-3, abs=1e-4), name


@pytest.mark.slow
def test_climbs_from_all_amplitudes_come_to_one_top() -> None:
    intake, layout = laid_out({"spin_drag": 0.6}, 300, 5)
    fitted = fit_believed(intake, layout)
    asked = only_shared(layout, (SPIN_DRAG,))
    change = np.zeros(len(asked.columns))
    tops = []
    for amplitude in (0.0, 0.1, 0.2, 0.3):
        change[0] = amplitude
        _, evidence = climb(intake, asked, moved(asked, fitted.spot, change))
        tops.append((objective(evidence, asked), evidence.point[0]))
    values, places = np.array(tops).T
    assert np.ptp(values) < 0.05 and np.ptp(places) < 0.01
