"""Image -> Sighting: the retro-reflective half hexagon, its distance, and how far to trust it. Pure.

marks.py refuses images that are too bright, finds regions of the tape's colour and turns a region into four sub-pixel
marks, pose.py turns marks into a camera pose with covariance. Here the one candidate becomes a Sighting,
or the reason why there is none; `draw_mask` and `draw_regions` show people what was made of an image.
"""

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from truearc.hw.protocols import CameraFrame
from truearc.hw.reason import Reason
from truearc.robot import reasons as because
from truearc.robot.config.schema import CameraConfig, CameraFile, Config, Tape, Vision
from truearc.robot.reasons import text
from truearc.robot.types import Sighting
from truearc.robot.vision.marks import (
    Image,
    Marks,
    Region,
    check_exposure,
    check_size,
    find_outline,
    find_regions,
    is_dark,
    mask_colour,
)
from truearc.robot.vision.pose import Optics, Pose, judge_pose, make_optics, make_shape, make_sighting, solve_pose
from truearc.robot.vision.tag import detect_tag

SAME_M = 0.02
FOUND_BGR, DOUBT_BGR, MARK_BGR = (80, 255, 80), (60, 60, 255), (255, 255, 255)
DIMMED = 0.5


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
    Images of another size than the calibration's are explained in `geometry`. Never raises on an image's content: a
    doubtful one has found=False and a reason.
    """
    if (unusable := check_size(frame.image) or check_exposure(frame.image)) is not None:
        return Sighting(frame.t_ns, False, unusable)
    optics = make_optics(camera, frame.image.shape[1], frame.image.shape[0])
    found, doubts = look(frame.image, optics, camera, tape, vision)
    if not found:
        return Sighting(frame.t_ns, False, max(doubts, key=lambda doubt: (doubt[0], doubt[1].code))[1] if doubts else
                        because.IMAGE_DARK() if is_dark(frame.image, vision.value_low) else because.NO_TAPE_COLOUR())
    if len(found) > 1:
        return Sighting(frame.t_ns, False, because.SEVERAL_TARGETS(count=len(found)))
    marks, pose = found[0]
    corners = marks.to_image(make_shape(tape).corners_m[:, :2], tape, optics)
    return make_sighting(frame.t_ns, pose, camera, corners)


def look(image: Image, optics: Optics, camera: CameraConfig, tape: Tape,
         vision: Vision) -> tuple[list[tuple[Marks, Pose]], list[tuple[float, Reason]]]:
    """All that looks like the target; and the area [px] of all else of its colour, and why it does not."""
    found: list[tuple[Marks, Pose]] = []
    doubts: list[tuple[float, Reason]] = []
    for region in find_regions(image, vision, vision.min_area_px * optics.scale**2):
        answer = explain(region, optics, camera, tape, vision)
        if isinstance(answer, Reason):
            doubts.append((region.area_px, answer))
        elif all(np.abs(answer[1].tvec_m - other.tvec_m).max() > SAME_M for _, other in found):    # not in two patches
            found.append(answer)
    return found, doubts


def explain(region: Region, optics: Optics, camera: CameraConfig, tape: Tape,
            vision: Vision) -> tuple[Marks, Pose] | Reason:
    """The region as the tape, or why it is not."""
    marks = find_outline(region, optics, tape)
    if isinstance(marks, Reason):
        return marks
    spread_px2 = marks.spread_px2 + optics.smooth_spread(marks.ideal_px, vision.corner_sigma_px)
    pose = judge_pose(solve_pose(marks.ideal_px, spread_px2, optics.smeared(marks.smear_px2), camera, tape),
                      vision.max_reprojection_px, because.TAPE_OFF_SHAPE)
    return pose if isinstance(pose, Reason) else (marks, pose)


def draw_mask(image: Image, file: CameraFile) -> Image:
    """White where the colour is the tape's."""
    mask, _ = mask_colour(image, file.vision)
    return np.asarray(cv2.cvtColor(mask, cv2.COLOR_GRAY2BGR), np.uint8)


def draw_regions(image: Image, file: CameraFile) -> tuple[Image, list[str]]:
    """The dimmed image with each region outlined and numbered, the target's corners and marks where it is one; and for
    each region, in its number's order, what it is or why it is not the target."""
    drawn: Any = (image * DIMMED).astype(np.uint8)
    optics = make_optics(file.camera, image.shape[1], image.shape[0])
    said = []
    for number, region in enumerate(find_regions(image, file.vision, file.vision.min_area_px * optics.scale**2), 1):
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
        _draw_cross(drawn, marks.to_image(make_shape(file.tape).corners_m[:, :2], file.tape, optics), FOUND_BGR, 5)
        _draw_cross(drawn, optics.distort(marks.ideal_px), MARK_BGR, 3)
        said.append(f"the target at {pose.distance_m - file.camera.bias_m:.3f} m ({region.area_px:.0f} px), off its "
                    f"shape by {pose.reprojection_px:.2f} px")
    return drawn, said


def _draw_cross(drawn: Any, points_px: npt.NDArray[np.float64], colour: tuple[int, int, int], reach_px: int) -> None:
    for x, y in points_px:
        at = round(float(x)), round(float(y))
        cv2.drawMarker(drawn, at, colour, cv2.MARKER_CROSS, 2 * reach_px + 1, 1)
