"""What the recordings say about every way in which the simulation could be wrong, one row a shot.

A channel is a small extra effect with an amplitude, zero in the believed simulation: an acceleration along the flight,
a change of launch speed, a raised target. Evidence holds the log-likelihood's slope and curvature in all channel
amplitudes and in the parameters that all shots share, each shot's own unknowns (where its track starts, how fast)
already removed. Everything after that (tests, place, free correction) needs no physics.
"""

from dataclasses import dataclass

import numpy as np

Array = np.ndarray


# What a departure of each stage usually amounts to, one standard deviation, by its unit: speed lost to droop and slip
# (launchers measured by others give 67-87 % of their wheels' surface speed), a degree of hood, 2 % of camera scale at
# 6 m, an acceleration as of a wrong drag law or a breeze of 1 m/s, a target or an exit point 4 or 5 cm off. Such
# effects' usual sizes; fitted to no data.
USUAL = {("sensing", "m"): 0.12, ("sensing", "1"): 0.02, ("sensing", "rad"): 0.0175, ("launch", "1"): 0.2,
         ("launch", "rad"): 0.0175, ("launch", "m"): 0.04, ("flight", "m/s2"): 1.5, ("arrival", "m"): 0.05}


@dataclass(frozen=True)
class Channel:
    """One way to be wrong. `direction`: along (the velocity), vertical (across it, up), lateral (left)."""

    name: str
    stage: str                        # sensing | launch | flight | arrival
    direction: str
    unit: str                         # of its amplitude
    words: tuple[str, str]            # what a positive and a negative amplitude mean, compared with the simulation
    follows: str = ""                 # what it varies with inside one flight; "" = an amplitude a shot
    times_s: tuple[float, float] | None = None

    @property
    def usual(self) -> float:
        """One standard deviation of what such a departure amounts to, in the channel's unit."""
        return USUAL[self.stage, self.unit]


@dataclass(frozen=True)
class Evidence:
    """Slopes and curvatures at the fitted believed model; n shots, C channels first, then p shared parameters.

    `rows` [n] are the shots; `score` [n, C+p] the slope of each shot's log-likelihood; `info` [n, C+p, C+p] its
    (expected) negative curvature; `precision` [p] and `pull` [p] curvature and slope of the shared parameters' log
    prior; `log_score` [n] the log-likelihood of each shot under the fitted believed model.
    """

    kind: str                         # tracks | launch | outcomes
    rows: Array
    channels: tuple[Channel, ...]
    shared: tuple[str, ...]
    score: Array
    info: Array
    precision: Array
    pull: Array
    log_score: Array

    def gain(self, change: Array) -> Array:
        """Log-likelihood gained by each shot when amplitudes and shared parameters change by `change` [n, C+p].

        Exact for Gaussian residuals that are linear in them; other likelihoods override it.
        """
        bend = np.einsum("ni,nij,nj->n", change, self.info, change)
        return np.einsum("ni,ni->n", self.score, change) - 0.5 * bend

    def slopes_at(self, change: Array) -> tuple[Array, Array]:
        """Score [n, C+p] and information [n, C+p, C+p] after `change`; exact for the same likelihoods as `gain`."""
        return self.score - np.einsum("nij,nj->ni", self.info, change), self.info


def shared_columns(evidence: Evidence) -> slice:
    """Columns of the shared parameters in score and info."""
    return slice(len(evidence.channels), None)
