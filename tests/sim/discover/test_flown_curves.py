"""Unexplained changes truly flown, terms ranked where slopes tell nothing, and the air of a closed hall."""

from dataclasses import replace

import numpy as np
import pytest
from msgspec import structs

from tests.sim.discover.worlds import FACTS, World, make_outcomes
from truearc.robot.config.rig_spec import Site
from truearc.sim.discover.detect.covariates import Covariate
from truearc.sim.discover.select.posterior import (
    Part,
    log_evidence,
    nats_flown,
    process_shapes,
    term_of,
    weigh,
    with_parts,
)
from truearc.sim.discover.select.terms import _scan, name_terms, one_step
from truearc.sim.infer.fit import fit_believed
from truearc.sim.infer.launcher import Launcher, LauncherFit
from truearc.sim.infer.likelihood.data import take_in
from truearc.sim.infer.likelihood.layout import lay_out
from truearc_proof.truth.generate import shoot
from truearc_proof.truth.world import make_world

BELIEVED = ("gravity", "drag", "magnus")


def fit_drifting(drift: float) -> tuple[LauncherFit, Part]:
    """Launches grow faster by this share from first to last shot; the part is a curve of the speed over time."""
    dataset = make_outcomes(World(measured=True, speed_drift=drift), 80, 4)
    intake = take_in(dataset)
    fitted = fit_believed(Launcher(intake, lay_out(intake, BELIEVED)))
    shapes = process_shapes(dataset.shots.number("t_s")[intake.rows], 1.0)
    return fitted, Part(fitted.scores.index("launch speed"), shapes, np.full(shapes.shape[1], 0.03))


@pytest.mark.slow
def test_a_small_change_is_worth_flown_what_the_table_says_and_no_change_costs() -> None:
    for drift in (0.0, 0.03):
        fitted, part = fit_drifting(drift)
        evidence = fitted.scores
        table = log_evidence(with_parts(evidence, [part]))[0] - log_evidence(evidence.shared_only())[0]
        flown = nats_flown(fitted, part)
        assert flown is not None and flown == pytest.approx(table, abs=0.6)
        assert flown < 0.0 if drift == 0.0 else flown > 5.0


@pytest.mark.slow
def test_an_unexplained_change_that_matters_is_weighed_as_it_flies() -> None:
    fitted, _ = fit_drifting(0.06)
    t_s = make_outcomes(World(measured=True, speed_drift=0.06), 80, 4).shots.number("t_s")
    posterior = weigh(fitted, name_terms(fitted, lambda done, note: None), (Covariate((("t_s", t_s),)),), ())
    alone = [one for one in posterior.hypotheses if one.family is not None and not one.names]
    likeliest = max(alone, key=lambda one: one.nats)
    assert likeliest.family is not None
    flown = nats_flown(fitted, likeliest.family.part)
    assert flown is not None and likeliest.nats == pytest.approx(flown + likeliest.family.spread, abs=1e-6)
    assert posterior.probability.sum() == pytest.approx(1.0)


@pytest.mark.slow
def test_what_no_simulation_of_single_shots_holds_is_not_flown() -> None:
    fitted, part = fit_drifting(0.0)
    wide = np.zeros((len(part.shapes), 12))
    assert nats_flown(fitted, Part(part.column, wide, np.ones(12))) is None
    drag = fitted.scores.columns[fitted.scores.index("spin_drag.share")]
    assert term_of(drag, fitted.model.layout) is None


@pytest.mark.slow
def test_a_scan_ranks_the_true_term_and_gives_its_sign() -> None:
    dataset = shoot(make_world({"hood_offset": -2.0}, "L1", 100, 3))
    intake = take_in(dataset)
    fitted = fit_believed(Launcher(intake, lay_out(intake, dataset.facts.believe.terms)))
    scanned = sorted(_scan(fitted, [one for one in one_step(fitted.scores)[0] if one.visible]),
                     key=lambda one: -one.nats)
    place = [one.name for one in scanned].index("hood_offset.angle_deg")
    assert place < 4 and scanned[place].amplitude < 0.0


def test_in_a_closed_hall_wind_is_a_draught() -> None:
    dataset = make_outcomes(World(), 12, 1)
    hall = replace(dataset, facts=structs.replace(FACTS, site=Site(indoor=True)))
    usual = [{column.name: column.usual for column in lay_out(take_in(one), BELIEVED).columns}
             for one in (dataset, hall)]
    assert [each["wind_x.speed_m_s"] for each in usual] == [0.8, 0.2]
    assert usual[0]["hood_offset.angle_deg"] == usual[1]["hood_offset.angle_deg"]
