"""What every entrant gets and answers, and the simplest of them: the term that fits these very shots best.

That one refits as truearc does, and the highest likelihood wins, no question asked: it always says something. Of all
terms of the catalogue the LIKELY with the largest first-step gain are truly refitted (more cost minutes in dirty
worlds, whose fits settle slowly), and those that truearc has refitted by itself; ranking is by log likelihood of the
shots that were fitted, not held out, without a prior's price for the term.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from msgspec import Struct

from truearc.sim.data.dataset import Dataset
from truearc.sim.discover.investigate import Investigation
from truearc.sim.discover.select.simulations import end_errors
from truearc.sim.discover.select.terms import Candidate, one_step
from truearc.sim.infer.launcher import LauncherFit
from truearc.sim.infer.likelihood.score_table import FOLDS, folds_of

Array = np.ndarray
LIKELY = 3
MOST_USUAL = 3.0                      # usual sizes from which a refit starts at most


class Claim(Struct, frozen=True):
    """One entrant about one world.

    says_something: that the believed simulation lacks something. names: terms of the catalogue, likeliest first; empty
    where none is named. before_m, after_m: RMS error of the forecast height at the tracks' ends in hold-out shots, by
    the believed physics and by the entrant's law (equal if it does not say something); None where it makes no forecast.
    figures: those that decided.
    """

    says_something: bool
    names: tuple[str, ...] = ()
    before_m: float | None = None
    after_m: float | None = None
    figures: Mapping[str, float] = {}


@dataclass(frozen=True)
class RivalBelief:
    """The believed simulation fitted to the dataset, as truearc fits it; refits: of single terms, as far as made."""

    fitted: LauncherFit
    refits: Mapping[str, LauncherFit] = field(default_factory=dict)

    @property
    def terms(self) -> tuple[str, ...]:
        """Terms that are believed."""
        columns = self.fitted.scores.columns[self.fitted.scores.first_shared:]
        return tuple(dict.fromkeys(column.name.partition(".")[0] for column in columns if column.kind == "shared"))


Rival = Callable[[Dataset, RivalBelief, int], Claim]


class Held(NamedTuple):
    """A fold: which of n rows are learnt from, and which are held out; masks [n]."""

    train: Array
    out: Array


def folds(n: int) -> tuple[Held, ...]:
    """Every fifth of n shots, as truearc's own figures on unseen shots have it."""
    fold = folds_of(n)
    return tuple(Held(fold != k, fold == k) for k in range(FOLDS))


def believed_of(found: Investigation) -> RivalBelief | None:
    """From truearc's own investigation; None where the data carry no test at all."""
    if found.fitted is None:
        return None
    refits = found.steps[0].naming.refits if found.steps else {}
    return RivalBelief(found.fitted, refits)


def rms(errors: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(errors))))


def answer_argmax(dataset: Dataset, believed: RivalBelief, seed: int = 0) -> Claim:
    """Return the best fit's name and its forecast errors; nothing in it is random."""
    fitted = believed.fitted
    candidates = [one for one in one_step(fitted.scores)[0] if one.visible]
    if not candidates:
        return Claim(False)
    ordered = sorted(candidates, key=lambda one: -one.z**2)
    refits = {one.name: believed.refits.get(one.name) or _refit(fitted, one) for k, one in enumerate(ordered)
              if k < LIKELY or one.name in believed.refits}
    fits = {name: float(found.scores.log_score.sum()) for name, found in refits.items()}
    ranked = sorted(fits, key=lambda name: -fits[name]) + [one.name for one in ordered if one.name not in fits]
    null, best = fitted.without_terms(), refits[ranked[0]]
    before, after = (end_errors(one, one.scores.held_out_change()) for one in (null, best))
    names = tuple(dict.fromkeys(name.partition(".")[0] for name in ranked))
    return Claim(True, names, before, after, {"gain": fits[ranked[0]] - float(null.scores.log_score.sum())})


def _refit(fitted: LauncherFit, one: Candidate) -> LauncherFit:
    """From one step on, tamed: all is linear nearby only."""
    usual = fitted.scores.columns[one.column].usual
    return fitted.with_terms((one.name,), np.clip([one.amplitude], -MOST_USUAL * usual, MOST_USUAL * usual))
