"""Target detection: from an Image to a Sighting of the retro-reflective half hexagon or an AprilTag, with uncertainty.

Detection is pure. marks.py refuses images that are too bright, finds regions of the tape's colour and turns a region
into four sub-pixel marks; pose.py turns marks into a camera pose with covariance. This module turns the single
candidate into a Sighting, or returns the reason why there is none. `draw_mask` and `draw_regions` visualise how an
image is processed.
"""

import math
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from truearc.hw.protocols import CameraFrame
from truearc.hw.reason import Reason
from truearc.robot import reasons as because
from truearc.robot.config.schema import AprilTag, CameraConfig, CameraFile, Config, Tape, Vision
from truearc.robot.reasons import text
from truearc.robot.types import Sighting
from truearc.robot.vision import marks as tape_marks
from truearc.robot.vision import pose as geometry
from truearc.robot.vision.marks import Image, Marks, Region
from truearc.robot.vision.pose import Array, Optics, Pose

SAME_M = 0.02
FOUND_BGR, DOUBT_BGR, MARK_BGR = (80, 255, 80), (60, 60, 255), (255, 255, 255)
DIMMED = 0.5


def find_target(frame: CameraFrame, config: Config | CameraFile) -> Sighting:
    """Find the configured target, the tape or an AprilTag, in one image, and its distance."""
    if config.camera.target == "apriltag" and config.apriltag is not None:
        return detect_tag(frame, config.camera, config.apriltag, config.vision)
    return detect(frame, config.camera, config.tape, config.vision)


def detect(frame: CameraFrame, camera: CameraConfig, tape: Tape, vision: Vision) -> Sighting:
    """Find the tape in one image and measure its distance.

    `distance_m` is the horizontal distance from the lens to the tape's centre, along the horizontal line of sight: that
    is the way the ball takes to the target plane. (Straight on it equals the perpendicular distance; off axis the
    perpendicular foot is not where the ball goes, and it depends on the target's yaw, which one image shows poorly.)
    From the ball's exit it is `truearc.robot.motors.exit_distance_m`. `sigma_m` is one standard deviation, from the
    tape's edges in this image, `corner_sigma_px`, the uncertainties of the camera's mounting and calibration.
    `bearing_deg` is positive when the target is right of the axis.
    Images of another size than the calibration's are explained in `geometry`. Never raises on an image's content: a
    doubtful one has found=False and a reason.
    """
    if (unusable := tape_marks.check_size(frame.image) or tape_marks.check_exposure(frame.image)) is not None:
        return Sighting(frame.t_ns, False, unusable)
    optics = geometry.make_optics(camera, frame.image.shape[1], frame.image.shape[0])
    found, doubts = look(frame.image, optics, camera, tape, vision)
    if not found:
        return Sighting(frame.t_ns, False, max(doubts, key=lambda doubt: (doubt[0], doubt[1].code))[1] if doubts else
                        because.IMAGE_DARK() if tape_marks.is_dark(frame.image, vision.value_low) else
                        because.NO_TAPE_COLOUR())
    if len(found) > 1:
        return Sighting(frame.t_ns, False, because.SEVERAL_TARGETS(count=len(found)))
    marks, pose = found[0]
    corners = marks.to_image(geometry.make_shape(tape).corners_m[:, :2], tape, optics)
    return geometry.make_sighting(frame.t_ns, pose, camera, corners)


def look(image: Image, optics: Optics, camera: CameraConfig, tape: Tape,
         vision: Vision) -> tuple[list[tuple[Marks, Pose]], list[tuple[float, Reason]]]:
    """Return all that looks like the target, the area [px] of everything else of its colour, and why that does not."""
    found: list[tuple[Marks, Pose]] = []
    doubts: list[tuple[float, Reason]] = []
    for region in tape_marks.find_regions(image, vision, vision.min_area_px * optics.scale**2):
        answer = explain(region, optics, camera, tape, vision)
        if isinstance(answer, Reason):
            doubts.append((region.area_px, answer))
        elif all(np.abs(answer[1].tvec_m - other.tvec_m).max() > SAME_M for _, other in found):    # not in two patches
            found.append(answer)
    return found, doubts


def explain(region: Region, optics: Optics, camera: CameraConfig, tape: Tape,
            vision: Vision) -> tuple[Marks, Pose] | Reason:
    """Return the region as the tape, or why it is not."""
    marks = tape_marks.find_outline(region, optics, tape)
    if isinstance(marks, Reason):
        return marks
    spread_px2 = marks.spread_px2 + optics.smooth_spread(marks.ideal_px, vision.corner_sigma_px)
    solved = geometry.solve_pose(marks.ideal_px, spread_px2, optics.smeared(marks.smear_px2), camera, tape)
    pose = geometry.judge_pose(solved, vision.max_reprojection_px, because.TAPE_OFF_SHAPE)
    return pose if isinstance(pose, Reason) else (marks, pose)


