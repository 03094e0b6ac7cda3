"""A belief of what was fitted: the numbers of the simulation with their covariance, without those of one session."""

import numpy as np
from jaxtyping import Float

from truearc.sim.infer.belief import SCATTER, scale_of
from truearc.sim.infer.coefficients import Coefficients
from truearc.sim.infer.likelihood.belief_prior import SCATTERS, believed_name, own_slope
from truearc.sim.infer.likelihood.design_columns import is_tracker
from truearc.sim.infer.likelihood.score_table import Column, ScoreTable
from truearc.sim.physics.catalogue import Catalogue, find_terms
from truearc.sim.physics.nonparametric import CURVE, NAMELESS
from truearc.sim.physics.term import WatchTerm, complete
from truearc.sim.physics.term_fields import fits_scale


def belongs(column: Column, among: Catalogue) -> bool:
    """A parameter of the simulation or a scatter of the launch, not a ball's random effect or a tracker's calibration.
    """
    if column.kind == "group" or is_tracker(column, among):
        return False
    return column.name in SCATTERS or not column.name.startswith(SCATTER + ".")


def believed_columns(evidence: ScoreTable, among: Catalogue) -> list[int]:
    """Places of the shared columns that belong to a belief."""
    return [k for k in range(evidence.first_shared, len(evidence.columns)) if belongs(evidence.columns[k], among)]


def coefficients_of(evidence: ScoreTable, believed: tuple[str, ...], among: Catalogue) -> Coefficients:
    """Every believed and named term of the catalogue, with parameters that were not fitted at their defaults."""
    tracker = (term.name for term in among if isinstance(term, WatchTerm))
    apart = {*among.always, *tracker, *(term.name for term in NAMELESS)}
    given: Coefficients = {name: {} for name in believed if name not in apart}
    for k in believed_columns(evidence, among):
        term, _, parameter = evidence.columns[k].name.partition(".")
        if term not in (SCATTER, CURVE):
            given.setdefault(term, {})[parameter] = float(evidence.point[k])
    return {name: {key: float(value) for key, value in complete(find_terms([name], among)[0], values).items()}
            for name, values in given.items()}


def scatter_of(evidence: ScoreTable) -> dict[str, float]:
    """Scatters of the launch by their names in a belief."""
    found = {column.name: float(np.exp(value)) for column, value in zip(evidence.columns, evidence.point, strict=True)
             if column.name in SCATTERS}
    return {SCATTERS[name]: float(np.degrees(value)) if name.endswith("_rad") else value
            for name, value in found.items()}


def covariance_of(evidence: ScoreTable, among: Catalogue) -> tuple[tuple[str, ...], Float[np.ndarray, "p p"]]:
    """(names, covariance on their scales); a number that does not fit on its scale counts as exact."""
    whole = evidence.covariance
    columns = believed_columns(evidence, among)
    names = {k: believed_name(evidence.columns[k].name) for k in columns}
    kept = [k for k in columns if evidence.columns[k].name in SCATTERS
            or fits_scale(scale_of(names[k], among), float(evidence.point[k]))]
    slope = np.array([1.0 / own_slope(evidence.columns[k].name, float(evidence.point[k]), among) for k in kept])
    return tuple(names[k] for k in kept), whole[np.ix_(kept, kept)] * np.outer(slope, slope)
