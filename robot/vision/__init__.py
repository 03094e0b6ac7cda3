"""Image -> Sighting: the retro-reflective half hexagon, its distance, and how far to trust it. Pure.

threshold.py refuses images that are too bright and finds regions of the tape's colour, outline.py and edges.py turn a
region into four sub-pixel marks, pose.py turns marks into a camera pose with covariance, and here the one candidate
becomes a Sighting or a reason why not.
"""

import math

import numpy as np

from truearc.hw.protocols import CameraFrame
from truearc.hw.reason import Reason
from truearc.robot import reasons as because
from truearc.robot.config.schema import CameraConfig, CameraFile, Config, Tape, Vision
from truearc.robot.types import Sighting
from truearc.robot.vision.edges import Marks
from truearc.robot.vision.optics import Optics, make_optics
from truearc.robot.vision.outline import find_outline
from truearc.robot.vision.pose import Pose, solve_pose
from truearc.robot.vision.shape import make_shape
from truearc.robot.vision.tag import detect_tag
from truearc.robot.vision.threshold import Image, Region, check_exposure, find_regions, is_dark

SAME_M = 0.02


def find_target(frame: CameraFrame, config: Config | CameraFile) -> Sighting:
    """Find the target of the configuration in one image, the tape or an AprilTag; how far away it is."""
    if config.camera.target == "apriltag" and config.apriltag is not None:
        return detect_tag(frame, config.camera, config.apriltag, config.vision)
    return detect(frame, config.camera, config.tape, config.vision)


def detect(frame: CameraFrame, camera: CameraConfig, tape: Tape, vision: Vision) -> Sighting:
    """Find the tape in one image and say how far away it is.

    `distance_m` is the horizontal distance from the lens to the tape's centre, along the horizontal line of sight: that
    is the way the ball takes to the target plane. (Straight on it equals the perpendicular distance; off axis the
    perpendicular foot is not where the ball goes, and it depends on the target's yaw, which one image shows poorly.)
    From the ball's exit it is `truearc.robot.motors.exit_distance_m`. `sigma_m` is one standard deviation, from the
    tape's edges in this image, `corner_sigma_px`, the uncertainties of the camera's mounting and calibration.
    `bearing_deg` is positive when the target is right of the axis.
    Images of another size than the calibration's are explained in `optics`. Never raises on an image's content: a
    doubtful one has found=False and a reason.
    """
    height_px, width_px = frame.image.shape[:2]
    if min(height_px, width_px) < 8:
        return _lost(frame, because.IMAGE_TOO_SMALL(width_px=width_px, height_px=height_px))
    overexposed = check_exposure(frame.image)
    if overexposed is not None:
        return _lost(frame, overexposed)
    optics = make_optics(camera, width_px, height_px)
    found, doubts = look(frame.image, optics, camera, tape, vision)
    if not found:
        return _lost(frame, max(doubts, key=_largest)[1] if doubts else _missing(frame.image, vision))
    if len(found) > 1:
        return _lost(frame, because.SEVERAL_TARGETS(count=len(found)))
    marks, pose = found[0]
    corners = marks.to_image(make_shape(tape).corners_m[:, :2], tape, optics)
    return Sighting(t_ns=frame.t_ns, found=True, distance_m=pose.distance_m - camera.bias_m,
                    sigma_m=math.hypot(pose.sigma_m, camera.bias_sigma_m), bearing_deg=math.degrees(pose.bearing_rad),
                    corners_px=tuple((float(x), float(y)) for x, y in corners))


def look(image: Image, optics: Optics, camera: CameraConfig, tape: Tape,
         vision: Vision) -> tuple[list[tuple[Marks, Pose]], list[tuple[float, Reason]]]:
    """All that looks like the target; and the area [px] of all else of its colour, and why it does not."""
    found: list[tuple[Marks, Pose]] = []
    doubts: list[tuple[float, Reason]] = []
    for region in find_regions(image, vision, vision.min_area_px * optics.scale**2):
        answer = explain(region, optics, camera, tape, vision)
        if isinstance(answer, Reason):
            doubts.append((region.area_px, answer))
        elif all(_apart(answer[1], other) for _, other in found):
            found.append(answer)
    return found, doubts


def explain(region: Region, optics: Optics, camera: CameraConfig, tape: Tape,
            vision: Vision) -> tuple[Marks, Pose] | Reason:
    """The region as the tape, or why it is not."""
    marks = find_outline(region, optics, tape)
    if isinstance(marks, Reason):
        return marks
    spread_px2 = marks.spread_px2 + optics.smooth_spread(marks.ideal_px, vision.corner_sigma_px)
    pose = solve_pose(marks.ideal_px, spread_px2, optics.smeared(marks.smear_px2), camera, tape)
    if pose is None:
        return because.NO_POSE()
    if pose.doubt is not None:
        return pose.doubt
    if pose.reprojection_px > vision.max_reprojection_px:
        return because.TAPE_OFF_SHAPE(error_px=pose.reprojection_px)
    return marks, pose


def _apart(one: Pose, other: Pose) -> bool:
    """Whether two answers are two things, not one thing found in two patches."""
    return float(np.abs(one.tvec_m - other.tvec_m).max()) > SAME_M


def _largest(doubt: tuple[float, Reason]) -> tuple[float, str]:
    return doubt[0], doubt[1].code


def _missing(image: Image, vision: Vision) -> Reason:
    """Why nothing at all is of the tape's colour."""
    if is_dark(image, vision.value_low):
        return because.IMAGE_DARK()
    return because.NO_TAPE_COLOUR()


def _lost(frame: CameraFrame, reason: Reason) -> Sighting:
    return Sighting(t_ns=frame.t_ns, found=False, reason=reason)
