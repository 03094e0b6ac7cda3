"""Evidence from outcomes and heights at the plane: launch from the recorded columns, scatter fitted."""

import itertools
from dataclasses import dataclass

import numpy as np

from sim.discover import outcomes
from sim.discover.evidence import Array, Channel, Evidence
from sim.discover.motion import Believed, plane_heights, plane_slopes, prior
from sim.discover.outcomes import Seen
from sim.physics.launch import Exit
from sim.shots import Shots

# Slopes that plane_slopes gives, in its order, and what an amplitude of each means; the height itself comes last.
CHANNELS = (
    Channel("launch speed", "launch", "along", "1", "the ball leaves faster than simulated by a fraction of {}"),
    Channel("launch elevation", "launch", "vertical", "rad", "the ball leaves steeper than simulated by {}"),
    Channel("distance", "sensing", "along", "m", "the target is farther than recorded by {}"),
    Channel("push along", "flight", "along", "m/s2", "the ball is pushed forward along its flight by {} more than "
            "simulated"),
    Channel("push vertical", "flight", "vertical", "m/s2", "the ball is lifted across its flight by {} more than "
            "simulated"),
    Channel("height at the target", "arrival", "vertical", "m", "the ball passes the target higher than simulated by {}"),
)
SPREADS = ("scatter.speed", "scatter.height")
# Standard deviation of launch speed (a fraction) and of whatever else moves the height (m): log-normal, a factor of 3.
SPREAD_MEDIANS = (0.015, 0.03)
SPREAD_FACTOR = 3.0
GRID = (0.0, 0.05, 0.1, 0.2, 0.4, 0.8)        # share of each coefficient's range from which the fit may start
MOST_GRID = 2                                  # coefficients that are gridded; more start from the prior
ROUNDS = 60
HALVINGS = 12
SETTLED = 1e-6


@dataclass(frozen=True)
class Plane:
    """All that the heights at the plane depend on, for n shots."""

    believed: Believed
    seen: Seen
    launch: Array                     # [n, 6], see motion.plane_heights
    spin_rev_s: Array                 # [n, 3]
    distance_m: Array                 # [n]


@dataclass(frozen=True)
class Heights:
    """Heights at one setting of the shared parameters (coefficients, then log scatters)."""

    mean_m: Array                     # [n] above the target's centre; -inf where the ball never came near
    spread_m: Array
    by_launch: Array                  # [n, 6]
    by_shared: Array                  # [n, p]: of the mean by coefficients
    log_spread_by: Array              # [n, 2]: of log spread by log scatters


@dataclass(frozen=True)
class OutcomeEvidence(Evidence):
    """Evidence whose likelihood is one of classes: gains are computed, not extrapolated."""

    plane: Plane
    heights: Heights

    def gain(self, change: Array) -> Array:
        """Log-likelihood gained by each shot; the height is taken as linear in `change` [n, C+p]."""
        mean_m, spread_m = self.corrected(change)
        return outcomes.log_likelihood(self.plane.seen, mean_m, spread_m) - self.log_score

    def corrected(self, change: Array) -> tuple[Array, Array]:
        """Mean and spread [n] of the heights after `change` [n, C+p]."""
        moves = np.concatenate([_channel_slopes(self.heights), self.heights.by_shared], axis=1)
        inner = change[:, :-len(SPREADS)]
        spread = np.einsum("ni,ni->n", self.heights.log_spread_by, change[:, -len(SPREADS):])
        return (self.heights.mean_m + np.einsum("ni,ni->n", moves, inner),
                self.heights.spread_m * np.exp(np.clip(spread, -2.0, 2.0)))


def make_plane(believed: Believed, shots: Shots, leaving: Exit, rows: Array, seen: Seen) -> Plane:
    """The rows' launches as plane_heights wants them; backspin is about -y."""
    n = len(rows)
    launch = np.zeros((n, 6))
    launch[:, 0] = np.log(np.maximum(np.asarray(leaving.speed_m_s)[rows], 1e-6))
    launch[:, 1] = np.asarray(leaving.elevation_rad)[rows]
    launch[:, 2] = believed.facts.launcher.release_height_m
    spin = np.stack([np.zeros(n), -np.asarray(leaving.spin_rev_s)[rows], np.zeros(n)], axis=1)
    return Plane(believed, seen, launch, spin, shots.number("distance_m")[rows])


def fit_outcomes(plane: Plane) -> Array:
    """Maximum a posteriori coefficients and log scatters [p + 2]: grid, then Fisher scoring with halved steps."""
    mean, sd = _prior(plane.believed)
    shared = max(_starts(plane.believed), key=lambda start: _objective(plane, start, mean, sd))
    best = _objective(plane, shared, mean, sd)
    for _ in range(ROUNDS):
        heights = heights_at(plane, shared)
        score, info = _shared_terms(plane, heights)
        step = np.linalg.solve(info.sum(0) + np.diag(1.0 / sd**2), score.sum(0) + (mean - shared) / sd**2)
        for halving in range(HALVINGS):
            tried = shared + step * 0.5**halving
            value = _objective(plane, tried, mean, sd)
            if value >= best:
                break
        else:
            break
        gained, shared, best = value - best, tried, value
        if gained < SETTLED:
            break
    return shared


