"""One named change at a time, truly refitted, and its worth on hold-out shots.

Shape parameters of a term, such as a time constant, are unidentified at zero amplitude, so they are not columns of the
score table. A refit looks for the likeliest place of each, and their uncertainty adds to that of the amplitude.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from truearc.sim.infer.belief import Coefficients
from truearc.sim.infer.fit import BaselineFit, climb, moved, objective, top_from, usual_spot
from truearc.sim.infer.likelihood.layout import LinearizationPoint, ParameterLayout, only_shared
from truearc.sim.infer.likelihood.linearization import linearise
from truearc.sim.infer.likelihood.score_table import Array, ScoreTable, without
from truearc.sim.physics.catalogue import find_terms
from truearc.sim.physics.scales import from_scale, to_scale
from truearc.sim.physics.term import Parameter

NEVER = -1e6                          # nats, of what does not fly
FARTHEST = 3.0                        # standard deviations from a shape parameter's prior centre: the end of the search
PLAIN = 2.0                           # standard errors of an amplitude, from which its term's shape is fitted, too


@dataclass(frozen=True)
class Refit:
    """The baseline model with these terms' amplitudes fitted too.

    evidence: at the optimum, named columns first, all shared. log_evidence: nats by which the data favour it over the
    baseline model, size of the amplitude integrated out (Laplace). amplitude, sd [k] of the named columns; value [k]:
    the same, and of changes of believed numbers the number after the change. wanted [k]: value, or where the fit would
    go from there if the end of the parameter's range did not stop it.
    """

    names: tuple[str, ...]
    layout: ParameterLayout
    spot: LinearizationPoint
    evidence: ScoreTable
    amplitude: Float[Array, " k"]
    value: Float[Array, " k"]
    wanted: Float[Array, " k"]
    sd: Float[Array, " k"]
    log_evidence: float


@dataclass(frozen=True)
class ShapeParameter:
    """One such number: its slot in the chain, and its declaration."""

    slot: int
    parameter: Parameter

    def put(self, spot: LinearizationPoint, place: float) -> LinearizationPoint:
        """The spot with the number `place` standard deviations from its prior's centre, within its range."""
        prior = self.parameter.prior
        assert prior is not None
        value = float(from_scale(prior.scale, to_scale(prior.scale, prior.centre) + place * prior.sd))
        values = spot.values.copy()
        values[self.slot] = np.clip(value, self.parameter.low, self.parameter.high)
        return replace(spot, values=values)


def further_numbers(layout: ParameterLayout, names: tuple[str, ...]) -> list[ShapeParameter]:
    """Those of the named terms that have a prior and are not fitted as columns already."""
    columns = {column.name for column in layout.columns}
    terms = find_terms({name.partition(".")[0] for name in names}, layout.chain.catalogue)
    return [ShapeParameter(layout.chain.slots.index((term.name, one.name)), one) for term in terms
            for one in term.parameters[1:] if one.prior is not None and f"{term.name}.{one.name}" not in columns]


def further_values(layout: ParameterLayout, spot: LinearizationPoint, names: tuple[str, ...]) -> Coefficients:
    """{term: {parameter: value}} of them at a spot."""
    return {layout.chain.slots[one.slot][0]: {one.parameter.name: float(spot.values[one.slot])}
            for one in further_numbers(layout, names)}


@dataclass(frozen=True)
class Peak:
    """Where a number is likeliest, how far it may be from there (one deviation), and the two places beside it that were
    looked at; all in standard deviations from the prior's centre. nats: of all that it may be together."""

    place: float
    sd: float
    beside: tuple[float, float]
    nats: float


def find_peak(nats: Callable[[float], float]) -> Peak:
    """nats: what the data say for a place, which the prior is added to; asked from the centre outwards, then at the top
    of the parabola through the best three."""
    found = {place: nats(place) - 0.5 * place**2 for place in (0.0, -1.0, 1.0)}
    while (best := max(found, key=lambda place: found[place])) in (min(found), max(found)) and abs(best) < FARTHEST:
        further = best + np.copysign(1.0, best)
        found[further] = nats(further) - 0.5 * further**2
    best = min(max(best, min(found) + 1.0), max(found) - 1.0)
    left, middle, right = (found[best + step] for step in (-1.0, 0.0, 1.0))
    bend = max(2.0 * middle - left - right, 1.0)         # no less sure than the prior is
    top = best + float(np.clip(0.5 * (right - left) / bend, -1.0, 1.0))
    value = nats(top) - 0.5 * top**2
    return Peak(top, bend**-0.5, (best - 1.0, best + 1.0), float(value - 0.5 * np.log(bend)))


