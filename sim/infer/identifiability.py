"""Parameters that a dataset keeps together, and those that only the prior knows, before anyone refines the model.

By the covariance of the fit in units of the priors' standard deviations.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from truearc.sim.infer.map_fit import MapFit

CORRELATED = 0.9                      # pairs from here on are named
SILENT = 0.7                          # a parameter known to more than this share of its prior's sd is the prior's


@dataclass(frozen=True)
class AliasedPair:
    """Two parameters that this dataset keeps together: it fixes `a` + factor * `b`, to `known_to`, in a's unit."""

    a: str
    b: str
    correlation: float
    factor: float
    known_to: float


@dataclass(frozen=True)
class Identified:
    """`share`: of its prior's sd to which each parameter is known. `from_prior`: those that the data hardly touch."""

    pairs: tuple[AliasedPair, ...]
    share: dict[str, float]
    from_prior: tuple[str, ...]


def identify(fit: MapFit) -> Identified:
    """Return pairs that the fit keeps together, and how far each parameter is known beyond its prior."""
    names = fit.names
    share = {name: float(np.sqrt(fit.covariance[index, index])) for index, name in enumerate(names)}
    return Identified(_pairs(fit), share, tuple(name for name in names if share[name] > SILENT))


def _pairs(fit: MapFit) -> tuple[AliasedPair, ...]:
    """Pairs with a correlation of at least CORRELATED, strongest first, each with the combination that is fixed."""
    names, covariance = fit.names, fit.covariance * np.outer(slopes(fit), slopes(fit))
    sd = np.sqrt(np.diag(covariance))
    pairs = []
    for a in range(len(names)):
        for b in range(a + 1, len(names)):
            correlation = covariance[a, b] / (sd[a] * sd[b])
            if abs(correlation) >= CORRELATED:
                factor = -covariance[a, b] / covariance[b, b]
                left = covariance[a, a] - covariance[a, b]**2 / covariance[b, b]
                known_to = float(np.sqrt(max(left, 0.0)))
                pairs.append(AliasedPair(names[a], names[b], float(correlation), float(factor), known_to))
    return tuple(sorted(pairs, key=lambda pair: -abs(pair.correlation)))


def slopes(fit: MapFit) -> Float[np.ndarray, " p"]:
    """d value / d (prior standard deviation) [p] at the optimum: from units of the prior to the parameter's own."""
    return np.array([one.sd * one.slope(float(fit.evidence.point[one.column])) for one in fit.sought])
