"""The ranking of candidate terms: a one-step estimate for every term, true refits of the likely ones, and the sizes.

Every term has a normal prior on its amplitude, scaled to the usual size of such effects. A term that would have to be
absurdly large to explain the data thus loses to a smaller one, and no term can win with an amplitude outside its
permitted range.

A term's evidence is first computed with that normal prior, and then corrected for the term's own prior, which mixes
several sizes and is zero outside the term's range.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.special import log_ndtr, logsumexp, ndtr
from scipy.stats import norm

from truearc.sim.discover.detect.battery import LEAST_SHARE
from truearc.sim.infer.fit import amplitudes
from truearc.sim.infer.launcher import LauncherFit
from truearc.sim.infer.likelihood.layout import Measured
from truearc.sim.infer.likelihood.score_table import Array, ScoreTable
from truearc.sim.printed import Progress

# Measured at L1 (seed 701), with the ranges and signs of the terms: 1 of 16 single names wrong instead of 3, and the
# truth in the set in .93 instead of .87 of 61 (git show archive-1:archive/measurements.md)
TERM_SIZES = (0.5, 1.0, 2.0, 4.0)     # possible sizes of a term's amplitude, in usual sizes
PLACES = 801                          # points at which its density is evaluated


def nats_measured(measured: Measured, column: str, amplitude: float, sd: float) -> float:
    """Return the log likelihood ratio of this column's measurement: an amplitude ~ N(amplitude, sd^2) against no
    effect.

    0 without a measurement.
    """
    if column not in measured:
        return 0.0
    value, own = measured[column]
    variance = own**2 + sd**2
    return float(0.5 * (np.log(own**2 / variance) + value**2 / own**2 - (value - amplitude)**2 / variance))


def nats_in_range(fitted: LauncherFit, name: str, amplitude: float, sd: float, usual: float) -> float:
    """Return the change of the log evidence, in nats, when the amplitude's own prior replaces the normal one: the
    parameter's range, its likelier sign, and the size that a law of physics gives."""
    ends = _ends(fitted, name)
    if ndtr((ends[1] - amplitude) / sd) - ndtr((ends[0] - amplitude) / sd) < 1e-12:
        own = ndtr(ends[1] / usual) - ndtr(ends[0] / usual)
        return float(max(log_ndtr(min((ends[1] - amplitude) / sd, (amplitude - ends[0]) / sd)), -50.0) - np.log(own))
    places, density = _density(fitted, name, amplitude, sd, usual)
    return float(logsumexp(density) + np.log(places[1] - places[0]))


class Size(NamedTuple):
    """An amplitude with its standard deviation under the normal prior of the usual size, and its probability.

    A name has several sizes, which depend on the other effects in a hypothesis.
    """

    amplitude: float
    sd: float
    probability: float = 1.0


def sizes_of(found: LauncherFit) -> tuple[Size, ...]:
    """Return the sizes of the names of a refit."""
    return tuple(map(Size, found.amplitude.tolist(), found.sd.tolist()))


def posterior_amplitude(fitted: LauncherFit, name: str, sizes: Sequence[Size]) -> tuple[float, float, float, float]:
    """Return mean, standard deviation and ends of the 90 % interval of an amplitude, mixed over all its sizes.

    The amplitude's own prior replaces the normal one.
    """
    usual = fitted.scores.columns[fitted.scores.index(name)].usual
    ends, parts = _ends(fitted, name), []
    for amplitude, sd, probability in sizes:
        if ends[0] < amplitude < ends[1] and sd < usual:
            places, density = _density(fitted, name, amplitude, sd, usual)
        else:
            places = np.linspace(amplitude - 8.0 * sd, amplitude + 8.0 * sd, PLACES)
            density = norm.logpdf(places, amplitude, sd)
        parts.append((places, probability * np.exp(density - logsumexp(density))))
    places, weight = np.concatenate(parts, axis=1)
    order, weight = np.argsort(places), weight / weight.sum()
    mean = float(weight @ places)
    low, high = np.interp((0.05, 0.95), np.cumsum(weight[order]), places[order])
    return mean, float(np.sqrt(weight @ (places - mean)**2)), float(low), float(high)


