"""One effect: its name, and the worth of the name beside a free curve, beside decoys, and averaged with others.

A decoy moves the shots as much as its term does, each by a random sign. It is null by construction, yet it meets the
same shots with the same surprises, however they are spread: a name that decoys equal is not one.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.special import logsumexp

from truearc.sim.discover.detect.free_curve import correct
from truearc.sim.discover.detect.localization import Place
from truearc.sim.discover.detect.reference_session import ReferenceSession
from truearc.sim.discover.detect.score_test import efficient_scores
from truearc.sim.discover.model.baseline_fit import BaselineFit
from truearc.sim.discover.model.score_table import Array, Column, ScoreTable
from truearc.sim.discover.select.refit import Refit, clustered_error, folds_of, promote, unseen_score, without
from truearc.sim.discover.select.term_ranking import Naming, name_terms, nats_for, visible_terms
from truearc.sim.progress import Progress

CLEARLY = 2.0                         # standard errors by which a free curve must beat the best name on unseen shots
FALSE_NAMES = 0.1                     # share of draws of decoys that may do as well as a name
DRAWS = 400                           # of decoys
Each = Float[Array, " n"]             # a number of each shot


@dataclass(frozen=True)
class Step:
    """One effect. `before`, `after`, `average`, `free` [n]: log scores of unseen shots without it, with the leading
    name, with all names as far as they are likely, with the free curve. Other named effects are in `fitted`.

    rival: nats by which the curve beats the name on unseen shots (None without a curve). unknown: the curve beats it
    clearly, decoys do as well too often, or no term explains it.
    """

    naming: Naming
    place: Place | None
    before: Each
    after: Each
    average: Each
    free: Each | None
    rival: float | None
    unknown: bool
    base: tuple[str, ...]             # names put in before
    fitted: BaselineFit               # without this effect
    outrun: bool                      # it is unknown for the curve's sake alone: more names might do better yet

    @property
    def refit(self) -> Refit:
        return self.naming.refits[self.naming.leader]

    @property
    def column(self) -> Column:
        """Of the leading name, in `fitted`."""
        return self.fitted.evidence.columns[self.fitted.evidence.index(self.naming.leader)]


def make_step(fitted: BaselineFit, shots: int, place: Place | None, base: tuple[str, ...], seed: int,
              progress: Progress, home: ReferenceSession | None = None) -> Step:
    """Name what is left in `fitted`, and weigh the name against a free curve and decoys. home: what such a curve gains
    there already is not to the credit of this one."""
    naming = name_terms(fitted, progress)
    before, after, average = unseen_scores(naming, fitted)
    free = None if place is None else place.correction.log_after
    rivals = _rivals(naming, after, place, fitted, home)
    decoys = share_above(fitted.evidence, shots, naming.nats[naming.leader], seed)
    nameless = naming.nats[naming.leader] <= 0.0 or decoys > FALSE_NAMES
    outrun = not nameless and bool(rivals) and all(clearly(gain, fitted) for gain in rivals)
    rival = min((worth(gain, fitted) for gain in rivals), default=None)
    return Step(naming, place, before, after, average, free, rival, nameless or outrun, base, fitted, outrun)


def share_above(evidence: ScoreTable, shots: int, nats: float, seed: int) -> float:
    """Share of draws (one decoy of each visible term) in which the best decoy has as many nats as the best name."""
    ones = np.ones((len(evidence.rows), 1))
    best = np.full(DRAWS, -np.inf)
    flips: Array | None = None
    rng = np.random.default_rng(seed)
    for column in visible_terms(evidence).tolist():
        scores = efficient_scores(evidence, column, ones, evidence.rows, shots)
        if flips is None:
            flips = rng.choice((-1.0, 1.0), (DRAWS, len(scores.psi)))
        found = flips @ (scores.psi * scores.stretch)[:, 0]
        best = np.maximum(best, nats_for(found, float(scores.kappa.sum()), evidence.columns[column].usual))
    return float(np.mean(best >= nats))


def unseen_scores(naming: Naming, fitted: BaselineFit) -> tuple[Each, Each, Each]:
    """Log scores [n] of unseen shots (without any name, with the leading one, averaged over all refitted ones)."""
    before = unseen_score(without(fitted.evidence))
    scores = {name: unseen_score(one.evidence) for name, one in naming.refits.items()}
    return before, scores[naming.leader], averaged(naming, before, scores)


def averaged(naming: Naming, before: Each, scores: dict[str, Each]) -> Each:
    """Log score [n] of unseen shots by all refitted names and none, each as likely as the other folds' shots make it.

    For forecasts: a name that is one of several likely ones forgoes what the others know (Hoeting et al. 1999).
    """
    fold = folds_of(len(before))
    each = np.stack([before, *scores.values()])
    nats = np.array([0.0, *(naming.nats[name] for name in scores)])
    result = np.zeros(len(before))
    for held in range(fold.max() + 1):
        out = fold == held
        log_weight = nats - (each[:, out] - before[out]).sum(1)
        result[out] = logsumexp(each[:, out].T + log_weight - logsumexp(log_weight), axis=1)
    return result


def _rivals(naming: Naming, after: Each, place: Place | None, fitted: BaselineFit,
            home: ReferenceSession | None) -> list[Each]:
    """Gains [n] of the free curve on unseen shots, twice: instead of the name, and, if that is anything, on top of it.
    The former alone compares two linearisations, the latter alone would mistake a second effect for proof against the
    first."""
    if place is None:
        return []
    usual = 0.0 if home is None else _gain_at(home, place)
    instead = place.correction.log_after - after - usual
    if instead.sum() <= 0.0:
        return [instead]
    named = promote(fitted, naming.refits[naming.leader])
    test = replace(place.test, column=named.evidence.index(place.column.name))
    return [instead, correct(named.evidence, test).gain - usual]


def _gain_at(home: ReferenceSession, place: Place) -> float:
    """Nats per shot that such a curve gains at home; 0 where it cannot be drawn there."""
    number, what = home.index(place.column.name), home.own(place.test.what)
    if number is None or (what is None and place.test.what is not None):
        return 0.0
    test = replace(place.test, column=number, what=what, weights=place.test.form.weigh(home.look))
    return max(0.0, float(correct(home.fitted.evidence, test).gain.mean()))


def clearly(gain: Each, fitted: BaselineFit) -> bool:
    """Whether log scores [n] of unseen shots gain more than CLEARLY standard errors, and more than CLEARLY nats."""
    return bool(gain.mean() > CLEARLY * clustered_error(gain, fitted.together) and gain.sum() > CLEARLY)


def worth(gain: Each, fitted: BaselineFit) -> float:
    """Nats that log scores [n] of unseen shots gain; no more than their own spread vouches for, since shots that lie
    far beyond their stated noise speak louder than they know."""
    error = clustered_error(gain, fitted.together)
    total = float(gain.sum())
    return total if total <= 0.0 or error <= 0.0 else min(total, 0.5 * float(gain.mean() / error)**2)
