"""Balls in one picture: blobs that differ from the background and are round, or a round shape that moved.

A ball that moves while the shutter is open leaves a streak: a disk swept along a line. Its middle is where the ball
was at the middle of the exposure. With coverage a(x, y) from 0 to 1 of the streak's pixels, the variance across is
d^2 / 16, of the disk alone, and along d^2 / 16 + L^2 / 12, which gives the length L. The diameter d is that of the area
of a disk, or for a streak that of the variance across.
"""

from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from truearc.sim.video.frames import Image

Floats = npt.NDArray[np.float64]
# Chosen on clips that tests/sim/video draws and on four by others; no benchmark measures them yet
LEAST_DIFFERENCE, NOISE_SDS = 14.0, 5.0           # of grey levels: what may be a ball
LEAST_AREA = 16                       # pixels; a smaller ball has no diameter
MAX_SHARE = 0.12                      # of the picture's longer side: the largest ball
MAX_STREAK = 12.0                     # diameters
MARGIN = 2                            # pixels of half the resolution around a blob, for its edges
LEAST_DIAMETER = 5.0                  # pixels
CLEAR = 12.0                          # pixels x least differences: what is small must stand out more
EDGE_VARIANCE = 0.5                   # pixels^2: what lens, pixel and coding add to a shape's variance
# percentiles of a shape's difference that are a place covered all the time; the second where the contrast varies
FULL = (85.0, 40.0)
LEAST_EDGE = 6.0                      # pixels: the diameter of a disk whose edge can be followed
EDGE_REACH, RADII, DIRECTIONS = 0.9, 48, 48       # diameters from the centre that are looked at; samples of them
INSIDE, RIM = (0.28, 0.42), (0.34, 0.44)          # diameters from the centre: inside, and near the edge
# Measured on rendered clips: the mean centre is off by 0.20 pixels, 0.42 without; with three lights that were not used
# for this choice by 0.07
SHADING = 0.5                         # share of the fall of the contrast toward the edge that goes on up to it
LEAST_LIT, OUTLIER = 0.3, 0.4         # of the rim's contrast, at the edge; samples of RADII off a circle
STREAK = 0.9                          # diameters: a longer way during the exposure is a streak
# diameter by the spread / by the area of a disk; by the area of a streak / by the spread
SOLID = ((0.85, 1.2), (0.6, 1.25))
MAX_BLOBS, KEPT = 80, 30              # shapes of a picture that are measured, the thickest; and kept, the clearest


class Blob(NamedTuple):
    """A shape that may be a ball, in pixels; x to the right, y down.

    Fields:
        time_s: Of its picture.
        x_px, y_px: Centre.
        diameter_px: Of the ball, across the streak.
        length_px: Of the streak: way of the centre during the exposure.
        angle_rad: Direction of the streak, from x toward y; without meaning where the length is small.
        contrast: Grey levels between ball and background.
        row: Place between the first row of the sensor (-0.5) and its last (0.5), for the rolling shutter.
        frame: Number of the picture.
    """

    time_s: float
    x_px: float
    y_px: float
    diameter_px: float
    length_px: float
    angle_rad: float
    contrast: float
    row: float
    frame: int


