"""A region of the tape's colour -> the tape's rough corners, and from them its marks to a fraction of a pixel.

The region's convex hull gives the corners to a pixel or two; the side along which there is no tape is the open top.
`edges` measures precisely from there.
"""

from typing import Any

import cv2
import numpy as np

from truearc.hw.reason import Reason
from truearc.robot import reasons as because
from truearc.robot.config.schema import Tape
from truearc.robot.vision.edges import Marks, measure_marks
from truearc.robot.vision.optics import Array, Optics
from truearc.robot.vision.shape import PROBES, make_shape
from truearc.robot.vision.threshold import Region

FILL_LOW, FILL_HIGH = 0.08, 0.65      # tape area / hull area; 0.22 for bare tape, more when it is small and blurred
LEAST_SIDE_PX = 6.0
LEAST_LIT, MOST_LIT_HOLLOW = 0.8, 0.25
NEXT, BEFORE = np.array([1, 2, 3, 0]), np.array([3, 0, 1, 2])
LIT_ALONG = np.linspace(0.2, 0.8, 13)[:, None, None]
LIT_DEPTH_PX = 1.5


def find_outline(region: Region, optics: Optics, tape: Tape) -> Marks | Reason:
    """The tape's four marks in a region, or why it cannot be the tape."""
    x, y, w, h = cv2.boundingRect(region.contour)
    x, y = x + region.x0_px, y + region.y0_px
    if x == 0 or y == 0 or x + w >= optics.width_px or y + h >= optics.height_px:
        return because.TAPE_CUT_OFF()
    rough = _rough_corners(region)
    if isinstance(rough, Reason):
        return rough
    marks = measure_marks(region, rough + np.array([region.x0_px, region.y0_px]), optics, tape)
    if isinstance(marks, Reason):
        return marks
    return _check_tape(marks, region, optics, tape) or marks


def _check_tape(marks: Marks, region: Region, optics: Optics, tape: Tape) -> Reason | None:
    """None when the region has tape where the marks say so, and none in the opening; else what is wrong."""
    seen = marks.to_image(make_shape(tape).probes_m[:, :2], tape, optics)
    height, width = region.mask.shape
    at = (seen + np.array([0.5 - region.x0_px, 0.5 - region.y0_px])).astype(np.intp)
    at = np.minimum(np.maximum(at, 0), (width - 1, height - 1))
    lit = region.mask[at[:, 1], at[:, 0]] > 0
    on_tape, inside = float(lit[:3 * PROBES].mean()), float(lit[3 * PROBES:].mean())
    if on_tape < LEAST_LIT:
        return because.TAPE_OUTLINE_UNLIT(lit=on_tape)
    if inside > MOST_LIT_HOLLOW:
        return because.TAPE_OPENING_LIT()
    return None


def _rough_corners(region: Region) -> Array | Reason:
    """Corners (4, 2) in the patch, in the Outline's order; or what is wrong with the shape."""
    hull = cv2.convexHull(region.contour)
    hull_area_px = max(float(cv2.contourArea(hull)), 1.0)
    if not FILL_LOW <= region.area_px / hull_area_px <= FILL_HIGH:
        return because.REGION_FILLED()
    corners = _four_corners(hull)
    if corners is None:
        return because.REGION_CORNERS()
    side = corners[NEXT] - corners
    length_px = np.sqrt((side * side).sum(axis=1))
    if length_px.min() < LEAST_SIDE_PX:
        return because.REGION_SMALL()
    lit = _lit_shares(region, corners, side, length_px)
    top = int(lit.argmin())
    if lit[top] > 0.5 or np.sort(lit)[1] < 0.6:
        return because.REGION_SIDES()
    return corners[np.arange(top - 2, top + 2) % 4]


def _four_corners(hull: Any) -> Array | None:
    """(4, 2), clockwise as seen, or None where no four corners describe the hull."""
    length_px = cv2.arcLength(hull, True)
    for share in (0.02, 0.03, 0.045, 0.065, 0.09):
        found = cv2.approxPolyDP(hull, share * length_px, True).reshape(-1, 2)
        if len(found) < 4:
            return None
        if len(found) == 4:
            corners = np.asarray(found, dtype=np.float64)
            ahead = corners[NEXT]
            turning = (corners[:, 0] * ahead[:, 1] - ahead[:, 0] * corners[:, 1]).sum()
            return _pull_out(corners if turning > 0 else corners[::-1], hull.reshape(-1, 2))
    return None


def _pull_out(corners: Array, hull: Any) -> Array:
    """Corners moved to those of the hull's points that span the most area: a polygon's approximation may sit beside
    a corner, where the outline is rounded."""
    for _ in range(2):
        across = corners[NEXT] - corners[BEFORE]
        corners = hull[(hull @ np.array([across[:, 1], -across[:, 0]])).argmax(axis=0)].astype(np.float64)
    return corners


def _lit_shares(region: Region, corners: Array, side: Array, length_px: Array) -> Array:
    """(4,): the part of side i (corner i to i + 1) that has the tape's colour just inside it."""
    inward = np.array([-side[:, 1], side[:, 0]]).T / length_px[:, None]
    at = (corners + LIT_DEPTH_PX * inward + 0.5 + LIT_ALONG * side).astype(np.intp)
    rows = at[..., 1].clip(0, region.mask.shape[0] - 1)
    columns = at[..., 0].clip(0, region.mask.shape[1] - 1)
    return np.asarray((region.mask[rows, columns] > 0).mean(axis=0))
