"""The tape's four marks to a small part of a pixel, with the covariance that the tape's own edges show.

Across each straight, at many places, brightness is sampled; the two points of half height lie at equal distances from
the tape's middle however blurred, bloomed or overexposed it is, and a line is fitted through what is midway. Along the
middle line, the point of half height at a cut end is where the end is, for the same reason: a strip and what is cut
off from it mirror each other there, in light that is measured in proportion. With a tone curve, or where the tape
clips, half height lies outside of a cut end, by as much as `widths` finds it outside of the bottom straight's edges.
Marks are where two middle lines meet, and where the ends are.

How far the points lie off their line is the noise, and the marks' covariance follows from it: two marks on one line
share that line's error.
"""

import math
from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from truearc.hw.reason import Reason
from truearc.robot import reasons as because
from truearc.robot.config.schema import Tape
from truearc.robot.vision.optics import Array, Optics
from truearc.robot.vision.shape import SAMPLES, Shape, make_shape
from truearc.robot.vision.threshold import Region
from truearc.robot.vision.widths import Widening, compare_widths, expected_widths

STEP_PX = 0.5                         # between samples across the tape, where that makes no more than
MOST_STEPS = 64
OUT_PX = 4.0                          # how far outside the rough outline the tape's edge may lie
TAIL = 3                              # samples at either end of a profile that may be dark
LEAST_CONTRAST = 12.0                 # brightness step across an edge, of 255
CLIPPED = 240.0                       # of 255, on the average along the straights
LEAST_GOOD = 0.8 * SAMPLES            # on each straight, after outliers are gone
STRAIGHT_PX = 0.6                     # a point this close to its line is never an outlier
REFITS = 4
ALIKE_PX = 4.0                        # points nearer than this on one edge err alike (lens, JPEG, rows of the sensor)
FAINTEST_PX = 0.02                    # no edge is better than this
TIP_SPREAD = 0.5                      # variance of a cut end over that of a point on the side's middle line
LEAST_CROSSING = 0.05                 # sine of the angle at which two straights meet
LEVEL_PX, LEVEL = 0.6, 0.3            # a cut end may lean by this much, and this share of the tape's width
WIDE_PX, WIDE = 4.0, 1.5              # a tape WIDE times as wide as its size says, and this much more, is another


class Marks(NamedTuple):
    """Where the marks are in ideal pixels (4, 2), and the covariance (8, 8) of x0 y0 x1 ... from the edges alone."""

    ideal_px: Array
    spread_px2: Array
    smear_px2: float = 0.0            # right or left while the shutter was open, squared; below 0: up or down

    def to_image(self, points_m: Array, tape: Tape, optics: Optics) -> Array:
        """Points (n, 2) of the target's plane -> where these marks put them in the image, whatever the lens."""
        turn = cv2.getPerspectiveTransform(make_shape(tape).marks_m[:, :2].astype(np.float32),
                                           self.ideal_px.astype(np.float32))
        return optics.distort(_map(turn, points_m))


class Straights(NamedTuple):
    """Measurements across the bottom, left and right straight at SAMPLES places each, in the image."""

    middle_px: Array                  # (3, SAMPLES, 2) midway between the edges
    good: Any                         # (3, SAMPLES) which are to be trusted
    wide_px: Array                    # (3, SAMPLES) from edge to edge
    rise_px: Array                    # (3, SAMPLES) over which the outer edge would rise if it were straight
    clipped: bool                     # most of the tape is as bright as can be written


class _Lines(NamedTuple):
    """Three fitted lines: bottom, left, right."""

    middle: Array                     # (3, 2) a point on each
    along: Array                      # (3, 2) unit
    point_var: Array                  # (3,) of one measured point across the line
    offset_var: Array                 # (3,) of the line at its point
    slope_var: Array                  # (3,) of the angle


def measure_marks(region: Region, rough_px: Array, optics: Optics, tape: Tape) -> Marks | Reason:
    """The marks near four rough outer corners (4, 2) in the image; or why they cannot be measured."""
    shape = make_shape(tape)
    turn = cv2.getPerspectiveTransform(shape.corners_m[:, :2].astype(np.float32), rough_px.astype(np.float32))
    origin = np.array([region.x0_px, region.y0_px], dtype=np.float64)
    found = _straights(region.value, turn, origin, shape)
    if isinstance(found, Reason):
        return found
    lines = _fit_lines(optics.undistort(found.middle_px).reshape(found.middle_px.shape), found.good)
    if lines is None:
        return because.TAPE_EDGES_HIDDEN()
    rough = optics.undistort(_map(turn, shape.marks_m[:, :2]))
    tips = _tips(region.value, turn, optics.distort(_onto(lines, rough[2:])), origin, shape)
    if tips is None:
        return because.TAPE_ENDS_HIDDEN()
    tips = optics.undistort(tips)
    marks = _marks(lines, tips)
    if marks is None or not (np.abs(marks.ideal_px - rough) < OUT_PX + 2.0).all():
        return because.TAPE_EDGES_APART()
    true_px = expected_widths(shape, lambda points_m: marks.to_image(points_m, tape, optics))
    widening = compare_widths(found.wide_px, found.rise_px, found.good, true_px, found.clipped)
    if isinstance(widening, Reason):
        return widening
    sideways = shape.across_m[1, 0, 0] ** 2 / float((shape.across_m[1, 0] ** 2).sum())    # of what meets a side
    return _pull_in(marks, lines, widening)._replace(smear_px2=widening.smear_px2 / sideways)


