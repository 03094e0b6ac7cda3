"""Two names at once: where neither alone explains what is missing, the first that comes to hand leads astray."""

import numpy as np

from truearc.sim.discover.model.baseline_fit import BaselineFit
from truearc.sim.discover.select.refit import Refit, promote, refit
from truearc.sim.discover.select.term_ranking import Naming, is_possible, one_step, tame

FIRSTS = 4                            # of the likeliest names, each put in to see which other one goes with it
WITHIN = 6.0                          # nats of the likeliest pair by one step, beyond which none is refitted
MOST = 6                              # pairs refitted


def best_pair(fitted: BaselineFit, naming: Naming) -> Refit | None:
    """The likeliest pair, refitted; None where no second name is visible beside a first, or no pair possible."""
    guesses: dict[frozenset[str], tuple[float, tuple[str, str], tuple[float, float]]] = {}
    for first in sorted(naming.refits, key=lambda name: -naming.nats[name])[:FIRSTS]:
        alone = naming.refits[first]
        base = promote(fitted, alone)
        for second in one_step(base.evidence)[0]:
            both, nats = frozenset((first, second.name)), naming.nats[first] + second.nats
            if second.visible and nats > guesses.get(both, (-np.inf,))[0]:
                guesses[both] = nats, (first, second.name), (float(alone.amplitude[0]), tame(second, base.evidence))
    ranked = sorted(guesses.values(), reverse=True)[:MOST]
    pairs = [refit(fitted, names, np.array(start)) for nats, names, start in ranked if nats > ranked[0][0] - WITHIN]
    usual = {column.name: column.usual for column in fitted.evidence.columns[:fitted.evidence.first_shared]}
    possible = [pair for pair in pairs if is_possible(pair, *(usual[name] for name in pair.names))]
    return max(possible, key=lambda pair: pair.log_evidence, default=None)
