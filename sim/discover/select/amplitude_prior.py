"""Knowledge of an amplitude beside the shots: its range, its side, its usual size, a measurement.

The evidence of a term is worked out with a normal prior of its usual size. Its own prior has several sizes, and no
place outside its range.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy.special import log_ndtr, logsumexp, ndtr
from scipy.stats import norm

from truearc.sim.discover.select.refit import Refit, refit_at
from truearc.sim.infer.fit import BaselineFit
from truearc.sim.infer.likelihood.layout import nats_measured
from truearc.sim.infer.likelihood.score_table import Array
from truearc.sim.physics.catalogue import find_parameter, find_terms
from truearc.sim.physics.term import Term

TERM_SIZES = (0.5, 1.0, 2.0, 4.0)     # of a term's amplitude, by the usual one


def nats_known(fitted: BaselineFit, name: str, amplitude: float, sd: float, usual: float) -> float:
    """Nats for an amplitude beside the shots: its range, and what was measured of it."""
    return (nats_in_range(fitted, name, amplitude, sd, usual)
            + nats_measured(fitted.layout.measured, name, amplitude, sd))


def nats_in_range(fitted: BaselineFit, name: str, amplitude: float, sd: float, usual: float) -> float:
    """Nats by which the amplitude's own prior differs from the normal one that its evidence was worked out with: the
    range of its parameter, the side that nature prefers, the size that a law of physics gives it."""
    ends = _ends(fitted, name)
    after = ndtr((ends[1] - amplitude) / sd) - ndtr((ends[0] - amplitude) / sd)
    if after < 1e-12:
        own = ndtr(ends[1] / usual) - ndtr(ends[0] / usual)
        return float(max(log_ndtr(min((ends[1] - amplitude) / sd, (amplitude - ends[0]) / sd)), -50.0) - np.log(own))
    places, density = _density(fitted, name, amplitude, sd, usual)
    return float(logsumexp(density) + np.log(places[1] - places[0]))


def posterior_amplitude(fitted: BaselineFit, name: str, amplitude: float,
                        sd: float) -> tuple[float, float, float, float]:
    """Mean, standard deviation and ends of the 90 % interval of an amplitude, by its own prior in place of the normal
    one of the usual size that `amplitude` and `sd` were worked out with."""
    usual = fitted.evidence.columns[fitted.evidence.index(name)].usual
    ends = _ends(fitted, name)
    if not ends[0] < amplitude < ends[1] or sd >= usual:
        low, high = norm.interval(0.9, amplitude, sd)
        return amplitude, sd, float(low), float(high)
    places, density = _density(fitted, name, amplitude, sd, usual)
    weight = np.exp(density - logsumexp(density))
    mean = float(weight @ places)
    low, high = np.interp((0.05, 0.95), np.cumsum(weight), places)
    return mean, float(np.sqrt(weight @ (places - mean)**2)), float(low), float(high)


def own_size(fitted: BaselineFit, found: Refit, number: int) -> float:
    """The size of a normal prior by which the likeliest amplitude of one name is the mean by its own prior."""
    name, amplitude, evidence = found.names[number], float(found.amplitude[number]), found.evidence
    usual = fitted.evidence.columns[fitted.evidence.index(name)].usual
    information = 1.0 / evidence.covariance[number, number]
    known = information - usual**-2.0
    if known <= 0.0 or amplitude == 0.0 or name in fitted.layout.measured:
        return usual
    share = posterior_amplitude(fitted, name, amplitude, float(found.sd[number]))[0] * known / (amplitude * information)
    size = np.sqrt(max(share, 0.0) / (known * max(1.0 - share, 1e-9)))
    return float(np.clip(size, min(TERM_SIZES) * usual, max(TERM_SIZES) * usual))


def _ends(fitted: BaselineFit, name: str) -> tuple[float, float]:
    """Of the range of an amplitude: of a believed number, of its change."""
    parameter = find_parameter(name, fitted.layout.chain.catalogue)
    shared = [column.name for column in fitted.layout.columns[fitted.layout.first_shared:]]
    centre = float(fitted.layout.centre[shared.index(name)]) if name in shared else 0.0
    return parameter.low - centre, parameter.high - centre


def _density(fitted: BaselineFit, name: str, amplitude: float, sd: float,
             usual: float) -> tuple[Float[Array, " k"], Float[Array, " k"]]:
    """Places in an amplitude's range and the log density there, by its own prior: that of its evidence taken out."""
    ends, term = _ends(fitted, name), find_terms((name.partition(".")[0],), fitted.layout.chain.catalogue)[0]
    changed = name in [column.name for column in fitted.layout.columns[fitted.layout.first_shared:]]
    places = np.linspace(max(ends[0], amplitude - 8.0 * sd), min(ends[1], amplitude + 8.0 * sd), 801)
    by_shots = norm.logpdf(places, amplitude, sd) - norm.logpdf(places, 0.0, usual)
    return places, by_shots + _own_prior(term, places, ends, usual, changed)  # a believed number has no side and no law


def _own_prior(term: Term, places: Float[Array, " k"], ends: tuple[float, float], usual: float,
               changed: bool) -> Float[Array, " k"]:
    """Log density [k] of an amplitude inside its range: as large as usual, or half, twice or four times as large."""
    law = term.law_sd if not changed else None
    mean, sizes = (0.0, usual * np.array(TERM_SIZES)) if law is None else (1.0, np.array([law]))
    side = 0.5 if changed or law is not None else term.positive

    def held(low: float, high: float) -> Float[Array, " sizes"]:
        return np.asarray(ndtr((high - mean) / sizes) - ndtr((low - mean) / sizes))

    whole = 2.0 * ((1.0 - side) * held(min(ends[0], 0.0), min(ends[1], 0.0))
                   + side * held(max(ends[0], 0.0), max(ends[1], 0.0))).mean()
    density = norm.logpdf(places[:, None], mean, sizes)
    weight = np.where(places > 0.0, 2.0 * side, 2.0 * (1.0 - side))
    return np.asarray(logsumexp(density, axis=1) - np.log(len(sizes)) + np.log(weight) - np.log(max(whole, 1e-300)))


def by_own_prior(fitted: BaselineFit, found: Refit, beside: Sequence[tuple[BaselineFit, Refit]] = ()) -> Refit:
    """The refit with normal priors of own_size. beside: refits of terms that `fitted` has already."""
    sizes = {name: own_size(one, its, number) for one, its in ((fitted, found), *beside)
             for number, name in enumerate(its.names)}
    layout, first = fitted.layout, fitted.layout.first_shared
    precision = layout.precision.copy()
    for k, column in enumerate(layout.columns[first:]):
        if column.name in sizes and precision[k, k] == column.usual**-2.0:      # not of a number believed before
            precision[k, k] = sizes[column.name]**-2.0
    columns = tuple(replace(column, usual=sizes.get(column.name, column.usual)) for column in layout.columns)
    sized = replace(fitted, layout=replace(layout, columns=columns, precision=precision))
    again = refit_at(sized, found.names, np.zeros(len(found.names)), found.spot)
    return replace(again, sd=np.maximum(again.sd, found.sd))       # which has the uncertainty of the term's shape
