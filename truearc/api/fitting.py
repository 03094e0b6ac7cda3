"""Fit the parameters of terms to a dataset, and pool fits of several rigs or sessions."""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal, overload

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from truearc.api.arguments import check_kind, joined, names_of
from truearc.api.results import Table, Tabular
from truearc.api.systems import SystemFit, fit_system
from truearc.errors import InputError, whole_file
from truearc.sim.check.check import check_plausible
from truearc.sim.data.dataset import Dataset
from truearc.sim.data.files import hash_dataset
from truearc.sim.infer.belief import Belief, launcher_of, point_belief, replace_values, scale_of
from truearc.sim.infer.fit_report import CrossValidation, cross_validate, fit_lines, number_text
from truearc.sim.infer.intervals import Pooling, ProfileInterval, one_rig, pool_normal, profile_interval, said_by
from truearc.sim.infer.launcher import MapFit, fit_map
from truearc.sim.infer.track_forecast import ERROR, known_of
from truearc.sim.paper import STEP
from truearc.sim.paper.grid_fit import GridFit, Score, draw_map, explain, fit_grid, map_deviation, provenance_of, score
from truearc.sim.physics.term import LINEAR, Term, from_scale
from truearc.sim.printed import Progress, make_text, show_progress
from truearc.sim.statistics import Z90
from truearc.sim.systems.score_table import System
from truearc.sim.systems.system import Runs

COLUMNS = ("parameter", "value", "low90", "high90", "unit", "closed")
FEWEST = 2
POOLED_COLUMNS = ("parameter", "value", "low90", "high90", "unit", "differs", "differs_low90", "differs_high90")


@dataclass(frozen=True, eq=False)
class Fit(Tabular):
    """Maximum a posteriori (MAP) estimates of terms, launch scatter and tracker errors.

    `intervals`: 90 % profile intervals, one per parameter, in its own unit; empty if the search did not converge.
    `holdout`: scores of predicted hold-out outcomes; None with fewer than two groups of outcomes. `solution`: the
    optimum with its curvature.
    """

    dataset: Dataset
    solution: MapFit
    intervals: tuple[ProfileInterval, ...]
    holdout: CrossValidation | None

    @property
    def converged(self) -> bool:
        """Whether the search for the most probable parameters converged; if not, do not use the fit."""
        return self.solution.converged

    @cached_property
    def belief(self) -> Belief:
        """The estimates with their covariance and provenance; InputError for a fit that did not converge."""
        if not self.converged:
            raise InputError(f"{self.dataset.name}: the search for the most probable parameters did not settle: the "
                             "shots or rig.toml contradict each other, or fewer terms are enough")
        return replace(self.solution.belief, provenance=self._provenance())

    def table(self) -> Table:
        """Return a row per parameter: value and ends of its 90 % interval, in `unit`; closed: bounded by the data."""
        units = {one.name: one.unit for one in self.solution.sought}
        return Table(COLUMNS, tuple((one.name, one.value, one.low90, one.high90, units[one.name], one.closed)
                                    for one in self.intervals))

    def lines(self) -> list[str]:
        """Return the report: data used, aliased parameters, estimates, scatter, hold-out score."""
        return [*(f"warning: {line}" for line in self.dataset.accepted),
                *(f"note: {line}" for line in self.dataset.notes()),
                *fit_lines(self.solution, self.intervals, self.holdout)]

    def _provenance(self) -> dict[str, Any]:
        fit = self.solution
        said: dict[str, Any] = {
            "method": "ml", "dataset": self.dataset.name, "dataset_sha256": hash_dataset(self.dataset),
            "truearc": version("truearc"), "shots": len(fit.scores.rows), "terms": list(fit.terms),
            "log_posterior": fit.log_posterior, "evidence": fit.fitted.model.data.used,
            "left_out": list(fit.fitted.model.data.left_out), **known_of(self.dataset, fit.belief),
            **({"accepted": list(self.dataset.accepted)} if self.dataset.accepted else {}),
            "interval90": {one.name: [one.low90, one.high90] for one in self.intervals}}
        held = self.holdout
        if held is not None:
            said["heldout"] = {"shots": held.shots, "log_score": held.log_score, "accuracy": held.accuracy}
        return said


@dataclass(frozen=True, eq=False)
class GridSearch(Tabular):
    """Result of the paper's search: the drag and lift coefficients that reproduce the most outcomes.

    `step`: grid step. `solution`: the whole map, the tied pairs and the chosen one. `accuracy`: of the chosen pair.
    """

    dataset: Dataset
    step: float
    solution: GridFit
    accuracy: Score

    @property
    def belief(self) -> Belief:
        """The chosen pair, without a covariance, since the grid gives none."""
        said = provenance_of(self.step, self.dataset, self.solution, self.accuracy)
        return replace(point_belief(self.solution.coefficients), provenance=said)

    def save_map(self, path: str | Path) -> None:
        """Write an npz file: axis, share_three, share_two, tied, mean_deviation_m (NaN without a three); rows cd,
        columns cl."""
        found = self.solution
        mean_m = np.full(found.share_three.shape, np.nan)
        at = np.nonzero((found.share_three > 0.0) | found.tied)
        mean_m[at] = map_deviation(self.dataset.rig, self.dataset.shots, found.axis[at[0]], found.axis[at[1]])
        with whole_file(path) as new, new.open("wb") as file:
            np.savez_compressed(file, axis=found.axis, share_three=found.share_three, share_two=found.share_two,
                                mean_deviation_m=mean_m, tied=found.tied)

    def plot(self) -> Figure:
        """Plot three-point accuracy over drag and lift, with the tied pairs and the chosen one."""
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
        accept: Collection[str] = ..., progress: Progress | None = ...) -> Fit: ...