def outcome_evidence(plane: Plane, rows: Array, shared: Array) -> OutcomeEvidence:
    """Scores of every channel at fitted shared parameters."""
    mean, sd = _prior(plane.believed)
    heights = heights_at(plane, shared)
    score, info = _terms(plane, heights, np.concatenate([_channel_slopes(heights), heights.by_shared], axis=1))
    names = tuple(f"{term}.{parameter}" for term, parameter in plane.believed.shared) + SPREADS
    return OutcomeEvidence("outcomes", rows, CHANNELS, names, score, info, 1.0 / sd**2, (mean - shared) / sd**2,
                           outcomes.log_likelihood(plane.seen, heights.mean_m, heights.spread_m), plane, heights)


def heights_at(plane: Plane, shared: Array) -> Heights:
    """Heights, their scatter and their slopes."""
    facts, coefficients, scatter = plane.believed.facts, shared[:-2], np.exp(shared[-2:])
    height_m, near = (np.asarray(part) for part in
                      plane_heights(plane.believed, plane.launch, plane.spin_rev_s, plane.distance_m, coefficients))
    by_launch, by_shared = (np.where(near[:, None], np.asarray(part), 0.0) for part in
                            plane_slopes(plane.believed, plane.launch, plane.spin_rev_s, plane.distance_m, coefficients))
    centre_m = facts.target.centre_height_m if facts.target else 0.0
    by_speed = (by_launch[:, 0] * scatter[0])**2
    sensors = (by_launch[:, 1] * np.radians(facts.noise.hood_deg))**2 + (by_launch[:, 3] * facts.noise.distance_m)**2
    variance = by_speed + sensors + scatter[1]**2
    shares = np.stack([by_speed, np.full_like(by_speed, scatter[1]**2)], axis=1) / variance[:, None]
    return Heights(np.where(near, height_m - centre_m, -np.inf), np.sqrt(variance), by_launch, by_shared, shares)


def _channel_slopes(heights: Heights) -> Array:
    """Of the height by each of CHANNELS: the release height (column 2) is left to the height itself."""
    chosen = heights.by_launch[:, [0, 1, 3, 4, 5]]
    return np.concatenate([chosen, np.isfinite(heights.mean_m)[:, None].astype(float)], axis=1)


def _shared_terms(plane: Plane, heights: Heights) -> tuple[Array, Array]:
    """Score [n, p + 2] and information [n, p + 2, p + 2] of the shared parameters."""
    return _terms(plane, heights, heights.by_shared)


def _terms(plane: Plane, heights: Heights, moves: Array) -> tuple[Array, Array]:
    """Score and information of what moves the heights (`moves` [n, k]), followed by the log scatters."""
    none = np.zeros((len(moves), len(SPREADS)))
    to_mean = np.concatenate([moves, none], axis=1)
    to_spread = np.concatenate([np.zeros_like(moves), heights.log_spread_by], axis=1)
    by_mean, by_log = outcomes.slopes(plane.seen, heights.mean_m, heights.spread_m)
    carry = np.stack([to_mean, to_spread], axis=1)
    inner = outcomes.information(plane.seen, heights.mean_m, heights.spread_m)
    return (by_mean[:, None] * to_mean + by_log[:, None] * to_spread,
            np.einsum("nia,nij,njb->nab", carry, inner, carry))


def _objective(plane: Plane, shared: Array, mean: Array, sd: Array) -> float:
    heights = heights_at(plane, shared)
    value = outcomes.log_likelihood(plane.seen, heights.mean_m, heights.spread_m).sum()
    return float(value - 0.5 * (((shared - mean) / sd)**2).sum()) if np.isfinite(value) else -np.inf


def _prior(believed: Believed) -> tuple[Array, Array]:
    mean, sd = prior(believed)
    return (np.concatenate([mean, np.log(SPREAD_MEDIANS)]),
            np.concatenate([sd, np.full(2, np.log(SPREAD_FACTOR))]))


def _starts(believed: Believed) -> list[Array]:
    """Where the fit may start: a grid over up to MOST_GRID coefficients, and two sizes of scatter."""
    mean, sd = prior(believed)
    low, width = mean - 0.5 * sd, 5.0 * sd
    axes = [low[k] + width[k] * np.array(GRID) if k < MOST_GRID else mean[k:k + 1] for k in range(len(mean))]
    return [np.array([*point, np.log(SPREAD_MEDIANS[0] * factor), np.log(SPREAD_MEDIANS[1] * factor)])
            for point in itertools.product(*axes) for factor in (1.0, 3.0)]

