"""Does anything depend on anything? Efficient scores, clustered, and their largest, judged by flipping signs.

Pure numpy. A test asks whether a channel's amplitude is w_i b with given weights w (a covariate's shape) and b not 0.
Its score is freed of the shared parameters (Neyman's C(alpha): what they could explain is projected out), summed over
shots of one cluster, and divided by the spread that the clusters themselves show once b is fitted. Under the believed
simulation a cluster's sum is as likely to be negative as positive, whatever its variance and however the samples
inside it hang together; so the same statistic under random signs is its null distribution, and the largest over all
tests under the same signs gives the probability of so large a largest one (the wild cluster bootstrap-t with the null
imposed: Cameron, Gelbach and Miller 2008; max statistic: Westfall and Young 1993).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sim.discover.evidence import Array, Evidence, shared_columns

Progress = Callable[[float, str], None]
FEWEST_CLUSTERS = 8.0                 # a test that rests on fewer is not made: their signs can hardly say 1 %
LEAST_SHARE = 1e-4                    # of a test's information that must survive the projection
MOST_LEVERAGE = 0.9
CHUNK = 250                           # sign patterns at once


@dataclass(frozen=True)
class Scores:
    """M tests over G clusters: `psi` [G, M] efficient scores, `kappa` [G, M] their information; `kept` [M] usable.

    `stretch` [G, M]: fitting the shared parameters draws each cluster's score towards zero; times this it has the
    spread that it had before.
    """

    psi: Array
    kappa: Array
    stretch: Array
    kept: Array


@dataclass(frozen=True)
class Flips:
    """`statistic` [M] studentised |score|; `p_each` [M] one test alone; `p_family` [M] as the largest of all."""

    statistic: Array
    amplitude: Array                  # [M] one-step estimate of b
    gain: Array                       # [M] log-likelihood explained by it
    p_each: Array
    p_family: Array


def efficient_scores(evidence: Evidence, channel: int, weights: Array, cluster: Array, clusters: int) -> Scores:
    """Scores of `weights` [n, q] (q tests on one channel), summed over `cluster` [n] (numbers below `clusters`)."""
    shared = shared_columns(evidence)
    u, s = evidence.score[:, channel], evidence.score[:, shared]
    k_cc, k_ct = evidence.info[:, channel, channel], evidence.info[:, channel, shared]
    k_tt = evidence.info[:, shared, shared]
    total = k_tt.sum(0) + np.diag(evidence.precision)
    project = np.linalg.solve(total, (weights.T @ k_ct).T).T if len(total) else np.zeros((weights.shape[1], 0))
    psi = weights * u[:, None] - s @ project.T
    raw = weights**2 * k_cc[:, None]
    kappa = raw - 2.0 * weights * (k_ct @ project.T) + np.einsum("qa,nab,qb->nq", project, k_tt, project)
    common = weights[:, :, None] * k_ct[:, None] - np.einsum("qa,nab->nqb", project, k_tt)
    psi, kappa, common = (_sum_over(cluster, clusters, part) for part in (psi, kappa, common))
    return Scores(psi, kappa, _stretch(kappa, common, total), _usable(kappa, raw.sum(0)))


def _sum_over(cluster: Array, clusters: int, rows: Array) -> Array:
    summed = np.zeros((clusters, *rows.shape[1:]))
    np.add.at(summed, cluster, rows)
    return summed


def _stretch(kappa: Array, common: Array, total: Array) -> Array:
    """1 / sqrt(1 - leverage), each cluster's leverage in each test as its information has it (HC2 of linear models).

    `common` [G, q, p]: covariance of a cluster's efficient score with its score of the shared parameters.
    """
    if not len(total):
        return np.ones_like(kappa)
    drawn = np.einsum("gqa,ab,gqb->gq", common, np.linalg.inv(total), common)
    leverage = drawn / np.maximum(kappa, 1e-300)
    return 1.0 / np.sqrt(1.0 - np.clip(leverage, 0.0, MOST_LEVERAGE))


def _usable(kappa: Array, raw: Array) -> Array:
    total = kappa.sum(0)
    effective = total**2 / np.maximum((kappa**2).sum(0), 1e-300)
    return (total > LEAST_SHARE * raw) & (raw > 0.0) & (effective >= FEWEST_CLUSTERS)


def join_scores(parts: list[Scores]) -> Scores:
    """Several families of tests over the same clusters as one."""
    return Scores(np.concatenate([part.psi for part in parts], axis=1),
                  np.concatenate([part.kappa for part in parts], axis=1),
                  np.concatenate([part.stretch for part in parts], axis=1),
                  np.concatenate([part.kept for part in parts]))


def flip_signs(scores: Scores, draws: int, seed: int, progress: Progress) -> Flips:
    """Judge every test alone and all together under `draws` random sign patterns of the clusters."""
    psi, kappa = scores.psi * scores.stretch, scores.kappa
    observed = scores.psi.sum(0)
    rng = np.random.default_rng(seed)
    total = kappa.sum(0)
    squares = (psi**2).sum(0), (psi * kappa).sum(0), (kappa**2).sum(0)
    seen = _studentise(observed[None], squares[1][None], squares, total)[0]
    above_each, above_all = np.zeros(len(total)), np.zeros(len(total))
    weighted = psi * kappa
    for start in range(0, draws, CHUNK):
        signs = rng.choice((-1.0, 1.0), size=(min(CHUNK, draws - start), len(psi)))
        flipped = _studentise(signs @ psi, signs @ weighted, squares, total)
        above_each += (flipped >= seen - 1e-9).sum(0)
        above_all += (flipped.max(1)[:, None] >= seen[None] - 1e-9).sum(0)
        progress((start + len(signs)) / draws, "chance")
    amplitude = observed / total
    return Flips(seen, amplitude, 0.5 * amplitude * observed, (1.0 + above_each) / (1.0 + draws),
                 (1.0 + above_all) / (1.0 + draws))


def _studentise(score: Array, cross: Array, squares: tuple[Array, Array, Array], total: Array) -> Array:
    """|score| over the spread of cluster sums left when the effect it implies is taken out (signs square to 1)."""
    amplitude = score / total
    left = squares[0] - 2.0 * amplitude * cross + amplitude**2 * squares[2]
    return np.abs(score) / np.sqrt(np.maximum(left, 1e-9 * squares[0] + 1e-300))
