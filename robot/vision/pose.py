"""Camera and target geometry for vision: the lens (Optics), the target's shape, and the camera pose with covariance.

A calibration is valid for one image size. An image of another size is assumed to be another mode of the same sensor
that shows its full height: focal length and principal point scale with the image's height, and a wider image only shows
more on both sides. Webcam sensors are 16:9 and crop the sides for 4:3. The LifeCam HD-3000's stated 68.5-degree
diagonal field of view confirms this: 719 px at 480 lines when scaled from 720, against 539 px if the height were
cropped.

A rolling shutter reads one row after another, so a camera that turns during exposure shears its picture, and a camera
that nods stretches it. A single image can hardly distinguish this from a more oblique view of the target. The maximum
rate of turn is therefore configured, and a picture that is smeared sideways shows that the camera turns.

Two properties hold for any camera without calibration: its pixels are square and its axis is near the centre of the
image. A calibration with standard deviations is weighed against these properties; any other calibration is used
unchanged.

In the target's frame, x points right and y up as the viewer sees them, z points towards the viewer, and the origin is
midway between the outer top and bottom edges; coordinates are in metres. Vision measures four `marks`: the
intersections of the tape's centre lines at the bottom, and their ends at the top. Blur, bloom and overexposure move
both edges of a thin tape outward by the same amount and leave its middle in place.

The pose is computed in two steps. IPPE (the closed form for flat targets) gives the starting point, and Gauss-Newton
then minimises the marks' residuals, weighted by their covariance, together with three priors on the mounting: lens
height, pitch, and zero roll (with the same uncertainty as the pitch). The covariance combines that of the edges, a
floor for errors that edges do not show, and the uncertainty of the camera. The tape hangs upright, so its pose alone
determines the camera's height and pitch; its size, slant and elevation contribute to the distance according to their
precision.
"""

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from truearc.hw.reason import Code, Reason
from truearc.robot import reasons as because
from truearc.robot.config.schema import AprilTag, CameraConfig, Tape
from truearc.robot.types import Sighting

SQUARE_SIGMA = 0.002                  # of fy / fx about 1: lithography does better, lenses may not
BEND_SHARE = 0.08                     # of the image's height: reach of an unmodelled bending; two waves a frame have it
MIDDLE_SIGMA = 0.02                   # of the axis about the image's middle, as a share of its height
SHORT_S = 0.005                       # of an exposure that is not configured
NODDING = 0.2                         # of a camera's turning is up or down: robots turn about the vertical
Array = npt.NDArray[np.float64]
PROBES = 9                            # points on each of the tape's three straights
SAMPLES = 24                          # places along each of them where its middle is measured
FIRST, LAST = 0.16, 0.84              # of a straight; near its ends the other straights disturb it
TIP_ROWS = (-0.2, -0.1, 0.0, 0.1, 0.2)    # beside the middle line, in tape widths, where the cut ends are measured
STRAIGHTS = ((0, 1), (1, 2), (3, 0))  # marks at the ends of the bottom, left and right straight