def refit(fitted: BaselineFit, names: tuple[str, ...], start: Float[Array, " k"],
          near: LinearizationPoint | None = None) -> Refit:
    """Fit the named columns with the shared ones, from amplitudes `start` [k] at the fitted spot, or at `near`.

    Shape parameters of a term are at their likeliest, and their uncertainty is in sd and in log_evidence, where the
    term does enough for that to be identifiable.
    """
    found = refit_at(fitted, names, start, near)
    if (np.abs(found.amplitude) > PLAIN * found.sd).all():
        for number in further_numbers(fitted.layout, names):
            found = _looked_for(number, fitted, found)
    return found


def _looked_for(number: ShapeParameter, fitted: BaselineFit, found: Refit) -> Refit:
    """The same with one further number where it is likeliest."""
    tried: dict[float, Refit] = {}

    def nats(place: float) -> float:
        near = number.put(found.spot, place)
        tried[place] = refit_at(fitted, found.names, np.zeros(len(found.names)), near)
        return max(tried[place].log_evidence, NEVER)

    peak = find_peak(nats)
    best, (left, right) = tried[peak.place], (tried[place] for place in peak.beside)
    moves = (right.amplitude - left.amplitude) / (peak.beside[1] - peak.beside[0])
    return replace(best, sd=np.hypot(best.sd, peak.sd * moves), log_evidence=peak.nats)


def refit_at(fitted: BaselineFit, names: tuple[str, ...], start: Float[Array, " k"],
             near: LinearizationPoint | None) -> Refit:
    """Fit the named columns as refit does, with shape parameters where they are."""
    layout = only_shared(fitted.layout, names)
    order = [column.name for column in layout.columns[:len(names)]]
    change = np.zeros(len(layout.columns))
    change[:len(names)] = [start[names.index(name)] for name in order]
    tops = [climb(fitted.intake, layout, moved(layout, fitted.spot if near is None else near, change))]
    if near is None and fitted.lost:
        middle = usual_spot(fitted.intake, layout)
        tops.append(top_from(fitted.intake, layout, middle) if fitted.intake.filmed else
                    climb(fitted.intake, layout, moved(layout, middle, change)))
    spot, evidence = max(tops, key=lambda top: objective(top[1], layout))
    covariance = evidence.covariance
    # what the shots themselves scatter by, where the model is too sure of itself
    scattered = covariance @ (evidence.score.T @ evidence.score) @ covariance
    sd = np.sqrt(np.maximum(np.diag(covariance), np.diag(scattered)))
    k = len(names)
    value = evidence.point[:k]
    believed = {column.name for column in fitted.layout.columns[fitted.layout.first_shared:]}
    usual = np.array([centre if name in believed else 0.0 for name, centre in zip(order, layout.centre, strict=False)])
    wanted = value + (covariance @ (evidence.score.sum(0) + evidence.pull))[:k]
    return Refit(tuple(order), layout, spot, evidence, value - usual, value, wanted, sd[:k],
                 log_evidence_at(fitted, layout, evidence))


def log_evidence_at(fitted: BaselineFit, layout: ParameterLayout, evidence: ScoreTable) -> float:
    """Nats by which the data favour a layout of more shared columns, at its optimum, over those of the fit (Laplace).
    """
    null = without(fitted.evidence)
    info, null_info = evidence.information + evidence.precision, null.information + null.precision
    gained = objective(evidence, layout) - objective(null, only_shared(fitted.layout))
    priors = np.linalg.slogdet(layout.precision)[1] - np.linalg.slogdet(fitted.layout.precision)[1]
    nats = float(gained + 0.5 * (priors - np.linalg.slogdet(info)[1] + np.linalg.slogdet(null_info)[1]))
    return nats if np.isfinite(nats) else NEVER


def promote(fitted: BaselineFit, found: Refit) -> BaselineFit:
    """The fit with the named columns among the shared ones, at the refit's optimum."""
    layout = promoted(fitted.layout, found.names)
    spot = found.spot
    return BaselineFit(fitted.intake, layout, spot, linearise(fitted.intake, layout, spot)[0])


def promoted(layout: ParameterLayout, names: tuple[str, ...]) -> ParameterLayout:
    """The layout with these columns moved from the asked to the shared ones."""
    kept = [k for k in range(layout.first_shared) if layout.columns[k].name not in names]
    inner = only_shared(layout, names)
    shift = len(kept)
    return replace(inner, chain=layout.chain, columns=(*(layout.columns[k] for k in kept), *inner.columns),
                   source=np.concatenate([layout.source[kept], inner.source]),
                   scatters=tuple(place + shift if place >= 0 else -1 for place in inner.scatters))
