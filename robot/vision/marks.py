"""Detection of the tape in an image: regions of its colour, and its four marks to sub-pixel accuracy with covariance.

The image must be exposed for tape under a ring light, so that all else is dark. Automatic exposure brightens the
picture of the room until the tape is white, and then the tape's colours and edges are wrong. Since most of the image is
dark, the colour is first searched for in every fourth row and column, and the full resolution is used only around
matches.

The region's convex hull gives the corners to within a pixel or two; the side without tape is the open top. Brightness
is sampled at many places across each straight (a straight stretch of tape). In such a profile, the two points at half
height are equally far from the middle of the tape, however blurred, bloomed or overexposed it is, and a line is fitted
through their midpoints. Along the centre line, the point at half height marks the position of a cut end, because in
linear light the strip and its missing continuation mirror each other there. With a tone curve, or where the brightness
clips, the point at half height lies as far outside a cut end as outside the edges of the bottom straight. The marks are
the intersections of the centre lines and the ends. The scatter of the points about their line gives the marks'
covariance; two marks on one line share the error of that line.

Measured widths show how much wider the tape appears than its geometric image. Blur does not change the width of a
straight at half height unless the straight is narrow; then the width follows from the slope of the edges. A tone curve
or clipping moves half height outward on both edges, so the excess width is twice the error of a cut end. The bottom
straight shows this best: it is parallel to the cut ends, so that blur and motion affect both alike. The width also
reveals a different tape, or a tape that is partly hidden along its own edges: its three straights fit neither the marks
nor each other.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from truearc.hw.reason import Reason
from truearc.robot import reasons as because
from truearc.robot.config.schema import Tape, Vision
from truearc.robot.reasons import IMAGE_BRIGHT, IMAGE_BURNT, IMAGE_TOO_SMALL
from truearc.robot.vision.pose import PROBES, SAMPLES, Array, Optics, Shape, make_shape

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
    """Return regions of at least `min_area_px` in a BGR image (h, w, 3); a region's area is that within its outline."""
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
    """Return where a BGR image has the tape's colour (255, else 0), and its HSV value; hue_low > hue_high wraps."""
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
        if not any(box[0] >= x0 and box[1] >= y0 and box[2] <= x1 and box[3] <= y1 for x0, y0, x1, y1 in kept):
            kept.append(box)
    return kept


def _regions_in(patch: Image, vision: Vision, min_area_px: float, x0_px: int, y0_px: int) -> list[Region]:
    mask, value = mask_colour(patch, vision)
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    return [Region(contour, area_px, mask, value, x0_px, y0_px) for contour in contours
            if (area_px := float(cv2.contourArea(contour))) >= min_area_px]


def check_size(image: Image) -> Reason | None:
    """Return None for an image that is large enough to search, else why it is not."""
    height_px, width_px = image.shape[:2]
    return IMAGE_TOO_SMALL(width_px=width_px, height_px=height_px) if min(height_px, width_px) < LEAST_PX else None


def check_exposure(image: Image) -> Reason | None:
    """Return None for a usable image (h, w, 3), else what is wrong with its exposure."""
    blue, green, red = np.ascontiguousarray(image[::SPARSE, ::SPARSE].transpose(2, 0, 1))
    if np.count_nonzero(np.maximum(np.maximum(blue, green), red) >= BRIGHT) > 0.5 * blue.size:
        return IMAGE_BRIGHT()
    if np.count_nonzero(np.minimum(np.minimum(blue, green), red) >= BURNT) > BURNT_SHARE * blue.size:
        return IMAGE_BURNT()
    return None


def is_dark(image: Image, value: int) -> bool:
    """Return whether no sampled pixel of an image (h, w, 3) reaches this brightness."""
    return bool(image[::SPARSE, ::SPARSE].max() < value)


FILL_LOW, FILL_HIGH = 0.08, 0.65      # tape area / hull area; 0.22 for bare tape, more when it is small and blurred
LEAST_SIDE_PX = 6.0
LEAST_LIT, MOST_LIT_HOLLOW = 0.8, 0.25
NEXT, BEFORE = np.array([1, 2, 3, 0]), np.array([3, 0, 1, 2])
LIT_ALONG = np.linspace(0.2, 0.8, 13)[:, None, None]
LIT_DEPTH_PX = 1.5
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
GENTLE = math.sqrt(2.0 * math.pi)     # a blurred edge's rise at its steepest, over the blur's standard deviation
TAPE_SHARE = 0.07                     # by which a tape may be wider or narrower than configured
SCALE_SHARE = 0.05                    # marks that the lens bends give a straight's scale to a quarter of this
FINEST_PX = 0.15                      # no width is better known: samples lie half a pixel apart
SIGMAS = 4.0
MOST_TONE, MOST_CLIPPED = 1.0, 2.0    # widening of both edges by a tone curve, or where the tape clips, in blurs: a
                                      # gamma of 2.2 makes 0.8; two and a half times too bright 1.9, as it looks sharper