def own_size(fitted: LauncherFit, found: LauncherFit, number: int) -> float:
    """Return the standard deviation of the normal prior whose MAP estimate of the amplitude equals the mean under the
    amplitude's own prior."""
    name, amplitude, evidence = found.names[number], float(found.amplitude[number]), found.scores
    usual = fitted.scores.columns[fitted.scores.index(name)].usual
    information = float(amplitudes(found.model.layout, (name,), evidence.point, evidence.covariance)[1][0])**-2.0
    known = information - usual**-2.0
    if known <= 0.0 or amplitude == 0.0 or name in fitted.model.layout.measured:
        return usual
    own = posterior_amplitude(fitted, name, [Size(amplitude, float(found.sd[number]))])[0]
    share = own * known / (amplitude * information)
    size = np.sqrt(max(share, 0.0) / (known * max(1.0 - share, 1e-9)))
    return float(np.clip(size, min(TERM_SIZES) * usual, max(TERM_SIZES) * usual))


def _ends(fitted: LauncherFit, name: str) -> tuple[float, float]:
    """Return the ends of an amplitude's range; for a believed number, of its change."""
    (low, high), before = fitted.model.range_of(name), fitted.model.layout.believed.get(name, 0.0)
    return low - before, high - before


def _density(fitted: LauncherFit, name: str, amplitude: float, sd: float,
             usual: float) -> tuple[Float[Array, " k"], Float[Array, " k"]]:
    """Return points in an amplitude's range and the log density there, with its own prior in place of the normal one.

    Its own prior is a mixture of TERM_SIZES. The change of a believed number has neither a preferred sign nor a law.
    """
    ends, (law, positive) = _ends(fitted, name), fitted.model.law_of(name)
    changed = name in fitted.model.layout.believed
    law = law if not changed else None
    mean, sizes = (0.0, usual * np.array(TERM_SIZES)) if law is None else (1.0, np.array([law]))
    side = 0.5 if changed or law is not None else positive
    places = np.linspace(max(ends[0], amplitude - 8.0 * sd), min(ends[1], amplitude + 8.0 * sd), PLACES)

    def held(low: float, high: float) -> Float[Array, " sizes"]:
        return np.asarray(ndtr((high - mean) / sizes) - ndtr((low - mean) / sizes))

    whole = 2.0 * ((1.0 - side) * held(min(ends[0], 0.0), min(ends[1], 0.0))
                   + side * held(max(ends[0], 0.0), max(ends[1], 0.0))).mean()
    own = logsumexp(norm.logpdf(places[:, None], mean, sizes), axis=1) - np.log(len(sizes) * max(whole, 1e-300))
    weight = np.where(places > 0.0, 2.0 * side, 2.0 * (1.0 - side))
    return places, norm.logpdf(places, amplitude, sd) - norm.logpdf(places, 0.0, usual) + own + np.log(weight)


def by_own_prior(fitted: LauncherFit, found: LauncherFit,
                 beside: Sequence[tuple[LauncherFit, LauncherFit]] = ()) -> LauncherFit:
    """Return the refit with normal priors of own_size. beside: refits of terms that `fitted` already includes."""
    sizes = {name: own_size(one, its, number) for one, its in ((fitted, found), *beside)
             for number, name in enumerate(its.names)}
    model, layout, first = fitted.model, fitted.model.layout, fitted.model.layout.first_shared
    precision = layout.precision.copy()
    for k, column in enumerate(layout.columns[first:]):
        if column.name in sizes and precision[k, k] == column.usual**-2.0:      # not for a number of the belief
            precision[k, k] = sizes[column.name]**-2.0
    columns = tuple(replace(column, usual=sizes.get(column.name, column.usual)) for column in layout.columns)
    sized = replace(fitted, model=replace(model, layout=replace(layout, columns=columns, precision=precision)))
    again = sized.with_columns(found.names, np.zeros(len(found.names)), found.point)
    return replace(again, sd=np.maximum(again.sd, found.sd))       # its sd includes the term's shape


