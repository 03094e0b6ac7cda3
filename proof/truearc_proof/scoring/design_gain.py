"""How many shots drawn at random would have parted the names as well as those that were asked for and given."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from truearc.sim.data.dataset import Dataset, join_datasets
from truearc.sim.discover.plan.next_steps import Contest, worth
from truearc.sim.infer.fit import fit_believed
from truearc.sim.infer.likelihood.data import take_in
from truearc.sim.infer.likelihood.layout import column_of, groups_of, lay_out

MOST = 64.0                           # times the first shots, up to which random ones are counted
HALVINGS = 30


def random_worth(first: Dataset, more: Dataset, finding: Mapping[str, Any]) -> int | None:
    """By what the given shots themselves say of the amplitudes of the set's names, each as large and as likely as was
    claimed before; None beyond MOST times the first shots, or for fewer than two names.

    Worth is the design's (truearc.sim.discover.plan.next_steps.worth), with the information of shots that were
    really shot.
    """
    what = {one["term"]: one for one in finding["what"] if one["term"] in (finding["set"] or ())}
    whole = join_datasets(first, more)
    terms, intake = first.facts.believe.terms, take_in(whole)
    evidence = fit_believed(intake, lay_out(intake, terms, groups_of(whole.shots, intake.rows))).evidence
    there = {column.name for column in evidence.columns[:evidence.first_shared]}
    names = [name for name in what if column_of(name) in there]
    if len(names) < 2:
        return None
    columns = np.array([evidence.index(column_of(name)) for name in names])
    sizes = [what[name]["parameters"][column_of(name).partition(".")[2]]["value"] for name in names]
    share = np.array([what[name]["probability"] for name in names])
    contest = Contest(evidence, columns, np.array(sizes), np.array([evidence.columns[k].usual for k in columns]),
                      share / share.sum(), np.zeros(len(names)))
    old = np.flatnonzero(evidence.rows < len(first.shots))
    new = np.flatnonzero(evidence.rows >= len(first.shots))
    return _as_many(contest, evidence.told_by(old), evidence.told_by(new), len(old))


def _as_many(contest: Contest, present: np.ndarray, more: np.ndarray, shots: int) -> int | None:
    """Random shots, each with 1 / shots of the present information, that are worth `more`, which is in the contest's
    evidence already."""
    wanted = worth(contest, 0.0)
    low, high = 0.0, MOST
    if worth(contest, high * present - more) < wanted:
        return None
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if worth(contest, middle * present - more) >= wanted else (middle, high)
    return int(np.ceil(high * shots))
