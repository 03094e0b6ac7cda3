"""Hypotheses over what a simulation leaves out: one term, two, an unexplained change, or a term beside one.

Each hypothesis has a share of the prior and a log evidence: of single terms by true refits of the likely (name_terms),
of what stands beside a likely term on the table linearised at that term's refit, of an unexplained change on the
table of the fit, its size and smoothness averaged over. Of pairs and of unexplained changes that matter, true refits
replace these.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int
from scipy.special import logsumexp

from truearc.sim.discover.detect.covariates import Covariate, Factor, varies
from truearc.sim.discover.detect.reference_session import ReferenceSession
from truearc.sim.discover.select.amplitude_prior import nats_in_range, nats_known
from truearc.sim.discover.select.flown_curves import nats_flown
from truearc.sim.discover.select.hypotheses import (
    LENGTHS,
    SIZES,
    Part,
    Projector,
    group_shapes,
    log_evidence,
    process_shapes,
    with_parts,
)
from truearc.sim.discover.select.refit import Refit, promote, refit
from truearc.sim.discover.select.term_ranking import NEVER, Candidate, Naming, efficient, is_possible, one_step
from truearc.sim.infer.fit import BaselineFit
from truearc.sim.infer.likelihood.layout import nats_measured
from truearc.sim.infer.likelihood.score_table import Array, ScoreTable, without

SHARES = {"one": 0.55, "varies": 0.03, "two": 0.18, "unexplained": 0.22, "both": 0.05}
LEADERS = 3                           # likeliest terms, beside which a second thing is looked for
WITHIN, SHARE = 8.0, 0.2              # nats of the likeliest, or share of its nats, beyond which none is a leader
SECONDS, FAMILIES = 10, 4             # of one step, beside a leader or alone, that are climbed to their top
PAIRS, GUESS = 4, 0.04                # refitted; share of its nats by which a pair's guess may be too low
FLOWN, MINOR = 4, 0.05                # unexplained changes that are flown, and the probability from which one is
BALLS = "ball_id"                     # balls differ; sessions may differ by chance alone
Shapes = tuple[Float[Array, "n _"], Float[Array, "m _"] | None]     # here, and the same at home
Guesses = dict[frozenset[str], tuple[float, tuple[str, str], tuple[float, float]]]   # pair -> nats, names, amplitudes
Bases = dict[tuple[str, ...], tuple[BaselineFit, float]]     # names -> fit with these, and its nats


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
    """Terms by the names of their columns, and an unexplained change or None."""

    names: tuple[str, ...]
    family: Family | None
    nats: float
    log_prior: float


@dataclass(frozen=True)
class Hypotheses:
    """Hypotheses with their probabilities [h], which sum to 1."""

    hypotheses: tuple[Hypothesis, ...]
    probability: Float[Array, " h"]
    pairs: dict[tuple[str, str], Refit]

    def unexplained(self) -> float:
        """Of an unexplained change, alone or beside a term."""
        return self.share("unexplained") + self.share("both")

    def inclusion(self, beside: bool = False) -> dict[str, float]:
        """Of each name among what is missing, with nothing unexplained or even `beside` that; likeliest first."""
        found: dict[str, float] = {}
        for one, p in zip(self.hypotheses, self.probability, strict=True):
            for name in one.names if beside or kind_of(one) != "both" else ():
                found[name] = found.get(name, 0.0) + float(p)
        return dict(sorted(found.items(), key=lambda item: -item[1]))

    def held_by(self, names: Collection[str], beside: bool = False) -> float:
        """Probability that one of these is among what is missing; `beside` as above."""
        return float(sum(p for one, p in zip(self.hypotheses, self.probability, strict=True)
                         if (beside or kind_of(one) != "both") and any(name in names for name in one.names)))

    def likeliest_pair(self) -> Refit | None:
        """Of those that were refitted."""
        pairs = {one.names: p for one, p in zip(self.hypotheses, self.probability, strict=True)
                 if one.names in self.pairs and one.family is None}
        return self.pairs[max(pairs, key=lambda names: pairs[names])] if pairs else None

    def likeliest_change(self, beside: str = "") -> Hypothesis | None:
        """The likeliest unexplained change, alone or beside a term; or only beside that one."""
        able = {k: float(self.probability[k]) for k, one in enumerate(self.hypotheses)
                if kind_of(one) in ("unexplained", "both") and (not beside or one.names == (beside,))}
        return self.hypotheses[max(able, key=lambda k: able[k])] if able else None

    def share(self, kind: str) -> float:
        """Of the hypotheses of one kind of SHARES."""
        return float(sum(p for one, p in zip(self.hypotheses, self.probability, strict=True) if kind_of(one) == kind))


def kind_of(one: Hypothesis) -> str:
    """Of SHARES; "varies": the size of the term itself differs from ball to ball."""
    if one.family is None:
        return "one" if len(one.names) == 1 else "two"
    return "unexplained" if not one.names else "varies" if one.family.column in one.names else "both"


def weigh(fitted: BaselineFit, naming: Naming, covariates: Sequence[Covariate], factors: Sequence[Factor],
          home: ReferenceSession | None = None) -> Hypotheses:
    """The posterior over what is missing in `fitted`, whose single terms `naming` has ranked; or over what has changed
    since `home`, whose own misfit an unexplained change must exceed."""
    visible = [c for c in naming.candidates if c.visible]
    singles = {name: nats + range_nats(fitted, naming, name) for name, nats in naming.nats.items() if nats > NEVER}
    top = max(singles.values(), default=0.0)
    single_prior = np.log(SHARES["one"] / len(visible))
    found = [Hypothesis((name,), None, nats, single_prior) for name, nats in singles.items()]
    families = families_of(fitted.evidence, covariates, factors, home)
    count = max(len(families), 1)
    bases: Bases = {(): (fitted, 0.0)}
    null = log_evidence(without(fitted.evidence))[0]
    found += [Hypothesis((), one, nats, np.log(SHARES["unexplained"] / count))
              for one, nats in _climbed(fitted.evidence, families, null)]
    pair_prior = np.log(SHARES["two"] / max(0.5 * len(visible) * (len(visible) - 1), 1.0))
    both_prior = np.log(SHARES["both"] / (count * len(visible)))
    leaders = [name for name in sorted(naming.refits, key=lambda name: -singles.get(name, NEVER))[:LEADERS]
               if singles.get(name, NEVER) > top - max(WITHIN, SHARE * top)]
    guesses = _at_once(fitted, visible, null)
    usual = {one.name: fitted.evidence.columns[one.column].usual for one in visible}
    for first in leaders:
        base = promote(fitted, naming.refits[first])
        bases[(first,)] = base, singles[first]
        floor = log_evidence(without(base.evidence))[0]
        for second in sorted((c for c in one_step(base.evidence)[0] if c.visible), key=lambda c: -c.nats)[:SECONDS]:
            own = base.evidence.columns[second.column]
            part = Part(second.column, np.ones((len(base.evidence.rows), 1)), np.array([own.usual]))
            value, change, sd = log_evidence(with_parts(base.evidence, [part]))
            known = nats_known(fitted, second.name, float(change[0]), float(sd[0]), own.usual)
            nats = singles[first] + value - floor + known
            both = frozenset((first, second.name))
            if nats > guesses.get(both, (-np.inf,))[0]:
                guesses[both] = nats, (first, second.name), (float(naming.refits[first].amplitude[0]),
                                                             float(change[0]))
        own_factors = [(one, many) for one, many in _factors_of(base.evidence, factors) if one.name == BALLS]
        varied = [_family(Projector(base.evidence), base.evidence.index(first), first, usual[first], one, many)
                  for one, many in own_factors]
        varies_prior = np.log(SHARES["varies"] / (len(visible) * max(len(own_factors), 1)))
        found += [Hypothesis((first,), one, singles[first] + nats, varies_prior)
                  for one, nats in _climbed(base.evidence, varied, floor)]
        beside = families_of(base.evidence, covariates, factors, home)
        found += [Hypothesis((first,), one, singles[first] + nats, both_prior)
                  for one, nats in _climbed(base.evidence, beside, floor)]
    pairs = _refitted(fitted, guesses, top + single_prior - pair_prior - WITHIN)
    found += [Hypothesis(names, None, pairs[names][1] if names in pairs else nats, pair_prior)
              for nats, names, _ in guesses.values()]
    found = _flown(found, bases)
    return Hypotheses(tuple(found), _probability(found), {names: one for names, (one, _) in pairs.items()})


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
        flown = nats_flown(base, one.family.part)
        guessed = one.nats - floor - one.family.spread
        if flown is None or guessed <= 0.0:
            true[k] = 1.0
            continue
        true[k] = flown / guessed
        found[k] = replace(one, nats=floor + flown + one.family.spread)
        share = float(np.clip(np.mean([true[n] for n in true if table[n].names == one.names]), 0.0, 1.0))
        for n in able:
            if n != k and table[n].names == one.names and table[n].nats > floor:
                found[n] = replace(table[n], nats=floor + share * (table[n].nats - floor))
    return found


def _at_once(fitted: BaselineFit, visible: Sequence[Candidate], null: float) -> Guesses:
    """The SECONDS likeliest of all pairs by closed form, on the table of the fit; neither name need be likely alone."""
    evidence = fitted.evidence
    columns = np.array([one.column for one in visible], dtype=int)
    usual = np.array([evidence.columns[k].usual for k in columns])
    score, info = efficient(evidence, columns)
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
        table = with_parts(evidence, [Part(int(columns[one]), ones, usual[[one]]) for one in pair])
        value, change, sd = log_evidence(table)
        nats = value - null + sum(nats_known(fitted, name, float(change[n]), float(sd[n]), float(usual[pair[n]]))
                                  for n, name in enumerate(names))
        found[frozenset(names)] = nats, names, (float(change[0]), float(change[1]))
    return found


def _refitted(fitted: BaselineFit, guesses: Guesses, least: float) -> dict[tuple[str, str], tuple[Refit, float]]:
    """{names: (refit, nats)} of pairs, the likeliest first, until no guess may be as likely as one that is refitted."""
    usual = {column.name: column.usual for column in fitted.evidence.columns[:fitted.evidence.first_shared]}
    left = sorted(guesses.values(), reverse=True)
    found: dict[tuple[str, str], tuple[Refit, float]] = {}
    while left and len(found) < PAIRS:
        best = max([least, *(nats for _, nats in found.values())])
        if left[0][0] <= best - GUESS * abs(best):
            break
        _, names, start = left.pop(0)
        one, nats = refit(fitted, names, np.array(start)), NEVER
        if is_possible(one, *(usual[name] for name in one.names)):
            nats = one.log_evidence + sum(
                nats_in_range(fitted, name, float(a), float(sd), usual[name])
                + nats_measured(fitted.layout.measured, name, 0.0, usual[name])      # the rest is in the refit's prior
                for name, a, sd in zip(one.names, one.amplitude, one.sd, strict=True))
        found[names] = one, nats
    return found


def range_nats(fitted: BaselineFit, naming: Naming, name: str) -> float:
    """For the prior of a refitted name's amplitude being cut where the parameter's range ends."""
    found = naming.refits.get(name)
    if found is None:
        return 0.0
    usual = fitted.evidence.columns[fitted.evidence.index(name)].usual
    return nats_in_range(fitted, name, float(found.amplitude[0]), float(found.sd[0]), usual)


def families_of(evidence: ScoreTable, covariates: Sequence[Covariate], factors: Sequence[Factor],
                home: ReferenceSession | None = None) -> list[Family]:
    """Every unexplained change that the table can show, by closed form; likeliest first."""
    rows, projector, ones = evidence.rows, Projector(evidence), np.ones((len(evidence.rows), 1))
    earlier = None if home is None else Projector(home.fitted.evidence)
    shapes: list[tuple[Covariate | Factor, list[Shapes]]] = [
        (one, _processes(one, rows, home)) for one in covariates if varies(one.values[rows])]
    shapes += _factors_of(evidence, factors)
    constant: list[Shapes] = [(ones, None if home is None else np.ones((len(home.fitted.evidence.rows), 1)))]
    found = []
    for number, column in enumerate(evidence.columns[:evidence.first_shared]):
        if column.kind != "free":
            continue
        there = None if earlier is None or home is None or (own := home.index(column.name)) is None else (earlier, own)
        if column.name.startswith("push") or column.follows:
            found.append(_family(projector, number, column.name, column.usual, None, constant, there))
        if not column.follows:
            found += [_family(projector, number, column.name, column.usual, what, many, there) for what, many in shapes]
    return sorted(found, key=lambda one: -one.nats)


def _processes(one: Covariate, rows: Int[Array, " n"], home: ReferenceSession | None) -> list[Shapes]:
    """Shapes over a covariate for each length, and at the shots of home where it varied there."""
    own = None if home is None else home.own(one)
    values = one.values[rows]
    if home is None or not isinstance(own, Covariate):
        return [(process_shapes(values, length), None) for length in LENGTHS]
    there = own.values[home.fitted.evidence.rows]
    return [(process_shapes(values, length), process_shapes(values, length, there)) for length in LENGTHS]


def _factors_of(evidence: ScoreTable, factors: Sequence[Factor]) -> list[tuple[Factor, list[Shapes]]]:
    """Factors that differ among the shots and have no random effects, with their shapes."""
    grouped = next((column.name.partition(" ")[0] for column in evidence.columns if column.kind == "group"), "")
    return [(one, [(group_shapes(one.codes[evidence.rows], len(one.levels)), None)]) for one in factors
            if one.name != grouped and len(set(one.codes[evidence.rows].tolist())) > 1]


def _family(projector: Projector, number: int, name: str, usual: float, what: Covariate | Factor | None,
            shapes: Sequence[Shapes], there: tuple[Projector, int] | None = None) -> Family:
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
    return Family(name, what, Part(number, best_shapes, np.full(best_shapes.shape[1], sd)), mean, mean - alone)


def _climbed(evidence: ScoreTable, families: Sequence[Family], null: float) -> list[tuple[Family, float]]:
    """The families with their nats, the likeliest climbed to their top."""
    found = [(one, one.nats) for one in families[FAMILIES:]]
    for one in families[:FAMILIES]:
        nats = log_evidence(with_parts(evidence, [one.part]))[0] - null + one.spread
        found.append((replace(one, nats=nats), nats))
    return found
