"""An effect without a name as part of the simulation: its free curve, and the term that takes it."""

from dataclasses import dataclass, replace

import numpy as np

from sim.curve import Curve, natural
from sim.discover.correct import Correction
from sim.discover.covariates import Covariate, Factor, Pair, spline_knots
from sim.discover.evidence import Array, Column, Evidence
from sim.discover.step import Step

TERMS = {"launch speed": ("free_speed", {"share": 1.0}), "launch elevation": ("free_elevation", {"angle_rad": 1.0}),
         "distance": ("free_distance", {"bias_m": 1.0})}
SIDES = {"along": "along", "vertical": "up", "lateral": "left"}
LONGEST_S = 60.0


@dataclass(frozen=True)
class Freed:
    """`term` with `values` takes the curve; evidence: the shared columns as fitted beside it; `said` in short."""

    term: str
    values: dict[str, float]
    curve: Curve
    evidence: Evidence
    said: str


def freed(step: Step) -> Freed | None:
    """None for a step with a name, and for what no simulation of single shots can take: two covariates together, or a
    launch to one side, on which no height depends."""
    place = step.place
    if not step.unknown or place is None:
        return None
    correction, column = place.correction, place.column
    taken, curve = _term(column), _curve(correction)
    if taken is None or curve is None:
        return None
    evidence = correction.evidence.pick(np.arange(1, len(correction.evidence.columns)))
    evidence = replace(evidence, point=evidence.point + correction.shared)
    goes = f" by {curve.covariate}" if curve.covariate else ""
    return Freed(*taken, curve, evidence, f"{column.name}{goes}")


def _term(column: Column) -> tuple[str, dict[str, float]] | None:
    if column.name in TERMS:
        name, values = TERMS[column.name]
        return name, dict(values)
    if not column.name.startswith("push "):
        return None
    values = {"size_m_s2": 1.0, SIDES[column.direction]: 1.0}
    if column.times_s is not None:
        values |= {"from_s": column.times_s[0], "to_s": min(column.times_s[1], LONGEST_S)}
    elif column.follows:
        values |= {"with_speed": 1.0}
    return "free_push", values


def _curve(correction: Correction) -> Curve | None:
    what, amplitude = correction.test.what, correction.amplitude
    rows, otherwise = correction.evidence.rows, float(correction.amplitude.mean())
    if what is None:
        return Curve((), otherwise)
    if isinstance(what, Factor):
        codes = what.codes[rows]
        seen = [k for k in range(len(what.levels)) if (codes == k).any()]
        return Curve(tuple(float(amplitude[codes == k][0]) for k in seen), otherwise, what.name,
                     levels=tuple(what.levels[k] for k in seen))
    if isinstance(what, Pair) or not isinstance(what, Covariate):
        return None
    return _spline(what, rows, amplitude, otherwise)


def _spline(what: Covariate, rows: Array, amplitude: Array, otherwise: float) -> Curve:
    """Values at the fit's own knots: between them the fit is that very spline."""
    x = what.values[rows]
    said = np.isfinite(x)
    knots = spline_knots(x[said])
    value = np.linalg.lstsq(natural(knots, x[said]), amplitude[said], rcond=None)[0]
    return Curve(tuple(map(float, value)), otherwise, what.name, at=tuple(map(float, knots)),
                 low=float(x[said].min()), high=float(x[said].max()))
