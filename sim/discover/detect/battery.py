"""A battery of tests on a session's data, alone or against an earlier session.

The tests form families: terms, free changes over covariates, and arbitrary patterns.

A simulation adopted from one session ("home") does not fit that session perfectly, and tracks reveal the misfit. In the
next session, the misfit would be found again and look like a change. Each test is therefore made in both sessions. If
nothing has changed, the score at home, scaled by the ratio of the two sessions' information, is the expected score
here, within the chance variation of both (a difference of two samples, whose signs are flipped alike). Where home has
no information, as along a covariate that was not recorded there, the test uses this session alone.

No test can find a change in the tracker's calibration, since every fit absorbs it; instead the estimates of both
sessions are compared. Their covariance is a sandwich over clusters of shots (White 1980), in which a prior of the
calibration counts as one more observation. A change in some of the numbers is then a normal model with a closed form,
averaged over the subsets that may have changed. Terms that would shift the estimates in the same way (a headwind
resembles a tilt) are added to the numbers one at a time and weighed against such a change.

The tests use efficient scores of the shots, and the largest of them is judged by flipping signs.

The alternative of a test is that a channel's amplitude in shot i is w_i b, with given weights w (a covariate's shape)
and b not 0. The part of its score that the shared parameters could explain is projected out (Neyman's C(alpha)); the
rest is summed over the shots and divided by their empirical spread. Under the baseline model a shot's contribution is
as likely to be negative as positive, regardless of its variance and the correlation of its samples. The statistic under
random signs therefore has the null distribution, and the maximum over all tests under the same signs gives the
family-wise p-value (score bootstrap: Kline and Santos 2012; max statistic: Westfall and Young 1993). The spread is that
of the scores themselves, not of their residuals after an effect: signs do not change it, so tests that rest on few
shots have light tails and do not raise the threshold for all. The tests are pure NumPy.

The prior of a shared parameter is one more observation of it, with an error like that of any other, and so it has its
own sign. Otherwise a test that depends on priors (one supplier's balls against another's, where each ball may differ at
random) would mistake the priors' errors for a finding.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, combinations
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped
from scipy.special import logsumexp
from scipy.stats import f as f_distribution
from scipy.stats import multivariate_normal

from truearc.sim.discover.detect import covariates as functions
from truearc.sim.discover.detect.covariates import SAME_SHAPE, Covariate, Factor, Look, WeightFunction, weights_of
from truearc.sim.infer.intervals import NumberChange, estimate_by_shots
from truearc.sim.infer.launcher import LauncherFit
from truearc.sim.infer.likelihood.score_table import Array, Column, ScoreTable
from truearc.sim.printed import Progress

# Derived: to be seen as well, an effect would have to be a hundred times as large
LEAST_SHARE = 1e-4                    # of the information of a test or term that must survive the projection
# Bounds the stretch of a shot that decides its own fit (HC2: MacKinnon and White 1985)
MOST_LEVERAGE = 0.9
# Chosen: more signs than FEWEST by far, so that their sum is normal
PIECES = 30                           # that what an earlier session found of one number is split into
TINY = 1e-300                         # what is not known at all has a root, too
CHUNK = 250                           # sign patterns at once


@dataclass(frozen=True)
class Scores:
    """M tests over G signs, those of shots, then of the shared parameters' priors: `psi` [G, M] efficient scores,
    `kappa` [G, M] their information; `kept` [M] usable.

    `stretch` [G, M]: fitting the shared parameters draws each score towards zero; times this it has the spread that it
    had before.
    """

    psi: Float[Array, "G M"]
    kappa: Float[Array, "G M"]
    stretch: Float[Array, "G M"]
    kept: Bool[Array, " M"]

    def take(self, kept: Int[Array, " kept"]) -> "Scores":
        """Return the scores of these tests."""
        return Scores(self.psi[:, kept], self.kappa[:, kept], self.stretch[:, kept], self.kept[kept])


@dataclass(frozen=True)
class Judged:
    """`statistic` [M] |score| in units of its spread; `p_each` [M] one test alone; `p_value` [M] as the largest of its
    family, with the family's share of the allowance for false alarms; `families` {name: p of the family}; `p_any`: of
    all.

    largest {family: [1 + draws]} the largest of each as seen, then by chance; weights: their shares of the allowance.
    """

    statistic: Float[Array, " M"]
    amplitude: Float[Array, " M"]     # one-step estimate of b
    gain: Float[Array, " M"]          # log-likelihood explained by it
    p_each: Float[Array, " M"]
    p_value: Float[Array, " M"]
    families: dict[str, float]
    p_any: float
    largest: dict[str, Float[Array, " draws"]]
    weights: dict[str, float]

    def threshold(self, family: str, false_alarm: float) -> float:
        """Return the statistic above which one test of the family is an alarm; infinite if nothing was tested."""
        if family not in self.largest:
            return float("inf")
        allowed = np.quantile(_least(self.largest, self.weights)[1], false_alarm) * self.weights[family]
        return float(np.quantile(self.largest[family], 1.0 - min(allowed, 1.0)))


def efficient_scores(evidence: ScoreTable, channel: int, weights: Float[Array, "n q"], rows: Int[Array, " n"],
                     shots: int) -> Scores:
    """Return scores of `weights` (q tests on one channel) in these `rows` of `shots`; those of the p priors follow."""
    shared, first = evidence.shared, evidence.first_shared
    place = evidence.deal.place[:, first:] - first
    k_cc, k_ct, k_tt = (evidence.info[:, channel, channel], evidence.info[:, channel, first:],
                        evidence.info[:, first:, first:])
    across = evidence.deal.spread(evidence.info[:, channel])[:, shared]
    total = evidence.information[shared, shared] + evidence.precision
    project = np.linalg.solve(total, (weights.T @ across).T).T if len(total) else np.zeros((weights.shape[1], 0))
    mine = np.swapaxes(project[:, place], 0, 1)
    known = mine @ k_tt
    psi = weights * evidence.score[:, channel, None] - evidence.score[:, shared] @ project.T
    raw = weights**2 * k_cc[:, None]
    kappa = raw - 2.0 * weights * (across @ project.T) + (known * mine).sum(2)
    common = weights[:, :, None] * k_ct[:, None] - known
    own = np.linalg.inv(total)[place[:, :, None], place[:, None, :]]
    drawn = ((common @ own) * common).sum(2)          # variance by which fitting the shared ones draws each score
    parts = np.zeros((3, shots, weights.shape[1]))
    parts[:, rows] = psi, kappa, drawn
    psi, kappa, drawn = (np.concatenate(both) for both in zip(parts, _prior_scores(evidence, project, total),
                                                              strict=True))
    return Scores(psi, kappa, _stretch(kappa, drawn), _usable(kappa, raw.sum(0)))


def _prior_scores(evidence: ScoreTable, project: Float[Array, "q p"], total: Float[Array, "p p"]
                  ) -> tuple[Float[Array, "m q"], Float[Array, "m q"], Float[Array, "m q"]]:
    """(psi, kappa, drawn) of the priors, as independent observations of combinations of the shared parameters:
    one each, or, of those from an earlier session, PIECES each.

    A session's error is normal and as large as it says, so it may be split into many (its share of the error and
    noise that adds up to zero); a single one would leave a test that rests on it with one sign to flip. How far the
    catalogue's priors err is unknown: their one error stands for itself.
    """
    told = np.array([column.told for column in evidence.columns[evidence.shared]], dtype=bool)
    root = np.linalg.cholesky(evidence.precision + TINY * np.eye(len(evidence.precision)))
    error = np.linalg.solve(root, evidence.pull)
    count = np.where(told, PIECES, 1)
    whose = np.repeat(np.arange(len(told)), count)
    noise = np.random.default_rng(0).normal(size=(len(told), PIECES))
    noise = (noise - noise.mean(axis=1, keepdims=True)) / np.sqrt(PIECES)
    piece = (error / count)[whose]
    piece[told[whose]] += noise[told].ravel()
    onto = (project @ root).T
    share = 1.0 / count[whose, None]
    leaned = np.einsum("ij,ij->i", root.T @ np.linalg.inv(total), root.T)[whose, None]
    return -onto[whose] * piece[:, None], onto[whose]**2 * share, onto[whose]**2 * leaned * share**2


def _stretch(kappa: Float[Array, "G M"], drawn: Float[Array, "G M"]) -> Float[Array, "G M"]:
    """1 / sqrt(1 - leverage), each shot's leverage in each test as its information has it (HC2 of linear models)."""
    return np.asarray(1.0 / np.sqrt(1.0 - np.clip(drawn / np.maximum(kappa, 1e-300), 0.0, MOST_LEVERAGE)))


