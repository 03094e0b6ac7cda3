"""Every test that is made: each channel against each covariate, each group, and no covariate at all."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim.discover.covariates import Covariate, Factor, test_groups, test_shapes
from sim.discover.evidence import Array, Channel, Evidence
from sim.discover.statistics import Scores, efficient_scores, join_scores
from sim.shots import Shots

MANY = 10.0                           # groups, counted by size, from which they and not the shots hang together


@dataclass(frozen=True)
class Clusters:
    """What hangs together: `label` [shots] numbers the clusters; `by` ball_id, session or shot."""

    by: str
    label: Array
    count: int


@dataclass(frozen=True)
class Test:
    """One question: does this channel's amplitude go with these weights?"""

    __test__ = False                  # not one of pytest's

    evidence: int
    channel: int
    what: Covariate | Factor | None   # None: the same in every shot
    shape: str
    weights: Array                    # [n] of the evidence's rows


def find_clusters(shots: Shots) -> Clusters:
    """Balls when there are at least ten, else sessions when there are, else each shot by itself.

    Counted as (sum of sizes)^2 / sum of squares, so that a big group and its crumbs are not many. With fewer groups
    their signs say too little, and a difference between them counts as a finding.
    """
    for name in ("ball_id", "session"):
        texts = [text or f"shot {row}" for row, text in enumerate(shots.text(name))]
        levels, label, sizes = np.unique(texts, return_inverse=True, return_counts=True)
        if any(shots.text(name)) and sizes.sum()**2 / (sizes**2).sum() >= MANY and len(levels) < len(shots):
            return Clusters(name, label, len(levels))
    return Clusters("shot", np.arange(len(shots)), len(shots))


def ask_everything(evidences: Sequence[Evidence], covariates: Sequence[Covariate], factors: Sequence[Factor],
                   clusters: Clusters) -> tuple[tuple[Test, ...], Scores]:
    """All tests that the data can carry, and their scores; a factor that makes the clusters is not asked about."""
    tests: list[Test] = []
    parts: list[Scores] = []
    for number, evidence in enumerate(evidences):
        shapes = _shapes(evidence, covariates, [f for f in factors if f.name != clusters.by])
        for channel, about in enumerate(evidence.channels):
            asked = [shape for shape in shapes if shape[0] is None or not about.follows]
            weights = np.stack([shape[2] for shape in asked], axis=1)
            tests += [Test(number, channel, *shape) for shape in asked]
            parts.append(efficient_scores(evidence, channel, weights, clusters.label[evidence.rows], clusters.count))
    scores = join_scores(parts)
    kept = np.flatnonzero(scores.kept)
    return (tuple(tests[k] for k in kept),
            Scores(scores.psi[:, kept], scores.kappa[:, kept], scores.stretch[:, kept], scores.kept[kept]))


def name_of(test: Test, channel: Channel) -> str | None:
    """The covariate as reported: what it varies with inside a flight, a column, or nothing."""
    if channel.follows:
        return None if channel.follows == "sensor" else channel.follows
    if test.what is None:
        return None
    return test.what.name


def _shapes(evidence: Evidence, covariates: Sequence[Covariate],
            factors: Sequence[Factor]) -> list[tuple[Covariate | Factor | None, str, Array]]:
    shapes: list[tuple[Covariate | Factor | None, str, Array]] = [(None, "same", np.ones(len(evidence.rows)))]
    for covariate in covariates:
        weights, names = test_shapes(covariate, evidence.rows)
        shapes += [(covariate, name, weights[:, k]) for k, name in enumerate(names)]
    for factor in factors:
        weights, names = test_groups(factor, evidence.rows)
        shapes += [(factor, name, weights[:, k]) for k, name in enumerate(names)]
    return shapes
