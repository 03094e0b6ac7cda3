"""ODR-BINDy: positions are noisy unknowns, the equation of motion is a soft constraint, and evidence selects its terms.

The method is that of Fung 2025 (arXiv 2507.23426). The cost is half of |(x - measured) / sigma|^2 + |(x'' - g -
library(x') p) / SOFT_M_S2|^2 + |p / prior sd|^2 over the positions x of every frame and the coefficients p. The
evidence for a set of terms uses Laplace's approximation with the Gauss-Newton Hessian of p after minimisation over x.
Terms are removed one at a time, always the one whose removal leaves the largest evidence; the set with the largest
evidence along that path is the answer.

This implementation differs from the authors' MATLAB code in four ways. The equation is second-order, so x are positions
and the derivatives are central differences. Many tracks share p, and a banded solver eliminates each track's x. While
terms are removed, x is updated linearly (their code refits x for each set) and is relinearised at the winning set. The
noise is not given but estimated about a smooth flight. As in their code, the noise is white and only the initial
conditions vary between shots.
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import solveh_banded

from truearc.sim.data.dataset import Dataset
from truearc.sim.infer.likelihood.observations import Samples, measure_scatter
from truearc_proof.rivals import claim as laws
from truearc_proof.rivals.claim import Array, Claim, RivalBelief, folds, rms
from truearc_proof.rivals.sindy import known_of

SOFT_M_S2 = 0.02                      # by how much the law may miss an acceleration: truncation, and no more
PRIOR = 1.0                           # standard deviation of a candidate, in usual sizes of its term
VAGUE = 10.0                          # of a believed coefficient
ROUNDS, TURNS = 2, 30                 # sets that x settles for, the whole one first, and Gauss-Newton's steps at most
SHARES, CLOSE = 0.5**np.arange(12), 1e-3      # of a step that are tried, and nats of a step that is the last
SMOOTH_DEGREE = 4                     # of each track's polynomial, where x begins
NUDGE_M_S = 1e-4
TIE = 1e-6                            # nats by which a larger set must be better
BAND = 9                              # three positions of three coordinates


class Films(NamedTuple):
    """n tracks on even steps, padded to L frames: position_m, and as a smooth curve, [n, L, 3], seen [n, L], law
    [n, L - 2]: where three frames of the track lie side by side; step_s [n]."""

    position_m: Array
    smooth_m: Array
    seen: Array
    law: Array
    step_s: Array


class State(NamedTuple):
    """Positions [n, L, 3] and coefficients [K]."""

    position_m: Array
    weights: Array


class Linear(NamedTuple):
    """Each track's part of the cost of p, x minimised out, p @ square @ p / 2 - p @ pull: square [n, K, K], pull
    [n, K]; and the step of x, by_p [n, 3 L, K] @ p + free [n, 3 L]."""

    square: Array
    pull: Array
    by_p: Array
    free: Array


class Chosen(NamedTuple):
    """A set of columns, their coefficients and standard deviations (0 for the others) [K], and the evidence in nats up
    to a constant."""

    kept: Array
    weights: Array
    sd: Array
    evidence: float


def answer(dataset: Dataset, believed: RivalBelief, seed: int = 0) -> Claim:
    """Return the claim of the set with the largest evidence; nothing in it is random."""
    return claim_of(laws.gather_flights(dataset), known_of(believed.terms))


def claim_of(flights: laws.Flights, known: tuple[str, ...]) -> Claim:
    """Choose, rank by coefficients over their standard deviations, and forecast held-out tracks by the others' law."""
    names = known + laws.candidates_of(known)
    prior = np.where(np.arange(len(names)) < len(known), VAGUE, PRIOR)
    linear = linearise_at_best(flights, names, prior, len(known))
    whole = (linear.square.sum(0), linear.pull.sum(0), prior)
    alone = np.arange(len(names)) < len(known)
    best, plain = choose(*whole, len(known)), solve(*whole, alone)
    ranked = sorted(np.flatnonzero(best.kept & ~alone), key=lambda k: -abs(best.weights[k]) / best.sd[k])
    weights = np.zeros((2, len(flights), len(names)))
    for held in folds(len(flights)):
        part = (linear.square[held.train].sum(0), linear.pull[held.train].sum(0), prior)
        weights[0, held.out] = solve(*part, alone).weights
        weights[1, held.out] = choose(*part, len(known)).weights
    before, after = (rms(laws.end_errors(flights, names, each)) for each in weights)
    figures = {"gain": best.evidence - plain.evidence}
    if ranked:
        top = ranked[0]
        figures |= {end: float(laws.usual_of(names[top]) * (best.weights[top] + far * best.sd[top]))
                    for end, far in (("low90", -1.645), ("high90", 1.645))}
    return Claim(bool(ranked), tuple(term for k in ranked for term in laws.terms_of(names[k])), before,
                 after if ranked else before, figures)


