"""Expected evidence: of shots that nobody has taken, or of configurations without results, at believed coefficients."""

from dataclasses import replace

import numpy as np

from truearc.robot.config.rig_spec import Rig
from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.discover.model.baseline_fit import fit_believed, usual_spot
from truearc.sim.discover.model.design_columns import groups_of, lay_out
from truearc.sim.discover.model.linearization import linearise
from truearc.sim.discover.model.prepared_data import take_in
from truearc.sim.discover.model.score_table import ScoreTable
from truearc.sim.discover.plan.detectability import Sight, sight_of
from truearc.sim.discover.plan.planned_season import ASIDE, mark, rehearse
from truearc.sim.physics.catalogue import Catalogue
from truearc.sim.progress import Progress

FEW = 5                               # results, from which a dataset speaks for itself


def foresee(rig: Rig, believed: tuple[str, ...], level: str, shots: int, sides: bool = False, seed: int = 0,
            progress: Progress = lambda done, note: None, among: Catalogue | None = None) -> Sight:
    """What a season of `shots` with this rig could tell; BadInput as in rehearse. among: the catalogue of the terms."""
    progress(0.0, "aim")
    dataset = rehearse(rig, believed, level, shots, sides, seed, among)
    progress(0.2, "slopes")
    evidence, _ = _expected(dataset, believed, among)
    progress(1.0, "done")
    return sight_of(evidence, level, believed)


def foresee_dataset(dataset: Dataset, believed: tuple[str, ...], sides: bool = False, seed: int = 0,
                    progress: Progress = lambda done, note: None, among: Catalogue | None = None) -> Sight:
    """What the shots of a dataset can tell: with results at the coefficients fitted to them, else as aimed beside the
    centre with the usual coefficients."""
    told = dataset.tracks is not None or sum(map(bool, dataset.shots.text("outcome"))) >= FEW or (
        np.isfinite(dataset.shots.number("miss_height_m")).sum() >= FEW)
    if told or dataset.facts.target is None:
        intake = take_in(dataset)
        layout = lay_out(intake, believed, groups_of(dataset.shots, intake.rows), among)
        fitted = fit_believed(intake, layout, progress)
        return sight_of(fitted.evidence, intake.level, believed)
    progress(0.1, "slopes")
    marked = Shots(dataset.shots.shot_id, dataset.shots.numbers,
                   {**dataset.shots.texts, **mark(len(dataset.shots), sides)}, dataset.shots.source)
    evidence, level = _expected(replace(dataset, shots=marked), believed, among)
    progress(1.0, "done")
    return sight_of(_as_aimed(evidence, seed), level, believed)


def _expected(dataset: Dataset, believed: tuple[str, ...], among: Catalogue | None) -> tuple[ScoreTable, str]:
    """Evidence at the middle of the priors; its scores mean nothing."""
    intake = take_in(dataset)
    layout = lay_out(intake, believed, groups_of(dataset.shots, intake.rows), among)
    return linearise(intake, layout, usual_spot(intake, layout))[0], intake.level


def _as_aimed(evidence: ScoreTable, seed: int) -> ScoreTable:
    """Heights beside the centre, wherever the middle of the priors would have sent them."""
    plane = evidence.plane
    if plane is None:
        return evidence
    rng = np.random.default_rng(seed)
    aside = rng.choice((-1.0, 1.0), len(plane.mean_m)) * rng.uniform(*ASIDE, len(plane.mean_m))
    aimed = replace(evidence, plane=replace(plane, mean_m=aside * plane.spread_m))
    return aimed.moved(np.zeros_like(evidence.score))
