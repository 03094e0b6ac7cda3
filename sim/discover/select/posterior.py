"""The posterior over the hypotheses for a mismatch: one term, two terms, an unexplained change, or a term and a change.

Each hypothesis has a prior probability and a log evidence. The evidence of the likely single terms comes from true
refits (name_terms). Additions to a likely term use the table linearised at its refit. An unexplained change uses the
table of the fit, averaged over its size and smoothness. True refits replace the values of important pairs and
unexplained changes.

Each hypothesis adds parts to the parameters that all hypotheses share. A part is one column of the table multiplied by
shapes over the shots, with normal priors on their coefficients. A single shape of ones is a term or a constant push;
shapes of a Gaussian process over a covariate are an unexplained change that depends on it.

Scores at the fit overestimate the gain from a large change. A name's evidence therefore comes from a true refit, and so
does that of a competing unexplained change.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import block_diag
from scipy.special import logsumexp, softmax

from truearc.sim.discover.detect.battery import ReferenceSession
from truearc.sim.discover.detect.covariates import Covariate, Factor, varies
from truearc.sim.discover.select import terms
from truearc.sim.infer.fit import Fit, amplitudes, climb
from truearc.sim.infer.launcher import CURVE_POINTS, LauncherFit
from truearc.sim.infer.likelihood.score_table import Array, PlaneScores, ScoreTable, fit_linear
from truearc.sim.infer.model import AnyModel, Carrying, Columns
from truearc.sim.statistics import Z90, invert

# Chosen: a bump in a part of the range, a bend, a slope
LENGTHS = (0.15, 0.4, 1.0)            # of a Gaussian process, as shares of its covariate's range
# Chosen: beyond lies one shot in fifty, which may be a slip
EDGES = (2.0, 98.0)                   # percentiles: the range
# Chosen: a factor of two either way
SIZES = (0.5, 1.0, 2.0)               # of a process, by its column's usual amplitude
JITTER = 1e-6


@dataclass(frozen=True)
class Part:
    """Columns of the evidence [q], often one and the same, times shapes [n, q], whose coefficients have these standard
    deviations [q]."""

    columns: tuple[int, ...]
    shapes: Float[Array, "n q"]
    sd: Float[Array, " q"]

    @staticmethod
    def of(column: int, shapes: Float[Array, "n q"], sd: Float[Array, " q"]) -> "Part":
        """Return the part of one column."""
        return Part((column,) * shapes.shape[1], shapes, sd)


def with_parts(evidence: ScoreTable, parts: Sequence[Part]) -> ScoreTable:
    """Return the table of the parts' coefficients and the shared numbers alone, all shared."""
    first, count = evidence.first_shared, len(evidence.rows)
    rest = np.arange(first, evidence.linear.shape[1])
    own = np.concatenate([*(np.array(part.columns, dtype=int) for part in parts), rest]).astype(int)
    times = np.concatenate([*(part.shapes for part in parts), np.ones((count, len(rest)))], axis=1)
    more = times.shape[1] - len(rest)
    square = times[:, :, None] * times[:, None, :]
    deal = replace(evidence.deal, real=more + evidence.deal.real - first)
    columns = tuple(replace(evidence.columns[k], kind="shared") for k in own[:more].tolist())
    precision = block_diag(*(np.diag(part.sd**-2.0) for part in parts), evidence.precision)
    return ScoreTable(
        evidence.rows, (*columns, *evidence.columns[first:]), deal,
        np.concatenate([np.zeros(more), evidence.point[first:]]), evidence.linear[:, own] * times,
        evidence.bend[:, own][:, :, own] * square, _plane(evidence.plane, own, times), precision,
        np.concatenate([np.zeros(more), evidence.pull]), evidence.log_score, evidence.own_score[:, own] * times,
        evidence.info[:, own][:, :, own] * square)


def _plane(plane: PlaneScores | None, own: Int[Array, " c"], times: Float[Array, "n c"]) -> PlaneScores | None:
    if plane is None:
        return None
    mine = times[plane.rows]
    return replace(plane, by_column=plane.by_column[:, own] * mine, moved_by=plane.moved_by[:, :, own] * mine[:, None],
                   log_spread_by=plane.log_spread_by[:, own] * mine)


