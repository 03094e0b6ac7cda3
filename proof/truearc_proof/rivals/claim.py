"""What every entrant gets, and what it answers."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from msgspec import Struct

from truearc.sim.data.dataset import Dataset
from truearc.sim.discover.adopt import Investigation
from truearc.sim.discover.select.terms import Refit
from truearc.sim.infer.fit import BaselineFit

Array = np.ndarray
FOLDS = 5


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

    fitted: BaselineFit
    refits: Mapping[str, Refit] = field(default_factory=dict)

    @property
    def terms(self) -> tuple[str, ...]:
        """Terms that are believed."""
        columns = self.fitted.evidence.columns[self.fitted.evidence.first_shared:]
        return tuple(dict.fromkeys(column.name.partition(".")[0] for column in columns if column.kind == "shared"))


Rival = Callable[[Dataset, RivalBelief, int], Claim]


class Held(NamedTuple):
    """A fold: which of n rows are learnt from, and which are held out; masks [n]."""

    train: Array
    out: Array


def folds(n: int) -> tuple[Held, ...]:
    """Every fifth of n shots, as truearc's own figures on unseen shots have it."""
    fold = np.arange(n) % FOLDS
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
