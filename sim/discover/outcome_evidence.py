"""Evidence from outcomes and heights at the plane: launch from the recorded columns, scatter fitted."""

import itertools
from dataclasses import dataclass, replace

import numpy as np

from sim.discover import outcomes
from sim.discover.evidence import Array, Channel, Evidence
from sim.discover.motion import Believed, plane_heights, plane_slopes, prior
from sim.discover.outcomes import Seen
from sim.physics.launch import Exit
from sim.shots import Shots

# Slopes that plane_slopes gives, in its order, and what an amplitude of each means; the height itself comes last.
CHANNELS = (
    Channel("launch speed", "launch", "along", "1", ("the ball leaves faster", "the ball leaves slower")),
    Channel("launch elevation", "launch", "vertical", "rad", ("the ball leaves steeper", "the ball leaves flatter")),
    Channel("distance", "sensing", "along", "m", ("the target is farther", "the target is nearer")),
    Channel("push along", "flight", "along", "m/s2",
            ("the ball is driven along its flight", "the ball is held back along its flight")),
    Channel("push vertical", "flight", "vertical", "m/s2",
            ("the ball is lifted across its flight", "the ball is pressed down across its flight")),
    Channel("height at the target", "arrival", "vertical", "m",
            ("the ball passes the target higher", "the ball passes the target lower")),
)
SPREADS = ("scatter.speed", "scatter.height")
# Standard deviation of launch speed (a fraction) and of whatever else moves the height (m): log-normal, a factor of 3.
SPREAD_MEDIANS = (0.015, 0.03)
SPREAD_FACTOR = 3.0
GRID = (0.0, 0.05, 0.1, 0.2, 0.4, 0.8)        # share of each coefficient's range from which the fit may start
SCATTER_GRID = (1.0, 3.0, 10.0)                # times the usual one
MOST_GRID = 2                                  # coefficients that are gridded; more start from the prior
FAR_BELOW_M = -10.0                            # stands for a ball that never came near
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

    mean_m: Array                     # [n] above the target's centre
    near: Array                       # [n] False: the ball came nowhere near the plane, and no slope says how far off
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

    def slopes_at(self, change: Array) -> tuple[Array, Array]:
        """Score and information after `change`."""
        moves = np.concatenate([_channel_slopes(self.heights), self.heights.by_shared], axis=1)
        mean_m, spread_m = self.corrected(change)
        return _terms(self.plane.seen, replace(self.heights, mean_m=mean_m, spread_m=spread_m), moves)

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
    shared = _best_start(plane, mean, sd)
    best = _objective(plane, heights_at(plane, shared), shared, mean, sd)
    for _ in range(ROUNDS):
        heights = heights_at(plane, shared)
        score, info = _shared_terms(plane, heights)
        step = np.linalg.solve(info.sum(0) + np.diag(1.0 / sd**2), score.sum(0) + (mean - shared) / sd**2)
        for halving in range(HALVINGS):
            tried = shared + step * 0.5**halving
            value = _objective(plane, heights_at(plane, tried), tried, mean, sd)
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
    score, info = _terms(plane.seen, heights, np.concatenate([_channel_slopes(heights), heights.by_shared], axis=1))
    names = tuple(f"{term}.{parameter}" for term, parameter in plane.believed.shared) + SPREADS
    return OutcomeEvidence("outcomes", rows, CHANNELS, names, score, info, 1.0 / sd**2, (mean - shared) / sd**2,
                           outcomes.log_likelihood(plane.seen, heights.mean_m, heights.spread_m), plane, heights)


def heights_at(plane: Plane, shared: Array) -> Heights:
    """Heights, their scatter and their slopes."""
    return _scatter(plane, _fly(plane, shared[:-2]), shared[-2:])