def _straights(value: npt.NDArray[np.uint8], turn: Array, origin: Array, shape: Shape) -> Straights | Reason:
    """The tape's middle, width and sharpness along its straights; or why they cannot be measured."""
    centre = _map(turn, shape.samples_m)
    across = _map(turn, shape.samples_m + shape.across_m) - centre
    half_px = np.sqrt((across * across).sum(axis=2))
    out = across / half_px[..., None]
    reach_px = float(half_px.max()) + OUT_PX
    offsets = np.linspace(reach_px, -reach_px, min(MOST_STEPS, int(2 * reach_px / STEP_PX) + 1))
    level = _sample(value, centre - origin, out, offsets)
    outer, inner, good = _half_heights(level, offsets, half_px.reshape(-1))
    if good.any() and float((outer - inner)[good].mean()) > WIDE * 2 * float(half_px.mean()) + WIDE_PX:
        return because.TAPE_SMEARED()
    shift = (0.5 * (outer + inner)).reshape(half_px.shape)
    top, steepest = level.max(axis=1), (level[:, 1:] - level[:, :-1]).max(axis=1)
    rise_px = (top - level.min(axis=1)) / np.maximum(steepest, 1e-6) * (offsets[0] - offsets[1])
    return Straights(centre + shift[..., None] * out, good.reshape(half_px.shape),
                     (outer - inner).reshape(half_px.shape), rise_px.reshape(half_px.shape),
                     float(top.mean()) >= CLIPPED)


def _half_heights(level: Any, offsets: Array, half_px: Array) -> tuple[Array, Array, Any]:
    """Of profiles (n, m): where brightness is half of its height over the dark, on the outer and on the inner side (n,)
    each; and which of the profiles have both."""
    rows, steps, last = np.arange(len(level)), np.arange(len(offsets)), len(offsets) - 1
    peak = np.where(np.abs(offsets) <= half_px[:, None] + 2.0, level, -1.0).argmax(axis=1)
    top = level[rows, peak]
    outer_half, inner_half = (0.5 * (top + tail.min(axis=1)) for tail in (level[:, :TAIL], level[:, -TAIL:]))
    before = np.where((level < outer_half[:, None]) & (steps < peak[:, None]), steps, -1).max(axis=1)
    after = np.where((level < inner_half[:, None]) & (steps > peak[:, None]), steps, last + 1).min(axis=1)
    good = (2 * (top - np.maximum(outer_half, inner_half)) >= LEAST_CONTRAST) & (before >= 0) & (after <= last)
    after, step_px = np.minimum(after, last), offsets[0] - offsets[1]
    outer = offsets[before] - step_px * _share(level, rows, before, before + 1, outer_half, good)
    inner = offsets[after] + step_px * _share(level, rows, after, after - 1, inner_half, good)
    return outer, inner, good


def _onto(lines: _Lines, points: Array) -> Array:
    """Two points (2, 2) moved to the nearest places on the left and on the right line."""
    middle, along = lines.middle[1:], lines.along[1:]
    return np.asarray(middle + ((points - middle) * along).sum(axis=1)[:, None] * along)


def _tips(value: npt.NDArray[np.uint8], turn: Array, near: Array, origin: Array, shape: Shape) -> Array | None:
    """(2, 2): the cut ends' middles in the image, left and right, which lie near these points on the middle lines; None
    where an end does not stand out, or is not cut as the tape is: something else ends it."""
    rough = _map(turn, shape.tips_m)
    up = _map(turn, shape.tips_m + shape.up_m) - rough
    centre = rough + (near - rough.mean(axis=1))[:, None]
    half_px = np.sqrt((up * up).sum(axis=2))
    reach_px = max(2.5 * float(half_px.max()), 2.0) + OUT_PX
    offsets = np.linspace(reach_px, -reach_px, min(MOST_STEPS, int(2 * reach_px / STEP_PX) + 1))
    level = _sample(value, centre - origin, up / half_px[..., None], offsets)
    outside, inside = level[:, :TAIL].min(axis=1), level[:, -2 * TAIL:].mean(axis=1)
    half = 0.5 * (outside + inside)
    first = (level >= half[:, None]).argmax(axis=1)
    good = (first > 0) & (inside - outside >= LEAST_CONTRAST)
    if not good.all():
        return None
    rows = np.arange(len(level))
    shift = offsets[first - 1] - (offsets[0] - offsets[1]) * _share(level, rows, first - 1, first, half, good)
    shift = shift.reshape(half_px.shape)
    if (np.ptp(shift, axis=1) > LEVEL * 2 * half_px.mean(axis=1) + LEVEL_PX).any():
        return None
    ends = centre + shift[..., None] * up / half_px[..., None]
    return np.asarray(ends.mean(axis=1))


