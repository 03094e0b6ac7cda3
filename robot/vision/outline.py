"""A region of the tape's colour -> the tape's four outer corners to a fraction of a pixel.

The region's convex hull gives the corners to a pixel or two; the side along which there is no tape is the open top.
Then each straight edge is measured where it is brightest to darkest: at many places along it, brightness is sampled
across, the point of half height found, and a line fitted through all of them. Half height is where the true edge lies
however blurred it is, which the threshold's edge of the mask is not. Corners are where those lines meet.
"""

from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from robot.config import Tape
from robot.vision.optics import Array, Optics
from robot.vision.shape import make_shape
from robot.vision.threshold import Region

SAMPLES = 24                          # places along each edge
STEP_PX = 0.5                         # between samples across an edge
OUT_PX = 4.0                          # how far outside the rough edge it may lie
FILL_LOW, FILL_HIGH = 0.08, 0.65      # tape area / hull area; 0.22 for bare tape, more when it is small and blurred
LEAST_SIDE_PX = 6.0
LEAST_CONTRAST = 12.0                 # brightness step across an edge, of 255
LEAST_GOOD = 0.8 * SAMPLES             # on each edge, after outliers are gone
STRAIGHT_PX = 0.6                     # a point this close to its line is never an outlier
REFITS = 4
NEXT, BEFORE = np.array([1, 2, 3, 0]), np.array([3, 0, 1, 2])


# Edges run bottom, left, right, top, each between two corners; the top edge is only there at its two ends. A sample's
# place is a weighted mean of the corners: SIDES + tip share x TIPS, (4, SAMPLES, 4 corners).
EDGES = ((0, 1), (1, 2), (3, 0), (2, 3))
FROM, TO = (np.array(ends) for ends in zip(*EDGES, strict=True))
MEETS, WITH = np.array([2, 0, 1, 3]), np.array([0, 1, 3, 2])     # the two edges at each corner
SIDES, TIPS = np.zeros((4, SAMPLES, 4)), np.zeros((4, SAMPLES, 4))
for _edge, (_begin, _end) in enumerate(EDGES[:3]):
    SIDES[_edge, :, _begin], SIDES[_edge, :, _end] = np.linspace(0.9, 0.1, SAMPLES), np.linspace(0.1, 0.9, SAMPLES)
_HALF = SAMPLES // 2
SIDES[3, :_HALF, 2] = SIDES[3, _HALF:, 3] = 1.0
TIPS[3, :_HALF, 3] = TIPS[3, _HALF:, 2] = np.linspace(0.15, 0.85, _HALF)
TIPS[3, :_HALF, 2] = TIPS[3, _HALF:, 3] = -np.linspace(0.15, 0.85, _HALF)
LIT_ALONG = np.linspace(0.2, 0.8, 13)[:, None, None]
LIT_DEPTH_PX = 1.5


class Doubt(NamedTuple):
    """Why a region is not the tape."""

    area_px: float
    reason: str


class Outline(NamedTuple):
    """Outer corners: bottom right, bottom left, top left, top right; each (4, 2)."""

    seen_px: Array                    # in the image
    ideal_px: Array                   # as a perfect pinhole with the same matrix would have seen them


def find_outline(region: Region, optics: Optics, tape: Tape) -> Outline | Doubt:
    """The tape's four outer corners in a region, or why it cannot be the tape."""
    x, y, w, h = cv2.boundingRect(region.contour)
    x, y = x + region.x0_px, y + region.y0_px
    if x == 0 or y == 0 or x + w >= optics.width_px or y + h >= optics.height_px:
        return Doubt(region.area_px, "what may be the tape is cut off by the image's edge")
    rough = _rough_corners(region)
    if isinstance(rough, str):
        return Doubt(region.area_px, rough)
    origin = np.array([region.x0_px, region.y0_px], dtype=np.float64)
    ideal = _meeting_edges(region, rough, origin, optics, tape)
    if ideal is None:
        return Doubt(region.area_px, "the edges of what may be the tape are hidden, or not straight")
    seen = optics.distort(ideal)
    if not (np.abs(seen - origin - rough) < OUT_PX + 2.0).all():
        return Doubt(region.area_px, "the edges of what may be the tape do not meet at its corners")
    return Outline(seen, ideal)


