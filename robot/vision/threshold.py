"""Regions of the tape's colour, in an image that was exposed for tape under a ring light: dark, except for what shines.

A camera that chooses its own exposure brightens the room until the tape is white; then colours and edges lie.
Most of an image is dark, so the colour is first looked for in every fourth row and column; only around what is found
there is the full resolution looked at.
"""

from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from truearc.hw.reason import Reason
from truearc.robot.config.schema import Vision
from truearc.robot.reasons import IMAGE_BRIGHT, IMAGE_BURNT, IMAGE_TOO_SMALL

Image = npt.NDArray[np.uint8]

STRIDE = 4
BRIDGE = np.ones((3, 9), np.uint8)    # joins what so coarse a look tears apart when the tape is 2-4 px wide
MARGIN_PX = 8                         # kept around a region: edges are measured in it
MAX_PATCHES = 16                      # a colourful scene is searched in its largest regions only
HUES = 180                            # OpenCV's 8-bit hue
SPARSE = 16                           # pixels looked at: every sixteenth column of every sixteenth row
BRIGHT = 150                          # of 255: more than half of an image this bright is not a dark one
BURNT, BURNT_SHARE = 250, 0.3
LEAST_PX = 8                          # of an image, either way


class Region(NamedTuple):
    """One connected region of the tape's colour, inside a patch whose top left pixel is (x0_px, y0_px)."""

    contour: Any                      # (n, 1, 2) int32, outermost pixels, in the patch
    area_px: float                    # enclosed by the contour
    mask: Image                       # (h, w), 255 where the colour is the tape's
    value: Image                      # (h, w), the brightest channel
    x0_px: int
    y0_px: int


def find_regions(image: Image, vision: Vision, min_area_px: float) -> list[Region]:
    """Regions of at least `min_area_px` in a BGR image (h, w, 3); a region's area is what its outline encloses."""
    size = (-(-image.shape[1] // STRIDE), -(-image.shape[0] // STRIDE))
    coarse = cv2.resize(image, size, interpolation=cv2.INTER_NEAREST)
    mask, _ = mask_colour(coarse, vision)
    if not cv2.countNonZero(mask):
        return []
    regions: list[Region] = []
    for x0, y0, x1, y1 in _patches(mask, image.shape[1], image.shape[0], min_area_px):
        regions += _regions_in(image[y0:y1, x0:x1], vision, min_area_px, x0, y0)
    return regions


def mask_colour(image: Image, vision: Vision) -> tuple[Image, Image]:
    """Where the colour of a BGR image is the tape's (255, else 0), and its HSV value; hue_low > hue_high wraps."""
    hsv = cv2.cvtColor(image, cv2.COLOR_BGR2HSV)
    low, high = (vision.saturation_low, vision.value_low), (255, 255)
    if vision.hue_low <= vision.hue_high:
        mask = cv2.inRange(hsv, (vision.hue_low, *low), (vision.hue_high, *high))
    else:
        mask = cv2.inRange(hsv, (vision.hue_low, *low), (HUES - 1, *high))
        cv2.bitwise_or(mask, cv2.inRange(hsv, (0, *low), (vision.hue_high, *high)), dst=mask)
    return mask, hsv[:, :, 2]


def _patches(mask: Image, width_px: int, height_px: int, min_area_px: float) -> list[tuple[int, int, int, int]]:
    """Full-resolution boxes (x0, y0, x1, y1) around what the coarse mask shows, largest first, none inside another."""
    joined = cv2.dilate(mask, BRIDGE)
    contours, _ = cv2.findContours(joined, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    boxes = []
    for contour in contours:
        x, y, w, h = (STRIDE * side for side in cv2.boundingRect(contour))
        if w * h >= min_area_px:
            boxes.append((max(x - MARGIN_PX, 0), max(y - MARGIN_PX, 0),
                          min(x + w + MARGIN_PX, width_px), min(y + h + MARGIN_PX, height_px)))
    boxes.sort(key=lambda box: (box[0] - box[2]) * (box[3] - box[1]))
    kept: list[tuple[int, int, int, int]] = []
    for box in boxes[:MAX_PATCHES]:
        if not any(_inside(box, other) for other in kept):
            kept.append(box)
    return kept


def _inside(box: tuple[int, int, int, int], other: tuple[int, int, int, int]) -> bool:
    return box[0] >= other[0] and box[1] >= other[1] and box[2] <= other[2] and box[3] <= other[3]


def _regions_in(patch: Image, vision: Vision, min_area_px: float, x0_px: int, y0_px: int) -> list[Region]:
    mask, value = mask_colour(patch, vision)
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    return [Region(contour, area_px, mask, value, x0_px, y0_px) for contour in contours
            if (area_px := float(cv2.contourArea(contour))) >= min_area_px]


def check_size(image: Image) -> Reason | None:
    """None for an image that is large enough to search; else why not."""
    height_px, width_px = image.shape[:2]
    return IMAGE_TOO_SMALL(width_px=width_px, height_px=height_px) if min(height_px, width_px) < LEAST_PX else None


def check_exposure(image: Image) -> Reason | None:
    """None for an image (h, w, 3) that may be used; else what is wrong with its exposure."""
    blue, green, red = np.ascontiguousarray(image[::SPARSE, ::SPARSE].transpose(2, 0, 1))
    if np.count_nonzero(np.maximum(np.maximum(blue, green), red) >= BRIGHT) > 0.5 * blue.size:
        return IMAGE_BRIGHT()
    if np.count_nonzero(np.minimum(np.minimum(blue, green), red) >= BURNT) > BURNT_SHARE * blue.size:
        return IMAGE_BURNT()
    return None


def is_dark(image: Image, value: int) -> bool:
    """Whether nothing in an image (h, w, 3) reaches this brightness, where it is looked at."""
    return bool(image[::SPARSE, ::SPARSE].max() < value)
