"""One effect after another, where everything is linear: each is put in before the next is looked for."""

from dataclasses import replace

import numpy as np
import pytest

from tests.sim.discover.straight import ASKED, SHARED, fit_straight
from truearc.sim.discover.decide import Search, Step, decide, unseen_scores
from truearc.sim.discover.select.terms import NEVER, name_terms
from truearc.sim.infer.launcher import LauncherFit


def steps_of(fitted: LauncherFit) -> tuple[Step, ...]:
    return decide(fitted, None, Search(len(fitted.scores.rows), (), (), 0.05, 0), lambda done, note: None)


def test_two_effects_are_named_in_turn_and_then_it_ends() -> None:
    planted = {"wind_z.speed_m_s": 0.9, "added_mass.share": 0.5}
    fitted = fit_straight(planted, 2)
    steps = steps_of(fitted)
    assert {step.naming.leader for step in steps} == set(planted) and len(steps) == 2
    assert [step.base for step in steps] == [(), (steps[0].naming.leader,)]
    assert not any(step.unknown for step in steps)
    for step in steps:
        assert step.after.sum() > step.before.sum() + 10.0
    assert steps[1].after == pytest.approx(steps[0].after, abs=0.02)       # either with the other in
    for step in steps:
        assert step.refit.amplitude[0] == pytest.approx(planted[step.naming.leader], abs=0.25)


def test_a_name_that_only_stood_for_two_others_goes() -> None:
    """What lies between two effects explains more than either alone, and nothing once both are in."""
    planted = {"wind_z.speed_m_s": 1.2, "added_mass.share": 0.8}
    fitted = fit_straight(planted, 5, 400, usual=dict.fromkeys(ASKED, 1.0),
                          between={"drag_wear.share": tuple(planted)})
    assert name_terms(fitted, lambda done, note: None).leader == "drag_wear.share"
    steps = steps_of(fitted)
    found = {step.naming.leader: float(step.refit.amplitude[0]) for step in steps}
    assert found == pytest.approx(planted, abs=0.3)
    assert {step.chosen for step in steps} == {(name,) for name in planted}


def test_it_stops_after_so_many() -> None:
    planted = {name: 1.0 - 0.1 * k for k, name in enumerate(ASKED[:5])}
    assert len(steps_of(fit_straight(planted, 3))) == 3


def test_nothing_that_is_worth_its_prior_is_unknown() -> None:
    """Asked to name what is not there, it names nothing and goes no further."""
    steps = steps_of(fit_straight({}, 11))
    assert len(steps) == 1
    assert steps[0].naming.nats[steps[0].naming.leader] <= 0.0 and steps[0].unknown


def test_the_promoted_column_has_no_slope_left() -> None:
    fitted = fit_straight({"buoyancy.share": 0.7, "wind_x.speed_m_s": 0.4}, 4)
    found = fitted.with_terms(("buoyancy.share",), np.array([0.5]))
    there = fitted.beside(found)
    columns = [one.name for one in there.scores.columns]
    assert columns == [*(name for name in ASKED if name != "buoyancy.share"), "buoyancy.share", *SHARED]
    assert there.scores.first_shared == len(ASKED) - 1
    slope = there.scores.score[:, there.scores.first_shared:].sum(0) + there.scores.pull
    assert slope == pytest.approx(np.zeros(3), abs=0.5)                    # of information 200: a thousandth of an sd
    information = there.scores.info.sum(0).diagonal()[there.scores.first_shared:]
    assert (np.abs(slope) / np.sqrt(information) < 0.06).all()
    assert there.scores.log_score.sum() == pytest.approx(found.scores.log_score.sum())
    # the other effect is still to be seen, the promoted one's slots hold what was fitted
    other = there.scores.index("wind_x.speed_m_s")
    assert there.scores.score[:, other].sum() / np.sqrt(there.scores.info[:, other, other].sum()) > 4.0
    assert there.values["buoyancy.share"] == pytest.approx(found.amplitude[0])


def test_a_refit_that_is_impossible_has_no_part_in_the_average() -> None:
    """One that came to rest where no ball flies has no information that could be inverted."""
    fitted = fit_straight({}, 11)
    naming = name_terms(fitted, lambda done, note: None)
    other = next(name for name in naming.refits if name != naming.leader)
    lost = replace(naming.refits[other].scores, info=np.full_like(naming.refits[other].scores.info, np.nan))
    refits = {**naming.refits, other: replace(naming.refits[other], scores=lost)}
    alone = replace(naming, refits={name: one for name, one in refits.items() if name != other})
    impossible = replace(naming, refits=refits, nats={**naming.nats, other: NEVER})
    for one, same in zip(unseen_scores(impossible, fitted), unseen_scores(alone, fitted), strict=True):
        assert np.isfinite(one).all() and np.array_equal(one, same)