def find_blobs(difference: Image, noise: float, frame: int, time_s: float,
               quarter_turns: int = 0) -> list[Blob]:
    """Return the shapes of a picture that may be balls.

    Args:
        difference: How far each pixel differs from the background.
        noise: One standard deviation of that.
        frame: Number of the picture.
        time_s: Its time.
        quarter_turns: By which the picture was turned counterclockwise, which turned the sensor's rows.
    """
    level = max(LEAST_DIFFERENCE, NOISE_SDS * noise)
    mask = cv2.threshold(cv2.blur(difference, (3, 3)), level, 255, cv2.THRESH_BINARY)[1]
    # at half the resolution: labelling takes most of the time
    small = cv2.threshold(cv2.resize(mask, (mask.shape[1] // 2, mask.shape[0] // 2), interpolation=cv2.INTER_AREA), 120,
                          255, cv2.THRESH_BINARY)[1]
    _, labels, stats, _ = cv2.connectedComponentsWithStats(small, connectivity=8, ltype=cv2.CV_32S)
    width, height = (2.0 * stats[:, k] for k in (cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT))
    area = 4.0 * stats[:, cv2.CC_STAT_AREA]
    longest = MAX_SHARE * max(difference.shape)
    thick = area / np.hypot(width, height)        # of a streak nearly its diameter, of branches little
    fits = (area >= LEAST_AREA) & (thick >= 2.0) & (thick <= longest) & (np.hypot(width, height) <= MAX_STREAK * thick)
    fits[0] = False                   # the background
    found = []
    for label in sorted(np.flatnonzero(fits), key=lambda one: -thick[one])[:MAX_BLOBS]:
        blob = _measure(difference, mask, labels, stats[label], int(label), level)
        if blob is not None and blob[2] * blob[5] >= CLEAR * level:
            row = _row(blob[0], blob[1], difference.shape, quarter_turns)
            found.append(Blob._make((time_s, *map(float, blob), row, frame)))
    return sorted(found, key=lambda one: -one.diameter_px * one.contrast)[:KEPT]


def _row(x_px: float, y_px: float, shape: tuple[int, ...], quarter_turns: int) -> float:
    down, right = y_px / shape[0] - 0.5, x_px / shape[1] - 0.5
    return (down, right, -down, -right)[quarter_turns]


def _measure(difference: Image, mask: Image, labels: npt.NDArray[np.int32], box: npt.NDArray[np.int32], label: int,
             level: float) -> tuple[float, float, float, float, float, float] | None:
    """(x, y, diameter, length, angle, contrast) of one shape; None if it is no disk and no streak, or is cut off."""
    if box[0] == 0 or box[1] == 0 or box[0] + box[2] == labels.shape[1] or box[1] + box[3] == labels.shape[0]:
        return None
    left, top, right, bottom = (max(box[0] - MARGIN, 0), max(box[1] - MARGIN, 0), box[0] + box[2] + MARGIN,
                                box[1] + box[3] + MARGIN)
    own = cv2.resize(labels[top:bottom, left:right].astype(np.float32), None, fx=2.0, fy=2.0,
                     interpolation=cv2.INTER_NEAREST)
    left, top = 2 * left, 2 * top
    part = difference[top:top + own.shape[0], left:left + own.shape[1]].astype(np.float64)
    own = own[:part.shape[0], :part.shape[1]]
    inside = (own == label) & (mask[top:top + own.shape[0], left:left + own.shape[1]] > 0)
    if not inside.any():
        return None
    near = cv2.dilate(inside.astype(np.uint8), np.ones((5, 5), np.uint8)).astype(bool) & ((own == 0) | (own == label))
    for percentile in FULL:
        full = float(np.percentile(part[inside], percentile))
        floor = min(0.5 * level, 0.25 * full)
        shape = _shape(np.where(near, np.clip((part - floor) / (full - floor), 0.0, 1.0), 0.0))
        if shape is not None:
            x_px, y_px, diameter_px, length_px, angle_rad = shape
            if length_px <= STREAK * diameter_px and diameter_px >= LEAST_EDGE:
                for _ in range(2):    # the second time from a better middle
                    x_px, y_px, diameter_px = _circle(np.where(near, part, 0.0), x_px, y_px, diameter_px)
                # across the way a place is covered half of the time nearer to the middle than the edge
                diameter_px *= 2.0 / (1.0 + float(np.sqrt(1.0 - (length_px / diameter_px / 2.0) ** 2)))
            return left + x_px, top + y_px, diameter_px, length_px, angle_rad, full
    return None


def _circle(part: Floats, x_px: float, y_px: float, diameter_px: float) -> tuple[float, float, float]:
    """(x, y, diameter) of the circle through a disk's edge, found in each direction where half of its contrast is left.

    A ball has more contrast on one side than on the other, before a textured wall or in slanting light; its edge has
    not moved for that. For the centre, the contrast at the edge is that near it, less what it loses on the way there: a
    ball's lit side darkens more slowly. That makes a blurred ball larger, so the diameter is by the contrast inside.
    Falls back on what is given where the edge is no circle.
    """
    reach = EDGE_REACH * diameter_px
    polar = cv2.warpPolar(part.astype(np.float32), (RADII, DIRECTIONS), (x_px, y_px), reach, cv2.WARP_POLAR_LINEAR)
    inner, outer = (round(RADII * share / EDGE_REACH) for share in RIM)
    near, steps = polar[:, inner:outer], np.arange(inner, outer) - (inner + outer - 1) / 2.0
    fall = np.minimum(near @ steps / (steps @ steps), 0.0) * (RADII * 0.5 / EDGE_REACH - (inner + outer - 1) / 2.0)
    rim = near.mean(axis=1)
    centre = _edge(polar, np.maximum(rim + SHADING * fall, LEAST_LIT * rim) / 2.0, outer)
    inner, outer = (round(RADII * share / EDGE_REACH) for share in INSIDE)
    size = _edge(polar, polar[:, inner:outer].mean(axis=1) / 2.0, outer)
    if centre is None or size is None or np.hypot(centre[1], centre[2]) * reach / RADII > 0.25 * diameter_px:
        return x_px, y_px, diameter_px
    radius, right, down = (one * reach / RADII for one in (size[0], centre[1], centre[2]))
    return x_px + float(right), y_px + float(down), 2.0 * float(radius)


def _edge(polar: npt.NDArray[np.float32], half: npt.NDArray[np.float32], outer: int) -> Floats | None:
    """(mean, cosine, sine) of the radius over directions at which a disk falls to `half`, from sample `outer` on."""
    below = polar[:, outer:] < half[:, None]
    sound = below.any(axis=1) & (half > 0.5 * float(np.median(half)))
    rows, last = np.flatnonzero(sound), outer - 1 + np.argmax(below, axis=1)[sound]
    high, low = polar[rows, last], polar[rows, last + 1]
    radius = last + (high - half[rows]) / np.maximum(high - low, 1e-6)
    angle = rows * 2.0 * np.pi / DIRECTIONS
    design = np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle)], axis=1)
    kept = np.ones(len(rows), dtype=bool)
    for _ in range(3):
        if kept.sum() < DIRECTIONS // 2:
            return None
        found: Floats = np.linalg.lstsq(design[kept], radius[kept], rcond=None)[0]
        off = np.abs(radius - design @ found)
        kept = off <= 2.5 * 1.48 * float(np.median(off[kept])) + OUTLIER
    return found


