"""What tracks and measured exits say about a spot: residuals and slopes made white and multiplied out, once a flight.

Near the spot all is linear, so that what they say anywhere else follows from these products alone, without samples.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from truearc.sim.infer.likelihood.forward_model import DEVIATES, Prediction
from truearc.sim.infer.likelihood.noise import UNMEASURED_M
from truearc.sim.infer.likelihood.prepared_data import Intake
from truearc.sim.infer.likelihood.track_noise import log_volume, timed_noise, whiten

Array = np.ndarray
LEAD = DEVIATES.index("lead_s")


@dataclass(frozen=True)
class Normal:
    """Normal equations of n shots in k numbers, the chain's inputs and then the D deviates.

    With white slopes W [G, k] and white residuals r [G] of a shot as seen from no deviation: inner [n, k, k] = W'W,
    onto [n, k] = W'r, square [n] = r'r. log_noise [n]: log density of noise that is nothing, constants included.
    """

    inner: Float[Array, "n k k"]
    onto: Float[Array, "n k"]
    square: Float[Array, " n"]
    log_noise: Float[Array, " n"]

    def beside(self, other: "Normal | None", share: float) -> "Normal":
        """With what a share of the other says."""
        if other is None:
            return self
        return Normal(self.inner + share * other.inner, self.onto + share * other.onto,
                      self.square + share * other.square, self.log_noise + other.log_noise)

    def at(self, change: Float[Array, "*n k"]) -> "Normal":
        """With the residuals after the k numbers change by `change` [k], or of each shot by its own [n, k]."""
        if not change.any():
            return self
        change = np.broadcast_to(change, self.onto.shape)
        taken = np.einsum("nij,nj->ni", self.inner, change)
        return replace(self, onto=self.onto - taken,
                       square=self.square - ((2.0 * self.onto - taken) * change).sum(1))


def multiply_out(intake: Intake, seen: Prediction, slopes: Prediction,
                 deviates: Float[Array, "n D"]) -> tuple[Normal, Normal | None]:
    """The normal equations of the exits seen [n] with their slopes (last axis k), about deviates [n, D], and those of
    the tracks."""
    exits = _product(_exit_part(intake, seen, slopes), deviates)
    tracks = _track_part(intake, seen, slopes, deviates.shape[1])
    return exits, None if tracks is None else _product(tracks, deviates)


def _product(part: tuple[Float[Array, "n G inputs"], Float[Array, " n"]], deviates: Float[Array, "n D"]) -> Normal:
    raw, log_noise = part
    # as seen from no deviation: the prior's mean
    raw[..., 0] += np.einsum("ngd,nd->ng", raw[..., raw.shape[2] - deviates.shape[1]:], deviates)
    with np.errstate(over="ignore", invalid="ignore"):     # far from all that flies there is no likelihood: not finite
        product = np.swapaxes(raw, 1, 2) @ raw
    return Normal(product[:, 1:, 1:], product[:, 1:, 0], product[:, 0, 0], log_noise)


def _exit_part(intake: Intake, seen: Prediction,
               slopes: Prediction) -> tuple[Float[Array, "n 3 inputs"], Float[Array, " n"]]:
    """(white [n, 3, 1 + k] of the measured exits, log density); unmeasured ones are 0."""
    known = np.isfinite(intake.exits)
    off = np.where(known, intake.exits - seen.exit, 0.0) / intake.exit_sd
    white = np.where(known[..., None], slopes.exit / intake.exit_sd[..., None], 0.0)
    log_noise = -(known * (np.log(intake.exit_sd) + 0.5 * np.log(2.0 * np.pi))).sum(1)
    return np.concatenate([off[..., None], white], axis=2), log_noise


def _track_part(intake: Intake, seen: Prediction, slopes: Prediction,
                deviates: int) -> tuple[Float[Array, "n G inputs"], Float[Array, " n"]] | None:
    """(white [n, 3 L, 1 + k] of the tracks, log density); shots without one are 0. deviates: how many of k, the last.

    A later release leaves every sample as much earlier in the flight, so that slopes by it are velocities.
    """
    if intake.samples is None or intake.scatter is None:
        return None
    rows, samples, n = intake.tracked, intake.samples, len(intake.rows)
    raw = np.concatenate([(samples.position_m - seen.track_m[rows])[..., None], slopes.track_m[rows]], axis=3)
    unmeasured = intake.scatter.sigma_m >= UNMEASURED_M
    if unmeasured.any():              # nothing at all: tests have no scale, so a tiny score of one sign is significant
        raw[:, :, unmeasured] = 0.0
    log_noise = np.zeros(n)
    log_noise[rows] = log_volume(samples, intake.scatter)
    if samples.clock_s is not None:
        by_release = np.asarray(slopes.track_m)[rows, :, 2, slopes.track_m.shape[3] - deviates + LEAD]
        wider = timed_noise(samples, by_release)
        raw /= wider[:, :, None, None]
        log_noise[rows] -= (np.log(wider) * samples.real).sum(1)
    white = np.zeros((n, 3 * raw.shape[1], raw.shape[3]))
    white[rows] = whiten(samples, intake.scatter, raw)
    return white, log_noise


def noise_terms(tracks: Normal, mean: Float[Array, "n D"], covariance: Float[Array, "n D D"],
                counts: Float[Array, " n"], share: float) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """Score and information of the log of how many times as noisy tracks are as measured, 1 / sqrt(share).

    mean, covariance: of the deviates given what was seen; counts [n]: numbers of each track.
    """
    deviates = mean.shape[1]
    inner, onto = tracks.inner[:, -deviates:, -deviates:], tracks.onto[:, -deviates:]
    absorbed = share * np.einsum("nde,ned->n", covariance, inner)
    off = tracks.square - 2.0 * (onto * mean).sum(1) + np.einsum("nd,nde,ne->n", mean, inner, mean)
    return share * off + absorbed - counts, 2.0 * np.maximum(counts - absorbed, 0.0)