def linearise_at_best(flights: laws.Flights, names: tuple[str, ...], prior: Array, known: int) -> Linear:
    """Linearise the cost about the most probable x and p, of all columns and then of those that the evidence
    chooses."""
    films, sigma_m = film(flights), noise_of(flights)
    at, kept = State(films.smooth_m, np.zeros(len(names))), np.ones(len(names), dtype=bool)
    for _ in range(ROUNDS):
        at, linear = settle(flights, films, sigma_m, names, prior, at, kept)
        kept = choose(linear.square.sum(0), linear.pull.sum(0), prior, known).kept
    return linear


def settle(flights: laws.Flights, films: Films, sigma_m: Array, names: tuple[str, ...], prior: Array, at: State,
           kept: Array) -> tuple[State, Linear]:
    """Run Gauss-Newton from a state, halving steps until the cost falls, to where a step gains less than CLOSE nats."""
    at, cost = at._replace(weights=at.weights * kept), np.inf
    for _ in range(TURNS):
        linear = linearise(flights, films, sigma_m, names, at)
        before = cost_of(flights, films, sigma_m, names, prior, at)
        weights = solve(linear.square.sum(0), linear.pull.sum(0), prior, kept).weights
        moved = (linear.by_p @ weights + linear.free).reshape(at.position_m.shape)
        for share in SHARES:
            new = State(at.position_m + share * moved, at.weights + share * (weights - at.weights))
            cost = cost_of(flights, films, sigma_m, names, prior, new)
            if cost < before:
                at = new
                break
        if not cost < before - CLOSE:
            break
    return at, linear


def cost_of(flights: laws.Flights, films: Films, sigma_m: Array, names: tuple[str, ...], prior: Array,
            at: State) -> float:
    """Return the cost in nats."""
    velocity, bend = _differences(films, at.position_m)
    law = _library(flights, films, names, velocity) @ at.weights + laws.gravity(flights.facts)
    miss = films.law[..., None] * flights.measured * (bend - law) / SOFT_M_S2
    off = films.seen[..., None] * (films.position_m - at.position_m) / sigma_m
    return float(0.5 * ((miss**2).sum() + (off**2).sum() + ((at.weights / prior)**2).sum()))


def choose(square: Array, pull: Array, prior: Array, known: int) -> Chosen:
    """Drop candidates one by one; the smallest set on the path within TIE of the largest evidence."""
    best = now = solve(square, pull, prior, np.ones(len(pull), dtype=bool))
    while now.kept[known:].any():
        smaller = []
        for k in np.flatnonzero(now.kept[known:]) + known:
            kept = now.kept.copy()
            kept[k] = False
            smaller.append(solve(square, pull, prior, kept))
        now = max(smaller, key=lambda one: one.evidence)
        best = now if now.evidence > best.evidence - TIE else best
    return best


def solve(square: Array, pull: Array, prior: Array, kept: Array) -> Chosen:
    """Return the most probable coefficients of a set, and its evidence by Laplace's approximation."""
    weights, sd = np.zeros((2, len(pull)))
    hessian = square[np.ix_(kept, kept)] + np.diag(prior[kept]**-2.0)
    covariance = np.linalg.inv(hessian)
    weights[kept], sd[kept] = covariance @ pull[kept], np.sqrt(np.diag(covariance))
    occam = 0.5 * np.linalg.slogdet(hessian)[1] + np.log(prior[kept]).sum()
    return Chosen(kept, weights, sd, float(0.5 * pull @ weights - occam))


def film(flights: laws.Flights) -> Films:
    """Return tracks on even steps; lost frames are marked as not seen."""
    tracks = [flights.filled(k) for k in range(len(flights))]
    longest = max(len(time_s) for time_s, _ in tracks)
    position_m, smooth_m = np.zeros((2, len(tracks), longest, 3))
    seen, inside = np.zeros((2, len(tracks), longest), dtype=bool)
    step_s = np.array([time_s[1] for time_s, _ in tracks])
    for k, (time_s, path_m) in enumerate(tracks):
        powers = np.vander(time_s, SMOOTH_DEGREE + 1)
        position_m[k, :len(time_s)], inside[k, :len(time_s)] = path_m, True
        smooth_m[k, :len(time_s)] = powers @ np.linalg.lstsq(powers, path_m, rcond=None)[0]
        seen[k, np.rint(flights.time_s[k][flights.real[k]] / step_s[k]).astype(int)] = True
    return Films(position_m, smooth_m, seen, inside[:, 2:], step_s)