@dataclass(frozen=True)
class Optics:
    """Pinhole `matrix` (3, 3) in px and Brown `distortion` (5,), for images of one size."""

    width_px: int
    height_px: int
    scale: float                      # pixels of this image per pixel of the calibration's
    matrix: Array
    distortion: Array | None          # None = a perfect pinhole
    doubts: tuple[float, float, float]    # one sigma: focal length (share), fy / fx (share), either centre (px)
    turns: tuple[float, float]        # one sigma: px right and px down that a rolling shutter adds from row to row
    exposures: float                  # this many exposures pass from row to row

    def undistort(self, points_px: Any) -> Array:
        """Convert (n, 2) image pixels to pixels of a perfect pinhole with the same matrix."""
        points = np.asarray(points_px, dtype=np.float64).reshape(-1, 2)
        if self.distortion is None or not len(points):
            return points
        ideal = cv2.undistortPoints(points.reshape(-1, 1, 2), self.matrix, self.distortion, P=self.matrix)
        return np.asarray(ideal, dtype=np.float64).reshape(-1, 2)

    def distort(self, points_px: Array) -> Array:
        """Invert undistort."""
        if self.distortion is None:
            return points_px
        rays = np.column_stack([points_px, np.ones(len(points_px))]) @ np.linalg.inv(self.matrix).T
        seen, _ = cv2.projectPoints(rays.reshape(-1, 1, 3), np.zeros(3), np.zeros(3), self.matrix, self.distortion)
        return np.asarray(seen, dtype=np.float64).reshape(-1, 2)

    def smooth_spread(self, points_px: Array, sigma_px: float) -> Array:
        """Return (2 n, 2 n): covariance of (n, 2) pixels displaced by a smooth distortion of the image of `sigma_px`.

        This covers the remaining lens distortion and a rolling shutter that shakes. Neighbours are displaced together.
        """
        away = points_px[:, None, :] - points_px
        near = np.exp(-(away * away).sum(axis=2) / (2.0 * (BEND_SHARE * self.height_px) ** 2))
        spread = np.zeros((2 * len(points_px), 2 * len(points_px)))
        spread[::2, ::2] = spread[1::2, 1::2] = sigma_px**2 * near
        return spread

    def smeared(self, smear_px2: float) -> "Optics":
        """Return these optics with the larger motion, from row to row, that a smear of the image reveals."""
        if smear_px2 == 0.0:
            return self
        right, down = self.turns
        seen = self.exposures * math.sqrt(abs(smear_px2))
        sideways = (math.hypot(right, seen), down)
        return replace(self, turns=sideways if smear_px2 > 0.0 else (right, math.hypot(down, seen)))

    def camera_spread(self, points_px: Array) -> Array:
        """Return (2 n, 2 n): covariance of (n, 2) ideal pixels from the calibration's uncertainty and a camera that
        turns while its rows are read, which shears the picture or stretches it from row to row."""
        off = points_px - self.matrix[:2, 2]
        focal, aspect, centre_px = self.doubts
        shifts = np.zeros((6, len(points_px), 2))
        shifts[0] = focal * off
        shifts[1] = 0.5 * aspect * off * np.array([-1.0, 1.0])
        shifts[2, :, 0] = shifts[3, :, 1] = centre_px
        rows = points_px[:, 1] - points_px[:, 1].mean()
        shifts[4, :, 0], shifts[5, :, 1] = self.turns[0] * rows, self.turns[1] * rows
        flat = shifts.reshape(6, -1)
        return np.asarray(flat.T @ flat, dtype=np.float64)


@lru_cache(maxsize=8)
def make_optics(camera: CameraConfig, width_px: int, height_px: int) -> Optics:
    """Return the camera's optics for an image of this size, cached; the module docstring describes other sizes than the
    calibration's."""
    scale = height_px / camera.height_px
    middle_sigma_px = MIDDLE_SIGMA * camera.height_px
    aspect, aspect_sigma = _weigh(math.log(camera.fy_px / camera.fx_px), camera.aspect_sigma, 0.0, SQUARE_SIGMA)
    cx, centre_sigma_px = _weigh(camera.cx_px, camera.centre_sigma_px, camera.width_px / 2 - 0.5, middle_sigma_px)
    cy, _ = _weigh(camera.cy_px, camera.centre_sigma_px, camera.height_px / 2 - 0.5, middle_sigma_px)
    focal_px = math.sqrt(camera.fx_px * camera.fy_px) * scale
    cx_px = (cx + 0.5 - camera.width_px / 2) * scale + width_px / 2 - 0.5
    cy_px = (cy + 0.5) * scale - 0.5
    matrix = np.array([[focal_px * math.exp(-aspect / 2), 0.0, cx_px], [0.0, focal_px * math.exp(aspect / 2), cy_px],
                       [0.0, 0.0, 1.0]])
    shear = math.radians(camera.turn_sigma_deg_s) * camera.readout_s * focal_px / height_px
    distortion = np.array(camera.distortion, dtype=np.float64) if any(camera.distortion) else None
    return Optics(width_px, height_px, scale, matrix, distortion,
                  (camera.focal_sigma, aspect_sigma, centre_sigma_px * scale), (shear, NODDING * shear),
                  camera.readout_s / height_px / (camera.exposure_s or SHORT_S))


