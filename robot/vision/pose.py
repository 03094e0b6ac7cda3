"""Four marks -> where the camera stands, with covariance.

IPPE (the closed form for flat targets) gives the start; Gauss-Newton then minimises the marks' residuals, weighed by
their covariance, together with three beliefs about the mounting: lens height, pitch, and no roll (as well known as the
pitch). The covariance is that of the edges, a floor for what edges do not show, and what the camera leaves open. The
tape hangs upright, so its pose alone tells the camera's height and pitch; how far its apparent size, its slant and its
elevation each count in the distance is settled by how well each is known.
"""

import math
from typing import NamedTuple

import cv2
import numpy as np

from truearc.hw.reason import Code, Reason
from truearc.robot import reasons as because
from truearc.robot.config.schema import AprilTag, CameraConfig, Tape
from truearc.robot.types import Sighting
from truearc.robot.vision.geometry import Array, Optics, make_shape, tag_corners_m

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
    """The pose; or why it cannot be the target's: `off_shape` where the marks are further than `most_px` off."""
    if pose is None:
        return because.NO_POSE()
    if pose.doubt is not None:
        return pose.doubt
    return off_shape(error_px=pose.reprojection_px) if pose.reprojection_px > most_px else pose


def make_sighting(t_ns: int, pose: Pose, camera: CameraConfig, corners_px: Array, behind_m: float = 0.0) -> Sighting:
    """The sighting of a target that is `behind_m` further away than what the pose is of."""
    return Sighting(t_ns=t_ns, found=True, distance_m=pose.distance_m + behind_m - camera.bias_m,
                    sigma_m=math.hypot(pose.sigma_m, camera.bias_sigma_m), bearing_deg=math.degrees(pose.bearing_rad),
                    corners_px=tuple((float(x), float(y)) for x, y in corners_px))


def solve_pose(ideal_px: Array, spread_px2: Array, optics: Optics, camera: CameraConfig,
               tape: Tape | AprilTag) -> Pose | None:
    """Best camera pose for four undistorted marks (4, 2) of a tape, or corners of a tag, with covariance (8, 8), to
    which the camera's own is added; or None when there is none before the camera."""
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
    """Horizontal distance from lens to tape centre, and its derivative (6,)."""
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
