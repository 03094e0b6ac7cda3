"""Fit the parameters of terms to a dataset."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal, overload

import numpy as np
from matplotlib.figure import Figure

from truearc.api.table import Table
from truearc.api.terms import check_kind, joined, names_of
from truearc.errors import InputError, whole_file
from truearc.sim.data.dataset import Dataset, hash_dataset
from truearc.sim.infer.belief import Belief, launcher_of, point_belief, ranges_of
from truearc.sim.infer.fit import MapFit, fit_map
from truearc.sim.infer.fit_report import CrossValidation, cross_validate, fit_lines
from truearc.sim.infer.intervals import ProfileInterval, profile_interval
from truearc.sim.infer.plausibility.check import check_plausible
from truearc.sim.paper.grid_fit import GridFit, fit_grid, map_deviation
from truearc.sim.paper.grid_report import draw_map, explain, provenance_of
from truearc.sim.paper.score import Score, score
from truearc.sim.paper.settings import STEP
from truearc.sim.physics.term import Term
from truearc.sim.printed import Printed
from truearc.sim.progress import Progress

COLUMNS = ("parameter", "value", "low90", "high90", "unit", "closed")


@dataclass(frozen=True, eq=False)
class Fit(Printed):
    """Maximum a posteriori estimates of terms, launch scatter and a tracker's errors.

    `intervals`: 90 % profile intervals, one per parameter, in its own unit; empty where the search did not converge.
    `holdout`: how well outcomes are predicted that the fit had not seen; None with fewer than two groups of outcomes.
    `solution`: the optimum with its curvature.
    """

    dataset: Dataset
    solution: MapFit
    intervals: tuple[ProfileInterval, ...]
    holdout: CrossValidation | None

    @property
    def converged(self) -> bool:
        """Whether the search for the most probable parameters settled; if not, do not use the fit."""
        return self.solution.converged

    @cached_property
    def belief(self) -> Belief:
        """The estimates with their covariance and where they came from; InputError for a fit that did not converge."""
        if not self.converged:
            raise InputError(f"{self.dataset.name}: the search for the most probable parameters did not settle: the "
                             "shots or rig.toml contradict each other, or fewer terms are enough")
        return replace(self.solution.belief, provenance=self._provenance())

    def table(self) -> Table:
        """Return a row per parameter: value and ends of its 90 % interval, in `unit`; closed: the data bound it."""
        units = {one.name: one.unit for one in self.solution.sought}
        return Table(COLUMNS, tuple((one.name, one.value, one.low90, one.high90, units[one.name], one.closed)
                                    for one in self.intervals))

    def lines(self) -> list[str]:
        """Return the report: data used, what cannot be told apart, estimates, scatter, hold-out score."""
        return [*(f"warning: {line}" for line in self.dataset.accepted),
                *fit_lines(self.solution, self.intervals, self.holdout)]

    def _provenance(self) -> dict[str, Any]:
        fit = self.solution
        said: dict[str, Any] = {
            "method": "ml", "dataset": self.dataset.name, "dataset_sha256": hash_dataset(self.dataset),
            "truearc": version("truearc"), "shots": len(fit.evidence.rows), "terms": list(fit.terms),
            "log_posterior": fit.log_posterior, "evidence": fit.fitted.intake.used,
            "left_out": list(fit.fitted.intake.left_out), "range": ranges_of(self.dataset.shots),
            "rig": launcher_of(self.dataset.rig),
            **({"accepted": list(self.dataset.accepted)} if self.dataset.accepted else {}),
            "interval90": {one.name: [one.low90, one.high90] for one in self.intervals}}
        held = self.holdout
        if held is not None:
            said["heldout"] = {"shots": held.shots, "log_score": held.log_score, "accuracy": held.accuracy}
        return said


@dataclass(frozen=True, eq=False)
class GridSearch(Printed):
    """The paper's search: the pair of drag and lift coefficient under which most outcomes are reproduced.

    `step`: of the grid. `solution`: the whole map, the tied pairs and the chosen one. `accuracy`: of the chosen pair.
    """

    dataset: Dataset
    step: float
    solution: GridFit
    accuracy: Score

    @property
    def belief(self) -> Belief:
        """The chosen pair, without a covariance: the grid gives none."""
        said = provenance_of(self.step, self.dataset, self.solution, self.accuracy)
        return replace(point_belief(self.solution.coefficients), provenance=said)

    def save_map(self, path: str | Path) -> None:
        """Write an npz file: axis, share_three, share_two, tied, and mean_deviation_m (nan where no three is
        reproduced); rows cd, columns cl."""
        found = self.solution
        mean_m = np.full(found.share_three.shape, np.nan)
        at = np.nonzero((found.share_three > 0.0) | found.tied)
        mean_m[at] = map_deviation(self.dataset.rig, self.dataset.shots, found.axis[at[0]], found.axis[at[1]])
        with whole_file(path) as new, new.open("wb") as file:
            np.savez_compressed(file, axis=found.axis, share_three=found.share_three, share_two=found.share_two,
                                mean_deviation_m=mean_m, tied=found.tied)

    def plot(self) -> Figure:
        """Draw three-point accuracy over drag and lift, with the tied pairs and the chosen one."""
        return draw_map(self.dataset, self.solution)

    def table(self) -> Table:
        """Return a row per tied pair, the chosen one first; deviations [m] from the centre, None: not reached."""
        return Table(("cd", "cl", "mean_deviation_m", "median_deviation_m"),
                     tuple(tuple(float(value) if value == value else None for value in row)
                           for row in self.solution.ties))

    def lines(self) -> list[str]:
        """Return the report: shots used, tied pairs, the chosen pair and its accuracy, warnings."""
        return [*(f"warning: {line}" for line in self.dataset.accepted),
                *explain(self.dataset, self.solution, self.accuracy)]


@overload
def fit(dataset: Dataset, terms: Iterable[str | Term] | None = None, *, method: Literal["map"] = "map",
        accept: Collection[str] = ..., progress: Progress = ...) -> Fit: ...
@overload
def fit(dataset: Dataset, *, method: Literal["grid"], step: float = STEP, accept: Collection[str] = ...,
        progress: Progress = ...) -> GridSearch: ...
def fit(dataset: Dataset, terms: Iterable[str | Term] | None = None, *, method: str = "map",
        step: float | None = None, accept: Collection[str] = (),
        progress: Progress = lambda done, note: None) -> Fit | GridSearch:
    """Fit parameters of the physics to everything that a dataset records.

    Args:
        dataset: Shots with outcomes, heights, exit measurements or tracks.
        terms: Terms to fit, by name or as values (the user's own, too); None: [believe] of the rig. Gravity is always
            there.
        method: "map": maximum a posteriori of all records, with 90 % intervals. "grid": the paper's search over drag
            and lift by outcomes alone; terms do not apply.
        step: Grid only: distance of neighbouring coefficients; divides 5.
        accept: Names of plausibility checks (truearc.sim.infer.plausibility) whose objections are accepted; recorded.
        progress: Called with the share done, 0 to 1, and a note.

    Returns:
        Fit, or GridSearch for "grid": both have `.belief`, `.table()` and print as a report.

    Raises:
        InputError: implausible data, an unknown term or method, an argument of the other method, or nothing to fit to.
    """
    check_kind("dataset", dataset, Dataset, "load_dataset(...)")
    dataset = check_plausible(dataset, accept)
    if method == "map":
        if step is not None:
            raise InputError("step: method 'map' makes no use of it; method 'grid' does")
        return _fit_map(dataset, terms, progress)
    if method != "grid":
        raise InputError(f"method: there is no {method!r}; there are 'map' and 'grid'")
    if terms is not None:
        raise InputError("terms: method 'grid' makes no use of them; method 'map' does")
    step = STEP if step is None else step
    found = fit_grid(dataset.rig, dataset.shots, step, progress)
    return GridSearch(dataset, step, found, score(dataset.rig, found.coefficients, dataset.shots))


def _fit_map(dataset: Dataset, terms: Iterable[str | Term] | None, progress: Progress) -> Fit:
    where = "terms" if terms is not None else f"{dataset.name}: rig.toml: believe.terms"
    terms = dataset.rig.believe.terms if terms is None else terms
    terms = terms if isinstance(terms, str) else tuple(terms)
    among = joined(terms)
    solution = fit_map(dataset, names_of(terms, where, among) or (), lambda done, note: progress(0.4 * done, note),
                       among)
    if not solution.converged:
        return Fit(dataset, solution, (), None)
    intervals = []
    for number, name in enumerate(solution.names, 1):
        intervals.append(profile_interval(solution, name))
        progress(0.4 + 0.4 * number / len(solution.names), name)
    held = cross_validate(solution, lambda done, note: progress(0.8 + 0.15 * done, note))
    progress(1.0, "done")
    return Fit(dataset, solution, tuple(intervals), held)
