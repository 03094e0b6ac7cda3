"""Decoys: terms that are nothing, as many as there are names, to see how often one of them would have led.

A decoy moves the shots as much as its term does, each by a random sign. It is nothing by construction, yet it meets the
same shots with the same surprises, however they are spread: a name that decoys equal is not one.
"""

import numpy as np

from truearc.sim.discover.detect.clusters import Clusters
from truearc.sim.discover.detect.score_test import efficient_scores
from truearc.sim.discover.model.score_table import Array, ScoreTable
from truearc.sim.discover.select.term_ranking import nats_for, visible_terms

DEALS = 400


def share_above(evidence: ScoreTable, clusters: Clusters, nats: float, seed: int) -> float:
    """Share of deals (one decoy of each visible term) in which the best decoy has as many nats as the best name."""
    label = clusters.label[evidence.rows]
    ones = np.ones((len(evidence.rows), 1))
    best = np.full(DEALS, -np.inf)
    flips: Array | None = None
    rng = np.random.default_rng(seed)
    for column in visible_terms(evidence).tolist():
        scores = efficient_scores(evidence, column, ones, label, clusters.count)
        if flips is None:
            flips = rng.choice((-1.0, 1.0), (DEALS, len(scores.psi)))
        found = flips @ (scores.psi * scores.stretch)[:, 0]
        best = np.maximum(best, nats_for(found, float(scores.kappa.sum()), evidence.columns[column].usual))
    return float(np.mean(best >= nats))