REFITTED = 8                          # maximum number of refitted terms; bounds the run time
# Derived: a thousandth of the probability
WITHIN = 7.0                          # nats below the likeliest term by one step, within which terms are refitted,
SHARE = 0.5                           # or this share of its nats, as one step is inaccurate for large effects; chosen
# Derived: either explains 0.95^2 = 90 % of what the other does
ALIAS = 0.95                          # correlation of two efficient slopes above which terms are aliases
# Derived: a likelihood interval of 95 % ends at 1.92 (Wilks 1938), rounded
TOLD_APART = 2.0                      # nats by which fits of two such terms must differ to be distinguished
# Stated to the user; how often it holds: docs/measured/sealed.md, python -m benchmarks.proof
SURE = 0.9                            # probability of a single name, or of a set as a share of what is explained
SCAN = (-3.0, -2.0, -1.0, -0.5, 0.5, 1.0, 2.0, 3.0)     # sizes simulated if the fit is lost, in usual sizes
FIRM = 100.0                          # information of a scanned size, so that it hardly shrinks towards zero
BUSY = 1e-12                          # information below which nothing in the data depends on a term
# Derived: 1.5 deviations of the largest of TERM_SIZES
MOST_USUAL = 6.0                      # usual sizes beyond which an amplitude is not attributed to its term
SPARE_SD = 2.0                        # allowance at these limits, in standard deviations; chosen: about 95 %
NEVER = -1e3                          # nats of an impossible term


@dataclass(frozen=True)
class Candidate:
    """A term's amplitude column after one step: z, amplitude, efficient information and log Bayes factor (nats)."""

    name: str
    column: int
    z: float
    amplitude: float
    information: float
    nats: float
    visible: bool


@dataclass(frozen=True)
class Naming:
    """The names with the log Bayes factor (nats) of each.

    kin: for each refitted name, those that one step cannot distinguish from it. alike: those that a true fit cannot
    distinguish from the name with the most nats. inclusion: probability that a name is among the missing effects, if
    hypotheses with several effects were considered; None: exactly one name is missing. sizes: for each name, its sizes
    in these hypotheses.
    """

    candidates: tuple[Candidate, ...]
    refits: dict[str, LauncherFit]
    nats: dict[str, float]
    alike: tuple[str, ...] = ()
    kin: dict[str, tuple[str, ...]] = field(default_factory=dict)
    inclusion: Mapping[str, float] | None = None
    sizes: Mapping[str, Sequence[Size]] = field(default_factory=dict)

    @cached_property
    def probability(self) -> dict[str, float]:
        """Return the probability of each name, likeliest first."""
        top = max(self.nats.values())
        weight = {name: float(np.exp(value - top)) for name, value in self.nats.items()}
        total = sum(weight.values())
        alone = _likeliest_first({name: value / total for name, value in weight.items()})
        if self.inclusion is None:
            return alone
        return _likeliest_first({name: self.inclusion.get(name, 0.0) for name in alone})

    def alone(self, fitted: LauncherFit, name: str) -> Size:
        """Return the size of a name if nothing else is missing: from its refit if there is one, otherwise by one
        step."""
        if name in self.refits:
            return sizes_of(self.refits[name])[0]
        return shrunk(next(one for one in self.candidates if one.name == name), fitted.scores)

    def told(self, fitted: LauncherFit, name: str) -> tuple[float, float, float, float]:
        """Return the size of a name over all hypotheses that include it, in the form of `posterior_amplitude`."""
        return posterior_amplitude(fitted, name, self.sizes.get(name) or (self.alone(fitted, name),))

    @property
    def ranked(self) -> list[str]:
        """Return the names that may lead or belong to a set, likeliest first."""
        if self.inclusion is None:
            return sorted(self.nats, key=lambda name: -self.nats[name])
        return sorted(self.refits, key=lambda name: -self.probability[name])

    @property
    def leader(self) -> str:
        return self.ranked[0]

    @property
    def aliases(self) -> tuple[str, ...]:
        """Return the aliases of the leader, whatever their probability."""
        return self.alike if self.leader == max(self.nats, key=lambda name: self.nats[name]) else ()


def _likeliest_first(probability: Mapping[str, float]) -> dict[str, float]:
    return dict(sorted(probability.items(), key=lambda item: -item[1]))


def one_step(evidence: ScoreTable) -> tuple[tuple[Candidate, ...], Float[Array, "K K"]]:
    """Return all terms after one step, and the correlations of their efficient slopes [K, K]."""
    columns = [k for k in range(evidence.first_shared) if evidence.columns[k].kind == "term"]
    score, left = efficient(evidence, np.array(columns, dtype=int))
    total = evidence.information
    found = []
    for number, column in enumerate(columns):
        own, kept = total[column, column], left[number, number]
        visible = bool(own > BUSY and kept > LEAST_SHARE * own)
        information = kept if visible else 0.0
        usual = evidence.columns[column].usual
        found.append(Candidate(evidence.columns[column].name, column,
                               float(score[number] / np.sqrt(information)) if visible else 0.0,
                               float(score[number] / information) if visible else 0.0, float(information),
                               nats_for(score[number], information, usual), visible))
    size = np.sqrt(np.maximum(np.diag(left), BUSY))
    return tuple(found), left / np.outer(size, size)


