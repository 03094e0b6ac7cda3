"""Image -> Sighting: the retro-reflective half hexagon, its distance, and how far to trust it. Pure.

threshold.py finds regions of the tape's colour, outline.py turns a region into four sub-pixel corners, pose.py turns
corners into a camera pose with covariance, and here the best candidate becomes a Sighting or a reason why not.
"""

import math

from hw.reading import CameraFrame
from robot.config import CameraConfig, Tape, Vision
from robot.types import Sighting
from robot.vision.optics import Optics, make_optics
from robot.vision.outline import Doubt, Outline, find_outline
from robot.vision.pose import Pose, check_tape, solve_pose
from robot.vision.threshold import Region, find_regions


def detect(frame: CameraFrame, camera: CameraConfig, tape: Tape, vision: Vision) -> Sighting:
    """Find the tape in one image and say how far away it is.

    `distance_m` is the horizontal distance from the lens to the tape's centre, along the horizontal line of sight: that
    is the way the ball takes to the target plane. (Straight on it equals the perpendicular distance; off axis the
    perpendicular foot is not where the ball goes, and it depends on the target's yaw, which one image shows poorly.)
    `sigma_m` is one standard deviation, from `corner_sigma_px` and the stated doubt about the camera's mounting; it
    does not include the calibration's own error. `bearing_deg` is positive when the target is right of the axis.
    Images of another size than the calibration's are explained in `optics`. Never raises on an image's content: a
    doubtful one has found=False and a reason in words.
    """
    height_px, width_px = frame.image.shape[:2]
    if min(height_px, width_px) < 8:
        return _lost(frame, f"the image is only {width_px} x {height_px} pixels")
    optics = make_optics(camera, width_px, height_px)
    regions = find_regions(frame.image, vision, vision.min_area_px * optics.scale**2)
    if not regions:
        return _lost(frame, "nothing of the tape's colour is large enough")
    best: tuple[Pose, Outline] | None = None
    doubts: list[tuple[float, str]] = []
    for region in regions:
        answer = _explain(region, optics, camera, tape, vision)
        if isinstance(answer, Doubt):
            doubts.append((answer.area_px, answer.reason))
        elif best is None or answer[0].cost < best[0].cost:
            best = answer
    if best is None:
        return _lost(frame, max(doubts)[1])
    pose, outline = best
    return Sighting(t_ns=frame.t_ns, found=True, reason="", distance_m=pose.distance_m, sigma_m=pose.sigma_m,
                    bearing_deg=math.degrees(pose.bearing_rad),
                    corners_px=tuple((float(x), float(y)) for x, y in outline.seen_px.reshape(-1, 2)))


def _explain(region: Region, optics: Optics, camera: CameraConfig, tape: Tape,
             vision: Vision) -> tuple[Pose, Outline] | Doubt:
    """The region as the tape, or why it is not."""
    outline = find_outline(region, optics, tape)
    if isinstance(outline, Doubt):
        return outline
    pose = solve_pose(outline.ideal_px, vision.corner_sigma_px, optics, camera, tape)
    if pose is None:
        return Doubt(region.area_px, "no camera pose explains the four corners")
    if pose.doubt:
        return Doubt(region.area_px, pose.doubt)
    if pose.reprojection_px > vision.max_reprojection_px:
        return Doubt(region.area_px, f"the corners miss the tape's shape by {pose.reprojection_px:.1f} px")
    reason = check_tape(pose, region, optics, tape)
    return Doubt(region.area_px, reason) if reason else (pose, outline)


def _lost(frame: CameraFrame, reason: str) -> Sighting:
    return Sighting(t_ns=frame.t_ns, found=False, reason=reason)