def _weigh(stated: float, sigma: float, usual: float, usual_sigma: float) -> tuple[float, float]:
    """A stated value weighed against what is usual, and its sigma."""
    share = sigma**2 / (sigma**2 + usual_sigma**2)
    return stated + share * (usual - stated), usual_sigma * math.sqrt(share)


@dataclass(frozen=True)
class Shape:
    """The shape that vision looks for. The arrays are shared and must not be modified."""

    corners_m: Array                  # (4, 3) outer corners: bottom right, bottom left, top left, top right
    marks_m: Array                    # (4, 3) the middle lines' ends, in the same order
    samples_m: Array                  # (3, SAMPLES, 2) on the middle lines
    across_m: Array                   # (3, 1, 2) from a middle line to the outer edge
    tips_m: Array                     # (2, len(TIP_ROWS), 2) on the cut ends: left, right
    up_m: Array                       # (2, 1, 2) from a tip on along the tape, half the tape's width long
    probes_m: Array                   # (3 PROBES + 12, 3): first on the tape, then inside its opening


@lru_cache(maxsize=8)
def make_shape(tape: Tape) -> Shape:
    """Return the shape of a tape of these dimensions, cached."""
    marks = _marks_m(tape)
    ends = np.array([(marks[a], marks[b]) for a, b in STRAIGHTS])
    along = ends[:, 1] - ends[:, 0]
    along /= np.linalg.norm(along, axis=1)[:, None]
    across = np.column_stack([along[:, 1], -along[:, 0]]) * -tape.tape_width_m / 2
    share = np.linspace(FIRST, LAST, SAMPLES)[None, :, None]
    samples = ends[:, None, 0] * (1 - share) + ends[:, None, 1] * share
    up = np.array([along[1], -along[2]]) * tape.tape_width_m / 2
    rows = np.array(TIP_ROWS)[:, None] * np.array([tape.tape_width_m * math.hypot(1.0, _flare(tape)), 0.0])
    return Shape(outer_corners_m(tape), np.column_stack([marks, np.zeros(4)]), samples, across[:, None],
                 marks[2:, None] + rows, up[:, None], _probes_m(samples, tape))


def outer_corners_m(tape: Tape) -> Array:
    """Return (4, 3): bottom right, bottom left, top left, top right."""
    top, bottom, high = tape.top_width_m / 2, tape.bottom_width_m / 2, tape.height_m / 2
    return np.array([[bottom, -high, 0.0], [-bottom, -high, 0.0], [-top, high, 0.0], [top, high, 0.0]])


@lru_cache(maxsize=8)
def tag_corners_m(tag: AprilTag) -> Array:
    """Return (4, 3): outer corners of a tag's black square in its own frame, clockwise from top left."""
    half = tag.side_m / 2
    return np.array([[-half, half, 0.0], [half, half, 0.0], [half, -half, 0.0], [-half, -half, 0.0]])


def _marks_m(tape: Tape) -> Array:
    """(4, 2): the middle lines' ends."""
    half, high = tape.tape_width_m / 2, tape.height_m / 2
    inward = half * math.hypot(1.0, _flare(tape))       # half the tape's width, along the horizontal
    low, up = tape.bottom_width_m / 2 + _flare(tape) * half - inward, tape.top_width_m / 2 - inward
    return np.array([[low, half - high], [-low, half - high], [-up, high], [up, high]])


def _probes_m(samples_m: Array, tape: Tape) -> Array:
    """Points on the tape, then 12 that it encloses but does not cover, in the middle half of the opening."""
    on_tape = samples_m[:, np.linspace(0, SAMPLES - 1, PROBES).astype(int)].reshape(-1, 2)
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, 4) * tape.bottom_width_m, np.array([-0.1, 0.1, 0.3]) * tape.height_m)
    flat = np.concatenate([on_tape, np.column_stack([x.ravel(), y.ravel()])])
    return np.column_stack([flat, np.zeros(len(flat))])


def _flare(tape: Tape) -> float:
    """Horizontal run of a side per unit of height."""
    return (tape.top_width_m - tape.bottom_width_m) / 2 / tape.height_m


