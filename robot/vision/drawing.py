"""What vision sees, for people: the mask, and the regions with what was made of each."""

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from truearc.hw.reason import Reason
from truearc.robot.config.schema import CameraFile
from truearc.robot.reasons import text
from truearc.robot.vision import explain
from truearc.robot.vision.optics import make_optics
from truearc.robot.vision.shape import make_shape
from truearc.robot.vision.threshold import Image, find_regions, mask_colour

FOUND_BGR, DOUBT_BGR, MARK_BGR = (80, 255, 80), (60, 60, 255), (255, 255, 255)
DIMMED = 0.5


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
