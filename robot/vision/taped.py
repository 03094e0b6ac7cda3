"""Focal length from distances measured with a tape: scale and bias, their standard deviations, and the residuals."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from truearc.hw.protocols import CameraFrame
from truearc.robot.config.schema import CameraConfig, Tape, Vision
from truearc.robot.types import Sighting
from truearc.robot.vision import detect
from truearc.robot.vision.optics import Array

FOCAL_SIGMA = 0.05                    # assumed of a calibration that states none: makers' figures are this good
ROUNDS = 4                            # distances follow the focal length almost in proportion
LEAST = 2                             # images


class TapedFit(NamedTuple):
    """`camera` has the new focal lengths and bias, with their sigmas; the rest is about the images used."""

    camera: CameraConfig
    scale: float                      # new focal lengths / old ones
    correlation: float                # between scale and bias
    sightings: tuple[Sighting, ...]   # with the new camera
    residual_m: Array                 # estimate - taped, with the new camera
    expected_m: Array                 # one sigma of each residual, the fit's own uncertainty not included
    inflated: float                   # 1, or how much worse than expected the residuals are: sigmas are as much larger


def fit_taped(frames: Sequence[CameraFrame], taped_m: Sequence[float], camera: CameraConfig, tape: Tape,
              vision: Vision, *, tape_sigma_m: float, bias_sigma_m: float) -> TapedFit | None:
    """Least squares of taped horizontal distances against those seen, with what was believed before as two more rows:
    scale 1 within the calibration's uncertainty, bias as configured within `bias_sigma_m` (how well it is known where
    the tape measure began). None when the target is found in fewer than LEAST of the images."""
    prior_sigma = camera.focal_sigma or FOCAL_SIGMA
    log_scale, bias_m = 0.0, camera.bias_m
    for _ in range(ROUNDS):
        now = replace(camera, fx_px=camera.fx_px * math.exp(log_scale), fy_px=camera.fy_px * math.exp(log_scale),
                      bias_m=bias_m, focal_sigma=0.0, bias_sigma_m=0.0)
        sightings = [detect(frame, now, tape, vision) for frame in frames]
        used = [k for k, sighting in enumerate(sightings) if sighting.found]
        if len(used) < LEAST:
            return None
        seen_m = np.array([sightings[k].distance_m for k in used], dtype=np.float64)
        residual_m = seen_m - np.array([taped_m[k] for k in used])
        expected_m = np.hypot([float(sightings[k].sigma_m or 0.0) for k in used], tape_sigma_m)
        rows = np.column_stack([(seen_m + bias_m) / expected_m, -1.0 / expected_m])
        rows = np.vstack([rows, [1.0 / prior_sigma, 0.0], [0.0, 1.0 / bias_sigma_m]])
        believed = [log_scale / prior_sigma, (bias_m - camera.bias_m) / bias_sigma_m]
        off = np.concatenate([residual_m / expected_m, believed])
        covariance = np.linalg.inv(rows.T @ rows)
        step = covariance @ rows.T @ off
        log_scale, bias_m = log_scale - float(step[0]), bias_m - float(step[1])
    inflated = max(1.0, math.sqrt(float(off @ off) / len(used)))
    sigma = inflated * np.sqrt(np.diag(covariance))
    fitted = replace(now, focal_sigma=float(sigma[0]), bias_sigma_m=float(sigma[1]))
    again = tuple(detect(frame, fitted, tape, vision) for frame in frames)
    residual_m = np.array([(again[k].distance_m or seen) - taped_m[k] for k, seen in zip(used, seen_m, strict=True)])
    correlation = float(covariance[0, 1] / math.sqrt(covariance[0, 0] * covariance[1, 1]))
    return TapedFit(fitted, math.exp(log_scale), correlation, again, residual_m, expected_m, inflated)