@overload
def fit(dataset: Dataset, *, method: Literal["grid"], step: float = STEP, accept: Collection[str] = ...,
        progress: Progress | None = ...) -> GridSearch: ...


@overload
def fit(dataset: System, terms: Runs, *, progress: Progress | None = ...) -> SystemFit: ...


def fit(dataset: Dataset | System, terms: Iterable[str | Term] | Runs | None = None, *, method: str = "map",
        step: float | None = None, accept: Collection[str] = (),
        progress: Progress | None = None) -> Fit | GridSearch | SystemFit:
    """Fit parameters of the physics to all data of a dataset, or those of a system to its runs.

    Args:
        dataset: Shots with outcomes, heights, exit measurements or tracks; or a System.
        terms: Terms to fit, by name or as values, including your own; None: [believe] of the rig. Gravity is always
            included. The Runs of a System.
        method: "map" for MAP estimates from all data, with 90 % intervals; "grid" for the paper's search over drag and
            lift by outcomes alone; terms do not apply.
        step: Grid only: step between neighbouring coefficients; divides 5.
        accept: Names of plausibility checks (truearc.sim.check) whose objections are accepted; recorded.
        progress: Called with the share done, 0 to 1, and a note; None: a bar with the time left.

    Returns:
        Fit, or GridSearch for "grid"; both have `.belief` and `.table()` and print as a report. SystemFit for a
        System.

    Raises:
        InputError: implausible data, an unknown term or method, an argument of the other method, or no usable data.
    """
    if isinstance(dataset, System):
        return fit_system(dataset, terms if isinstance(terms, Runs) else None, progress or show_progress("fit"))
    check_kind("dataset", dataset, Dataset, "load_dataset(...)")
    if isinstance(terms, Runs):
        raise InputError("terms: runs go with a System, not with a dataset of shots")
    dataset = check_plausible(dataset, accept)
    if method == "map":
        if step is not None:
            raise InputError("step: method 'map' makes no use of it; method 'grid' does")
        return _fit_map(dataset, terms, progress or show_progress("fit"))
    if method != "grid":
        raise InputError(f"method: there is no {method!r}; there are 'map' and 'grid'")
    if terms is not None:
        raise InputError("terms: method 'grid' makes no use of them; method 'map' does")
    step = STEP if step is None else step
    found = fit_grid(dataset.rig, dataset.shots, step, progress or show_progress("fit"))
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


