"""Camera calibration from pictures of a flat board, or from distances measured with a tape.

A board gives the focal length, axis and lens distortion with their standard deviations. The pixels are assumed to be
square and the third radial term to be zero: both hold for any webcam, and values fitted to a few pictures would be
noise. Taped distances give the scale of the focal length and a bias.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from msgspec.structs import replace

from truearc.hw.protocols import CameraFrame
from truearc.robot.config.schema import CameraConfig, Tape, Vision
from truearc.robot.types import Sighting
from truearc.robot.vision import detect, marks, pose

LEAST_VIEWS = 4
SAME_PX = 2.0                         # views whose corners all lie nearer to each other's are one view
MOST_FOCAL_SIGMA = 0.03               # of a focal length that is determined; a maker's figure is as good
LEAST_SLANT_DEG = 10.0                # of the board most slanted: facing boards are as small at any focal length
LEAST_POINTS = 8                      # of a ChArUco board that is partly seen
FIXED = cv2.CALIB_FIX_ASPECT_RATIO | cv2.CALIB_FIX_K3 | cv2.CALIB_USE_INTRINSIC_GUESS
FOCAL_SIGMA = 0.05                    # assumed of a calibration that states none: makers' figures are this good
ROUNDS = 4                            # distances follow the focal length almost in proportion
LEAST = 2                             # images


class Board(NamedTuple):
    """`columns` x `rows` inner corners of a chessboard, or squares of a ChArUco board."""

    columns: int
    rows: int
    square_m: float
    marker_m: float = 0.0             # 0 = a chessboard
    dictionary: str = ""              # of a ChArUco board, as OpenCV calls it


class BoardView(NamedTuple):
    """One picture of a board."""

    points_m: npt.NDArray[np.float32]     # (n, 3) on the board
    seen_px: npt.NDArray[np.float32]      # (n, 2)


class BoardFit(NamedTuple):
    camera: CameraConfig
    error_px: tuple[float, ...]       # root mean square of each view
    slant_deg: float                  # of the board most slanted, against facing the camera


def find_board(image: marks.Image, board: Board) -> BoardView | None:
    """Find the board's corners in a BGR or grey image; None if it is not in view (for a chessboard, entirely)."""
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    if board.marker_m > 0.0:
        return _find_charuco(grey, board)
    found, corners = cv2.findChessboardCornersSB(grey, (board.columns, board.rows), flags=cv2.CALIB_CB_ACCURACY)
    if not found:
        return None
    column, row = np.meshgrid(np.arange(board.columns), np.arange(board.rows))
    flat = np.column_stack([column.ravel(), row.ravel(), np.zeros(column.size)]) * board.square_m
    return BoardView(flat.astype(np.float32), np.asarray(corners, np.float32).reshape(-1, 2))


def _find_charuco(grey: marks.Image, board: Board) -> BoardView | None:
    marked = cv2.aruco.CharucoBoard((board.columns, board.rows), board.square_m, board.marker_m,
                                    cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary)))
    corners, ids, _, _ = cv2.aruco.CharucoDetector(marked).detectBoard(grey)
    if ids is None or len(ids) < LEAST_POINTS:
        return None
    places = np.asarray(marked.getChessboardCorners(), np.float32).reshape(-1, 3)[np.ravel(ids)]
    return BoardView(places, np.asarray(corners, np.float32).reshape(-1, 2))


def is_same(view: BoardView, other: BoardView) -> bool:
    """Return whether neither board nor camera moved between two views: together they say no more than one."""
    return view.seen_px.shape == other.seen_px.shape and bool(np.array_equal(view.points_m, other.points_m)) and bool(
        np.abs(view.seen_px - other.seen_px).max() < SAME_PX)


def calibrate(views: Sequence[BoardView], camera: CameraConfig) -> BoardFit:
    """Calibrate the camera from the views, of which there are at least LEAST_VIEWS, all of its image size.

    One sigma is the larger of what the corners' scatter gives and of what leaving out one view after another does
    (jackknife): views err as wholes where a board is bent or an exposure shaken.
    """
    focal_px, centre_px, distortion, errors_px, said, slant_deg = _solve(views, camera)
    left_out = [_solve([view for k, view in enumerate(views) if k != out], camera)[:2] for out in range(len(views))]
    share = (len(views) - 1) / len(views)
    focal_sigma = math.sqrt(share * sum((focal / focal_px - 1.0) ** 2 for focal, _ in left_out))
    centre_sigma_px = math.sqrt(share * sum(float(((centre - centre_px) ** 2).sum()) / 2 for _, centre in left_out))
    fitted = replace(camera, fx_px=focal_px, fy_px=focal_px, cx_px=float(centre_px[0]), cy_px=float(centre_px[1]),
                     distortion=distortion, focal_sigma=max(focal_sigma, float(said[0]) / focal_px),
                     aspect_sigma=pose.SQUARE_SIGMA, centre_sigma_px=max(centre_sigma_px, float(said[1])),
                     bias_m=0.0, bias_sigma_m=0.0)
    return BoardFit(fitted, errors_px, slant_deg)


def _solve(views: Sequence[BoardView],
           camera: CameraConfig) -> tuple[float, pose.Array, Any, tuple[float, ...], pose.Array, float]:
    """Focal length, centre (2,), distortion, error of each view, the stated sigmas (2,) of the first two, and the
    largest angle between a board and one that faces the camera."""
    size = (camera.width_px, camera.height_px)
    focal = math.sqrt(camera.fx_px * camera.fy_px)
    start = np.array([[focal, 0.0, size[0] / 2 - 0.5], [0.0, focal, size[1] / 2 - 0.5], [0.0, 0.0, 1.0]])
    _, matrix, distortion, turns, _, spread, _, errors = cv2.calibrateCameraExtended(
        [view.points_m for view in views], [view.seen_px for view in views], size, start, np.zeros(5), flags=FIXED)
    k1, k2, p1, p2, k3 = (float(part) for part in np.ravel(distortion)[:5])
    sigma = np.ravel(spread)
    said = np.array([max(sigma[0], sigma[1]), max(sigma[2], sigma[3])])
    return (float(matrix[0, 0]), np.asarray(matrix[:2, 2]), (k1, k2, p1, p2, k3),
            tuple(float(error) for error in np.ravel(errors)), said, max(map(_slant_deg, turns)))


def _slant_deg(turn: Any) -> float:
    """Of a board's normal against the optical axis."""
    return math.degrees(math.acos(min(1.0, abs(float(cv2.Rodrigues(np.asarray(turn))[0][2, 2])))))


class TapedFit(NamedTuple):
    """`camera` has the new focal lengths and bias, with their sigmas; the rest is about the images used."""

    camera: CameraConfig
    scale: float                      # new focal lengths / old ones
    correlation: float                # between scale and bias
    sightings: tuple[Sighting, ...]   # with the new camera
    residual_m: pose.Array                 # estimate - taped, with the new camera
    expected_m: pose.Array                 # one sigma of each residual, the fit's own uncertainty not included
    inflated: float                   # 1, or how much worse than expected the residuals are: sigmas are as much larger


def fit_taped(frames: Sequence[CameraFrame], taped_m: Sequence[float], camera: CameraConfig, tape: Tape,
              vision: Vision, *, tape_sigma_m: float, bias_sigma_m: float) -> TapedFit | None:
    """Fit taped horizontal distances to measured ones by least squares, with the prior knowledge as two more rows.

    These are scale 1 within the calibration's uncertainty, and the configured bias within `bias_sigma_m` (how well it
    is known where the tape measure began). None if the target is found in fewer than LEAST of the images.
    """
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
