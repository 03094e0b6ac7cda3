"""Change of a tracker's calibration since the reference session, which no test can find: every fit absorbs it.

Both sessions' estimates of the tracker's numbers are compared. Their covariance is a sandwich over clusters of shots
(White 1980), in which a prior of the calibration counts as one more observation. A change of some of the numbers is
then a normal model with a closed form, averaged over which of them changed. A term that would draw the estimates away
in the same manner (a head wind is much like a tilt) is added to the numbers, one at a time, and weighed against that.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain, combinations

import numpy as np
from jaxtyping import Float, Int
from scipy.special import logsumexp
from scipy.stats import f as f_distribution
from scipy.stats import multivariate_normal

from truearc.sim.infer.fit import BaselineFit
from truearc.sim.infer.likelihood.score_table import Array, Column, ScoreTable

ODDS = 0.1                            # a priori, of one more number that changed, or of another term instead
LEAST = 0.05                          # probability from which a number or term is listed


@dataclass(frozen=True)
class NumberChange:
    """Column, with the probability that it changed, and the change [its unit] if it did."""

    name: str
    unit: str
    probability: float
    change: float
    sd: float


@dataclass(frozen=True)
class TrackerChange:
    """p_value: of no change at all. `together`: the tracker's numbers that changed in the likeliest case; `numbers`:
    these, and numbers or terms that would do instead, the likeliest first."""

    p_value: float
    numbers: tuple[NumberChange, ...]
    together: tuple[str, ...]


def compare_trackers(fitted: BaselineFit, home: BaselineFit, false_alarm: float) -> TrackerChange | None:
    """Compare the calibrations of two fits of one belief; None where they agree, or there are too few tracks."""
    if not can_compare(fitted, home):
        return None
    names, clusters = _numbers(fitted, home), _clusters(fitted, home)
    seen, spare = _difference(fitted, home, names), clusters - len(names)
    size = float(seen.change @ np.linalg.solve(seen.covariance, seen.change))
    p_value = float(f_distribution.sf(size * spare / (len(names) * (clusters - 1)), len(names), spare))
    if p_value > false_alarm:
        return None
    subsets = list(chain.from_iterable(combinations(range(len(names)), k + 1) for k in range(len(names))))
    weight = np.array([seen.nats(one) + (len(one) - 1) * np.log(ODDS) for one in subsets])
    best = subsets[int(weight.argmax())]
    instead, last = [], len(names)
    for name in sorted((_terms(fitted) & _terms(home)) - set(names)):
        both = _difference(fitted, home, names, name)
        rest = max(both.nats(best), both.nats((*best, last)))      # the tracker changed, and the term may have, too
        instead.append((both, both.nats((last,)) - rest + np.log(ODDS) + weight.max()))
    whole = logsumexp([*weight, *(nats for _, nats in instead)])
    found = [both.number(last, np.exp(nats - whole), (last,)) for both, nats in instead]
    for k in range(len(names)):
        with_it = [n for n, one in enumerate(subsets) if k in one and (k in best or not set(best) <= set(one))]
        likeliest = subsets[max(with_it, key=lambda n: weight[n])]
        found.append(seen.number(k, np.exp(logsumexp(weight[with_it]) - whole), likeliest))
    together = tuple(names[k] for k in best)
    listed = [one for one in found if one.probability >= LEAST or one.name in together]
    return TrackerChange(p_value, tuple(sorted(listed, key=lambda one: -one.probability)), together)


def can_compare(fitted: BaselineFit, home: BaselineFit) -> bool:
    """Whether both sessions have the tracker's numbers, and enough flights."""
    names = _numbers(fitted, home)
    return bool(names) and _clusters(fitted, home) > len(names) + 1


def _clusters(fitted: BaselineFit, home: BaselineFit) -> int:
    return min(len(np.unique(one.together)) for one in (fitted, home))


def rivals_of(fitted: BaselineFit, home: BaselineFit, term: str) -> tuple[NumberChange, ...]:
    """The term, and the tracker's numbers of which one alone explains the sessions' difference about as well; each as
    likely a priori. Empty where there are none."""
    names = _numbers(fitted, home)
    if not names or term in names or term not in _terms(fitted) & _terms(home):
        return ()
    seen = _difference(fitted, home, names, term)
    weight = np.array([seen.nats((k,)) for k in range(len(names) + 1)])
    probability = np.exp(weight - logsumexp(weight))
    near = [k for k in range(len(names)) if probability[k] >= LEAST]
    return tuple(seen.number(k, probability[k], (k,)) for k in (len(names), *near)) if near else ()