@dataclass(frozen=True, eq=False)
class Pooled(Tabular):
    """Pooled numbers of several rigs or sessions, with their common values and differences.

    `fits`: the members' fits, in order. `names`: the pooled numbers. `solution`: the posterior, on their scales.
    """

    fits: tuple[Fit, ...]
    names: tuple[str, ...]
    solution: Pooling

    @cached_property
    def belief(self) -> Belief:
        """Belief for a further session or rig of this kind, with the uncertainty of common numbers and members."""
        first = self.fits[0].belief
        solutions = [fit.solution.belief for fit in self.fits]
        coefficients = {term: dict(values) for one in solutions for term, values in one.coefficients.items()}
        scatter = {key: value for one in solutions for key, value in one.scatter.items()}
        start = Belief(coefficients, scatter, self.names, self.solution.next_one, catalogue=first.catalogue)
        moved = replace_values(start, self.solution.common[0])
        ranges = [fit.belief.provenance["range"] for fit in self.fits]
        said = {"method": "pooled", "truearc": version("truearc"), "terms": list(self.fits[0].solution.terms),
                "datasets": [fit.dataset.name for fit in self.fits],
                "datasets_sha256": [hash_dataset(fit.dataset) for fit in self.fits],
                "shots": sum(len(fit.solution.scores.rows) for fit in self.fits),
                "range": {name: [min(one[name][0] for one in ranges), max(one[name][1] for one in ranges)]
                          for name in ranges[0] if all(name in one for one in ranges)},
                **({ERROR: max(errors)} if (errors := [fit.belief.provenance[ERROR] for fit in self.fits
                                                       if ERROR in fit.belief.provenance]) else {}),
                **({"rig": launcher_of(self.fits[0].dataset.rig)} if self._one_rig else {})}
        return replace(point_belief(moved.coefficients, moved.scatter, first.catalogue), names=self.names,
                       covariance=self.solution.next_one, provenance=said)

    @property
    def _one_rig(self) -> bool:
        return one_rig([fit.solution for fit in self.fits])

    def table(self) -> Table:
        """Return a row per number: the common value with its 90 % interval, in `unit`, and the standard deviation
        between members on the number's scale (of a logarithm: a share) with its 90 % interval."""
        common, covariance = self.solution.common
        error = Z90 * np.sqrt(np.diag(covariance))
        tau = np.quantile(self.solution.tau, [0.5, 0.05, 0.95], axis=0).T
        ends = np.stack([common, common - error, common + error], axis=1)
        return Table(POOLED_COLUMNS, tuple((name, *self._values(name, numbers), self._unit(name), *map(float, differs))
                                    for name, numbers, differs in zip(self.names, ends, tau, strict=True)))

    def members(self) -> Table:
        """Return a row per dataset and number: estimates by its own and by all shots, with 90 % intervals."""
        rows = []
        for fit, own, sd in zip(self.fits, self.solution.own, self.solution.own_sd, strict=True):
            alone = {one.name: (one.value, one.low90, one.high90) for one in fit.intervals}
            for name, here, error in zip(self.names, own, Z90 * sd, strict=True):
                given = self._values(name, np.array([here, here - error, here + error]))
                rows.append((fit.dataset.name, name, *alone.get(name, (None, None, None)), *given))
        return Table(("dataset", "parameter", "own", "own_low90", "own_high90", "pooled", "low90", "high90"),
                     tuple(rows))

    def lines(self) -> list[str]:
        """Return the report: the common numbers, the differences between members, and each member's numbers."""
        what = "sessions of one rig" if self._one_rig else "rigs"
        shots = [len(fit.solution.scores.rows) for fit in self.fits]
        head = f"{len(self.fits)} fits pooled as {what}: {sum(shots)} shots ({', '.join(map(str, shots))})"
        common = [(name, number_text(value), f"{number_text(low)} to {number_text(high)}{_after(unit)}",
                   self._differs(name, unit, differs))
                  for name, value, low, high, unit, *differs in self.table().rows]
        each = [(dataset, name, _interval(*numbers[:3]), _interval(*numbers[3:]))
                for dataset, name, *numbers in self.members().rows]
        return [*(f"warning: {line}" for fit in self.fits for line in fit.dataset.accepted), head, "", *make_text(
            ("in common", "value", "90 % interval", "differ by (standard deviation)"), common, right=(1,)), "",
            *make_text(("dataset", "parameter", "by its own shots", "given all"), each)]

    def _differs(self, name: str, unit: str, numbers: Sequence[float]) -> str:
        """In the unit of a number on a linear scale, else in per cent: of the number, or of what a loss leaves."""
        straight = scale_of(name, self.fits[0].solution.catalogue) == LINEAR
        value, low, high = (number_text(one if straight else 100.0 * one) for one in numbers)
        return f"{value} ({low} to {high}){_after(unit if straight else '%')}"

    def _values(self, name: str, numbers: Float[np.ndarray, " n"]) -> list[float]:
        scale = scale_of(name, self.fits[0].solution.catalogue)
        return [float(value) for value in np.asarray(from_scale(scale, numbers))]

    def _unit(self, name: str) -> str:
        return {one.name: one.unit for fit in self.fits for one in fit.solution.sought}[name]


def _after(unit: str) -> str:
    return "" if unit == "1" else f" {unit}"


def _interval(value: float | None, low: float | None, high: float | None) -> str:
    if value is None or low is None or high is None:
        return "-"
    return f"{number_text(value)} ({number_text(low)} to {number_text(high)})"


def pool(fits: Sequence[Fit], *, seed: int = 0) -> Pooled:
    """Pool fits of several rigs, or of several sessions of one, whose numbers may differ.

    Each number of a member is normally distributed about the common value, with a standard deviation that is also
    fitted: members that agree are averaged, members that differ keep their own values (partial pooling). Sessions of
    one rig are expected to differ less than rigs. Tracker errors are not pooled.

    Args:
        fits: Two or more, of the same terms.
        seed: Seed of the posterior draws.

    Returns:
        Pooled: `.belief` for a further session or rig, `.table()` of common numbers, `.members()` of each member's.

    Raises:
        InputError: fewer than two fits, fits of different terms or of the same data, no number to pool, or a fit that
            did not converge.
    """
    for fit in fits:
        check_kind("fits", fit, Fit, "fit(...)")
    if len(fits) < FEWEST:
        raise InputError(f"fits: {len(fits)} given; at least {FEWEST} can be pooled")
    if seed < 0:
        raise InputError(f"seed is {seed}; it cannot be negative")
    for fit in fits:
        _ = fit.belief                # refuses a fit that did not converge
    hashes = [hash_dataset(fit.dataset) for fit in fits]
    for number, one in enumerate(hashes):
        if one in hashes[:number]:
            raise InputError(f"{fits[number].dataset.name}: the same data twice; they would count twice")
    names, said = said_by([fit.solution for fit in fits])
    return Pooled(tuple(fits), names, pool_normal(said, seed))
