"""Maximum a posteriori fit of terms, scatter and tracker noise to everything that a dataset has."""

import itertools
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from truearc.robot.config.rig_spec import Rig
from truearc.sim.data.dataset import Dataset
from truearc.sim.infer.belief import Belief
from truearc.sim.infer.likelihood.launch_inputs import Given
from truearc.sim.infer.likelihood.observations import Gathered, Observations, gather
from truearc.sim.infer.likelihood.outcome_likelihood import without_lapses
from truearc.sim.infer.likelihood.shot_likelihood import Points, relinearise
from truearc.sim.infer.likelihood.track_likelihood import guess_lead, guess_start
from truearc.sim.infer.optimum import Optimum, Problem, best_of, minimise
from truearc.sim.infer.parameters import SCATTERS, TRACK_NOISE, Model, Sought, make_model
from truearc.sim.physics.catalogue import Catalogue
from truearc.sim.progress import Progress

STARTS = 2                            # of the coarse search that are followed up, besides the grid's pair
COARSE_U = (-1.5, -0.5, 0.5, 1.5)     # prior standard deviations, of up to COARSE parameters of terms
COARSE = 3
ROUNDS = 6                            # of moving the point about which tracks are linear
SETTLED = 1e-3                        # of a move of the parameters in prior standard deviations


@dataclass(frozen=True, eq=False)
class MapFit:
    """The fit: `covariance` of u (units of the priors) is the inverse Hessian."""

    model: Model
    gathered: Gathered
    problem: Problem
    optimum: Optimum
    covariance: Float[np.ndarray, "p p"]

    @property
    def converged(self) -> bool:
        return self.optimum.converged

    @property
    def values(self) -> dict[str, float]:
        """{name: most probable value}."""
        return self.model.values(self.optimum.u)

    @property
    def belief(self) -> Belief:
        """For whoever forecasts or simulates: without the tracker's noise, which is integrated out."""
        keep = [index for index, name in enumerate(self.model.names) if name != TRACK_NOISE]
        sd = self.model.scales()[1][keep]
        coefficients: dict[str, dict[str, float]] = {}
        scatter = {}
        for name, value in self.values.items():
            table, _, key = name.partition(".")
            if table == "scatter":
                scatter[key] = value
            elif name != TRACK_NOISE:
                coefficients.setdefault(table, {})[key] = value
        return Belief(coefficients, scatter, tuple(self.model.names[index] for index in keep),
                      self.covariance[np.ix_(keep, keep)] * np.outer(sd, sd), catalogue=self.model.catalogue)


def fit_map(rig: Rig, dataset: Dataset, terms: tuple[str, ...], progress: Progress = lambda done, note: None,
           grid: dict[str, dict[str, float]] | None = None, among: Catalogue | None = None) -> MapFit:
    """Fit the named terms (gravity always among them) and the scatter of the launch to a dataset.

    grid: {term: {parameter: value}} that the paper's grid chose, one more start (truearc.sim.paper.grid_fit).
    among: the catalogue of the terms, truearc.sim.physics.catalogue.catalogue() when not given.

    Deterministic. A fit that did not settle says so in `converged`. InputError: unknown terms, or nothing to fit to.
    """
    gathered = gather(rig, dataset)
    evidence = gathered.evidence
    tracked = evidence.tracks is not None or evidence.free is not None
    model = make_model(rig, terms, _scatters(evidence.given), tracked, among)
    points = _moved(model, evidence, _first_points(evidence), np.zeros(len(model.sought)))
    problem = Problem(model, evidence, points, np.ones(len(gathered.rows)))
    progress(0.05, "coarse search")
    starts = [*_starts(problem, grid or {}), *_all_heights(problem)]
    optimum = best_of(problem, starts, lambda done, note: progress(0.1 + 0.6 * done, note))
    problem, optimum = settle(problem, optimum)
    progress(1.0, "fitted")
    return MapFit(model, gathered, problem, optimum, _covariance(optimum.hessian))