def noise_of(flights: laws.Flights) -> Array:
    """Return [3] standard deviations in m; an axis that was not measured gets the others'."""
    samples = Samples(np.arange(len(flights)), flights.time_s, flights.position_m, flights.real)
    sigma_m = measure_scatter(samples, flights.facts.noise.track_m).sigma_m
    noise: Array = np.where(flights.measured, sigma_m, sigma_m[flights.measured].mean())
    return noise


def linearise(flights: laws.Flights, films: Films, sigma_m: Array, names: tuple[str, ...], at: State) -> Linear:
    """Linearise the cost about a state."""
    step_s = films.step_s[:, None, None]
    velocity, bend = _differences(films, at.position_m)
    library = _library(flights, films, names, velocity)
    nudged = [(_library(flights, films, names, velocity + NUDGE_M_S * axis) - library) @ at.weights
              for axis in np.eye(3)]
    slope = np.stack(nudged, axis=-1) / NUDGE_M_S / (2.0 * step_s[..., None])
    curve = np.eye(3) / step_s[..., None]**2
    holds = films.law[..., None] * flights.measured / SOFT_M_S2
    block = holds[..., None] * np.concatenate(np.broadcast_arrays(curve + slope, -2.0 * curve, curve - slope), axis=-1)
    target, columns = holds * (bend - laws.gravity(flights.facts)), holds[..., None] * library
    precise = np.where(films.seen[..., None], sigma_m**-2.0, 1e-9 * sigma_m**-2.0)
    right = _spread(block, np.concatenate([columns, -target[..., None]], axis=-1))
    right[..., -1] += (precise * (films.position_m - at.position_m)).reshape(len(right), -1)
    moved = _solve_bands(block, precise, right)
    flat, rows = _gather(block, moved), (len(right), -1, len(names))
    columns, flat = columns.reshape(rows), flat.reshape(len(right), -1, len(names) + 1)
    back = np.swapaxes(columns, 1, 2)
    left = target.reshape(len(right), -1, 1) + flat[..., -1:]
    return Linear(back @ (columns - flat[..., :-1]), (back @ left)[..., 0], moved[..., :-1], moved[..., -1])


def _differences(films: Films, position_m: Array) -> tuple[Array, Array]:
    """(velocity, acceleration) [n, L - 2, 3]."""
    step_s = films.step_s[:, None, None]
    return ((position_m[:, 2:] - position_m[:, :-2]) / (2.0 * step_s),
            (position_m[:, 2:] - 2.0 * position_m[:, 1:-1] + position_m[:, :-2]) / step_s**2)


def _library(flights: laws.Flights, films: Films, names: tuple[str, ...], velocity: Array) -> Array:
    """[n, L - 2, 3, K]."""
    time_s = films.step_s[:, None] * np.arange(1, velocity.shape[1] + 1)
    each = (flights.spin_rev_s, flights.age, flights.density, flights.radius_m, flights.mass_kg)
    spin, *others = (part[:, None] for part in each)
    return laws.accelerations(flights.facts, names, laws.Moments(velocity, spin, time_s, *others))


def _spread(block: Array, values: Array) -> Array:
    """The blocks' transpose: rows [n, L - 2, 3, m] -> positions [n, 3 L, m]."""
    each = np.swapaxes(block, -1, -2) @ values
    whole = np.zeros((len(block), 3 * (block.shape[1] + 2), values.shape[-1]))
    for k in range(BAND):
        whole[:, k:k + 3 * block.shape[1]:3] += each[:, :, k]
    return whole


def _gather(block: Array, moved: Array) -> Array:
    """The blocks: positions [n, 3 L, m] -> rows [n, L - 2, 3, m]."""
    near = np.stack([moved[:, k:k + 3 * block.shape[1]:3] for k in range(BAND)], axis=2)
    gathered: Array = block @ near
    return gathered


def _solve_bands(block: Array, precise: Array, right: Array) -> Array:
    """Solve each track's positions: the blocks' square and the measurements' precision, in LAPACK's lower bands."""
    square = np.swapaxes(block, -1, -2) @ block
    bands = np.zeros((len(block), BAND, right.shape[1]))
    bands[:, 0] = precise.reshape(len(block), -1)
    for row in range(BAND):
        for column in range(row + 1):
            bands[:, row - column, column:column + 3 * block.shape[1]:3] += square[:, :, row, column]
    return np.stack([solveh_banded(band, each, lower=True) for band, each in zip(bands, right, strict=True)])
