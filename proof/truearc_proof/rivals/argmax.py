"""The term that fits these very shots best: truearc's own refits, and the highest likelihood wins, no question asked.

It always says something. Of all terms of the catalogue the LIKELY with the largest first-step gain are truly refitted
(more cost minutes in dirty worlds, whose fits settle slowly), and those that truearc has refitted by itself; ranking
is by log likelihood of the shots that were fitted, not held out, without a prior's price for the term.
"""

import numpy as np

from truearc.sim.data.dataset import Dataset
from truearc.sim.discover.select.simulations import end_errors
from truearc.sim.discover.select.terms import Candidate, Refit, one_step, refit
from truearc.sim.infer.fit import BaselineFit
from truearc.sim.infer.likelihood.layout import only_shared
from truearc.sim.infer.likelihood.score_table import unseen_change, without
from truearc_proof.rivals.claim import Claim, RivalBelief

LIKELY = 3
MOST_USUAL = 3.0                      # usual sizes from which a refit starts at most


def answer(dataset: Dataset, believed: RivalBelief, seed: int = 0) -> Claim:
    """Return the best fit's name and its forecast errors; nothing in it is random."""
    fitted = believed.fitted
    candidates = [one for one in one_step(fitted.evidence)[0] if one.visible]
    if not candidates:
        return Claim(False)
    ordered = sorted(candidates, key=lambda one: -one.z**2)
    refits = {one.name: believed.refits.get(one.name) or _refit(fitted, one) for k, one in enumerate(ordered)
              if k < LIKELY or one.name in believed.refits}
    fits = {name: float(found.evidence.log_score.sum()) for name, found in refits.items()}
    ranked = sorted(fits, key=lambda name: -fits[name]) + [one.name for one in ordered if one.name not in fits]
    null = without(fitted.evidence)
    before = end_errors(fitted.intake, only_shared(fitted.layout), fitted.spot, null, unseen_change(null))
    best = refits[ranked[0]]
    after = end_errors(fitted.intake, best.layout, best.spot, best.evidence, unseen_change(best.evidence))
    names = tuple(dict.fromkeys(name.partition(".")[0] for name in ranked))
    return Claim(True, names, before, after, {"gain": fits[ranked[0]] - float(null.log_score.sum())})


def _refit(fitted: BaselineFit, one: Candidate) -> Refit:
    """From one step on, tamed: all is linear nearby only."""
    usual = fitted.evidence.columns[one.column].usual
    return refit(fitted, (one.name,), np.array([np.clip(one.amplitude, -MOST_USUAL * usual, MOST_USUAL * usual)]))
