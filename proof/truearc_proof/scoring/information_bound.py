"""Information bound of an opened world: what its data allow any solver, worked out by the grader from the truth."""

from typing import NamedTuple

import numpy as np

from truearc.sim.data.dataset import Dataset
from truearc.sim.data.shot_conditions import counts_shots
from truearc.sim.discover.select.terms import efficient, refit
from truearc.sim.infer.belief import Belief, point_belief
from truearc.sim.infer.fit import BaselineFit, coefficients_of, fit_believed
from truearc.sim.infer.likelihood.data import take_in
from truearc.sim.infer.likelihood.layout import groups_of, lay_out
from truearc.sim.infer.likelihood.score_table import ScoreTable, unseen_score, without
from truearc.sim.physics.catalogue import BUILT_IN
from truearc_proof.scoring.oracle import FALSE_ALARM, Ceiling, ceiling_of, strength_of
from truearc_proof.scoring.score_finding import PARAMETER
from truearc_proof.truth.generate import shift_m
from truearc_proof.truth.world import make_world
from truearc_proof.worlds.sampling_plan import NUMPY, WEAR, Drawn


class Measured(NamedTuple):
    """allowed: as truearc_proof.scoring.oracle.Ceiling, of one hidden effect of the catalogue; alike: terms of its
    class in these data; best_sd: least standard error of its amplitude; oracle_gain: nats per shot on unseen shots of
    a solver that knows the term; strength: lambda of an effect that no catalogue has, where only heights speak of it.
    before, oracle: what is believed, fitted by the grader, without the true term and with it."""

    allowed: tuple[float, ...] | None = None
    alike: tuple[str, ...] = ()
    best_sd: float | None = None
    oracle_gain: float | None = None
    strength: float | None = None
    before: Belief | None = None
    oracle: Belief | None = None


def measure(drawn: Drawn, dataset: Dataset, claimed: bool = True, seed: int = 0) -> Measured:
    """Of worlds of the NumPy engine with one hidden effect; of those with none or more only what is believed, if
    something was claimed; of others nothing is known."""
    single = len(drawn.effects) == 1
    if drawn.engine != NUMPY or not (single or claimed):
        return Measured()
    terms, intake = dataset.facts.believe.terms, take_in(dataset)
    fitted = fit_believed(intake, lay_out(intake, terms, groups_of(dataset.shots, intake.rows), BUILT_IN))
    before = _believed(fitted.evidence, terms)
    return _of_one(drawn, dataset, fitted, seed)._replace(before=before) if single else Measured(before=before)


def _of_one(drawn: Drawn, dataset: Dataset, fitted: BaselineFit, seed: int) -> Measured:
    (name, amount), = drawn.effects.items()
    if name not in PARAMETER:
        world = make_world(drawn.effects, drawn.level, drawn.shots, drawn.seed, drawn.dirt)
        return Measured(strength=strength_of(fitted.evidence, shift_m(world)))
    column, amplitude = f"{name}.{PARAMETER[name][0]}", PARAMETER[name][1](amount)
    ceiling = ceiling_of(fitted.evidence, drawn.level, column, amplitude, seed)
    if name in WEAR and not counts_shots(dataset.shots):       # it goes with balls, which are not told apart
        ceiling = Ceiling(FALSE_ALARM, 0.0, 0.0, 0.0, ())
    if ceiling is None:
        return Measured()
    index = np.array([fitted.evidence.index(column)])
    information = float(efficient(fitted.evidence, index)[1][0, 0])
    best_sd = information**-0.5 if information > 0.0 else None
    told = refit(fitted, (column,), np.array([amplitude]))
    gain = unseen_score(told.evidence) - unseen_score(without(fitted.evidence))
    return Measured(tuple(ceiling[:4]), ceiling.alike, best_sd, float(gain.mean()),
                    oracle=_believed(told.evidence, dataset.facts.believe.terms))


def _believed(evidence: ScoreTable, terms: tuple[str, ...]) -> Belief:
    """The point belief at the evidence's point, of these terms and those fitted with them."""
    return point_belief(coefficients_of(evidence, terms, BUILT_IN), among=BUILT_IN)