def _numbers(fitted: BaselineFit, home: BaselineFit) -> list[str]:
    """Columns of the tracker's calibration that both sessions have."""
    wanted = [f"{term.name}.{term.amplitude.name}" for term in fitted.layout.chain.catalogue
              if term.calibration_sd is not None or term.compared]
    return [name for name in wanted if all(name in _columns(one) for one in (fitted, home))]


def _columns(fitted: BaselineFit) -> set[str]:
    return {column.name for column in fitted.evidence.columns} if fitted.intake.filmed else set()


def _terms(fitted: BaselineFit) -> set[str]:
    """Terms that are tested, and believed ones that may have changed."""
    return {column.name for column in fitted.evidence.columns[:fitted.evidence.first_shared] if column.kind == "term"}


@dataclass(frozen=True)
class _Difference:
    """`change` [k]: later less earlier; `usual` [k]: standard deviation of a change."""

    columns: tuple[Column, ...]
    change: Float[Array, " k"]
    covariance: Float[Array, "k k"]
    usual: Float[Array, " k"]

    def nats(self, subset: Sequence[int]) -> float:
        """Log evidence where these of the numbers changed."""
        return float(multivariate_normal.logpdf(self.change, cov=self._spread(subset)))

    def number(self, k: int, probability: float, subset: Sequence[int]) -> NumberChange:
        """Size of number k's change where this subset changed."""
        gain = self.usual[k]**2 * np.linalg.inv(self._spread(subset))[k]
        sd = self.usual[k] * np.sqrt(max(1.0 - gain[k], 0.0))
        column = self.columns[k]
        return NumberChange(column.name, column.unit, float(probability), float(gain @ self.change), float(sd))

    def _spread(self, subset: Sequence[int]) -> Float[Array, "k k"]:
        return self.covariance + np.diag([one**2 if k in subset else 0.0 for k, one in enumerate(self.usual)])


def _difference(fitted: BaselineFit, home: BaselineFit, names: Sequence[str], term: str = "") -> _Difference:
    """Of the tracker's numbers, and of one term where it is named."""
    (value, here), (before, there) = (_estimate(one.evidence, one.together, _places(one.evidence, names, term))
                                      for one in (fitted, home))
    columns = tuple(fitted.evidence.columns[k] for k in _places(fitted.evidence, names, term))
    return _Difference(columns, value - before, here + there, np.sqrt(2.0) * np.array([one.usual for one in columns]))


def _places(evidence: ScoreTable, names: Sequence[str], term: str) -> list[int]:
    where = {column.name: k for k, column in enumerate(evidence.columns)}     # of two of one name the shared one
    return [where[name] for name in names] + ([evidence.index(term)] if term else [])


def _estimate(evidence: ScoreTable, label: Int[Array, " n"],
              places: Sequence[int]) -> tuple[Float[Array, " k"], Float[Array, "k k"]]:
    """(values, covariance) of some columns, one step from the top, with all shared ones free."""
    first = evidence.first_shared
    kept = [k for k in places if k < first] + list(range(first, len(evidence.columns)))
    extra, at = len(kept) - len(evidence.precision), [kept.index(k) for k in places]
    usual = np.array([evidence.columns[k].usual for k in kept])
    prior = np.diag(usual**-2.0)
    prior[extra:, extra:] = evidence.precision
    inverse = np.linalg.inv(evidence.information[np.ix_(kept, kept)] + prior)
    score = np.zeros((int(label.max()) + 1, len(kept)))
    np.add.at(score, label, evidence.score[:, kept])
    many = len(np.unique(label))
    middle = score.T @ score * many / (many - 1)
    middle[at, at] += usual[at]**-2.0
    step = inverse @ (score.sum(0) + np.concatenate([np.zeros(extra), evidence.pull]))
    start = np.concatenate([np.zeros(extra), evidence.point[first:]])
    return (start + step)[at], (inverse @ middle @ inverse)[np.ix_(at, at)]