STEPS = 6                             # Gauss-Newton from IPPE's start is at rest after two or three
AT_REST = 1e-2                        # squared last step in standard deviations; what is left after it is its square
MIRROR_PX = 1.0                       # IPPE's second answer is weighed too when it fits the marks nearly as well
DOUBT_SIGMAS = 6.0                    # a mounting this far off its belief means that something else was seen
MOST_COST = 22.0                      # of all residuals together, squared: five are to spare, so noise makes more once
                                      # in 2000 frames; something that covers or touches the tape does it always


class Pose(NamedTuple):
    """The camera relative to the tape (axes of `shape`; camera axes x right, y down, z forward)."""

    tvec_m: Array                     # (3,) target origin in the camera
    distance_m: float                 # horizontal, lens to tape centre
    sigma_m: float
    bearing_rad: float                # tape right of the optical axis is positive, about the vertical
    off_px: Array                     # (8,) of the marks
    reprojection_px: float            # root mean square over the marks, beyond the uncertainty of the camera
    cost: float                       # sum of squared normalised residuals, beliefs included
    doubt: Reason | None              # what the pose says against itself


def judge_pose(pose: Pose | None, most_px: float, off_shape: Code) -> Pose | Reason:
    """Return the pose, or why it cannot be the target's: `off_shape` if the marks are further than `most_px` off."""
    if pose is None:
        return because.NO_POSE()
    if pose.doubt is not None:
        return pose.doubt
    return off_shape(error_px=pose.reprojection_px) if pose.reprojection_px > most_px else pose


def make_sighting(t_ns: int, pose: Pose, camera: CameraConfig, corners_px: Array, behind_m: float = 0.0) -> Sighting:
    """Return the sighting of a target that is `behind_m` beyond the object of the pose."""
    return Sighting(t_ns=t_ns, found=True, distance_m=pose.distance_m + behind_m - camera.bias_m,
                    sigma_m=math.hypot(pose.sigma_m, camera.bias_sigma_m), bearing_deg=math.degrees(pose.bearing_rad),
                    corners_px=tuple((float(x), float(y)) for x, y in corners_px))


def solve_pose(ideal_px: Array, spread_px2: Array, optics: Optics, camera: CameraConfig,
               tape: Tape | AprilTag) -> Pose | None:
    """Return the best camera pose for four undistorted marks (4, 2) of a tape, or corners of a tag; None if there is
    none in front of the camera.

    The marks' covariance (8, 8) is increased by the camera's own.
    """
    model_m = tag_corners_m(tape) if isinstance(tape, AprilTag) else make_shape(tape).marks_m
    count, rvecs, tvecs, errors_px = cv2.solvePnPGeneric(model_m, ideal_px, optics.matrix, None,
                                                         flags=cv2.SOLVEPNP_IPPE)
    try:
        whiten = np.linalg.inv(np.linalg.cholesky(spread_px2 + optics.camera_spread(ideal_px)))
    except np.linalg.LinAlgError:                 # a camera of which next to nothing is known
        return None
    answers = [_refine(np.ravel(rvecs[k]), np.ravel(tvecs[k]), ideal_px, whiten, optics, camera, tape, model_m)
               for k in range(count) if float(errors_px[k].item()) <= float(errors_px[0].item()) + MIRROR_PX]
    best = min((pose for pose in answers if pose is not None), key=lambda pose: pose.cost, default=None)
    if best is None:
        return None
    # what is left of the residuals once the camera has taken its share of the blame
    left_px = spread_px2 @ (whiten.T @ (whiten @ best.off_px))
    return best._replace(reprojection_px=math.sqrt(float(left_px @ left_px) / 4))


