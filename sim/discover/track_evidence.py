"""Evidence from fitted tracks: accelerations along the flight in each direction, and the tracker's own errors."""

from itertools import pairwise

import numpy as np

from sim.discover.evidence import Array, Channel, Evidence
from sim.discover.motion import DIRECTIONS, prior, track_pushes
from sim.discover.samples import whiten
from sim.discover.tracks import TrackFit, project_out, substeps_for

BANDS = 4                             # of flight time
FORECAST = 0.4                        # of a flight's samples from which its end is forecast
WORDS = {"along": ("the ball is driven along its flight", "the ball is held back along its flight"),
         "vertical": ("the ball is lifted across its flight", "the ball is pressed down across its flight"),
         "lateral": ("the ball is pushed to the left", "the ball is pushed to the right")}
TRACKER = (
    Channel("track scale", "sensing", "vertical", "1", ("tracks are too large", "tracks are too small"), "sensor"),
    Channel("track pitch", "sensing", "along", "rad", ("tracks are pitched down", "tracks are pitched up"), "sensor"),
    Channel("track roll", "sensing", "lateral", "rad", ("tracks are rolled right", "tracks are rolled left"), "sensor"),
    Channel("track clock", "sensing", "vertical", "1", ("the tracker's clock is slow", "the tracker's clock is fast"),
            "sensor"),
)


def push_columns(fit: TrackFit) -> tuple[tuple[Channel, ...], Array]:
    """Channels, and what a unit of each adds to the positions [n, L, 3, C] in m."""
    samples = fit.samples
    edges_s = np.quantile(samples.time_s[samples.real], np.arange(1, BANDS) / BANDS)
    speed_m_s = float(np.linalg.norm(fit.velocity_m_s, axis=2)[samples.real].mean())
    pushes = track_pushes(fit.believed, fit.release, fit.shared, samples.time_s, edges_s, speed_m_s,
                          substeps_for(samples))
    bounds = [0.0, *edges_s.tolist(), float(samples.time_s.max())]
    channels = tuple(channel for direction in DIRECTIONS for channel in _pushes(direction, bounds))
    return channels + TRACKER, np.concatenate([np.asarray(pushes), _tracker_columns(fit)], axis=3)


def track_evidence(fit: TrackFit, channels: tuple[Channel, ...], columns: Array) -> Evidence:
    """Scores of every channel with each flight's start projected out."""
    raw = np.concatenate([fit.residual_m[..., None], columns, fit.slopes], axis=3)
    white = whiten(fit.samples, fit.scatter, raw)
    kept = project_out(whiten(fit.samples, fit.scatter, fit.starts), white)
    residual, slopes = kept[..., 0], kept[..., 1:]
    mean, sd = prior(fit.believed)
    # a flat prior on each start leaves 3 L - 6 independent unit normals a track
    freedom = 3 * fit.samples.real.sum(1) - 6
    log_score = -0.5 * (residual**2).sum(1) - 0.5 * freedom * np.log(2.0 * np.pi)
    return Evidence("tracks", fit.samples.rows, channels,
                    tuple(f"{term}.{parameter}" for term, parameter in fit.believed.shared),
                    np.einsum("nki,nk->ni", slopes, residual), np.einsum("nki,nkj->nij", slopes, slopes),
                    1.0 / sd**2, (mean - fit.shared) / sd**2, log_score)


def end_forecasts(fit: TrackFit, columns: Array, amplitude: Array) -> tuple[Array, Array]:
    """Errors [n] of the height at each track's end in m, forecast from its first part: as believed, and corrected.

    `columns` [n, L, 3] is what a unit of the correction adds to positions, `amplitude` [n] how much of it each shot
    gets. The start of each flight is fitted to its first FORECAST of samples, in both cases; coefficients stay.
    """
    raw = np.stack([fit.residual_m, fit.residual_m - amplitude[:, None, None] * columns], axis=3)
    starts = whiten(fit.samples, fit.scatter, fit.starts)
    white = whiten(fit.samples, fit.scatter, raw)
    errors = np.zeros((len(raw), 2))
    for k, count in enumerate(fit.samples.real.sum(1)):
        early = 3 * max(int(FORECAST * count), 4)
        moved = np.linalg.lstsq(starts[k, :early], white[k, :early], rcond=None)[0]
        errors[k] = raw[k, count - 1, 2] - fit.starts[k, count - 1, 2] @ moved
    return errors[:, 0], errors[:, 1]


def _pushes(direction: str, bounds: list[float]) -> list[Channel]:
    """Throughout the flight, in each band of its time, and with the speed: as motion.track_pushes orders them."""
    words = WORDS[direction]
    bands = [Channel(f"push {direction} from {first:.2f} to {last:.2f} s", "flight", direction, "m/s2", words,
                     "time_in_flight_s", (first, last)) for first, last in pairwise(bounds)]
    return [Channel(f"push {direction}", "flight", direction, "m/s2", words), *bands,
            Channel(f"push {direction} in proportion to speed", "flight", direction, "m/s2", words,
                    "speed_in_flight_m_s")]


def _tracker_columns(fit: TrackFit) -> Array:
    """What a tracker with a wrong scale, pitch, roll or clock would add to the positions, per unit."""
    x, y, z = np.moveaxis(fit.flown_m - fit.flown_m[:, :1], 2, 0)
    none = np.zeros_like(x)
    scale, pitch = np.stack([x, y, z], axis=2), np.stack([z, none, -x], axis=2)
    roll, clock = np.stack([none, -z, y], axis=2), fit.velocity_m_s * fit.samples.time_s[..., None]
    return np.stack([scale, pitch, roll, clock], axis=3)

