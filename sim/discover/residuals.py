"""What each shot still asks for, before and after something is put into the simulation: what the pictures show.

A shot's residual in one free number (its height at the target, its launch speed, a push in flight) is its score over
its information; many shots' is the sum of scores over the sum of informations.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim.discover import outcomes
from sim.discover.answer import COVARIATE
from sim.discover.ask import Asked
from sim.discover.covariates import Covariate, Factor
from sim.discover.evidence import Array, Evidence
from sim.discover.forward import Step, promote
from sim.discover.locate import Place
from sim.discover.sizes import scale_of

HEIGHT = "height at the target"
MOST_BINS, BIN_SHOTS = 8, 6
MOST_GROUPS = 3
Along = Covariate | Factor


@dataclass(frozen=True)
class Residual:
    """Score and information [n] of one number, before and after; `factor` turns it into `unit` as people say it.

    column: of the evidence, None for the height at the target. after None: nothing was put in.
    """

    name: str
    column: int | None
    factor: float
    unit: str
    before: tuple[Array, Array]
    after: tuple[Array, Array] | None


@dataclass(frozen=True)
class Bins:
    """Where each shot [n] belongs (-1 nowhere), and the bins' middles [B]; labels of groups, else empty."""

    name: str
    index: Array
    middle: Array
    labels: tuple[str, ...] = ()


def evidence_after(step: Step) -> Evidence:
    """With the step's name fitted in, or with the free curve, each shot's from the other folds, where it has none."""
    if not step.unknown:
        return promote(step.fitted, step.refit).evidence
    if step.place is None:
        return step.fitted.evidence
    return corrected(step.fitted.evidence, step.place)


def corrected(evidence: Evidence, place: Place) -> Evidence:
    """The evidence after the place's free curve."""
    change = np.zeros_like(evidence.score)
    change[:, place.test.column] = place.correction.after[:, 0]
    change[:, evidence.first_shared:] = place.correction.after[:, 1:]
    return evidence.moved(change)


def residuals_of(before: Evidence, after: Evidence | None, tracked: bool) -> tuple[Residual, ...]:
    """The height at the target; with tracks also launch, distance and pushes throughout the flight."""
    found = []
    if before.plane is not None:
        found.append(Residual(HEIGHT, None, 100.0, "cm", _height(before), None if after is None else _height(after)))
    for k, column in enumerate(before.columns[:before.first_shared] if tracked else ()):
        if column.kind == "free" and not column.follows and (before.info[:, k, k] > 0.0).any():
            factor, unit = scale_of(column.unit)
            later = None
            if after is not None:
                other = after.index(column.name)
                later = after.score[:, other], after.info[:, other, other]
            found.append(Residual(column.name, k, factor, unit.strip(), (before.score[:, k], before.info[:, k, k]),
                                  later))
    return tuple(found)


def _height(evidence: Evidence) -> tuple[Array, Array]:
    """Score and information [n] of metres above the centre."""
    plane, n = evidence.plane, len(evidence.rows)
    score, information = np.zeros(n), np.zeros(n)
    if plane is not None:
        score[plane.rows] = outcomes.slopes(plane.seen, plane.mean_m, plane.spread_m)[0]
        information[plane.rows] = outcomes.information(plane.seen, plane.mean_m, plane.spread_m)[:, 0, 0]
    return score, information


def covariates_in(asked: Asked) -> tuple[Along, ...]:
    """Everything that tests were made along, each once."""
    found: dict[str, Along] = {}
    for test in asked.tests:
        if test.what is not None:
            found.setdefault(test.what.name, test.what)
    return tuple(found.values())


def find_along(name: str | None, along: Sequence[Along]) -> Along | None:
    """The covariate or factor of that name, under any of its names; dips of wheels count as "dip"."""
    for one in along:
        names = one.names if isinstance(one, Covariate) else (one.name,)
        if name is not None and any(each == name or each.startswith(f"{name}_") for each in names):
            return one
    return None


def bins_of(along: Along, rows: Array) -> Bins:
    """Even shares of the shots, the distinct values of a covariate with few, the levels of a factor."""
    if isinstance(along, Factor):
        return Bins(along.name, along.codes[rows], np.arange(len(along.levels), dtype=float), along.levels)
    values = along.values[rows]
    known = np.isfinite(values)
    distinct = np.unique(values[known])
    if len(distinct) <= MOST_BINS:
        index = np.searchsorted(distinct, np.where(known, values, distinct[0]))
        return Bins(along.name, np.where(known, index, -1), distinct)
    count = int(np.clip(known.sum() // BIN_SHOTS, 2, MOST_BINS))
    edges = np.unique(np.quantile(values[known], np.linspace(0.0, 1.0, count + 1)))
    index = np.where(known, np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2), -1)
    middle = np.array([values[index == k].mean() if (index == k).any() else np.nan for k in range(len(edges) - 1)])
    return Bins(along.name, index, middle)


def binned(part: tuple[Array, Array], bins: Bins) -> tuple[Array, Array]:
    """(residual, standard error) [B] by how the shots of a bin differ among themselves; nan where they say nothing."""
    value, error = np.full((2, len(bins.middle)), np.nan)
    for k in range(len(bins.middle)):
        score, information = (each[bins.index == k] for each in part)
        if information.sum() > 0.0 and len(score) > 1:
            value[k] = score.sum() / information.sum()
            error[k] = np.sqrt(((score - information * value[k])**2).sum()) / information.sum()
    return value, error


def choose(residuals: Sequence[Residual], along: Sequence[Along], rows: Array) -> tuple[Residual, Along] | None:
    """The number and what to draw it against in which what was put in explains most; a group only if alone."""
    best: tuple[float, Residual, Along] | None = None
    for one in [each for each in along if isinstance(each, Covariate)] or along:
        bins = bins_of(one, rows)
        for residual in residuals:
            gained = _roughness(residual.before, bins)
            gained -= 0.0 if residual.after is None else _roughness(residual.after, bins)
            if best is None or gained > best[0]:
                best = gained, residual, one
    return None if best is None else best[1:]


def _roughness(part: tuple[Array, Array], bins: Bins) -> float:
    """Log-likelihood that the bins' means explain, times two, less what luck explains."""
    total = -float(len(bins.middle))
    for k in range(len(bins.middle)):
        score, information = (float(each[bins.index == k].sum()) for each in part)
        total += score**2 / information if information > 0.0 else 0.0
    return total


def stated_covariate(step: Step, first: str | None) -> str | None:
    """What the named term follows, or what the answer says the effect goes with."""
    if not step.unknown:
        column = step.fitted.evidence.columns[step.fitted.evidence.index(step.naming.leader)]
        if column.follows in COVARIATE:
            return COVARIATE[column.follows]
    return first if step.base == () else None


def halves(along: Along | None, rows: Array) -> list[tuple[str, Array]]:
    """All shots (no label), or those low and high in a covariate, or by the levels of a factor of two or three."""
    if isinstance(along, Factor) and len(along.levels) <= MOST_GROUPS:
        return [(f"{along.name} {level}", along.codes[rows] == k) for k, level in enumerate(along.levels)]
    if isinstance(along, Covariate):
        values = along.values[rows]
        middle = float(np.nanmedian(values))
        low, high = values <= middle, values > middle
        if low.any() and high.any():
            return [(f"{along.name} to {middle:.3g}", low), (f"{along.name} above", high)]
    return [("", np.ones(len(rows), dtype=bool))]
