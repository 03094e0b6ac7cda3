"""Every test of a session's data, alone or against an earlier session.

Tests are in families: terms, free changes over covariates, any pattern at all.

A simulation adopted from one session ("home") is not perfect for it either, and tracks see that. In the next session
the same misfit would be found again, as a change. So each test is made in both sessions: under no change its score at
home, scaled by the ratio of the two sessions' informations, is the expected score here, within the chance variation of
both (a difference of two samples, whose signs are flipped alike). Where home has no information, as along a covariate
that was not recorded there, the test stands as it is.

A change of the tracker's calibration no test can find, since every fit absorbs it: both sessions' estimates are
compared. Their covariance is a sandwich over clusters of shots (White 1980), in which a prior of the calibration counts
as one more observation. A change of some of the numbers is then a normal model with a closed form, averaged over which
of them changed. A term that would draw the estimates away in the same manner (a head wind is much like a tilt) is added
to the numbers, one at a time, and weighed against that.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, combinations
from typing import Any

import numpy as np
from jaxtyping import Float, Int, Shaped
from scipy.special import logsumexp
from scipy.stats import f as f_distribution
from scipy.stats import multivariate_normal

from truearc.sim.discover.detect import covariates as functions
from truearc.sim.discover.detect.covariates import (
    SAME_SHAPE,
    Covariate,
    CovariatePair,
    Factor,
    Look,
    WeightFunction,
    varies,
    weights_of,
)
from truearc.sim.discover.detect.score_test import Scores, efficient_scores
from truearc.sim.infer.launcher import LauncherFit
from truearc.sim.infer.likelihood.score_table import Array, Column, ScoreTable

MOST = 4.0                            # times home's information that a session may have: else home's noise drowns it


@dataclass(frozen=True)
class ReferenceSession:
    """`fitted`: the belief at its best there, with the same questions; `columns` {name: of every shot} there."""

    fitted: LauncherFit
    columns: Mapping[str, Any]
    company: dict[tuple[str, ...], "ReferenceSession"] = field(default_factory=dict, repr=False)

    @property
    def look(self) -> Look:
        rows = self.fitted.scores.rows
        return Look(len(rows), lambda what: self.find(what)[rows])

    def find(self, what: Covariate | Factor) -> Shaped[Array, " shots"]:
        """Its values, or codes, of every shot of home; nan, or -1, where home knows nothing of it."""
        names = what.names if isinstance(what, Covariate) else (what.name,)
        known = next((self.columns[name] for name in names if name in self.columns), None)
        if isinstance(what, Factor):
            codes = {level: code for code, level in enumerate(what.levels)}
            return np.array([codes.get(text, -1) for text in known]) if known is not None else self._all(-1)
        return self._all(np.nan) if known is None else np.asarray(known, dtype=float)

    def own(self, what: Covariate | Factor | CovariatePair | None) -> Covariate | Factor | None:
        """The same as it was here; None where it did not vary, and for two together."""
        if isinstance(what, Factor):
            return Factor(what.name, what.levels, self.find(what))
        if not isinstance(what, Covariate) or not varies(self.look.at(what)):
            return None
        return Covariate(((what.name, self.find(what)),))

    def index(self, name: str) -> int | None:
        """Of the tested column; None where there is none."""
        columns = self.fitted.scores.columns[:self.fitted.scores.first_shared]
        return next((k for k, column in enumerate(columns) if column.name == name), None)

    def beside(self, scores: Scores, evidence: ScoreTable, number: int, shapes: Sequence[WeightFunction],
               weights: Float[Array, "n q"]) -> Scores:
        """The scores of `shapes` (`weights` [n, q]) on the evidence's column, less home's, whose signs follow."""
        mine = self.fitted.scores
        column = self.index(evidence.columns[number].name)
        rows = len(mine.rows) + len(mine.precision)
        if column is None:
            none = np.zeros((rows, len(shapes)))
            return _joined(scores, Scores(none, none, none + 1.0, scores.kept), np.zeros(len(shapes)))
        there = weights_of(shapes, self.look)
        found = efficient_scores(mine, column, there, np.arange(len(mine.rows)), len(mine.rows))
        said, told = _said(evidence, number, weights), _said(mine, column, there)
        share = np.where(said <= MOST * told, said / np.maximum(told, 1e-300), 0.0)
        return _joined(scores, found, share)

    def among(self, fitted: LauncherFit) -> "ReferenceSession":
        """Home with the effects that `fitted` has been given since fitted there, too."""
        first = fitted.scores.first_shared
        given = {column.name for column in fitted.scores.columns[first:] if column.kind != "group"}
        own = self.fitted.scores.columns[self.fitted.scores.first_shared:]
        names = tuple(sorted(name for name in given - {column.name for column in own} if self.index(name) is not None))
        if names and names not in self.company:
            found = self.fitted.with_terms(names, np.zeros(len(names)))
            self.company[names] = replace(self, fitted=self.fitted.beside(found), company={})
        return self.company[names] if names else self

    def _all(self, value: int | float) -> Shaped[Array, " shots"]:
        return np.full(int(self.fitted.scores.rows.max(initial=-1)) + 1, value)


def _said(evidence: ScoreTable, column: int, weights: Float[Array, "n q"]) -> Float[Array, " q"]:
    return np.asarray((weights**2 * evidence.info[:, column, column, None]).sum(0))


def _joined(here: Scores, home: Scores, share: Float[Array, " q"]) -> Scores:
    """Scores of the difference, in units that leave amplitudes those of the change and gains what it explains."""
    mine, theirs = here.kappa.sum(0), share**2 * home.kappa.sum(0)
    part = mine / np.maximum(mine + theirs, 1e-300)
    psi = np.concatenate([part * here.psi, -part * share * home.psi])
    kappa = np.concatenate([part * here.kappa, np.zeros_like(home.kappa)])
    return Scores(psi, kappa, np.concatenate([here.stretch, home.stretch]), here.kept)


TERMS, FREE, PATTERN = "terms", "free", "pattern"
# How the allowance for false alarms is shared out: a name is worth most, and most of what is left out has one.
ALLOWANCE = {TERMS: 0.6, FREE: 0.3, PATTERN: 0.1}


@dataclass(frozen=True)
class Test:
    """One question: does this column's amplitude go with these weights [n]? what None: the same in every shot."""

    __test__ = False                  # not one of pytest's

    family: str
    column: int
    what: Covariate | Factor | CovariatePair | None
    shape: str
    weights: Float[Array, " n"]
    form: WeightFunction = SAME_SHAPE                # behind `shape` and `weights`, to lay over another session