def nats_for(score: Any, information: float, usual: float) -> Any:
    """Return the log Bayes factor of an amplitude ~ N(0, usual^2) against 0, for one or several Gaussian scores."""
    if information <= 0.0:
        return np.zeros_like(score) if np.ndim(score) else 0.0
    size = information * usual**2
    nats = 0.5 * score**2 / information * size / (1.0 + size) - 0.5 * np.log1p(size)
    return nats if np.ndim(nats) else float(nats)


def name_terms(fitted: LauncherFit, progress: Progress, starts: Mapping[str, float] | None = None) -> Naming:
    """Rank the terms, of which at least one must be visible. starts: names that are always refitted, and from which
    amplitude."""
    candidates, alike = one_step(fitted.scores)
    visible = [c for c in candidates if c.visible]
    slopes_tell = not fitted.lost or len(fitted.model.data.marked) == 0
    likely = sorted(visible if slopes_tell else _scan(fitted, visible), key=lambda c: -c.nats)
    within = max(WITHIN, SHARE * likely[0].nats) if slopes_tell else np.inf
    likely = [c for c in likely[:REFITTED] if c.nats > likely[0].nats - within]
    refits: dict[str, LauncherFit] = {}
    nats = {c.name: c.nats + nats_measured(fitted.model.layout.measured, c.name, c.amplitude, c.information**-0.5)
            for c in visible}
    for candidate in visible:
        if candidate.name in (starts or {}):
            _refit(fitted, candidate, refits, nats, (starts or {})[candidate.name])
    likely = [c for c in likely if c.name not in refits]
    for number, candidate in enumerate(likely):
        progress(number / len(likely), candidate.name.partition(".")[0])
        _refit(fitted, candidate, refits, nats)
    place = {c.name: number for number, c in enumerate(candidates)}

    def kin(top: str) -> list[Candidate]:
        """The likeliest term, and those that one step cannot distinguish from it, which must not lose for lack of a
        refit."""
        return [c for c in visible if abs(alike[place[c.name], place[top]]) > ALIAS or c.name == top]

    while missing := [c for c in kin(max(nats, key=lambda name: nats[name])) if c.name not in refits]:
        _refit(fitted, missing[0], refits, nats)
    top = next(c for c in visible if c.name == max(nats, key=lambda name: nats[name]))
    for one in kin(top.name):
        if refits[one.name].log_evidence < refits[top.name].log_evidence - TOLD_APART:
            _refit_beside(fitted, one, top, refits, nats)
    ranked = sorted(nats, key=lambda name: -nats[name])
    return Naming(candidates, refits, nats, _aliases(fitted, ranked, [c.name for c in kin(ranked[0])], refits, nats),
                  {name: tuple(c.name for c in kin(name)) for name in refits})


def _scanned(fitted: LauncherFit, one: Candidate, nats: Float[Array, " sizes"]) -> Candidate:
    """Return the candidate with the most probable of the sizes of SCAN, given the outcomes."""
    best, usual = int(nats.argmax()), fitted.scores.columns[one.column].usual
    return replace(one, nats=float(nats[best]), amplitude=SCAN[best] * usual, information=FIRM * usual**-2.0)


def _scan(fitted: LauncherFit, candidates: Sequence[Candidate]) -> list[Candidate]:
    """Return the candidates by the outcomes at several sizes of each, simulated from the middle of the prior.

    This replaces the slopes if the fit attributes so much to scatter that they carry no information.
    """
    columns = [one.column for one in candidates]
    points = np.tile(fitted.model.middle().values, (len(columns), len(SCAN), 1))
    for number, k in enumerate(columns):
        points[number, :, fitted.model.layout.source[k]] += np.array(SCAN) * fitted.scores.columns[k].usual
    told = fitted.model.rough_likelihood(points.reshape(-1, points.shape[-1]), columns).max(1)
    told = told.reshape(len(columns), -1) - 0.5 * np.square(SCAN)
    return [_scanned(fitted, one, nats) for one, nats in zip(candidates, told, strict=True)]


