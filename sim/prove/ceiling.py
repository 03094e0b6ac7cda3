"""What could have been done in a concealed world: by the information that its own data hold of the true term."""

import numpy as np
from scipy.stats import norm

from sim.discover.discover import Investigation
from sim.discover.name import one_step
from sim.discover.refit import refit, unseen_score, without

KNOWN, AMONG = 1.96, 2.9              # critical |z| at 5 %: of one term that is known, of the largest of some twenty


def signal_of(investigation: Investigation, name: str, amplitude: float) -> float | None:
    """Non-centrality amplitude^2 x information left of the term's column; None where it was not asked about."""
    if investigation.fitted is None:
        return None
    candidates = {candidate.name: candidate for candidate in one_step(investigation.fitted.evidence)[0]}
    return candidates[name].information * amplitude**2 if name in candidates else None


def power_of(signal: float, critical: float = AMONG) -> float:
    """Probability that a normal score of this non-centrality is beyond the critical value, either way."""
    return float(norm.sf(critical - np.sqrt(signal)) + norm.cdf(-critical - np.sqrt(signal)))


def oracle_gain(investigation: Investigation, name: str, amplitude: float) -> float | None:
    """Gain a shot on unseen shots, had somebody said which term it is; None where nothing was found."""
    fitted, clusters = investigation.fitted, investigation.clusters
    if fitted is None or clusters is None or not investigation.steps:
        return None
    if name not in {column.name for column in fitted.evidence.columns[:fitted.evidence.first_shared]}:
        return None
    told = refit(fitted, (name,), np.array([amplitude]))
    return float((unseen_score(told.evidence, clusters) - unseen_score(without(fitted.evidence), clusters)).mean())
