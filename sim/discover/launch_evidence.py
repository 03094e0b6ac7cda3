"""Evidence from where tracks begin: does the ball leave as wheels and hood say?"""

import numpy as np

from sim.discover.evidence import Array, Channel, Evidence
from sim.discover.tracks import TrackFit
from sim.physics.launch import Exit

CHANNELS = (
    Channel("launch speed", "launch", "along", "1", ("the ball leaves faster", "the ball leaves slower")),
    Channel("launch elevation", "launch", "vertical", "rad", ("the ball leaves steeper", "the ball leaves flatter")),
    Channel("launch azimuth", "launch", "lateral", "rad", ("the ball leaves to the left",
            "the ball leaves to the right")),
    Channel("release height", "launch", "vertical", "m", ("the ball leaves higher up", "the ball leaves lower down")),
)
NEAREST = 1e-9                        # smallest scatter, in a channel's unit


def launch_evidence(fit: TrackFit, leaving: Exit) -> Evidence:
    """Scores of departures of each track's beginning, carried back to x = 0, from `leaving` (rows of the tracks).

    Launches scatter from shot to shot; how much is measured about their own middle (robustly), so that a common
    departure shows. Coefficients are taken as the tracks have them.
    """
    position, velocity = exit_state(fit)
    flat = np.hypot(velocity[:, 0], velocity[:, 1])
    speed = np.linalg.norm(velocity, axis=1)
    off = np.stack([np.log(np.maximum(speed, 1e-9) / np.maximum(np.asarray(leaving.speed_m_s), 1e-9)),
                    np.arctan2(velocity[:, 2], flat) - np.asarray(leaving.elevation_rad),
                    np.arctan2(velocity[:, 1], velocity[:, 0]),
                    position[:, 2] - fit.believed.facts.launcher.release_height_m], axis=1)
    sigma = np.maximum(1.4826 * np.median(np.abs(off - np.median(off, axis=0)), axis=0), NEAREST)
    info = np.zeros((len(off), len(CHANNELS), len(CHANNELS))) + np.diag(sigma**-2)
    log_score = (-0.5 * (off / sigma)**2 - np.log(sigma) - 0.5 * np.log(2.0 * np.pi)).sum(1)
    return Evidence("launch", fit.samples.rows, CHANNELS, (), off / sigma**2, info, np.zeros(0), np.zeros(0), log_score)


def exit_state(fit: TrackFit) -> tuple[Array, Array]:
    """Position and velocity [n, 3] at x = 0, along the parabola that touches each flight's beginning."""
    position, velocity = fit.release.position_m, fit.release.velocity_m_s
    ahead = np.diff(fit.velocity_m_s[:, :2], axis=1)[:, 0] / np.maximum(np.diff(fit.samples.time_s[:, :2]), 1e-9)
    back_s = -position[:, :1] / np.maximum(velocity[:, :1], 0.1)
    return position + velocity * back_s + 0.5 * ahead * back_s**2, velocity + ahead * back_s