def settle(problem: Problem, optimum: Optimum) -> tuple[Problem, Optimum]:
    """Move the points about which tracks are linear to the optimum, and find it again, until neither moves."""
    evidence = problem.evidence
    if evidence.tracks is None and evidence.free is None:
        return problem, optimum
    for _ in range(ROUNDS):
        problem = replace(problem, points=_moved(problem.model, evidence, problem.points, optimum.u))
        before, optimum = optimum, minimise(problem, optimum.u)
        if np.abs(optimum.u - before.u).max() < SETTLED:
            break
    return problem, optimum


def refit(fit: MapFit, weight: Float[np.ndarray, " units"]) -> Optimum:
    """The optimum with other weights of the units, from the fit's own."""
    return minimise(replace(fit.problem, weight=weight), fit.optimum.u)


def _scatters(given: Given) -> tuple[Sought, ...]:
    """Those of which some launch has any: not where only the ball itself was measured."""
    return tuple(one for one, where in zip(SCATTERS, (given.rolled, given.hooded), strict=True) if np.any(where))


def _first_points(evidence: Observations) -> Points:
    tracks, free = evidence.tracks, evidence.free
    return Points(np.zeros((0, 3)) if tracks is None else guess_lead(tracks, evidence.given.rolling),
                  np.zeros((0, 4)) if free is None else guess_start(free))


def _moved(model: Model, evidence: Observations, points: Points, u: Float[np.ndarray, " p"], rounds: int = 4) -> Points:
    for _ in range(rounds if evidence.tracks is not None or evidence.free is not None else 0):
        points = relinearise(model, evidence, points, u)
    return points


def _covariance(hessian: Float[np.ndarray, "p p"]) -> Float[np.ndarray, "p p"]:
    """Inverse of the curvature; no direction is known worse than its prior says."""
    values, vectors = np.linalg.eigh(hessian)
    return np.asarray((vectors / np.maximum(values, 1.0)) @ vectors.T)


def _starts(problem: Problem, grid: dict[str, dict[str, float]]) -> list[Float[np.ndarray, " p"]]:
    """The prior's centre and the best of a coarse grid about it, and the pair of the paper's grid where it gave one."""
    size, count = len(problem.model.sought), min(len(problem.model.numbers), COARSE)
    tried = [np.zeros(size)]
    for point in itertools.product(COARSE_U, repeat=count):
        for scatter in (0.0, 1.5):
            u = np.zeros(size)
            u[:count] = point
            u[len(problem.model.numbers):] = scatter
            tried.append(u)
    best = sorted(range(len(tried)), key=lambda row: problem.value(tried[row]))
    starts = [tried[row] for row in best[:STARTS]]
    return starts + _grid_start(problem.model, grid)


def _all_heights(problem: Problem) -> list[Float[np.ndarray, " p"]]:
    """The fit in which no measured height is a slip, where some were measured.

    A slip costs a few nats, however far the height is off, so a search that starts far off may end at a fit that calls
    half of the heights slips, and hardly feels them any more.
    """
    marks = problem.evidence.marks
    if marks is None or not marks.measured.any():
        return []
    strict = replace(problem, evidence=problem.evidence._replace(marks=without_lapses(marks)))
    return [min((minimise(strict, start) for start in _starts(strict, {})), key=lambda one: one.value).u]


def _grid_start(model: Model, grid: dict[str, dict[str, float]]) -> list[Float[np.ndarray, " p"]]:
    """The grid's pair with a loss of nothing, which is what it was found with; within two sd of the prior."""
    if not grid:
        return []
    u = np.zeros(len(model.sought))
    wanted = {f"{term}.{key}": value for term, values in grid.items() for key, value in values.items()}
    wanted["exit_efficiency.loss"] = 0.0
    for index, one in enumerate(model.sought):
        if one.name in wanted:
            u[index] = np.clip(one.u(max(wanted[one.name], 1e-3)), -2.0, 2.0)
        elif one.name.startswith("scatter."):
            u[index] = 1.0
    return [u]
