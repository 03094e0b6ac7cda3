"""Whether the tape is as wide as it is said to be, and how much wider its picture is than its image.

Blur leaves a straight's width at half height as it is, unless the straight is narrow: then the width follows from how
gently the edges rise. A tone curve, or light that clips, moves half height outward on both edges of everything, so
the excess width is twice what a cut end lies too far outside by. The bottom straight says it best: it is
parallel to the cut ends, so that blur and motion meet it as they meet them.

Beyond that, width is what gives away another tape, and a tape that is partly hidden along its own edges: the three
straights would not fit the marks, or each other.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from truearc.hw.reason import Reason
from truearc.robot import reasons as because
from truearc.robot.vision.optics import Array
from truearc.robot.vision.shape import SAMPLES, Shape

GENTLE = math.sqrt(2.0 * math.pi)     # a blurred edge's rise at its steepest, over the blur's standard deviation
TAPE_SHARE = 0.07                     # a tape may be this much wider or narrower than it is said to be
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
    """How far outside of where it is an edge along the bottom straight is seen, and what the edges' blur shows."""

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
    """(3, SAMPLES): pixels from edge to edge, where `to_image` puts points of the target's plane in the image."""
    edges = np.stack([shape.samples_m + shape.across_m, shape.samples_m - shape.across_m])
    seen = to_image(edges.reshape(-1, 2)).reshape(2, 3, SAMPLES, 2)
    across = seen[0] - seen[1]
    return np.asarray(np.sqrt((across * across).sum(axis=2)))


def compare_widths(seen_px: Array, rise_px: Array, good: Any, true_px: Array, clipped: bool) -> Widening | Reason:
    """Widths at half height and rises of the edges as measured, which of them are good, and widths as marks and tape
    make them, (3, SAMPLES) each, give the widening; or why this cannot be the tape, whole."""
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