def _fly(plane: Plane, coefficients: Array) -> tuple[Array, Array, Array, Array]:
    """(height above the target's centre [n], near [n], slopes by launch [n, 6], by coefficients [n, p])."""
    arguments = plane.believed, plane.launch, plane.spin_rev_s, plane.distance_m, coefficients
    height_m, near = (np.asarray(part) for part in plane_heights(*arguments))
    by_launch, by_shared = (np.where(near[:, None], np.asarray(part), 0.0) for part in plane_slopes(*arguments))
    target = plane.believed.facts.target
    above_m = height_m - (target.centre_height_m if target else 0.0)
    return np.where(near, above_m, FAR_BELOW_M), near, by_launch, by_shared


def _scatter(plane: Plane, flown: tuple[Array, Array, Array, Array], log_scatter: Array) -> Heights:
    """The flown heights with their spread: launch speed, what the sensors are believed to do, and the rest."""
    mean_m, near, by_launch, by_shared = flown
    noise, scatter = plane.believed.facts.noise, np.exp(log_scatter)
    by_speed = (by_launch[:, 0] * scatter[0])**2
    sensors = (by_launch[:, 1] * np.radians(noise.hood_deg))**2 + (by_launch[:, 3] * noise.distance_m)**2
    variance = by_speed + sensors + scatter[1]**2
    shares = np.stack([by_speed, np.full_like(by_speed, scatter[1]**2)], axis=1) / variance[:, None]
    return Heights(mean_m, near, np.sqrt(variance), by_launch, by_shared, shares)


def _channel_slopes(heights: Heights) -> Array:
    """Of the height by each of CHANNELS: the release height (column 2) is left to the height itself."""
    chosen = heights.by_launch[:, [0, 1, 3, 4, 5]]
    return np.concatenate([chosen, heights.near[:, None].astype(float)], axis=1)


def _shared_terms(plane: Plane, heights: Heights) -> tuple[Array, Array]:
    """Score [n, p + 2] and information [n, p + 2, p + 2] of the shared parameters."""
    return _terms(plane.seen, heights, heights.by_shared)


def _terms(seen: Seen, heights: Heights, moves: Array) -> tuple[Array, Array]:
    """Score and information of what moves the heights (`moves` [n, k]), followed by the log scatters."""
    none = np.zeros((len(moves), len(SPREADS)))
    to_mean = np.concatenate([moves, none], axis=1)
    to_spread = np.concatenate([np.zeros_like(moves), heights.log_spread_by], axis=1)
    by_mean, by_log = outcomes.slopes(seen, heights.mean_m, heights.spread_m)
    carry = np.stack([to_mean, to_spread], axis=1)
    inner = outcomes.information(seen, heights.mean_m, heights.spread_m)
    return (by_mean[:, None] * to_mean + by_log[:, None] * to_spread,
            np.einsum("nia,nij,njb->nab", carry, inner, carry))


def _objective(plane: Plane, heights: Heights, shared: Array, mean: Array, sd: Array) -> float:
    """Log posterior, up to a constant."""
    value = outcomes.log_likelihood(plane.seen, heights.mean_m, heights.spread_m).sum()
    return float(value - 0.5 * (((shared - mean) / sd)**2).sum()) if np.isfinite(value) else -np.inf


def _prior(believed: Believed) -> tuple[Array, Array]:
    mean, sd = prior(believed)
    return (np.concatenate([mean, np.log(SPREAD_MEDIANS)]),
            np.concatenate([sd, np.full(2, np.log(SPREAD_FACTOR))]))


def _best_start(plane: Plane, mean: Array, sd: Array) -> Array:
    """The best point of a grid over up to MOST_GRID coefficients and some sizes of scatter."""
    low, width = mean - 0.5 * sd, 5.0 * sd                # the catalogue's range, see motion.prior
    axes = [low[k] + width[k] * np.array(GRID) if k < MOST_GRID else mean[k:k + 1] for k in range(len(mean) - 2)]
    found = []
    for point in itertools.product(*axes):
        flown = _fly(plane, np.array(point))
        for factor in SCATTER_GRID:
            shared = np.array([*point, *(mean[-2:] + np.log(factor))])
            found.append((_objective(plane, _scatter(plane, flown, shared[-2:]), shared, mean, sd), shared))
    return max(found, key=lambda pair: pair[0])[1]
