"""One simulation for all the names that are left: that whose heights come nearest to the average of their forecasts.

A name that is one of several likely ones forgoes what the others know, and is often the wrong one
(Hoeting et al. 1999). An average of forecasts is not a simulation, and numbers averaged name by name were never fitted;
but there is a simulation that forecasts nearly the same.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from truearc.sim.discover.select.name_effects import Step
from truearc.sim.discover.select.term_ranking import SURE, Naming
from truearc.sim.infer.fit import moved
from truearc.sim.infer.likelihood.layout import LinearizationPoint, ParameterLayout, only_shared
from truearc.sim.infer.likelihood.linearization import FAR_BELOW_M, linearise
from truearc.sim.infer.likelihood.score_table import Array, PlaneScores, ScoreTable

LEAST = 0.02                          # share of the probability below which a name has no part
STEPS = 8
ENOUGH = 1e-3                         # of what is left between both, that a step must take away
FAITH = 0.1                           # weight of the prior about the averaged numbers: it decides between names alike


@dataclass(frozen=True)
class Mixed:
    """share: {column: probability} of the names that have a part, likeliest first; the rest is nothing's, or too
    little. evidence: of all of them and all shared columns at once, where they forecast the average."""

    share: dict[str, float]
    evidence: ScoreTable


def mixed(step: Step) -> Mixed | None:
    """None where one name stands alone, and where no heights are forecast."""
    naming = step.naming
    if naming.probability[naming.leader] >= SURE or step.fitted.evidence.plane is None:
        return None
    share = shares(naming)
    layout = only_shared(step.fitted.layout, tuple(share))
    start, wanted = _average(step, layout, share)
    spot = moved(layout, step.fitted.spot, start - _point(step.fitted.evidence, layout))
    return None if wanted is None else Mixed(share, _come_near(step, layout, spot, start, wanted))


def shares(naming: Naming) -> dict[str, float]:
    """Probability of each name that was refitted, where no effect is a priori as likely as all names together; those
    with a part, likeliest first."""
    nats = {name: naming.nats[name] for name in naming.refits}
    nothing = np.log(sum(candidate.visible for candidate in naming.candidates))
    top = max(nothing, *nats.values())
    whole = np.exp(nothing - top) + sum(np.exp(value - top) for value in nats.values())
    share = {name: float(np.exp(value - top) / whole) for name, value in nats.items()}
    return {name: value for name, value in sorted(share.items(), key=lambda item: -item[1]) if value >= LEAST}


def _average(step: Step, layout: ParameterLayout,
             share: dict[str, float]) -> tuple[Float[Array, " P"], PlaneScores | None]:
    """(all numbers [P], each name's as far as it is likely; the average forecast, if there is one)."""
    point = (1.0 - sum(share.values())) * _point(step.fitted.evidence, layout)
    null = step.fitted.evidence.plane
    assert null is not None
    mean, flown = (1.0 - sum(share.values())) * null.mean_m, null.mean_m > FAR_BELOW_M
    for name, value in share.items():
        evidence = step.naming.refits[name].evidence
        point = point + value * _point(evidence, layout)
        if evidence.plane is None or not np.array_equal(evidence.plane.rows, null.rows):
            return point, None
        mean, flown = mean + value * evidence.plane.mean_m, flown & (evidence.plane.mean_m > FAR_BELOW_M)
    return point, replace(null, mean_m=np.where(flown, mean, np.nan))


def _point(evidence: ScoreTable, layout: ParameterLayout) -> Float[Array, " P"]:
    """The layout's numbers [P] as that evidence has them; zero for a name that it has not put in."""
    shared = zip(evidence.columns[evidence.first_shared:], evidence.point[evidence.first_shared:], strict=True)
    known = {column.name: float(value) for column, value in shared}
    return np.array([known.get(column.name, 0.0) for column in layout.columns])


def _come_near(step: Step, layout: ParameterLayout, spot: LinearizationPoint,
               start: Float[Array, " P"], wanted: PlaneScores) -> ScoreTable:
    """Gauss-Newton steps of all numbers except scatters and random effects of balls, as long as they reduce the rest.
    """
    free = np.flatnonzero(layout.source >= 0)
    prior = FAITH * layout.precision[np.ix_(free, free)]
    evidence = linearise(step.fitted.intake, layout, spot)[0]
    slope, gap, off = _left(evidence, wanted, free, start)
    left = gap @ gap + off @ prior @ off
    for _ in range(STEPS):
        change = np.zeros(len(layout.columns))
        change[free] = np.linalg.lstsq(slope.T @ slope + prior, slope.T @ gap + prior @ off, rcond=None)[0]
        there = moved(layout, spot, change)
        tried = linearise(step.fitted.intake, layout, there)[0]
        slope, gap, off = _left(tried, wanted, free, start)
        now = gap @ gap + off @ prior @ off
        if not now < (1.0 - ENOUGH) * left:
            break
        spot, evidence, left = there, tried, now
    return evidence


def _left(evidence: ScoreTable, wanted: PlaneScores, free: Int[Array, " free"], start: Float[Array, " P"]) -> tuple[
        Float[Array, "m free"], Float[Array, " m"], Float[Array, " free"]]:
    """(slopes [m, free] and what is missing [m] of the heights that are wanted, in the launch's own scatter; how far
    the numbers are from the averaged ones [free])."""
    plane = evidence.plane
    assert plane is not None
    kept = np.isfinite(wanted.mean_m) & (plane.mean_m > FAR_BELOW_M)
    missing = (wanted.mean_m - plane.mean_m)[kept] / wanted.spread_m[kept]
    return plane.by_column[kept][:, free] / wanted.spread_m[kept, None], missing, (start - evidence.point)[free]