def _sample(value: npt.NDArray[np.uint8], centre: Array, out: Array, offsets: Array) -> Any:
    """(n, m): brightness at these offsets from n centres along their unit vectors."""
    where = (centre[..., None, :] + offsets[:, None] * out[..., None, :]).astype(np.float32)
    where = where.reshape(-1, len(offsets), 2)
    level = cv2.remap(value, where, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(level, dtype=np.float64)


def _share(level: Any, rows: Any, dark: Any, lit: Any, half: Any, good: Any) -> Any:
    """How far from the dark sample to the lit one the level is half."""
    rise = level[rows, lit] - level[rows, dark]
    return (half - level[rows, dark]) / np.where(good & (rise > 0), rise, np.inf)


def _map(turn: Array, points: Array) -> Array:
    """Points (..., 2) through a homography (3, 3)."""
    lifted = points @ turn[:, :2].T + turn[:, 2]
    return np.asarray(lifted[..., :2] / lifted[..., 2:])


def _fit_lines(points: Array, good: Any) -> _Lines | None:
    """Total least squares, outliers left out step by step; None when any line is left with too few points."""
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
    square = np.maximum((weight * beside * beside).sum(axis=1) / (count - 2), FAINTEST_PX**2)
    along_px2 = (weight * (dx * dx + dy * dy)).sum(axis=1) / count
    apart = np.clip(np.sqrt(12 * along_px2) / ALIKE_PX, 3.0, count)
    return _Lines(middle, np.column_stack([b, -a]), square, square / apart, square / apart / along_px2)


def _marks(lines: _Lines, tips: Array) -> Marks | None:
    """Marks, and their covariance through those of the lines and of the ends; None when two lines hardly cross."""
    normal = np.column_stack([-lines.along[:, 1], lines.along[:, 0]])
    level = (normal * lines.middle).sum(axis=1)
    marks = np.empty((4, 2))
    slope = np.zeros((4, 2, 8))       # of the marks: offset and angle of the bottom, left, right line, left, right end
    for mark, side in ((0, 2), (1, 1)):
        (a, b), (c, d) = normal[0], normal[side]
        crossing = a * d - b * c
        if abs(crossing) < LEAST_CROSSING:
            return None
        both = np.array([[d, -b], [-c, a]]) / crossing
        marks[mark] = both @ np.array([level[0], level[side]])
        for column, line in ((0, 0), (1, side)):
            lever = float((marks[mark] - lines.middle[line]) @ lines.along[line])
            slope[mark, :, 2 * line] = both[:, column]
            slope[mark, :, 2 * line + 1] = both[:, column] * lever
    for mark, side, tip in ((2, 1, 0), (3, 2, 1)):
        lever = float((tips[tip] - lines.middle[side]) @ lines.along[side])
        marks[mark] = lines.middle[side] + lever * lines.along[side]
        slope[mark, :, 2 * side], slope[mark, :, 2 * side + 1] = normal[side], normal[side] * lever
        slope[mark, :, 6 + tip] = lines.along[side]
    ends = TIP_SPREAD * lines.point_var[1:]
    variance = np.concatenate([np.column_stack([lines.offset_var, lines.slope_var]).ravel(), ends])
    flat = slope.reshape(8, 8)
    return Marks(marks, flat @ (variance[:, None] * flat.T))


def _pull_in(marks: Marks, lines: _Lines, widening: Widening) -> Marks:
    """The marks with both cut ends, which are parallel to the bottom, nearer to it by their widening."""
    out = np.zeros(8)
    for mark, side in ((2, 1), (3, 2)):
        sine = lines.along[0, 0] * lines.along[side, 1] - lines.along[0, 1] * lines.along[side, 0]
        outward = math.copysign(1.0, float((marks.ideal_px[mark] - lines.middle[side]) @ lines.along[side]))
        out[2 * mark:2 * mark + 2] = outward * lines.along[side] / max(abs(float(sine)), LEAST_CROSSING)
    return Marks(marks.ideal_px - widening.shift_px * out.reshape(4, 2),
                 marks.spread_px2 + widening.variance_px2 * out[:, None] * out)
