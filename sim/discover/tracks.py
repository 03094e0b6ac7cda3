"""The believed model fitted to tracks: each flight's start is its own unknown, the coefficients are shared."""

from dataclasses import dataclass

import numpy as np

from robot.facts import Facts
from sim.discover.evidence import Array
from sim.discover.motion import STEP_S, Believed, Release, defaults, prior, track_positions, track_slopes
from sim.discover.samples import Samples, Scatter, whiten
from sim.physics.launch import exit_no_slip, is_opposed
from sim.shots import Shots

ROUNDS = 20                           # Gauss-Newton at most
HALVINGS = 10
SETTLED = 1e-7                        # largest last change, in standard deviations of a sample
MOST_SUBSTEPS = 16


@dataclass(frozen=True)
class TrackFit:
    """Fitted starts and coefficients; residual [n, L, 3] and velocity [n, L, 3] at the samples.

    `starts` [n, L, 3, 6] and `slopes` [n, L, 3, p]: derivatives of positions by each flight's start (position,
    velocity) and by the shared parameters.
    """

    samples: Samples
    scatter: Scatter
    believed: Believed
    release: Release
    shared: Array                     # [p]
    flown_m: Array
    velocity_m_s: Array
    starts: Array
    slopes: Array

    @property
    def residual_m(self) -> Array:
        return self.samples.position_m - self.flown_m


def fit_tracks(believed: Believed, samples: Samples, scatter: Scatter, spin_rev_s: Array) -> TrackFit:
    """Maximum likelihood (weak prior on shared parameters) by Gauss-Newton; spin [n, 3] is given, not fitted.

    Starts from the catalogue's defaults, where the terms are absent: tracks with free starts are then all but fitted.
    """
    substeps = substeps_for(samples)
    fit = _at(believed, samples, scatter, Release(*first_guess(samples), spin_rev_s), defaults(believed), substeps)
    cost = _cost(fit)
    for _ in range(ROUNDS):
        change, move, largest = _newton_step(fit)
        for halving in range(HALVINGS):
            part = 0.5**halving
            start = np.concatenate([fit.release.position_m, fit.release.velocity_m_s], axis=1) + part * move
            release = Release(start[:, :3], start[:, 3:], spin_rev_s)
            tried = _at(believed, samples, scatter, release, fit.shared + part * change, substeps)
            tried_cost = _cost(tried)
            if tried_cost <= cost * (1.0 + 1e-12):
                break
        else:
            break
        fit, cost = tried, tried_cost
        if largest < SETTLED:
            break
    return fit


def _newton_step(fit: TrackFit) -> tuple[Array, Array, float]:
    """Changes of the shared parameters [p] and of the starts [n, 6], and the largest change of a sample they make."""
    residual, starts, slopes = (whiten(fit.samples, fit.scatter, part)
                                for part in (fit.residual_m[..., None], fit.starts, fit.slopes))
    mean, sd = prior(fit.believed)
    kept = project_out(starts, np.concatenate([residual, slopes], axis=2))
    normal = np.einsum("nki,nkj->ij", kept[..., 1:], kept[..., 1:]) + np.diag(1.0 / sd**2)
    pull = np.einsum("nki,nk->i", kept[..., 1:], kept[..., 0]) + (mean - fit.shared) / sd**2
    change = np.linalg.solve(normal, pull) if len(pull) else np.zeros(0)
    left = residual[..., 0] - slopes @ change
    move = np.stack([np.linalg.lstsq(a, b, rcond=None)[0] for a, b in zip(starts, left, strict=True)])
    return change, move, float(np.abs(np.einsum("nki,ni->nk", starts, move) + slopes @ change).max())


def _cost(fit: TrackFit) -> float:
    """Sum of squares of white residuals and of departures from the prior."""
    mean, sd = prior(fit.believed)
    white = whiten(fit.samples, fit.scatter, fit.residual_m[..., None])
    cost = float((white**2).sum() + (((fit.shared - mean) / sd)**2).sum())
    return cost if np.isfinite(cost) else np.inf


def release_spin(facts: Facts, shots: Shots, backspin_rev_s: Array, velocity_m_s: Array) -> Array:
    """Spin [n, 3] in rev/s, launcher frame, of balls that start with velocity_m_s [n, 3].

    From all wheels where the rig is not the seed's and no spin was measured, else the given backspin about the
    horizontal axis across the flight; unknown = 0.
    """
    speed = np.maximum(np.linalg.norm(velocity_m_s, axis=1, keepdims=True), 1e-9)
    ahead = velocity_m_s / speed
    level = np.maximum(np.hypot(ahead[:, 0], ahead[:, 1]), 1e-9)
    left = np.stack([-ahead[:, 1] / level, ahead[:, 0] / level, np.zeros(len(ahead))], axis=1)
    spin = -left * np.nan_to_num(backspin_rev_s)[:, None]
    wheels = facts.launcher.wheel
    if wheels and not is_opposed(facts):
        surface = np.stack([shots.number(f"wheel_{w.name}_rad_s") * w.radius_m for w in wheels], axis=1)
        turned = exit_no_slip(facts, surface)[1] / (2.0 * np.pi)
        body = turned[:, :1] * ahead + turned[:, 1:2] * left + turned[:, 2:] * np.cross(ahead, left)
        rolled = np.isfinite(body).all(1) & np.isnan(shots.number("exit_spin_rev_s"))
        spin = np.where(rolled[:, None], body, spin)
    return spin


def substeps_for(samples: Samples) -> int:
    """Integration steps between samples that keep each below STEP_S."""
    return int(np.clip(np.ceil(np.diff(samples.time_s, axis=1).max(initial=0.0) / STEP_S), 1, MOST_SUBSTEPS))


def project_out(starts: Array, columns: Array) -> Array:
    """What is left of white columns [n, m, k] when everything that a flight's own start can do is taken out."""
    basis = np.linalg.qr(starts)[0]
    return columns - basis @ (np.swapaxes(basis, 1, 2) @ columns)


def first_guess(samples: Samples) -> tuple[Array, Array]:
    """Position and velocity at the first sample from a parabola through each track."""
    position, velocity = np.zeros((2, len(samples.rows), 3))
    for k, real in enumerate(samples.real):
        curve = np.polynomial.polynomial.polyfit(samples.time_s[k][real], samples.position_m[k][real], 2)
        position[k], velocity[k] = curve[0], curve[1]
    return position, velocity


def _at(believed: Believed, samples: Samples, scatter: Scatter, release: Release, shared: Array,
        substeps: int) -> TrackFit:
    """Flights and their slopes at one guess."""
    flown, velocity = track_positions(believed, release, shared, samples.time_s, substeps)
    starts, slopes = track_slopes(believed, release, shared, samples.time_s, substeps)
    return TrackFit(samples, scatter, believed, release, shared,
                    *(np.asarray(part) for part in (flown, velocity, starts, slopes)))
