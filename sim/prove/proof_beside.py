"""A round of proof played again by somebody else, with entropy of his own: is it what was published?"""

from collections.abc import Sequence
from math import ceil, floor

from scipy.stats import fisher_exact

from sim.intervals import wilson
from sim.prove.marking import Mark
from sim.prove.proof_table import Table
from sim.prove.proof_targets import Figure, figures_of


def beside(published: Sequence[Mark], again: Sequence[Mark]) -> Table:
    """A row for each share that both rounds have, of worlds of the NumPy engine: whether the second one's lies in the
    first one's 95 % interval, to a whole world (2 of 6 where it begins at .41), and how often chance alone would put
    two rounds of these sizes as far apart (Fisher's exact test)."""
    ours, theirs = (figures_of([one for one in marks if one.engine == "numpy"]) for marks in (published, again))
    rows = [_row(name, ours[name], theirs[name]) for name in ours
            if ours[name].counts is not None and theirs[name].counts is not None]
    return Table("Played again", ("figure", "published", "again", "inside", "by chance"), rows)


def _row(name: str, ours: Figure, theirs: Figure) -> list[str]:
    assert ours.counts is not None and theirs.counts is not None
    (low, high), (yes, of) = wilson(*ours.counts), theirs.counts
    counts = [[yes, of - yes], [ours.counts[0], ours.counts[1] - ours.counts[0]]]
    return [name, ours.words, theirs.words, "yes" if floor(low * of) <= yes <= ceil(high * of) else "no",
            f"{fisher_exact(counts).pvalue:.2f}"]
