"""Comparison of a published round of proof with a round that a third party has played, with entropy of its own."""

from collections.abc import Sequence

import numpy as np
from scipy.stats import fisher_exact

from truearc.sim.statistics import wilson
from truearc_proof.report.figures import TITLES, ProofFigure, figures_of
from truearc_proof.scoring.score_world import Mark
from truearc_proof.table import Table

ROUNDING = 1e-9                       # an interval that begins at 0 may begin a last digit above it


def beside(published: Sequence[Mark], again: Sequence[Mark]) -> Table:
    """A row for each share that both rounds have: whether the second one's lies in the first one's 95 % interval, ends
    included, and how often chance alone would put two rounds of these sizes as far apart (Fisher's exact test): of six
    worlds a share lies outside easily."""
    ours, theirs = figures_of(published), figures_of(again)
    rows = [_row(TITLES[name], ours[name], theirs[name]) for name in ours
            if ours[name].counts is not None and theirs[name].counts is not None]
    return Table("Played again", ("figure", "published", "again", "inside", "by chance"), rows)


def _row(name: str, ours: ProofFigure, theirs: ProofFigure) -> list[str]:
    assert ours.counts is not None and theirs.counts is not None
    (low, high), (yes, of) = wilson(*ours.counts), theirs.counts
    counts = np.array([[yes, of - yes], [ours.counts[0], ours.counts[1] - ours.counts[0]]])
    return [name, ours.words, theirs.words, "yes" if low - ROUNDING <= yes / of <= high + ROUNDING else "no",
            f"{fisher_exact(counts).pvalue:.2f}"]