@dataclass(frozen=True)
class Asked:
    """All tests with their scores [G, M]."""

    tests: tuple[Test, ...]
    scores: Scores


def ask_everything(evidence: ScoreTable, covariates: Sequence[Covariate], factors: Sequence[Factor], shots: int,
                   seed: int, home: ReferenceSession | None = None) -> Asked:
    """All tests that the `shots` of the dataset can carry, except along a factor whose groups have random effects.

    home: the misfit of that session is subtracted.
    """
    rows = evidence.rows
    look = Look(len(rows), lambda what: what.codes[rows] if isinstance(what, Factor) else what.values[rows])
    grouped = next((column.name.partition(" ")[0] for column in evidence.columns if column.kind == "group"), "")
    shapes = [SAME_SHAPE, *(shape for one in covariates for shape in functions.number_shapes(one, look)),
              *(shape for one in factors if one.name != grouped for shape in functions.group_shapes(one, look))]
    tests: list[Test] = []
    parts: list[Scores] = []

    def ask(number: int, family: str, shapes: Sequence[WeightFunction]) -> None:
        weights = weights_of(shapes, look)
        tests.extend(Test(family, number, shape.what, shape.name, weights[:, k], shape)
                     for k, shape in enumerate(shapes))
        scores = efficient_scores(evidence, number, weights, rows, shots)
        parts.append(scores if home is None else home.beside(scores, evidence, number, shapes, weights))

    for number, column in enumerate(evidence.columns[:evidence.first_shared]):
        if column.kind == "term" or column.follows:
            ask(number, TERMS if column.kind == "term" else FREE, [SAME_SHAPE])
        else:
            ask(number, FREE, shapes)
    if pairs := functions.pair_shapes(covariates, look, seed):
        ask(evidence.index("launch speed"), PATTERN, pairs)
    scores = _join(parts)
    kept = np.flatnonzero(scores.kept)
    return Asked(tuple(tests[k] for k in kept), scores.take(kept))


def name_of(test: Test, column: Column) -> str | None:
    """The covariate as reported: what it varies with inside a flight, a column, or nothing."""
    if column.kind == "free" and column.follows:
        return column.follows
    return None if test.what is None else test.what.name


def _join(parts: list[Scores]) -> Scores:
    return Scores(*(np.concatenate([getattr(part, name) for part in parts], axis=-1)
                    for name in ("psi", "kappa", "stretch", "kept")))


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


def compare_trackers(fitted: LauncherFit, home: LauncherFit, false_alarm: float) -> TrackerChange | None:
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


def can_compare(fitted: LauncherFit, home: LauncherFit) -> bool:
    """Whether both sessions have the tracker's numbers, and enough flights."""
    names = _numbers(fitted, home)
    return bool(names) and _clusters(fitted, home) > len(names) + 1


def _clusters(fitted: LauncherFit, home: LauncherFit) -> int:
    return min(len(np.unique(one.scores.together)) for one in (fitted, home))


def rivals_of(fitted: LauncherFit, home: LauncherFit, term: str) -> tuple[NumberChange, ...]:
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


def _numbers(fitted: LauncherFit, home: LauncherFit) -> list[str]:
    """Columns of the tracker's calibration that both sessions have."""
    wanted = [f"{term.name}.{term.amplitude.name}" for term in fitted.model.catalogue
              if term.calibration_sd is not None or term.compared]
    return [name for name in wanted if all(name in _columns(one) for one in (fitted, home))]


def _columns(fitted: LauncherFit) -> set[str]:
    return {column.name for column in fitted.scores.columns} if fitted.model.data.filmed else set()


def _terms(fitted: LauncherFit) -> set[str]:
    """Terms that are tested, and believed ones that may have changed."""
    return {column.name for column in fitted.scores.columns[:fitted.scores.first_shared] if column.kind == "term"}


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


def _difference(fitted: LauncherFit, home: LauncherFit, names: Sequence[str], term: str = "") -> _Difference:
    """Of the tracker's numbers, and of one term where it is named."""
    (value, here), (before, there) = (_estimate(one.scores, one.scores.together, _places(one.scores, names, term))
                                      for one in (fitted, home))
    columns = tuple(fitted.scores.columns[k] for k in _places(fitted.scores, names, term))
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
