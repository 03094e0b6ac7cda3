"""Image -> Sighting by an AprilTag of the family 36h11: OpenCV finds it, its edges give corners, pose.py the rest.

The tag hangs upright, as the tape does, so that the lens's height and pitch weigh in the distance. Only tags of the
configured numbers count, and hardly any wrong bit is put right: a wrong tag would be a wrong distance.
"""

import math
from functools import lru_cache
from typing import Any

import cv2
import numpy as np

from truearc.hw.protocols import CameraFrame
from truearc.hw.reason import Reason
from truearc.robot import reasons as because
from truearc.robot.config.schema import AprilTag, CameraConfig, Vision
from truearc.robot.types import Sighting
from truearc.robot.vision.marks import check_size
from truearc.robot.vision.pose import Array, Optics, Pose, judge_pose, make_optics, make_sighting, solve_pose

APART_SIGMAS = 4.0                    # two tags that say distances so far apart contradict each other
CELLS = 8                             # of a tag's black square, its border one cell wide
LEAST_SIDE_PX = 12.0                  # of a tag
FINE_PX = 2000                        # width to which pictures are enlarged for the search: tags far away
MOST_TIMES = 3                        # times at most
BITS = 0.2                            # of OpenCV's five wrong bits one is put right: no other tag is nearer than eleven
PLACES = np.linspace(0.1, 0.9, 25)    # along a side at which its edge is measured
ACROSS = np.linspace(-0.6, 0.6, 25)   # from inside to outside, in cells
LEAST_STEP = 15.0                     # from black to white
SMALL_PX2 = 0.2                       # sigma of a corner times the size of a cell: blur reaches from edge to edge
FEWEST = 8                            # places at which a side must be seen


def detect_tag(frame: CameraFrame, camera: CameraConfig, tag: AprilTag, vision: Vision) -> Sighting:
    """Find a tag in one image and say how far away the target is.

    `distance_m` is the horizontal distance from the lens to the tag's centre, and `tag.behind_m` more. `sigma_m` is one
    standard deviation, from `tag.corner_sigma_px` and the uncertainties of the camera's mounting and calibration.
    `bearing_deg` is positive when the tag is right of the axis. Of several tags the one known best counts. Never raises
    on an image's content: a doubtful one has found=False and a reason.
    """
    if (unusable := check_size(frame.image)) is not None:
        return Sighting(frame.t_ns, False, unusable)
    optics = make_optics(camera, frame.image.shape[1], frame.image.shape[0])
    grey = cv2.cvtColor(frame.image, cv2.COLOR_BGR2GRAY)
    found, doubts = list[tuple[Pose, Array]](), list[Reason]()
    for number, rough in find_tags(grey):
        if number not in tag.ids:
            continue
        corners = refine_corners(grey, rough)
        answer = because.TAG_EDGES_HIDDEN() if corners is None else explain_tag(corners, optics, camera, tag, vision)
        if isinstance(answer, Reason):
            doubts.append(answer)
        else:
            found.append(answer)
    if not found:
        return Sighting(frame.t_ns, False, doubts[0] if doubts else because.NO_TAG())
    pose, seen = min(found, key=lambda one: one[0].sigma_m)
    if any(abs(pose.distance_m - other.distance_m) > APART_SIGMAS * math.hypot(pose.sigma_m, other.sigma_m)
           for other, _ in found):
        return Sighting(frame.t_ns, False, because.SEVERAL_TARGETS(count=len(found)))
    return make_sighting(frame.t_ns, pose, camera, seen, tag.behind_m)


def explain_tag(quad_px: Array, optics: Optics, camera: CameraConfig, tag: AprilTag,
                vision: Vision) -> tuple[Pose, Array] | Reason:
    """The pose of four corners (4, 2) from the top left one, clockwise, or why there is none; and the corners."""
    side_px = float(np.linalg.norm(np.roll(quad_px, 1, axis=0) - quad_px, axis=1).min())
    if side_px < LEAST_SIDE_PX:
        return because.REGION_SMALL()
    ideal = optics.undistort(quad_px)
    spread = ((tag.corner_sigma_px * optics.scale)**2 + (SMALL_PX2 * CELLS / side_px)**2) * np.eye(8)
    pose = judge_pose(solve_pose(ideal, spread, optics, camera, tag), vision.max_reprojection_px, because.TAG_OFF_SHAPE)
    return pose if isinstance(pose, Reason) else (pose, quad_px)