def _refit(fitted: LauncherFit, candidate: Candidate, refits: dict[str, LauncherFit], nats: dict[str, float],
           start: float | None = None) -> None:
    """Refit one name, from its one-step amplitude unless a start is given, and store the result in both dicts."""
    name = candidate.name
    if start is None:                 # at most the largest size of SCAN
        most = SCAN[-1] * fitted.scores.columns[candidate.column].usual
        start = float(np.clip(shrunk(candidate, fitted.scores).amplitude, -most, most))
    refits[name] = fitted.with_terms((name,), np.array([start]))
    nats[name] = _nats(fitted, candidate, refits[name])


def _refit_beside(fitted: LauncherFit, one: Candidate, top: Candidate, refits: dict[str, LauncherFit],
                  nats: dict[str, float]) -> None:
    """Refit a name again from the optimum of the likeliest name.

    The posterior may have several maxima, and two names that one step cannot distinguish must not differ only because
    their searches ended at different ones.
    """
    best = refits[top.name]
    near = fitted.model.exchanged(top.name, best.model, best.point, fitted.point)
    start = np.array([best.amplitude[0] * one.amplitude / top.amplitude])
    again = fitted.with_terms((one.name,), start, near)
    if again.log_evidence > refits[one.name].log_evidence:
        refits[one.name], nats[one.name] = again, _nats(fitted, one, again)


def _nats(fitted: LauncherFit, candidate: Candidate, found: LauncherFit) -> float:
    """Return the nats for a refitted name, from the shots and from a measurement without shots, which is part of the
    fit's prior."""
    usual = fitted.scores.columns[candidate.column].usual
    said = nats_measured(fitted.model.layout.measured, found.names[0], 0.0, usual)
    return found.log_evidence + said if is_possible(found, usual) else NEVER


def is_possible(found: LauncherFit, *usual: float) -> bool:
    """Return whether each amplitude may lie within its parameter's range and within MOST_USUAL usual sizes.

    This uses the unbounded optimum, so that a fit that stopped at the end of its range does not count as inside it.
    """
    low, high = np.array([found.model.range_of(name) for name in found.names]).T
    spare = SPARE_SD * found.sd
    return bool(((found.wanted >= low - spare) & (found.wanted <= high + spare)
                 & (np.abs(found.amplitude) <= MOST_USUAL * np.array(usual) + spare)).all())


def is_natural(fitted: LauncherFit, name: str, size: Size) -> bool:
    """Return whether a size is within 99.9 % of a log-normal prior; always true for other priors."""
    return fitted.model.is_natural(name, size.amplitude - SPARE_SD * size.sd)


def shrunk(candidate: Candidate, evidence: ScoreTable) -> Size:
    """Return the one-step amplitude, shrunk towards zero by its prior."""
    precision = candidate.information + evidence.columns[candidate.column].usual**-2.0
    return Size(candidate.amplitude * candidate.information / precision, precision**-0.5)


def efficient(evidence: ScoreTable, columns: Int[Array, " K"],
              more: Float[Array, "P P"] | float = 0.0) -> tuple[Float[Array, " K"], Float[Array, "K K"]]:
    """Return efficient scores [K] and information [K, K] of columns; the shared ones are projected out.

    more [P, P]: information of future shots, added to that of the evidence; scores are the present ones.
    """
    shared = evidence.shared
    info, score = evidence.information + more, evidence.score.sum(0)
    inner = info[shared, shared] + evidence.precision
    cross = info[columns][:, shared]
    lift = np.linalg.solve(inner, cross.T).T if len(inner) else np.zeros((len(columns), 0))
    return (score[columns] - lift @ (score[shared] + evidence.pull),
            info[np.ix_(columns, columns)] - lift @ cross.T)


def _aliases(fitted: LauncherFit, ranked: Sequence[str], kin: Sequence[str], refits: Mapping[str, LauncherFit],
             nats: Mapping[str, float]) -> tuple[str, ...]:
    """Return the possible names of `kin` that a true fit cannot distinguish from the likeliest either.

    Only the quality of the fits counts: an unusually large size is prior knowledge, not data.
    """
    fit = {name: float(refits[name].scores.log_score.sum())
           + nats_measured(fitted.model.layout.measured, name, float(refits[name].amplitude[0]), 0.0) for name in kin}
    return tuple(name for name in ranked[1:]
                 if name in fit and fit[name] > fit[ranked[0]] - TOLD_APART and nats[name] > NEVER)
