"""Does anything depend on anything? Efficient scores of the shots, and their largest, judged by flipping signs.

Pure numpy. A test asks whether a channel's amplitude is w_i b with given weights w (a covariate's shape) and b not 0.
Its score is freed of the shared parameters (Neyman's C(alpha): the part that they could explain is projected out),
summed over the shots, and divided by the spread that the shots themselves show. Under the baseline model a shot's part
is as likely to be negative as positive, whatever its variance and however correlated its samples are; so the same
statistic under random signs is its null distribution, and the largest over all tests under the same signs gives the
probability of so large a largest one (the score bootstrap: Kline and Santos 2012; max statistic: Westfall and Young
1993). The spread is of the scores as they are, not of what an effect would leave of them: signs do not change the
former, so that tests that rest on few shots have light tails, and do not raise the bar for all.

A prior of a shared parameter is one more observation of it, which errs like any other, and so has a sign of its own.
Otherwise a test that leans on priors (one supplier's balls against another's, where each ball may differ at random)
would mistake the priors' errors for a finding.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from truearc.sim.infer.likelihood.score_table import Array, ScoreTable
from truearc.sim.printed import Progress

FEWEST_SIGNS = 8.0                    # a test that rests on fewer shots is not made: their signs can hardly say 1 %
LEAST_SHARE = 1e-4                    # of a test's information that must survive the projection
MOST_LEVERAGE = 0.9
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
        """These of the tests."""
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
        """The statistic from which one test of the family is an alarm; infinite where nothing was asked."""
        if family not in self.largest:
            return float("inf")
        allowed = np.quantile(_least(self.largest, self.weights)[1], false_alarm) * self.weights[family]
        return float(np.quantile(self.largest[family], 1.0 - min(allowed, 1.0)))


def efficient_scores(evidence: ScoreTable, channel: int, weights: Float[Array, "n q"], rows: Int[Array, " n"],
                     shots: int) -> Scores:
    """Scores of `weights` (q tests on one channel) in these `rows` of `shots`; those of the p priors follow."""
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
    leverage = drawn / np.maximum(kappa, 1e-300)
    factor: Array = 1.0 / np.sqrt(1.0 - np.clip(leverage, 0.0, MOST_LEVERAGE))
    return factor


def _usable(kappa: Float[Array, "G M"], raw: Float[Array, " M"]) -> Bool[Array, " M"]:
    total = kappa.sum(0)
    effective = total**2 / np.maximum((kappa**2).sum(0), 1e-300)
    usable: Array = (total > LEAST_SHARE * raw) & (raw > 0.0) & (effective >= FEWEST_SIGNS)
    return usable


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
