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

    def at(self, change: Float[Array, " k"]) -> "Normal":
        """With the residuals after the k numbers change by `change` [k]."""
        if not change.any():
            return self
        taken = self.inner @ change
        return replace(self, onto=self.onto - taken, square=self.square - (2.0 * self.onto - taken) @ change)


def multiply_out(intake: Intake, seen: Prediction, slopes: Prediction, deviates: Float[Array, "n D"]) -> Normal:
    """The normal equations of what is seen [n] and its slopes (last axis k), about deviates [n, D]."""
    parts = [_exit_part(intake, seen, slopes), *_track_part(intake, seen, slopes, deviates.shape[1])]
    raw = np.concatenate([part[0] for part in parts], axis=1)
    # as seen from no deviation: the prior's mean
    raw[..., 0] += np.einsum("ngd,nd->ng", raw[..., raw.shape[2] - deviates.shape[1]:], deviates)
    with np.errstate(over="ignore", invalid="ignore"):     # far from all that flies there is no likelihood: not finite
        product = np.swapaxes(raw, 1, 2) @ raw
    log_noise = sum((part[1] for part in parts), np.zeros(len(deviates)))
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
                deviates: int) -> list[tuple[Float[Array, "n G inputs"], Float[Array, " n"]]]:
    """(white [n, 3 L, 1 + k] of the tracks, log density); shots without one are 0. deviates: how many of k, the last.

    A later release leaves every sample as much earlier in the flight, so that slopes by it are velocities.
    """
    if intake.samples is None or intake.scatter is None:
        return []
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
    return [(white, log_noise)]