def find_tags(grey: Any) -> list[tuple[int, Array]]:
    """(number, rough corners (4, 2) from the top left one, clockwise) of every tag of the family."""
    times = min(max(round(FINE_PX / grey.shape[1]), 1), MOST_TIMES)
    fine = grey if times == 1 else cv2.resize(grey, None, fx=times, fy=times, interpolation=cv2.INTER_CUBIC)
    quads, numbers, _ = _detector().detectMarkers(fine)
    return [(int(number), (np.asarray(quad, dtype=np.float64).reshape(4, 2) + 0.5) / times - 0.5)
            for quad, number in zip(quads, [] if numbers is None else np.ravel(numbers), strict=True)]


def refine_corners(grey: Any, quad_px: Array) -> Array | None:
    """Corners (4, 2) where the lines through the border's edges meet; None where an edge is not seen.

    An edge is where the grey is halfway between black and white, which blur does not move.
    """
    level = np.asarray(grey, dtype=np.float32)
    for _ in range(2):
        lines = [_edge(level, quad_px[k], quad_px[(k + 1) % 4]) for k in range(4)]
        corners = [_meet(lines[k - 1], lines[k]) for k in range(4)]
        if any(corner is None for corner in corners):
            return None
        quad_px = np.array(corners)
    return quad_px


def _edge(level: Any, first: Array, second: Array) -> tuple[Array, Array] | None:
    """(point, direction) of the border's outer edge between two rough corners."""
    length = float(np.linalg.norm(second - first))
    if not length >= LEAST_SIDE_PX:
        return None
    along = (second - first) / length
    out = np.array([along[1], -along[0]])
    points = first + PLACES[:, None, None] * (second - first) + ACROSS[None, :, None] * (length / CELLS) * out
    seen = cv2.remap(level, points[..., 0].astype(np.float32), points[..., 1].astype(np.float32), cv2.INTER_LINEAR,
                     borderMode=cv2.BORDER_REPLICATE)
    black, white = seen[:, ACROSS < -0.1].min(1), seen[:, ACROSS > 0.1].max(1)
    half = (black + white) / 2
    place = np.argmax(seen >= half[:, None], axis=1)          # the first of each row that is light
    good = (place > 0) & (white - black > LEAST_STEP)
    rows, before = np.arange(len(PLACES)), np.maximum(place, 1) - 1
    low, high = seen[rows, before], seen[rows, before + 1]
    part = (half - low) / np.maximum(high - low, 1e-6)
    off = (ACROSS[before] + part * (ACROSS[1] - ACROSS[0])) * length / CELLS
    if good.sum() < FEWEST:
        return None
    x, y = PLACES[good] * length, off[good]
    slope, start = np.polyfit(x, y, 1)
    rest = np.abs(y - slope * x - start)
    near = rest <= 3.0 * (1.4826 * np.median(rest) + 1e-3)
    if near.sum() >= FEWEST:
        slope, start = np.polyfit(x[near], y[near], 1)
    return first + out * start, along + out * slope


def _meet(one: tuple[Array, Array] | None, other: tuple[Array, Array] | None) -> Array | None:
    """Where two lines meet; None where they are parallel, or one is not there."""
    if one is None or other is None:
        return None
    try:
        reach = np.linalg.solve(np.column_stack([one[1], -other[1]]), other[0] - one[0])
    except np.linalg.LinAlgError:
        return None
    return np.asarray(one[0] + reach[0] * one[1], dtype=np.float64)


@lru_cache(maxsize=1)
def _detector() -> cv2.aruco.ArucoDetector:
    how = cv2.aruco.DetectorParameters()
    how.errorCorrectionRate = BITS
    how.minMarkerPerimeterRate = 0.02             # of the image's larger side
    return cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11), how)
