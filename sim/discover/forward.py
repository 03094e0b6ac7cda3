"""Effects one after another: name one, put it in, ask again; at most three. Against each name runs a free curve."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import logsumexp

from sim.discover.ask import ALLOWANCE, Asked, Clusters, ask_everything
from sim.discover.believed import Fitted, only_shared
from sim.discover.correct import correct
from sim.discover.covariates import Covariate, Factor
from sim.discover.decoys import share_above
from sim.discover.evidence import Array
from sim.discover.linear import Layout, linearise
from sim.discover.locate import Place, locate
from sim.discover.name import Naming, name_terms
from sim.discover.refit import Refit, clustered_error, folds_of, unseen_score, without
from sim.discover.statistics import Judged, judge

Progress = Callable[[float, str], None]
MOST = 3
DRAWS = 999                           # after the first step, whose probability is the one that is promised
CLEARLY = 2.0                         # standard errors by which a free curve must beat the best name on unseen shots
FALSE_NAMES = 0.1                     # share of deals of decoys that may do as well as a name


@dataclass(frozen=True)
class Step:
    """One effect. `before`, `after`, `average`, `free` [n]: log scores of unseen shots by what was believed so far,
    with the leading name, with all names as far as they are likely, with the free curve.

    rival: nats by which the curve beats the name on unseen shots (None without a curve). decoys: share of deals in
    which one does as well as the name. unknown: the curve beats it clearly, decoys do too often, or nothing has a name.
    """

    naming: Naming
    place: Place | None
    before: Array
    after: Array
    average: Array
    free: Array | None
    rival: float | None
    decoys: float
    unknown: bool
    base: tuple[str, ...]             # names put in before
    fitted: Fitted                    # without this effect

    @property
    def refit(self) -> Refit:
        return self.naming.refits[self.naming.leader]


def go_forward(fitted: Fitted, clusters: Clusters, place: Place | None, covariates: tuple[Covariate, ...],
               factors: tuple[Factor, ...], false_alarm: float, seed: int, progress: Progress) -> tuple[Step, ...]:
    """Name the effect that was found, and go on while anything is left beyond chance."""
    steps: list[Step] = []
    for number in range(MOST):
        span = (number / MOST, (number + 0.8) / MOST)
        step = _step(fitted, clusters, place, tuple(name for each in steps for name in (each.naming.leader,)), seed,
                     lambda done, note, span=span: progress(span[0] + done * (span[1] - span[0]), note))
        if steps and not _pays(step):
            break
        steps.append(step)
        if step.unknown or number == MOST - 1:
            break
        fitted = promote(fitted, step.refit)
        asked = ask_everything(fitted.evidence, covariates, factors, clusters, seed)
        if not asked.tests:
            break
        judged = _judge(asked, seed)
        if judged.p_any > false_alarm:
            break
        place = locate(fitted.evidence, asked, judged, false_alarm, clusters, seed)
    return tuple(steps)


def _pays(step: Step) -> bool:
    """Whether a further effect does clearly better on unseen shots: chance finds something more than at first."""
    gain = (step.free if step.unknown and step.free is not None else step.after) - step.before
    return bool(gain.mean() > CLEARLY * clustered_error(gain, step.fitted.together))


def promote(fitted: Fitted, found: Refit) -> Fitted:
    """The fit with the named columns among the shared ones, at the refit's optimum."""
    layout = promoted(fitted.layout, found.names)
    spot = found.spot
    return Fitted(fitted.intake, layout, spot, linearise(fitted.intake, layout, spot)[0])


def promoted(layout: Layout, names: tuple[str, ...]) -> Layout:
    """The layout with these columns moved from the asked to the shared ones."""
    first = len(layout.columns) - len(layout.precision)
    kept = [k for k in range(first) if layout.columns[k].name not in names]
    inner = only_shared(layout, names)
    shift = len(kept)
    return replace(inner, columns=(*(layout.columns[k] for k in kept), *inner.columns),
                   source=np.concatenate([layout.source[kept], inner.source]),
                   scatters=tuple(place + shift if place >= 0 else -1 for place in inner.scatters))


def _step(fitted: Fitted, clusters: Clusters, place: Place | None, base: tuple[str, ...], seed: int,
          progress: Progress) -> Step:
    naming = name_terms(fitted, progress)
    before = unseen_score(without(fitted.evidence), clusters)
    scores = {name: unseen_score(one.evidence, clusters) for name, one in naming.refits.items()}
    after, average = scores[naming.leader], _averaged(naming, before, scores, clusters.label[fitted.evidence.rows])
    free = None if place is None else place.correction.log_after
    rivals = _rivals(naming, after, place, clusters, fitted)
    decoys = share_above(fitted.evidence, clusters, naming.nats[naming.leader], seed)
    unknown = (naming.nats[naming.leader] <= 0.0 or decoys > FALSE_NAMES
               or (bool(rivals) and all(_clearly(gain, fitted) for gain in rivals)))
    rival = min((_worth(gain, fitted) for gain in rivals), default=None)
    return Step(naming, place, before, after, average, free, rival, decoys, unknown, base, fitted)


def _averaged(naming: Naming, before: Array, scores: dict[str, Array], label: Array) -> Array:
    """Log score [n] of unseen shots by all refitted names and none, each as likely as the other folds' shots make it.

    For forecasts: a name that is one of several likely ones forgoes what the others know (Hoeting et al. 1999).
    """
    fold = folds_of(label)
    each = np.stack([before, *scores.values()])
    nats = np.array([0.0, *(naming.nats[name] for name in scores)])
    result = np.zeros(len(before))
    for held in range(fold.max() + 1):
        out = fold == held
        log_weight = nats - (each[:, out] - before[out]).sum(1)
        result[out] = logsumexp(each[:, out].T + log_weight - logsumexp(log_weight), axis=1)
    return result


def _rivals(naming: Naming, after: Array, place: Place | None, clusters: Clusters, fitted: Fitted) -> list[Array]:
    """What the free curve gains [n] on unseen shots, twice: instead of the name, and, if that is anything, on top of
    it. The former alone compares two linearisations, the latter alone would take a second effect for proof against
    the first."""
    if place is None:
        return []
    instead = place.correction.log_after - after
    if instead.sum() <= 0.0:
        return [instead]
    named = promote(fitted, naming.refits[naming.leader])
    test = replace(place.test, column=named.evidence.index(place.column.name))
    return [instead, correct(named.evidence, test, clusters).gain]


def _clearly(gain: Array, fitted: Fitted) -> bool:
    """Whether log scores [n] of unseen shots are better by more than chance, and by more than a trifle."""
    return bool(gain.mean() > CLEARLY * clustered_error(gain, fitted.together) and gain.sum() > CLEARLY)


def _worth(gain: Array, fitted: Fitted) -> float:
    """Nats that log scores [n] of unseen shots gain; no more than their own spread vouches for, since shots that lie
    far beyond their stated noise speak louder than they know."""
    error = clustered_error(gain, fitted.together)
    total = float(gain.sum())
    return total if total <= 0.0 or error <= 0.0 else min(total, 0.5 * float(gain.mean() / error)**2)


def _judge(asked: Asked, seed: int) -> Judged:
    return judge(asked.scores, [test.family for test in asked.tests], ALLOWANCE, DRAWS, seed, lambda done, note: None)