def _shape(cover: Floats) -> tuple[float, float, float, float, float] | None:
    """(x, y, diameter, length, angle) of the disk or streak that covers pixels by these shares; None if none does."""
    by_row, by_column, total = cover.sum(axis=1), cover.sum(axis=0), cover.sum()
    rows, columns = np.arange(len(by_row)), np.arange(len(by_column))
    x_px, y_px = float(by_column @ columns / total), float(by_row @ rows / total)
    dx, dy = columns - x_px, rows - y_px
    xx, yy, xy = by_column @ dx ** 2 / total, by_row @ dy ** 2 / total, dy @ cover @ dx / total
    middle, spread = (xx + yy) / 2.0, float(np.hypot((xx - yy) / 2.0, xy))
    length_px = float(np.sqrt(24.0 * spread))
    across = 4.0 * float(np.sqrt(max(middle - spread - EDGE_VARIANCE, 0.0)))
    area = float((cover > 0.5).sum())
    # a place is covered half of the time where the disk of the middle ends, if the streak is shorter than the disk
    disk, streak = 2.0 * float(np.sqrt(area / np.pi)), area / max(length_px, 1e-9)
    is_streak = length_px > STREAK * across
    diameter_px, expected = (across, streak) if is_streak else (disk, across)
    if diameter_px < LEAST_DIAMETER or not SOLID[is_streak][0] < expected / diameter_px < SOLID[is_streak][1]:
        return None
    return x_px, y_px, diameter_px, length_px, 0.5 * float(np.arctan2(2.0 * xy, xx - yy))
