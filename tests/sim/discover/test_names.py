"""Names, where everything is linear: exact evidence, sets, what is impossible, one effect put in before the next."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from tests.sim.discover.made import stand_in
from tests.sim.discover.straight import ASKED, NAMES, SHARED, fit_straight, slopes_and_y
from truearc.sim.discover.decide import (
    Search,
    Step,
    credible_set,
    decide,
    found_effects,
    guarded,
    unseen_scores,
    verdict_of,
)
from truearc.sim.discover.select.terms import NEVER, Naming, is_possible, name_terms, nats_for, one_step
from truearc.sim.infer.fit import Fit
from truearc.sim.infer.launcher import LauncherFit
from truearc.sim.physics.catalogue import BUILT_IN, find_parameter

PLANTED = "spin_drag.share"


def named(fitted: LauncherFit) -> Naming:
    return name_terms(fitted, lambda done, note: None)


def log_marginal(fitted: LauncherFit, names: tuple[str, ...], world: tuple[np.ndarray, np.ndarray]) -> float:
    """Of y under normal priors on these names and the shared ones: one big covariance matrix."""
    slopes, y = world
    sd = np.array([*(fitted.scores.columns[ASKED.index(name)].usual for name in names), 2.0, 2.0])
    mine = slopes[:, [NAMES.index(name) for name in (*names, *SHARED)]] * sd
    return float(multivariate_normal.logpdf(y, np.zeros(len(y)), np.eye(len(y)) + mine @ mine.T))


@pytest.mark.parametrize("seed", range(5))
def test_the_right_name_wins_and_probabilities_sum_to_one(seed: int) -> None:
    naming = named(fit_straight({PLANTED: 0.6}, seed))
    assert naming.leader == PLANTED
    assert sum(naming.probability.values()) == pytest.approx(1.0)
    assert set(naming.probability) == set(ASKED)
    assert credible_set(naming, None) == (PLANTED,) and naming.aliases == ()
    assert naming.probability[PLANTED] > 0.99
    found = naming.refits[PLANTED]
    assert abs(found.amplitude[0] - 0.6) < 4.0 * found.sd[0] < 0.4


def test_a_refits_evidence_is_the_exact_one() -> None:
    fitted = fit_straight({PLANTED: 0.2}, 3)
    naming, world = named(fitted), slopes_and_y({PLANTED: 0.2}, 3, 200, {})
    believed = log_marginal(fitted, (), world)
    assert len(naming.refits) >= 3
    for name, refit in naming.refits.items():
        assert refit.log_evidence == pytest.approx(log_marginal(fitted, (name,), world) - believed, abs=1e-3)
        assert naming.nats[name] == refit.log_evidence


def test_one_step_is_exact_where_all_is_linear() -> None:
    fitted = fit_straight({PLANTED: 0.3}, 4)
    world = slopes_and_y({PLANTED: 0.3}, 4, 200, {})
    believed = log_marginal(fitted, (), world)
    for candidate in one_step(fitted.scores)[0]:
        assert candidate.nats == pytest.approx(log_marginal(fitted, (candidate.name,), world) - believed, abs=0.01)


def test_nats_are_the_log_ratio_of_two_normal_laws() -> None:
    """A score s ~ N(0, I) without the amplitude, N(0, I + I^2 u^2) with it."""
    for score, information, usual in ((3.0, 2.0, 0.5), (-0.4, 9.0, 1.0), (7.0, 0.3, 0.1)):
        with_it = multivariate_normal.logpdf(score, 0.0, information + (information * usual)**2)
        without = multivariate_normal.logpdf(score, 0.0, information)
        assert nats_for(score, information, usual) == pytest.approx(with_it - without)
    assert nats_for(5.0, 0.0, 1.0) == 0.0


def test_exact_aliases_come_as_a_set() -> None:
    twin = "buoyancy.share"
    naming = named(fit_straight({PLANTED: 0.6}, 5, copies={twin: PLANTED}))
    assert set(credible_set(naming, None)) == {PLANTED, twin}
    assert naming.probability[PLANTED] == pytest.approx(naming.probability[twin]) == pytest.approx(0.5, abs=1e-3)
    assert len(naming.aliases) == 1 and naming.aliases[0] in {PLANTED, twin}


def test_of_two_aliases_the_one_of_a_usual_size_leads() -> None:
    twin = "buoyancy.share"
    naming = named(fit_straight({PLANTED: 0.6}, 5, copies={twin: PLANTED}, usual={twin: 0.01}))
    assert naming.leader == PLANTED
    assert naming.probability[PLANTED] > 0.95
    near = named(fit_straight({PLANTED: 0.6}, 5, copies={twin: PLANTED}, usual={twin: 2.0}))
    assert near.leader == PLANTED and twin in credible_set(near, None)   # less likely, but only words part them


def test_what_the_believed_terms_explain_is_invisible() -> None:
    copies = {"wind_x.speed_m_s": "drag.cd"}
    naming = named(fit_straight({PLANTED: 0.6}, 6, shots=5000, copies=copies))
    hidden = next(c for c in naming.candidates if c.name == "wind_x.speed_m_s")
    assert not hidden.visible and hidden.z == 0.0
    assert "wind_x.speed_m_s" not in naming.probability


def test_a_name_beyond_what_its_term_allows_loses() -> None:
    """Ten usual sizes are not this effect, though nothing else in the catalogue fits."""
    naming = named(fit_straight({PLANTED: 1.5}, 5, usual={PLANTED: 0.15}))
    assert naming.refits[PLANTED].log_evidence > 50.0
    assert naming.nats[PLANTED] == NEVER and naming.probability[PLANTED] == 0.0 and naming.leader != PLANTED
    assert named(fit_straight({PLANTED: 1.5}, 5, usual={PLANTED: 0.3})).leader == PLANTED


def test_amplitudes_of_the_wrong_sign_are_impossible_only_beyond_doubt() -> None:
    one = find_parameter("wheel_slip.loss_per_m_s", BUILT_IN)

    def found(value: float, wanted: float | None = None) -> LauncherFit:
        amplitude = np.array([value])
        return stand_in(Fit, names=("wheel_slip.loss_per_m_s",), amplitude=amplitude, value=amplitude,
                        wanted=amplitude if wanted is None else np.array([wanted]), sd=np.array([0.002]),
                        model=SimpleNamespace(range_of=lambda name: (one.low, one.high)))

    assert is_possible(found(0.01), 0.015) and is_possible(found(-0.003), 0.015)
    assert not is_possible(found(-0.006), 0.015)
    assert is_possible(found(0.053), 0.015) and not is_possible(found(0.056), 0.015)
    # a fit that the end of its range stopped
    assert is_possible(found(0.05, 0.053), 0.015) and not is_possible(found(0.05, 0.08), 0.015)


def test_a_name_that_is_nothing_gets_no_nats_on_average() -> None:
    """Bayes factors: under the believed simulation the mean of exp(nats) is 1, and that of nats below 0."""
    nats = np.concatenate([[c.nats for c in one_step(fit_straight({}, 100 + seed).scores)[0]] for seed in range(40)])
    assert nats.mean() < -0.5
    assert np.exp(nats).mean() == pytest.approx(1.0, abs=0.35)


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
    fitted = fit_straight(planted, 3)
    search = Search(len(fitted.scores.rows), (), (), 0.05, 0)
    assert len(found_effects(fitted, None, search, lambda done, note: None)) == 3


@pytest.mark.parametrize(("planted", "usual", "seed", "why"), [
    ({PLANTED: 1.1}, {PLANTED: 0.135}, 5, f"({PLANTED}) would have to be 7.6 times"),
    ({PLANTED: 0.6}, {}, 5, "")])
def test_a_name_is_withheld_where_a_guard_says_so(planted, usual, seed, why) -> None:
    """A size of six usual ones, and a sound one."""
    step = steps_of(fit_straight(planted, seed, usual=usual))[0]
    assert why in step.withheld and bool(step.withheld) == bool(why) == step.unknown
    assert verdict_of(step, step.fitted, None).verdict == ("unknown" if why else "named")


@pytest.mark.parametrize(("sds", "why"), [(None, "drag coefficient (drag.cd) stopped at 0, the end"),
                                           (3.5, "drag coefficient (drag.cd) would have to be"), (3.0, "")])
def test_a_number_where_it_cannot_be_withholds_the_name(sds, why) -> None:
    step = steps_of(fit_straight({PLANTED: 0.6}, 5))[0]
    fit, layout = step.refit, replace(step.refit.model.layout, precision=100.0 * step.refit.model.layout.precision)
    k = fit.scores.index("drag.cd")
    sd = np.linalg.inv(layout.precision)[k - layout.first_shared, k - layout.first_shared]**0.5
    point = fit.scores.point.copy()
    point[k] = 0.0 if sds is None else layout.centre[k - layout.first_shared] + sds * sd
    there = replace(fit, model=replace(fit.model, layout=layout), scores=replace(fit.scores, point=point))
    moved = replace(step, naming=replace(step.naming, refits={**step.naming.refits, step.naming.leader: there}))
    assert (why in (said := guarded((moved,))[0].withheld)) and bool(said) == bool(why)
    assert guarded((step,)) == (step,)


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