def draw_mask(image: Image, file: CameraFile) -> Image:
    """Return an image that is white where the colour is the tape's."""
    mask, _ = tape_marks.mask_colour(image, file.vision)
    return np.asarray(cv2.cvtColor(mask, cv2.COLOR_GRAY2BGR), np.uint8)


def draw_regions(image: Image, file: CameraFile) -> tuple[Image, list[str]]:
    """Return the dimmed image with each region outlined and numbered, and the corners and marks of the target.

    Also returns, for each region in order, what it is or why it is not the target.
    """
    drawn: Any = (image * DIMMED).astype(np.uint8)
    optics = geometry.make_optics(file.camera, image.shape[1], image.shape[0])
    said = []
    regions = tape_marks.find_regions(image, file.vision, file.vision.min_area_px * optics.scale**2)
    for number, region in enumerate(regions, 1):
        answer = explain(region, optics, file.camera, file.tape, file.vision)
        contour = region.contour + np.array([region.x0_px, region.y0_px])
        colour = DOUBT_BGR if isinstance(answer, Reason) else FOUND_BGR
        cv2.drawContours(drawn, [contour], -1, colour, 1)
        x, y, _, _ = cv2.boundingRect(contour)
        cv2.putText(drawn, str(number), (max(x - 14, 2), y + 12), cv2.FONT_HERSHEY_SIMPLEX, 0.5, colour, 1, cv2.LINE_AA)
        if isinstance(answer, Reason):
            said.append(f"{text(answer)} ({region.area_px:.0f} px)")
            continue
        marks, pose = answer
        corners_m = geometry.make_shape(file.tape).corners_m[:, :2]
        _draw_cross(drawn, marks.to_image(corners_m, file.tape, optics), FOUND_BGR, 5)
        _draw_cross(drawn, optics.distort(marks.ideal_px), MARK_BGR, 3)
        said.append(f"the target at {pose.distance_m - file.camera.bias_m:.3f} m ({region.area_px:.0f} px), off its "
                    f"shape by {pose.reprojection_px:.2f} px")
    return drawn, said


def _draw_cross(drawn: Any, points_px: npt.NDArray[np.float64], colour: tuple[int, int, int], reach_px: int) -> None:
    for x, y in points_px:
        at = round(float(x)), round(float(y))
        cv2.drawMarker(drawn, at, colour, cv2.MARKER_CROSS, 2 * reach_px + 1, 1)


# --- an AprilTag of the family 36h11

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
    """Find a tag in one image and measure the distance of the target.

    `distance_m` is the horizontal distance from the lens to the tag's centre, and `tag.behind_m` more. `sigma_m` is one
    standard deviation, from `tag.corner_sigma_px` and the uncertainties of the camera's mounting and calibration.
    `bearing_deg` is positive when the tag is right of the axis. Of several tags the one known best counts. Never raises
    on an image's content: a doubtful one has found=False and a reason.
    """
    if (unusable := tape_marks.check_size(frame.image)) is not None:
        return Sighting(frame.t_ns, False, unusable)
    optics = geometry.make_optics(camera, frame.image.shape[1], frame.image.shape[0])
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
    return geometry.make_sighting(frame.t_ns, pose, camera, seen, tag.behind_m)


def explain_tag(quad_px: Array, optics: Optics, camera: CameraConfig, tag: AprilTag,
                vision: Vision) -> tuple[Pose, Array] | Reason:
    """Return the pose of four corners (4, 2), clockwise from top left, or why there is none; and the corners."""
    side_px = float(np.linalg.norm(np.roll(quad_px, 1, axis=0) - quad_px, axis=1).min())
    if side_px < LEAST_SIDE_PX:
        return because.REGION_SMALL()
    ideal = optics.undistort(quad_px)
    spread = ((tag.corner_sigma_px * optics.scale)**2 + (SMALL_PX2 * CELLS / side_px)**2) * np.eye(8)
    solved = geometry.solve_pose(ideal, spread, optics, camera, tag)
    pose = geometry.judge_pose(solved, vision.max_reprojection_px, because.TAG_OFF_SHAPE)
    return pose if isinstance(pose, Reason) else (pose, quad_px)


def find_tags(grey: Any) -> list[tuple[int, Array]]:
    """Return (number, rough corners (4, 2), clockwise from top left) of every tag of the family."""
    times = min(max(round(FINE_PX / grey.shape[1]), 1), MOST_TIMES)
    fine = grey if times == 1 else cv2.resize(grey, None, fx=times, fy=times, interpolation=cv2.INTER_CUBIC)
    quads, numbers, _ = _detector().detectMarkers(fine)
    return [(int(number), (np.asarray(quad, dtype=np.float64).reshape(4, 2) + 0.5) / times - 0.5)
            for quad, number in zip(quads, [] if numbers is None else np.ravel(numbers), strict=True)]


def refine_corners(grey: Any, quad_px: Array) -> Array | None:
    """Return corners (4, 2) where the lines through the border's edges meet; None if an edge is not visible.

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