def _usable(kappa: Float[Array, "G M"], raw: Float[Array, " M"]) -> Bool[Array, " M"]:
    total = kappa.sum(0)
    effective = total**2 / np.maximum((kappa**2).sum(0), 1e-300)
    return np.asarray((total > LEAST_SHARE * raw) & (raw > 0.0) & (effective >= functions.FEWEST))


def judge(scores: Scores, family: Sequence[str], allowance: Mapping[str, float], draws: int, seed: int,
          progress: Progress) -> Judged:
    """Judge every test alone, in its family [M], and all families together, under `draws` random sign patterns.

    The families' probabilities, each over its share of the allowance, are compared by their smallest under the same
    signs, so that sharing costs no more than it must (Westfall and Young's min-p).
    """
    psi, total, observed = scores.psi * scores.stretch, scores.kappa.sum(0), scores.psi.sum(0)
    unit = psi / np.sqrt((psi**2).sum(0) + TINY)
    seen = np.abs(observed) / np.sqrt((psi**2).sum(0) + TINY)
    member = {name: np.array([one == name for one in family], dtype=bool) for name in allowance if name in set(family)}
    if not member:
        return Judged(seen, observed, observed, seen, seen, {}, 1.0, {}, {})
    largest, above_each = _flip(unit, seen, member, draws, seed, progress)
    share = sum(allowance[name] for name in member)
    weights = {name: allowance[name] / share for name in member}
    p_value, families, p_any = _combine(seen, member, largest, weights)
    amplitude = observed / total
    return Judged(seen, amplitude, 0.5 * amplitude * observed, (1.0 + above_each) / (1.0 + draws), p_value, families,
                  p_any, largest, weights)


