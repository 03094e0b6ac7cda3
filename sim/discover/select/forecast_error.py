"""How far off a forecast is: at the end of each track from its first part, or of the height at the plane."""

import numpy as np
from jaxtyping import Float

from truearc.sim.infer.likelihood.data import Intake
from truearc.sim.infer.likelihood.layout import LinearizationPoint, ParameterLayout
from truearc.sim.infer.likelihood.linearization import LEAD, TRACK, fly, variance_of
from truearc.sim.infer.likelihood.noise import TIMED_M
from truearc.sim.infer.likelihood.observations import timed_noise, whiten
from truearc.sim.infer.likelihood.score_table import Array, ScoreTable

FORECAST = 0.4                        # of a track's samples: from these its end is forecast


def end_errors(intake: Intake, layout: ParameterLayout, spot: LinearizationPoint, evidence: ScoreTable,
               change: Float[Array, "n P"]) -> float | None:
    """RMS error in m of forecast heights, columns changed by `change` [n, P]; None where no height was measured.

    With tracks: at each one's last sample, the shot's own deviation taken from its first FORECAST of samples. Without:
    heights measured at the plane against those of the evidence.
    """
    if intake.filmed:
        errors = track_errors(intake, layout, spot, change)[:, 2]
    else:
        if evidence.plane is None or not evidence.plane.seen.measured.any():
            return None
        seen, mean_m, _ = evidence.heights(change)
        errors = (mean_m - seen.height_m)[seen.measured]
    return float(np.sqrt(np.mean(errors**2)))


def side_errors(intake: Intake, layout: ParameterLayout, spot: LinearizationPoint,
                change: Float[Array, "n P"]) -> float:
    """RMS error in m of y at each track's last sample, forecast as the height is by end_errors."""
    return float(np.sqrt(np.mean(track_errors(intake, layout, spot, change)[:, 1]**2)))


def times_off(intake: Intake, layout: ParameterLayout, spot: LinearizationPoint) -> float | None:
    """RMS of what times at heights differ from the simulation by, in their own standard deviations; None without."""
    samples, rows = intake.samples, intake.tracked
    if samples is None or samples.clock_s is None:
        return None
    flown = fly(intake, layout, spot)
    speed_m_s = np.asarray(flown.slopes.track_m)[rows, :, 2, len(layout.inputs) + LEAD]
    off = (samples.position_m - flown.seen.track_m[rows])[..., 2] / (TIMED_M * timed_noise(samples, speed_m_s))
    return float(np.sqrt(np.mean(off[samples.real]**2)))


def track_errors(intake: Intake, layout: ParameterLayout, spot: LinearizationPoint, change: Float[Array, "n P"],
                 share: float = FORECAST) -> Float[Array, "k 3"]:
    """[k, 3] in m: each track's last sample less its forecast from the first `share` of its samples; 0: from the
    settings alone."""
    samples, rows, scatter = intake.samples, intake.tracked, intake.scatter
    assert samples is not None and scatter is not None
    inputs = layout.inputs
    columns = np.flatnonzero(layout.source >= 0)
    flown = fly(intake, layout, spot)
    seen, slopes = flown.seen, flown.slopes
    by_column, by_deviate = np.split(slopes.track_m[rows], [len(inputs)], axis=3)
    by_column = by_column[..., :len(columns)]
    off = (samples.position_m - seen.track_m[rows] - np.einsum("klcp,kp->klc", by_column, change[rows][:, columns])
           + np.einsum("klcd,kd->klc", by_deviate, spot.deviates[rows]))
    sd = np.sqrt(variance_of(intake, spot.log_scatter))[rows][:, :by_deviate.shape[3]]
    white = whiten(samples, scatter, np.concatenate([off[..., None], by_deviate * sd[:, None, None, :]], axis=3))
    white /= np.exp(spot.log_scatter[TRACK])
    errors = np.zeros((len(rows), 3))
    for k, count in enumerate(samples.real.sum(1)):
        early = white[k, :3 * max(int(share * count), 4 if share else 0)]
        slope = early[:, 1:]
        told = np.linalg.solve(np.eye(slope.shape[1]) + slope.T @ slope, slope.T @ early[:, 0])
        errors[k] = off[k, count - 1] - by_deviate[k, count - 1] @ (sd[k] * told)
    return errors