def log_evidence(table: ScoreTable) -> tuple[float, Float[Array, " P"], Float[Array, "P P"]]:
    """Return (log evidence in nats of a table whose columns are all shared, up to a constant of the scaffold; the
    likeliest change [P]; its covariance [P, P])."""
    rows = np.ones(len(table.rows), dtype=bool)
    top = fit_linear(table, rows)
    change = np.tile(top, (len(rows), 1))
    value = table.gain(change).sum() + table.pull @ top - 0.5 * top @ table.precision @ top
    info = table.deal.total(table.slopes_at(change)[1]) + table.precision
    volume = np.linalg.slogdet(table.precision)[1] - np.linalg.slogdet(info)[1]
    return float(value + 0.5 * volume), top, invert(info)


def process_shapes(values: Float[Array, " n"], length: float,
                   at: Float[Array, " m"] | None = None) -> Float[Array, "m q"]:
    """Return shapes of a Gaussian process of variance 1 over values in EDGES (0 where unknown), minus their mean; also
    at other values `at`, if given."""
    known = np.isfinite(values)
    low, high = np.percentile(values[known], EDGES)
    knots = np.linspace(0.0, 1.0, CURVE_POINTS)

    def kernel(a: Float[Array, " n"], b: Float[Array, " m"]) -> Float[Array, "n m"]:
        return np.asarray(np.exp(-0.5 * ((a[:, None] - b[None, :]) / length)**2))

    size, turn = np.linalg.eigh(kernel(knots, knots) + JITTER * np.eye(CURVE_POINTS))
    def shapes(x: Float[Array, " n"]) -> Float[Array, "n q"]:
        place = np.clip((x - low) / max(high - low, 1e-12), 0.0, 1.0)
        return np.asarray(kernel(place, knots) @ (turn * size**-0.5)[:, size > 1e-4])      # the others are rounding

    return np.asarray(np.nan_to_num(shapes(values if at is None else at) - shapes(values[known]).mean(0)))


def group_shapes(codes: Int[Array, " n"], levels: int) -> Float[Array, "n q"]:
    """Return one shape per group (-1: none), minus their mean."""
    shapes = (codes[:, None] == np.arange(levels)) * 1.0
    return np.asarray(np.where((codes >= 0)[:, None], shapes - shapes[codes >= 0].mean(0), 0.0))


@dataclass(frozen=True)
class Projected:
    """Score [q] and information [q, q] of a column's shapes, with what the shared numbers explain projected out."""

    score: Float[Array, " q"]
    info: Float[Array, "q q"]

    def nats(self, sd: float) -> float:
        """Return the log evidence of normal coefficients of this deviation against none, in closed form."""
        return _gained(self.score, self.info, sd**2 * np.eye(len(self.score)))

    def nats_since(self, home: "Projected", sd: float) -> float:
        """Return the log evidence of a change of the coefficients since an earlier session, by this deviation.

        The coefficients there, known from its scores and as large a priori as in `nats`, may also be present here.
        """
        covariance = np.linalg.inv(home.info + sd**-2.0 * np.eye(len(self.score)))
        left = self.score - self.info @ covariance @ home.score
        changed = covariance + sd**2 * np.eye(len(self.score))
        return _gained(left, self.info, changed) - _gained(left, self.info, covariance)


def _gained(score: Float[Array, " q"], info: Float[Array, "q q"], covariance: Float[Array, "q q"]) -> float:
    """Log evidence of normal coefficients about 0 against none."""
    inner = np.eye(len(score)) + covariance @ info
    return float(0.5 * score @ np.linalg.solve(inner, covariance @ score) - 0.5 * np.linalg.slogdet(inner)[1])