def _flip(unit: Float[Array, "G M"], seen: Float[Array, " M"], member: Mapping[str, Bool[Array, " M"]], draws: int,
          seed: int, progress: Progress) -> tuple[dict[str, Float[Array, " draws"]], Float[Array, " M"]]:
    """({family: its largest as observed, then in each draw}, draws [M] in which a test came out as large).

    `unit` [G, M]: each sign's part of a test's score, in units of the spread.
    """
    rng = np.random.default_rng(seed)
    largest = {name: np.append(seen[inside].max(), np.zeros(draws)) for name, inside in member.items()}
    above_each = np.zeros(len(seen))
    for start in range(0, draws, CHUNK):
        count = min(CHUNK, draws - start)
        flipped = np.abs(rng.choice((-1.0, 1.0), size=(count, len(unit))) @ unit)
        above_each += (flipped >= seen - 1e-9).sum(0)
        for name, inside in member.items():
            largest[name][1 + start:1 + start + count] = flipped[:, inside].max(1)
        progress((start + count) / draws, "chance")
    return largest, above_each


def _combine(seen: Float[Array, " M"], member: Mapping[str, Bool[Array, " M"]],
             largest: Mapping[str, Float[Array, " draws"]],
             weights: Mapping[str, float]) -> tuple[Float[Array, " M"], dict[str, float], float]:
    """(p of each test, p of each family alone, p of any): `largest` holds what was observed first, then the draws."""
    ranks, least = _least(largest, weights)
    p_value = np.ones(len(seen))
    for name, values in largest.items():
        alone = (values[None] >= seen[member[name]][:, None] - 1e-9).mean(1) / weights[name]
        p_value[member[name]] = (least[None] <= alone[:, None] + 1e-12).mean(1)
    return p_value, {name: float(rank[0]) for name, rank in ranks.items()}, float((least <= least[0] + 1e-12).mean())


def _least(largest: Mapping[str, Float[Array, " draws"]], weights: Mapping[str, float]
           ) -> tuple[dict[str, Float[Array, " draws"]], Float[Array, " draws"]]:
    """({family: p of each of its largest}, the smallest of these [1 + draws], each over its share of the allowance)."""
    ranks = {name: (values[None] >= values[:, None] - 1e-9).mean(1) for name, values in largest.items()}
    return ranks, np.min([ranks[name] / weights[name] for name in largest], axis=0)


# Derived: home's noise is then twice this session's
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
        """Return its values, or codes, of every shot of home; nan, or -1, where home has none."""
        names = what.names if isinstance(what, Covariate) else (what.name,)
        known = next((self.columns[name] for name in names if name in self.columns), None)
        if isinstance(what, Factor):
            codes = {level: code for code, level in enumerate(what.levels)}
            return np.array([codes.get(text, -1) for text in known]) if known is not None else self._all(-1)
        return self._all(np.nan) if known is None else np.asarray(known, dtype=float)

    def own(self, what: Covariate | Factor | functions.CovariatePair | None) -> Covariate | Factor | None:
        """Return the same as at home; None if it did not vary, and for two together."""
        if isinstance(what, Factor):
            return Factor(what.name, what.levels, self.find(what))
        if not isinstance(what, Covariate) or not functions.varies(self.look.at(what)):
            return None
        return Covariate(((what.name, self.find(what)),))

    def index(self, name: str) -> int | None:
        """Return the place of the tested column; None if there is none."""
        columns = self.fitted.scores.columns[:self.fitted.scores.first_shared]
        return next((k for k, column in enumerate(columns) if column.name == name), None)

    def beside(self, scores: Scores, evidence: ScoreTable, number: int, shapes: Sequence[WeightFunction],
               weights: Float[Array, "n q"]) -> Scores:
        """Return the scores of `shapes` (`weights` [n, q]) on the evidence's column, minus home's, whose signs
        follow."""
        mine = self.fitted.scores
        column = self.index(evidence.columns[number].name)
        rows = len(mine.rows) + len(mine.precision)
        if column is None:
            none = np.zeros((rows, len(shapes)))
            return _joined(scores, Scores(none, none, none + 1.0, scores.kept), np.zeros(len(shapes)))
        there = weights_of(shapes, self.look)
        found = efficient_scores(mine, column, there, np.arange(len(mine.rows)), len(mine.rows))
        said, told = _said(evidence, number, weights), _said(mine, column, there)
        return _joined(scores, found, np.where(said <= MOST * told, said / np.maximum(told, 1e-300), 0.0))

    def among(self, fitted: LauncherFit) -> "ReferenceSession":
        """Return home with the effects of `fitted` fitted there, too."""
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
LAUNCH_SPEED = "launch speed"         # a launcher's column
# How the allowance for false alarms is shared out: a name is worth most, and most of what is left out has one.
ALLOWANCE = {TERMS: 0.6, FREE: 0.3, PATTERN: 0.1}  # chosen: one of twenty terms needs 0.15 deviations more than alone