def _rough_corners(region: Region) -> Array | str:
    """Corners (4, 2) in the patch, in the Outline's order; or what is wrong with the shape."""
    hull = cv2.convexHull(region.contour)
    hull_area_px = max(float(cv2.contourArea(hull)), 1.0)
    if not FILL_LOW <= region.area_px / hull_area_px <= FILL_HIGH:
        return "a region of the tape's colour is filled, not an open outline"
    corners = _four_corners(hull)
    if corners is None:
        return "a region of the tape's colour does not have four corners"
    side = corners[NEXT] - corners
    length_px = np.sqrt((side * side).sum(axis=1))
    if length_px.min() < LEAST_SIDE_PX:
        return "a region of the tape's colour is too small to tell its corners"
    lit = _lit_shares(region, corners, side, length_px)
    top = int(lit.argmin())
    if lit[top] > 0.5 or np.sort(lit)[1] < 0.6:
        return "a region of the tape's colour does not have tape on three sides and none on the fourth"
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
    shares: Array = (region.mask[rows, columns] > 0).mean(axis=0)
    return shares


def _meeting_edges(region: Region, rough: Array, origin: Array, optics: Optics, tape: Tape) -> Array | None:
    """Corners (4, 2) in ideal pixels where the fitted edges meet; None when an edge cannot be fitted."""
    side = rough[TO] - rough[FROM]
    length_px = np.sqrt((side * side).sum(axis=1))
    outward = np.array([side[:, 1], -side[:, 0]]).T / length_px[:, None]
    starts = (SIDES + make_shape(tape).tip_share * TIPS) @ rough
    inside_px = max(2.0, 0.6 * float(length_px[3]) * tape.tape_width_m / tape.top_width_m)
    points, good = _half_heights(region.value, starts, outward, inside_px)
    points += origin
    if optics.distortion is not None:
        points = optics.undistort(points).reshape(points.shape)
    lines = _fit_lines(points, good)
    return None if lines is None else _meet(lines[MEETS], lines[WITH])


def _half_heights(value: npt.NDArray[np.uint8], starts: Array, outward: Array, inside_px: float) -> tuple[Array, Any]:
    """Points (4, n, 2) of half brightness across the edges near the starts, and which of them are to be trusted."""
    offsets = np.arange(OUT_PX, -inside_px - STEP_PX, -STEP_PX)
    where = (starts[:, :, None, :] + offsets[:, None] * outward[:, None, None, :]).astype(np.float32)
    where = where.reshape(-1, len(offsets), 2)
    level = cv2.remap(value, where, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(np.float32)
    outside = level[:, :4].min(axis=1)
    contrast = level.max(axis=1) - outside
    above = level - (outside + 0.5 * contrast)[:, None]
    first = (above >= 0).argmax(axis=1)
    rows = np.arange(len(first))
    before, after = above[rows, first - 1], above[rows, first]
    good = (first > 0) & (contrast >= LEAST_CONTRAST)
    part = before / np.where(good, before - after, -1.0)
    shift = (offsets[first] + STEP_PX * (1.0 - part)).reshape(starts.shape[:2])
    return starts + shift[..., None] * outward[:, None, :], good.reshape(starts.shape[:2])


def _fit_lines(points: Array, good: Any) -> Array | None:
    """(4, 3): a, b, c with a x + b y = c and a^2 + b^2 = 1, total least squares, outliers left out step by step; None
    when any line is left with too few points."""
    weight = good.astype(np.float64)
    for _ in range(REFITS):
        count = weight.sum(axis=1)
        if count.min() < LEAST_GOOD:
            return None
        middle = (weight[..., None] * points).sum(axis=1) / count[:, None]
        off = points - middle[:, None, :]
        dx, dy = off[..., 0], off[..., 1]
        lean = weight * dx
        angle = 0.5 * np.arctan2(2 * (lean * dy).sum(axis=1), (lean * dx - weight * dy * dy).sum(axis=1))
        a, b = -np.sin(angle), np.cos(angle)
        beside = np.abs(a[:, None] * dx + b[:, None] * dy)
        usual = (weight * beside).sum(axis=1) / count
        kept = weight * (beside <= np.maximum(STRAIGHT_PX, 1.5 * usual)[:, None])
        if (kept == weight).all():
            break
        weight = kept
    return np.array([a, b, a * middle[:, 0] + b * middle[:, 1]]).T


def _meet(one: Array, other: Array) -> Array:
    """(n, 2): where lines (n, 3) cross; far away when they hardly do."""
    turn = one[:, 0] * other[:, 1] - other[:, 0] * one[:, 1]
    turn = np.where(np.abs(turn) > 1e-6, turn, 1e-6)
    return np.array([one[:, 2] * other[:, 1] - other[:, 2] * one[:, 1],
                     one[:, 0] * other[:, 2] - other[:, 0] * one[:, 2]]).T / turn[:, None]