class Projector:
    """Projects a table's columns; the shared columns' information is inverted once."""

    def __init__(self, evidence: ScoreTable) -> None:
        self._evidence = evidence
        shared = evidence.shared
        self._inner = invert(evidence.information[shared, shared] + evidence.precision)
        self._score = evidence.score[:, shared].sum(0) + evidence.pull

    def of(self, columns: int | Sequence[int], shapes: Float[Array, "n q"]) -> Projected:
        """Project a column times shapes; or several columns, each times one of the shapes."""
        if not isinstance(columns, int):
            return self._several(np.array(columns), shapes)
        evidence, column = self._evidence, columns
        own = evidence.own_score[:, column]
        cross = shapes.T @ evidence.deal.spread(evidence.info[:, column])[:, evidence.shared]
        lift = cross @ self._inner
        info = np.einsum("nq,nr,n->qr", shapes, shapes, evidence.info[:, column, column])
        return Projected(shapes.T @ own - lift @ self._score, info - lift @ cross.T)

    def _several(self, columns: Int[Array, " q"], shapes: Float[Array, "n q"]) -> Projected:
        evidence = self._evidence
        own = evidence.own_score[:, columns] * shapes
        cross = np.stack([shapes[:, k] @ evidence.deal.spread(evidence.info[:, column])[:, evidence.shared]
                          for k, column in enumerate(columns)])
        lift = cross @ self._inner
        info = np.einsum("nq,nr,nqr->qr", shapes, shapes, evidence.info[:, columns][:, :, columns])
        return Projected(own.sum(0) - lift @ self._score, info - lift @ cross.T)


def flown(fitted: LauncherFit, part: Part) -> LauncherFit | None:
    """Return the best fit of a simulation with a part, its log evidence against none (Laplace), uphill from zero; None
    if no simulation of single shots can represent it."""
    carried = fitted.model.carrying(fitted.point, fitted.lost, part)
    if carried is None:
        return None
    top = climb_carried(carried)
    return replace(top, log_evidence=fitted.nats_for(top))


def climb_carried(carried: Carrying[AnyModel]) -> Fit[AnyModel]:
    """Return the best fit of the shared columns with an unexplained change."""
    bare = carried.model.shared_only()
    return max((climb(bare, start) for start in carried.starts), key=lambda found: found.log_posterior)


# Chosen: two effects a third as likely as one, something unexplained in every fourth or fifth case. How often
# probabilities so made are right: docs/measured/sealed.md, python -m benchmarks.proof
SHARES = {"one": 0.55, "varies": 0.03, "two": 0.18, "unexplained": 0.22, "both": 0.05}
LEADERS = 3                           # likeliest terms, beside which a second thing is looked for
# Measured: at a closer limit wheel slip was no leader by half a nat, and a wrong pair won (git show b2405af2)
WITHIN, SHARE = 8.0, 0.2              # nats of the likeliest, or share of its nats, beyond which none is a leader
# Bounds the work
SECONDS, FAMILIES = 10, 4             # of one step, beside a leader or alone, that are climbed to their top
# Bounds the work; chosen: the guesses that were seen
PAIRS, GUESS = 4, 0.04                # refitted; share of its nats by which a pair's guess may be too low
# Bounds the work
FLOWN, MINOR = 4, 0.05                # unexplained changes that are flown, and the probability from which one is
BALLS = "ball_id"                     # balls differ; sessions may differ by chance alone
Shapes = tuple[Float[Array, "n _"], Float[Array, "m _"] | None]     # here, and the same at home
Sizes = tuple[terms.Size, ...]
Guesses = dict[frozenset[str], tuple[float, tuple[str, str], Sizes]]     # pair -> nats, names, their sizes
Bases = dict[tuple[str, ...], tuple[LauncherFit, float]]     # names -> fit with these, and its nats


@dataclass(frozen=True)
class Family:
    """An unexplained change of one column, along a covariate or the same in all shots; `part`: at its likeliest size
    and length; spread: nats of the average over these, less that one's without regard to home."""

    column: str
    what: Covariate | Factor | None
    part: Part
    nats: float
    spread: float


@dataclass(frozen=True)
class Hypothesis:
    """Terms by their column names, each with its size if they are what is missing, and an unexplained change or None.
    """

    names: tuple[str, ...]
    family: Family | None
    nats: float
    log_prior: float
    sizes: Sizes = ()