def _refine(rvec: Array, tvec: Array, ideal_px: Array, whiten: Array, optics: Optics, camera: CameraConfig,
            tape: Tape | AprilTag, model_m: Array) -> Pose | None:
    state = np.concatenate([rvec, tvec])
    residual, slope = np.empty(11), np.empty((11, 6))
    for _ in range(STEPS):
        seen, jacobian = cv2.projectPoints(model_m, state[:3], state[3:], optics.matrix, None)
        off_px = seen.reshape(-1, 2) - ideal_px
        rotation, turning = _rotation(state[:3])
        residual[:8], slope[:8] = whiten @ off_px.ravel(), whiten @ jacobian[:, :6]
        residual[8:], slope[8:] = _beliefs(rotation, turning, state[3:], camera, tape)
        normal = slope.T @ slope
        pull = slope.T @ residual
        try:
            step = np.linalg.solve(normal, pull)
        except np.linalg.LinAlgError:
            return None
        state = state - step
        if step @ pull < AT_REST:
            break
    if not np.all(np.isfinite(state)) or state[5] <= 0.0:
        return None
    rotation, turning = _rotation(state[:3])
    distance_m, gradient = horizontal(rotation, turning, state[3:])
    spread: Array = np.asarray(np.linalg.inv(normal), dtype=np.float64)
    variance_m2 = float(gradient @ spread @ gradient)
    if not 0.0 < variance_m2 < math.inf:
        return None
    cost, strain = float(residual @ residual), np.abs(residual[8:])
    doubt = None
    if strain.max() > DOUBT_SIGMAS:
        doubt = because.POSE_OFF_MOUNTING(quantity=("height", "pitch", "roll")[int(strain.argmax())])
    elif cost > MOST_COST:
        doubt = because.POSE_CONTRADICTION(sigmas=math.sqrt(cost))
    return Pose(state[3:], distance_m, math.sqrt(variance_m2), _bearing(rotation, state[3:]), off_px.ravel(), math.inf,
                cost, doubt)


def _rotation(rvec: Array) -> tuple[Array, Array]:
    """Rotation matrix (3, 3) and its derivative (3, 3, 3), the first axis over the rotation vector."""
    matrix, jacobian = cv2.Rodrigues(rvec)
    return matrix, jacobian.reshape(3, 3, 3)


def _beliefs(rotation: Array, turning: Array, tvec_m: Array, camera: CameraConfig,
             tape: Tape | AprilTag) -> tuple[Array, Array]:
    """Normalised residuals (3,) of lens height, pitch and roll, and their derivative (3, 6)."""
    height_m = tape.centre_height_m - rotation[:, 1] @ tvec_m
    sine = rotation[2, 1]                             # upward part of the optical axis
    rising, level = rotation[0, 1], -rotation[1, 1]   # upward parts of the camera's x axis and against its y axis
    pitch_rad, roll_rad = math.asin(min(1.0, max(-1.0, sine))), math.atan2(rising, level)
    sigma_rad = math.radians(camera.pitch_sigma_deg)
    residual = np.array([(height_m - camera.height_m) / camera.height_sigma_m,
                         (pitch_rad - math.radians(camera.pitch_deg)) / sigma_rad, roll_rad / sigma_rad])
    slope = np.zeros((3, 6))
    slope[0, :3] = -(turning[:, :, 1] @ tvec_m) / camera.height_sigma_m
    slope[0, 3:] = -rotation[:, 1] / camera.height_sigma_m
    slope[1, :3] = turning[:, 2, 1] / (max(math.cos(pitch_rad), 1e-3) * sigma_rad)
    slope[2, :3] = ((level * turning[:, 0, 1] + rising * turning[:, 1, 1])
                    / (max(level**2 + rising**2, 1e-6) * sigma_rad))
    return residual, slope


def horizontal(rotation: Array, turning: Array, tvec_m: Array) -> tuple[float, Array]:
    """Return the horizontal distance from lens to tape centre, and its derivative (6,)."""
    x_m, z_m = -rotation[:, 0] @ tvec_m, -rotation[:, 2] @ tvec_m     # the lens in the target's frame
    distance_m = math.hypot(x_m, z_m)
    slope_x = np.concatenate([-(turning[:, :, 0] @ tvec_m), -rotation[:, 0]])
    slope_z = np.concatenate([-(turning[:, :, 2] @ tvec_m), -rotation[:, 2]])
    return distance_m, (x_m * slope_x + z_m * slope_z) / max(distance_m, 1e-9)


def _bearing(rotation: Array, tvec_m: Array) -> float:
    """Angle about the vertical from the optical axis to the tape's centre, rightward positive."""
    ahead_x, ahead_z = rotation[2, 0], rotation[2, 2]
    to_x, to_z = rotation[:, 0] @ tvec_m, rotation[:, 2] @ tvec_m
    return math.atan2(ahead_x * to_z - ahead_z * to_x, ahead_x * to_x + ahead_z * to_z)