@dataclass(frozen=True)
class Test:
    """One test: does this column's amplitude vary with these weights [n]? what None: the same in every shot."""

    __test__ = False                  # not one of pytest's

    family: str
    column: int
    what: Covariate | Factor | functions.CovariatePair | None
    shape: str
    weights: Float[Array, " n"]
    form: WeightFunction = SAME_SHAPE                # behind `shape` and `weights`, to lay over another session


@dataclass(frozen=True)
class Asked:
    """All tests with their scores [G, M]."""

    tests: tuple[Test, ...]
    scores: Scores


def ask_everything(evidence: ScoreTable, covariates: Sequence[Covariate], factors: Sequence[Factor], shots: int,
                   home: ReferenceSession | None = None, paired: str = LAUNCH_SPEED) -> Asked:
    """Return all tests that the `shots` of the dataset allow, except along a factor whose groups have random
    effects.

    home: the misfit of that session is subtracted. paired: the column that pairs of covariates are tested on; "": none.
    """
    rows = evidence.rows
    look = Look(len(rows), lambda what: what.codes[rows] if isinstance(what, Factor) else what.values[rows])
    grouped = next((column.name.partition(" ")[0] for column in evidence.columns if column.kind == "group"), "")
    shapes = [SAME_SHAPE, *(shape for one in covariates for shape in functions.number_shapes(one, look)),
              *(shape for one in factors if one.name != grouped for shape in functions.group_shapes(one, look))]
    pairs = functions.pair_shapes(covariates, look) if paired else []
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
    if pairs:
        ask(evidence.index(paired), PATTERN, pairs)
    scores = _join(parts)
    kept = np.flatnonzero(scores.kept)
    return Asked(tuple(tests[k] for k in kept), scores.take(kept))


def name_of(test: Test, column: Column) -> str | None:
    """Return the covariate as reported: what it varies with inside a flight, a column, or nothing."""
    if column.kind == "free" and column.follows:
        return column.follows
    return None if test.what is None else test.what.name


def _join(parts: list[Scores]) -> Scores:
    return Scores(*(np.concatenate([getattr(part, name) for part in parts], axis=-1)
                    for name in ("psi", "kappa", "stretch", "kept")))


# Chosen: a tracker that was moved has changed in several numbers one time in ten
ODDS = 0.1                            # a priori, of one more number that changed, or of another term instead
LEAST = 0.05                          # probability from which a number or term is listed; chosen: one in twenty


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
    """Return whether both sessions have the tracker's numbers, and enough flights."""
    names = _numbers(fitted, home)
    return bool(names) and _clusters(fitted, home) > len(names) + 1


def _clusters(fitted: LauncherFit, home: LauncherFit) -> int:
    return min(len(np.unique(one.scores.together)) for one in (fitted, home))


def rivals_of(fitted: LauncherFit, home: LauncherFit, term: str) -> tuple[NumberChange, ...]:
    """Return the term, and the tracker's numbers that alone explain the difference between the sessions about as well;
    each equally likely a priori. Empty if there are none."""
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
    (value, here), (before, there) = (estimate_by_shots(one.scores, _places(one.scores, names, term))
                                      for one in (fitted, home))
    columns = tuple(fitted.scores.columns[k] for k in _places(fitted.scores, names, term))
    return _Difference(columns, value - before, here + there, np.sqrt(2.0) * np.array([one.usual for one in columns]))


def _places(evidence: ScoreTable, names: Sequence[str], term: str) -> list[int]:
    where = {column.name: k for k, column in enumerate(evidence.columns)}     # of two of one name the shared one
    return [where[name] for name in names] + ([evidence.index(term)] if term else [])