@dataclass(frozen=True)
class Hypotheses:
    """Hypotheses with their probabilities [h], which sum to 1."""

    hypotheses: tuple[Hypothesis, ...]
    probability: Float[Array, " h"]
    pairs: dict[tuple[str, ...], LauncherFit]

    def unexplained(self) -> float:
        """Probability of an unexplained change, alone or beside a term."""
        return self.share("unexplained") + self.share("both")

    def inclusion(self, beside: bool = False) -> dict[str, float]:
        """Return the probability of each name among what is missing, likeliest first.

        Only hypotheses without an unexplained change count or, with `beside`, also those with one.
        """
        found: dict[str, float] = {}
        for one, p in zip(self.hypotheses, self.probability, strict=True):
            for name in one.names if beside or kind_of(one) != "both" else ():
                found[name] = found.get(name, 0.0) + float(p)
        return dict(sorted(found.items(), key=lambda item: -item[1]))

    def sizes(self) -> dict[str, Sizes]:
        """Return the sizes that each name has, as likely as the hypotheses are given that it is there."""
        found: dict[str, dict[terms.Size, float]] = {}
        for one in self.hypotheses:
            for name, size in zip(one.names, one.sizes, strict=True):
                of_name = found.setdefault(name, {})
                of_name[size] = float(np.logaddexp(of_name.get(size, -np.inf), one.nats + one.log_prior))
        return {name: tuple(size._replace(probability=p) for size, p in zip(
            sizes, softmax(list(sizes.values())).tolist(), strict=True)) for name, sizes in found.items()}

    def held_by(self, names: Collection[str], beside: bool = False) -> float:
        """Return the probability that one of these is among what is missing; `beside` as above."""
        return float(sum(p for one, p in zip(self.hypotheses, self.probability, strict=True)
                         if (beside or kind_of(one) != "both") and any(name in names for name in one.names)))

    def likeliest_pair(self) -> LauncherFit | None:
        """The likeliest of the pairs that were refitted."""
        pairs = {one.names: p for one, p in zip(self.hypotheses, self.probability, strict=True)
                 if one.names in self.pairs and one.family is None}
        return self.pairs[max(pairs, key=lambda names: pairs[names])] if pairs else None

    def likeliest_change(self, beside: str = "") -> Hypothesis | None:
        """The likeliest unexplained change, alone or beside a term; or only beside that one."""
        able = {k: float(self.probability[k]) for k, one in enumerate(self.hypotheses)
                if kind_of(one) in ("unexplained", "both") and (not beside or one.names == (beside,))}
        return self.hypotheses[max(able, key=lambda k: able[k])] if able else None

    def share(self, kind: str) -> float:
        """Return the share of the hypotheses of one kind of SHARES."""
        return float(sum(p for one, p in zip(self.hypotheses, self.probability, strict=True) if kind_of(one) == kind))


def kind_of(one: Hypothesis) -> str:
    """Return the kind of SHARES; "varies": the size of the term itself differs from ball to ball."""
    if one.family is None:
        return "one" if len(one.names) == 1 else "two"
    return "unexplained" if not one.names else "varies" if one.family.column in one.names else "both"