INDEPENDENT = 8.0                     # of a straight's SAMPLES widths
WIDTH_SIGMA = 0.03                    # share of the width: how well a tape's width is known, for its widening
NARROW_SIGMA = 0.3                    # share of what the blur adds to a narrow straight: blurs are not Gaussian
END_SIGMA = 0.4                       # share of the widening by which a cut end's may differ: a halo is lifted, too
USUAL_PX = 0.5                        # widening to be expected of an edge before it is measured
SQUARE_MEAN = 12.0                    # of a straight way, squared, over the variance that it adds to a blur
AT_REST = 2.5                         # smear over blur that is seen without any motion: colours are kept at half width
NEIGHBOURS = np.array([1, 2, 0])


class Widening(NamedTuple):
    """How far outside its true position an edge along the bottom straight appears, and what the edges' blur shows."""

    shift_px: float
    variance_px2: float
    smear_px2: float                  # squares of a motion seen across the sides, less those of one along them


def _blurred() -> tuple[Array, Array]:
    """A strip's width, and its width at half height after a blur, both over the blur that its edges show."""
    at, strips = np.linspace(-10.0, 10.0, 401), np.linspace(0.1, 10.0, 60)
    bell = np.vectorize(math.erf)(np.stack([at + strips[:, None] / 2, at - strips[:, None] / 2]) / math.sqrt(2.0))
    level = 0.5 * (bell[0] - bell[1])
    peak = level.max(axis=1)
    shown = peak / np.diff(level, axis=1).max(axis=1) * (at[1] - at[0]) / GENTLE
    half = [np.interp(-0.5 * top, -row[200:], at[200:]) for top, row in zip(peak, level, strict=True)]
    return strips / shown, 2.0 * np.array(half) / shown


TRUE_BLURS, SEEN_BLURS = _blurred()


def expected_widths(shape: Shape, to_image: Callable[[Array], Array]) -> Array:
    """Return (3, SAMPLES): pixels from edge to edge, where `to_image` projects points of the target's plane."""
    edges = np.stack([shape.samples_m + shape.across_m, shape.samples_m - shape.across_m])
    seen = to_image(edges.reshape(-1, 2)).reshape(2, 3, SAMPLES, 2)
    across = seen[0] - seen[1]
    return np.asarray(np.sqrt((across * across).sum(axis=2)))


def compare_widths(seen_px: Array, rise_px: Array, good: Any, true_px: Array, clipped: bool) -> Widening | Reason:
    """Return the widening, or why this cannot be the whole tape.

    Arguments, (3, SAMPLES) each: measured widths at half height and rises of the edges, which of them are good, and the
    widths that follow from marks and tape.
    """
    count, off = good.sum(axis=1), seen_px - true_px
    width, blur, excess = (np.where(good, part, 0.0).sum(axis=1) / count for part in (true_px, rise_px / GENTLE, off))
    scatter = np.where(good, off - excess[:, None], 0.0)
    noise = np.sqrt((scatter * scatter).sum(axis=1) / count / INDEPENDENT)
    narrow = np.maximum(blur * np.interp(width / blur, TRUE_BLURS, SEEN_BLURS) - width, 0.0)
    narrow[width > TRUE_BLURS[-1] * blur] = 0.0
    excess = excess - narrow
    least = FINEST_PX + SIGMAS * noise + NARROW_SIGMA * narrow
    if (excess < -TAPE_SHARE * width - least).any():
        return because.TAPE_NARROW()
    if (excess > TAPE_SHARE * width + (MOST_CLIPPED if clipped else MOST_TONE) * blur + least).any():
        return because.TAPE_WIDE()
    apart = np.abs(excess - excess[NEIGHBOURS])
    if (apart > SCALE_SHARE * width + np.maximum(least, least[NEIGHBOURS])).any():
        return because.TAPE_UNEVEN()
    sigma_px = 0.5 * math.hypot(WIDTH_SIGMA * width[0], NARROW_SIGMA * narrow[0], noise[0])
    share = USUAL_PX**2 / (USUAL_PX**2 + sigma_px**2)
    shift_px = share * max(0.5 * float(excess[0]), 0.0)
    return Widening(shift_px, share * sigma_px**2 + (END_SIGMA * shift_px) ** 2, _smear(blur))


def _smear(blur: Array) -> float:
    """Blurs of bottom, left and right -> by how much more the sides are smeared than the bottom is (below 0: less),
    squared, as far as a picture taken at rest does not show as much."""
    apart = SQUARE_MEAN * (0.5 * float(blur[1] ** 2 + blur[2] ** 2) - float(blur[0] ** 2))
    return math.copysign(max(abs(apart) - (AT_REST * float(blur.min())) ** 2, 0.0), apart)


class Marks(NamedTuple):
    """The marks in ideal pixels (4, 2), and the covariance (8, 8) of x0 y0 x1 ... from the edges alone."""

    ideal_px: Array
    spread_px2: Array
    smear_px2: float = 0.0            # right or left while the shutter was open, squared; below 0: up or down

    def to_image(self, points_m: Array, tape: Tape, optics: Optics) -> Array:
        """Project points (n, 2) of the target's plane into the image by these marks, regardless of the lens."""
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
    """Measure the marks near four rough outer corners (4, 2) in the image, or return why they cannot be measured."""
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


def find_outline(region: Region, optics: Optics, tape: Tape) -> Marks | Reason:
    """Return the tape's four marks in a region, or why it cannot be the tape."""
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
