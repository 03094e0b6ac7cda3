"""Subtract the reference session's scores: misfit present in both sessions is not evidence of change.

A simulation adopted from one session ("home") is not perfect for it either, and tracks see that. In the next session
the same misfit would be found again, as a change. So each test is made in both sessions: under no change its score at
home, scaled by the ratio of the two sessions' informations, is the expected score here, within the chance variation of
both (a difference of two samples, whose signs are flipped alike). Where home has no information, as along a covariate
that was not recorded there, the test stands as it is.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from jaxtyping import Float, Shaped

from truearc.sim.discover.detect.covariates import Covariate, CovariatePair, Factor, varies
from truearc.sim.discover.detect.score_test import Scores, efficient_scores
from truearc.sim.discover.detect.weight_functions import Look, WeightFunction, weights_of
from truearc.sim.discover.select.refit import promote, refit
from truearc.sim.infer.fit import BaselineFit
from truearc.sim.infer.likelihood.score_table import Array, ScoreTable

MOST = 4.0                            # times home's information that a session may have: else home's noise drowns it


@dataclass(frozen=True)
class ReferenceSession:
    """`fitted`: the belief at its best there, with the same questions; `columns` {name: of every shot} there."""

    fitted: BaselineFit
    columns: Mapping[str, Any]
    company: dict[tuple[str, ...], "ReferenceSession"] = field(default_factory=dict, repr=False)

    @property
    def look(self) -> Look:
        rows = self.fitted.evidence.rows
        return Look(len(rows), lambda what: self.find(what)[rows])

    def find(self, what: Covariate | Factor) -> Shaped[Array, " shots"]:
        """Its values, or codes, of every shot of home; nan, or -1, where home knows nothing of it."""
        names = what.names if isinstance(what, Covariate) else (what.name,)
        known = next((self.columns[name] for name in names if name in self.columns), None)
        if isinstance(what, Factor):
            codes = {level: code for code, level in enumerate(what.levels)}
            return np.array([codes.get(text, -1) for text in known]) if known is not None else self._all(-1)
        return self._all(np.nan) if known is None else np.asarray(known, dtype=float)

    def own(self, what: Covariate | Factor | CovariatePair | None) -> Covariate | Factor | None:
        """The same as it was here; None where it did not vary, and for two together."""
        if isinstance(what, Factor):
            return Factor(what.name, what.levels, self.find(what))
        if not isinstance(what, Covariate) or not varies(self.look.at(what)):
            return None
        return Covariate(((what.name, self.find(what)),))

    def index(self, name: str) -> int | None:
        """Of the tested column; None where there is none."""
        columns = self.fitted.evidence.columns[:self.fitted.evidence.first_shared]
        return next((k for k, column in enumerate(columns) if column.name == name), None)

    def beside(self, scores: Scores, evidence: ScoreTable, number: int, shapes: Sequence[WeightFunction],
               weights: Float[Array, "n q"]) -> Scores:
        """The scores of `shapes` (`weights` [n, q]) on the evidence's column, less home's, whose signs follow."""
        mine = self.fitted.evidence
        column = self.index(evidence.columns[number].name)
        rows = len(mine.rows) + len(mine.precision)
        if column is None:
            none = np.zeros((rows, len(shapes)))
            return _joined(scores, Scores(none, none, none + 1.0, scores.kept), np.zeros(len(shapes)))
        there = weights_of(shapes, self.look)
        found = efficient_scores(mine, column, there, np.arange(len(mine.rows)), len(mine.rows))
        said, told = _said(evidence, number, weights), _said(mine, column, there)
        share = np.where(said <= MOST * told, said / np.maximum(told, 1e-300), 0.0)
        return _joined(scores, found, share)

    def among(self, fitted: BaselineFit) -> "ReferenceSession":
        """Home with the effects that `fitted` has been given since fitted there, too."""
        first = fitted.evidence.first_shared
        given = {column.name for column in fitted.evidence.columns[first:] if column.kind != "group"}
        own = self.fitted.evidence.columns[self.fitted.evidence.first_shared:]
        names = tuple(sorted(name for name in given - {column.name for column in own} if self.index(name) is not None))
        if names and names not in self.company:
            found = refit(self.fitted, names, np.zeros(len(names)))
            self.company[names] = replace(self, fitted=promote(self.fitted, found), company={})
        return self.company[names] if names else self

    def _all(self, value: int | float) -> Shaped[Array, " shots"]:
        return np.full(int(self.fitted.evidence.rows.max(initial=-1)) + 1, value)


def _said(evidence: ScoreTable, column: int, weights: Float[Array, "n q"]) -> Float[Array, " q"]:
    return np.asarray((weights**2 * evidence.info[:, column, column, None]).sum(0))


def _joined(here: Scores, home: Scores, share: Float[Array, " q"]) -> Scores:
    """Scores of the difference, in units that leave amplitudes those of the change and gains what it explains."""
    mine, theirs = here.kappa.sum(0), share**2 * home.kappa.sum(0)
    part = mine / np.maximum(mine + theirs, 1e-300)
    psi = np.concatenate([part * here.psi, -part * share * home.psi])
    kappa = np.concatenate([part * here.kappa, np.zeros_like(home.kappa)])
    return Scores(psi, kappa, np.concatenate([here.stretch, home.stretch]), here.kept)