def weigh(fitted: LauncherFit, naming: terms.Naming, covariates: Sequence[Covariate], factors: Sequence[Factor],
          home: ReferenceSession | None = None) -> Hypotheses:
    """Compute the posterior over what is missing in `fitted`, whose single terms `naming` has ranked; or over what has
    changed since `home`, whose own misfit an unexplained change must exceed."""
    visible = [c for c in naming.candidates if c.visible]
    usual = {one.name: fitted.scores.columns[one.column].usual for one in visible}
    alone = {name: naming.alone(fitted, name) for name, nats in naming.nats.items() if nats > terms.NEVER}
    singles = {name: naming.nats[name] + (terms.nats_in_range(fitted, name, *size[:2], usual[name])
                                          if name in naming.refits else 0.0) for name, size in alone.items()}
    top = max(singles.values(), default=0.0)
    single_prior = np.log(SHARES["one"] / len(visible))
    found = [Hypothesis((name,), None, nats, single_prior, (alone[name],)) for name, nats in singles.items()]
    families = families_of(fitted.scores, covariates, factors, home)
    count = max(len(families), 1)
    bases: Bases = {(): (fitted, 0.0)}
    null = log_evidence(fitted.scores.shared_only())[0]
    found += [Hypothesis((), one, one.nats, np.log(SHARES["unexplained"] / count))
              for one, _ in _climbed(fitted, families, null)]
    pair_prior = np.log(SHARES["two"] / max(0.5 * len(visible) * (len(visible) - 1), 1.0))
    both_prior = np.log(SHARES["both"] / (count * len(visible)))
    leaders = [name for name in sorted(naming.refits, key=lambda name: -singles.get(name, terms.NEVER))[:LEADERS]
               if singles.get(name, terms.NEVER) > top - max(WITHIN, SHARE * top)]
    guesses = _at_once(fitted, visible, null)
    for first in leaders:
        base = fitted.beside(naming.refits[first])
        bases[(first,)] = base, singles[first]
        floor = log_evidence(base.scores.shared_only())[0]
        for second in sorted((c for c in terms.one_step(base.scores)[0] if c.visible), key=lambda c: -c.nats)[:SECONDS]:
            own = base.scores.columns[second.column]
            part = Part.of(second.column, np.ones((len(base.scores.rows), 1)), np.array([own.usual]))
            value, sizes = _sized(base, (first,), [part])
            known = nats_known(fitted, second.name, *sizes[0][:2], own.usual)
            nats = singles[first] + value - floor + known
            both = frozenset((first, second.name))
            if nats > guesses.get(both, (-np.inf,))[0]:
                guesses[both] = nats, (first, second.name), (sizes[1], _told(fitted, second.name, sizes[0]))
        own_factors = [(one, many) for one, many in _factors_of(base.scores, factors) if one.name == BALLS]
        varied = [_family(Projector(base.scores), base.scores.index(first), first, usual[first], one, many)
                  for one, many in own_factors]
        varies_prior = np.log(SHARES["varies"] / (len(visible) * max(len(own_factors), 1)))
        for prior, many in ((varies_prior, varied), (both_prior, families_of(base.scores, covariates, factors, home))):
            found += [Hypothesis((first,), one, singles[first] + one.nats, prior, sizes or (alone[first],))
                      for one, sizes in _climbed(base, many, floor, (first,))]
    pairs = _refitted(fitted, guesses, top + single_prior - pair_prior - WITHIN)
    found += [Hypothesis(names, None, nats, pair_prior, sizes) for key, (nats, names, sizes) in guesses.items()
              if key not in pairs]
    found += [Hypothesis(one.names, None, nats, pair_prior, terms.sizes_of(one)) for one, nats in pairs.values()]
    direction = {name: column.direction for column in fitted.scores.columns for name in (column.name, column.curve)}

    def told(one: Hypothesis) -> Hypothesis:
        """The sizes there. Where nature has none such, or an unexplained change in a name's own direction moves its
        size out of its 90 % interval, two share one effect in parts that nobody knows: only those of the whole say
        something."""
        wholes = [alone.get(name, size) for name, size in zip(one.names, one.sizes, strict=True)]
        is_shared = one.names and one.family is not None and one.family.column not in one.names and (
            direction[one.family.column] == direction[one.names[0]]
            and abs(one.sizes[0].amplitude - wholes[0].amplitude) > Z90 * wholes[0].sd)
        natural = all(terms.is_natural(fitted, name, size)
                      for name, size in zip(one.names, one.sizes, strict=True))
        return replace(one, sizes=tuple(wholes)) if is_shared or not natural else one

    found = list(map(told, _flown(found, bases)))
    return Hypotheses(tuple(found), _probability(found), {one.names: one for one, _ in pairs.values()})


def _probability(found: Sequence[Hypothesis]) -> Float[Array, " h"]:
    weight = np.array([one.nats + one.log_prior for one in found])
    return np.asarray(np.exp(weight - logsumexp(weight)))


def _flown(found: Sequence[Hypothesis], bases: Bases) -> list[Hypothesis]:
    """The hypotheses, unexplained changes that matter truly flown, and the others beside the same names worth the share
    of their nats that the flown ones are."""
    table, found = list(found), list(found)
    true: dict[int, float] = {}       # number of a hypothesis -> share of its nats on the table that is left once flown
    for _ in range(FLOWN):
        probability = _probability(found)
        able = [k for k, one in enumerate(table) if kind_of(one) in ("unexplained", "both") and k not in true]
        k = max(able, key=lambda number: float(probability[number]), default=None)
        if k is None or probability[k] < MINOR:
            break
        one, (base, floor) = table[k], bases[table[k].names]
        assert one.family is not None
        top, guessed = flown(base, one.family.part), one.nats - floor - one.family.spread
        if top is None or guessed <= 0.0:
            true[k] = 1.0
            continue
        true[k] = top.log_evidence / guessed
        found[k] = replace(one, nats=floor + top.log_evidence + one.family.spread, sizes=_sizes(
            top.model.layout, one.names, top.scores.point, top.scores.covariance))
        share = float(np.clip(np.mean([true[n] for n in true if table[n].names == one.names]), 0.0, 1.0))
        for n in able:
            if n != k and table[n].names == one.names and table[n].nats > floor:
                found[n] = replace(table[n], nats=floor + share * (table[n].nats - floor))
    return found


def _at_once(fitted: LauncherFit, visible: Sequence[terms.Candidate], null: float) -> Guesses:
    """The SECONDS likeliest of all pairs by closed form, on the table of the fit; neither name need be likely alone."""
    evidence = fitted.scores
    columns = np.array([one.column for one in visible], dtype=int)
    usual = np.array([evidence.columns[k].usual for k in columns])
    score, info = terms.efficient(evidence, columns)
    score, info = score * usual, info * np.outer(usual, usual)
    first, second = np.triu_indices(len(columns), 1)
    own = 1.0 + np.diag(info)
    det = own[first] * own[second] - info[first, second]**2
    fits = (own[second] * score[first]**2 + own[first] * score[second]**2
            - 2.0 * info[first, second] * score[first] * score[second]) / det
    found: Guesses = {}
    ones = np.ones((len(evidence.rows), 1))
    for k in np.argsort(-(fits - np.log(det)))[:SECONDS].tolist():
        pair = (first[k], second[k])
        names = evidence.columns[columns[pair[0]]].name, evidence.columns[columns[pair[1]]].name
        value, sizes = _sized(fitted, (), [Part.of(int(columns[one]), ones, usual[[one]]) for one in pair])
        nats = value - null + sum(nats_known(fitted, name, *size[:2], float(usual[k]))
                                  for k, name, size in zip(pair, names, sizes, strict=True))
        found[frozenset(names)] = nats, names, tuple(map(partial(_told, fitted), names, sizes))
    return found


def _refitted(fitted: LauncherFit, guesses: Guesses, least: float) -> dict[frozenset[str], tuple[LauncherFit, float]]:
    """{names: (refit, nats)} of pairs, the likeliest first, until no guess may be as likely as one that is refitted."""
    usual = {column.name: column.usual for column in fitted.scores.columns[:fitted.scores.first_shared]}
    left = sorted(guesses.values(), reverse=True)
    found: dict[frozenset[str], tuple[LauncherFit, float]] = {}
    while left and len(found) < PAIRS:
        best = max([least, *(nats for _, nats in found.values())])
        if left[0][0] <= best - GUESS * abs(best):
            break
        _, names, sizes = left.pop(0)
        one, nats = fitted.with_terms(names, np.array([size.amplitude for size in sizes])), terms.NEVER
        if terms.is_possible(one, *(usual[name] for name in one.names)):
            nats = one.log_evidence + sum(
                terms.nats_in_range(fitted, name, float(a), float(sd), usual[name])
                + terms.nats_measured(fitted.model.layout.measured, name, 0.0, usual[name])     # the rest is a prior
                for name, a, sd in zip(one.names, one.amplitude, one.sd, strict=True))
        found[frozenset(names)] = one, nats
    return found


def nats_known(fitted: LauncherFit, name: str, amplitude: float, sd: float, usual: float) -> float:
    """Return nats for an amplitude from other knowledge than the shots: its range, and its measurement."""
    return (terms.nats_in_range(fitted, name, amplitude, sd, usual)
            + terms.nats_measured(fitted.model.layout.measured, name, amplitude, sd))


def families_of(evidence: ScoreTable, covariates: Sequence[Covariate], factors: Sequence[Factor],
                home: ReferenceSession | None = None) -> list[Family]:
    """Return every unexplained change that the table can show, in closed form; likeliest first."""
    rows, projector, ones = evidence.rows, Projector(evidence), np.ones((len(evidence.rows), 1))
    earlier = None if home is None else Projector(home.fitted.scores)
    shapes: list[tuple[Covariate | Factor, list[Shapes]]] = [
        (one, _processes(one, rows, home)) for one in covariates if varies(one.values[rows])]
    shapes += _factors_of(evidence, factors)
    constant: list[Shapes] = [(ones, None if home is None else np.ones((len(home.fitted.scores.rows), 1)))]
    found = []
    for number, column in enumerate(evidence.columns[:evidence.first_shared]):
        if column.kind != "free" or column.curve:
            continue
        there = None if earlier is None or home is None or (own := home.index(column.name)) is None else (earlier, own)
        if column.name.startswith("push") or column.follows:
            found.append(_family(projector, number, column.name, column.usual, None, constant, there))
        if not column.follows:
            found += [_family(projector, number, column.name, column.usual, what, many, there) for what, many in shapes]
    curves: dict[str, list[int]] = {}
    for number, column in enumerate(evidence.columns[:evidence.first_shared]):
        if column.curve:
            curves.setdefault(column.curve, []).append(number)
    for name, numbers in curves.items():
        many = np.ones((len(rows), len(numbers)))
        found.append(_family(projector, tuple(numbers), name, evidence.columns[numbers[0]].usual, None, [(many, None)]))
    return sorted(found, key=lambda one: -one.nats)


def _processes(one: Covariate, rows: Int[Array, " n"], home: ReferenceSession | None) -> list[Shapes]:
    """Shapes over a covariate for each length, and at the shots of home where it varied there."""
    own = None if home is None else home.own(one)
    values = one.values[rows]
    if home is None or not isinstance(own, Covariate):
        return [(process_shapes(values, length), None) for length in LENGTHS]
    there = own.values[home.fitted.scores.rows]
    return [(process_shapes(values, length), process_shapes(values, length, there)) for length in LENGTHS]


def _factors_of(evidence: ScoreTable, factors: Sequence[Factor]) -> list[tuple[Factor, list[Shapes]]]:
    """Factors that differ among the shots and have no random effects, with their shapes."""
    grouped = next((column.name.partition(" ")[0] for column in evidence.columns if column.kind == "group"), "")
    return [(one, [(group_shapes(one.codes[evidence.rows], len(one.levels)), None)]) for one in factors
            if one.name != grouped and len(set(one.codes[evidence.rows].tolist())) > 1]


def _family(projector: Projector, number: int | tuple[int, ...], name: str, usual: float,
            what: Covariate | Factor | None, shapes: Sequence[Shapes],
            there: tuple[Projector, int] | None = None) -> Family:
    """there: of home, and the number of the column there."""
    each = []
    for one, at_home in shapes:
        projected = projector.of(number, one)
        earlier = None if there is None or at_home is None else there[0].of(there[1], at_home)
        for size in SIZES:
            sd = size * usual
            nats = projected.nats(sd) if earlier is None else projected.nats_since(earlier, sd)
            each.append((nats, projected.nats(sd), one, sd))
    values = np.array([nats for nats, *_ in each])
    mean = float(logsumexp(values) - np.log(len(values)))
    _, alone, best_shapes, sd = each[int(values.argmax())]
    columns = (number,) * best_shapes.shape[1] if isinstance(number, int) else number
    return Family(name, what, Part(columns, best_shapes, np.full(best_shapes.shape[1], sd)), mean, mean - alone)


def _climbed(base: LauncherFit, families: Sequence[Family], null: float,
             names: tuple[str, ...] = ()) -> list[tuple[Family, Sizes]]:
    """The families, the likeliest climbed to their top, with the sizes of these names there."""
    found: list[tuple[Family, Sizes]] = [(one, ()) for one in families[FAMILIES:]]
    for one in families[:FAMILIES]:
        value, sizes = _sized(base, names, [one.part])
        found.append((replace(one, nats=value - null + one.spread), sizes[len(sizes) - len(names):]))
    return found


def _sized(base: LauncherFit, names: tuple[str, ...], parts: Sequence[Part]) -> tuple[float, Sizes]:
    """(log evidence of parts beside a fit; their coefficients, then the amplitudes of shared columns)."""
    table = with_parts(base.scores, parts)
    value, change, covariance = log_evidence(table)
    own = len(change) - len(base.model.layout.precision)
    sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return value, (*map(terms.Size, change[:own].tolist(), sd[:own].tolist()), *_sizes(
        base.model.layout, names, (table.point + change)[own:], covariance[own:, own:]))


def _sizes(layout: Columns, names: tuple[str, ...], point: Float[Array, " p"],
           covariance: Float[Array, "p p"]) -> Sizes:
    return tuple(map(terms.Size, *(one.tolist() for one in amplitudes(layout, names, point, covariance))))


def _told(fitted: LauncherFit, name: str, size: terms.Size) -> terms.Size:
    """The size after its measurement without shots, if there is one."""
    value, sd = fitted.model.layout.measured.get(name, (0.0, np.inf))
    share = size.sd**2 / (size.sd**2 + sd**2)
    return terms.Size(size.amplitude + share * (value - size.amplitude), size.sd * (1.0 - share)**0.5)
