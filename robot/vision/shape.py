"""The tape's geometry in the target's own frame, metres.

x right and y up as the viewer sees them, z towards the viewer, origin midway between the outer top and bottom edges.

What vision measures are the four `marks`: where the tape's middle lines meet at the bottom, and where they end at the
top. Blur, bloom and overexposure move a thin tape's edges, all to the same extent on both sides; its middle they leave
where it is.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from truearc.robot.config.schema import AprilTag, Tape

Array = npt.NDArray[np.float64]
PROBES = 9                            # points on each of the tape's three straights
SAMPLES = 24                          # places along each of them where its middle is measured
FIRST, LAST = 0.16, 0.84              # of a straight; near its ends the other straights disturb it
TIP_ROWS = (-0.2, -0.1, 0.0, 0.1, 0.2)    # beside the middle line, in tape widths, where the cut ends are measured
STRAIGHTS = ((0, 1), (1, 2), (3, 0))  # marks at the ends of the bottom, left and right straight


@dataclass(frozen=True)
class Shape:
    """What vision looks for. The arrays are shared and not to be written."""

    corners_m: Array                  # (4, 3) outer corners: bottom right, bottom left, top left, top right
    marks_m: Array                    # (4, 3) the middle lines' ends, in the same order
    samples_m: Array                  # (3, SAMPLES, 2) on the middle lines
    across_m: Array                   # (3, 1, 2) from a middle line to the outer edge
    tips_m: Array                     # (2, len(TIP_ROWS), 2) on the cut ends: left, right
    up_m: Array                       # (2, 1, 2) from a tip on along the tape, half the tape's width long
    probes_m: Array                   # (3 PROBES + 12, 3): first on the tape, then inside its opening


@lru_cache(maxsize=8)
def make_shape(tape: Tape) -> Shape:
    """The shape of a tape of these dimensions (kept: a tape does not change from image to image)."""
    marks = _marks_m(tape)
    ends = np.array([(marks[a], marks[b]) for a, b in STRAIGHTS])
    along = ends[:, 1] - ends[:, 0]
    along /= np.linalg.norm(along, axis=1)[:, None]
    across = np.column_stack([along[:, 1], -along[:, 0]]) * -tape.tape_width_m / 2
    share = np.linspace(FIRST, LAST, SAMPLES)[None, :, None]
    samples = ends[:, None, 0] * (1 - share) + ends[:, None, 1] * share
    up = np.array([along[1], -along[2]]) * tape.tape_width_m / 2
    rows = np.array(TIP_ROWS)[:, None] * np.array([tape.tape_width_m * math.hypot(1.0, _flare(tape)), 0.0])
    return Shape(outer_corners_m(tape), np.column_stack([marks, np.zeros(4)]), samples, across[:, None],
                 marks[2:, None] + rows, up[:, None], _probes_m(samples, tape))


def outer_corners_m(tape: Tape) -> Array:
    """(4, 3): bottom right, bottom left, top left, top right."""
    top, bottom, high = tape.top_width_m / 2, tape.bottom_width_m / 2, tape.height_m / 2
    return np.array([[bottom, -high, 0.0], [-bottom, -high, 0.0], [-top, high, 0.0], [top, high, 0.0]])


@lru_cache(maxsize=8)
def tag_corners_m(tag: AprilTag) -> Array:
    """(4, 3): outer corners of a tag's black square in its own frame, from the top left one, clockwise."""
    half = tag.side_m / 2
    return np.array([[-half, half, 0.0], [half, half, 0.0], [half, -half, 0.0], [-half, -half, 0.0]])


def _marks_m(tape: Tape) -> Array:
    """(4, 2): the middle lines' ends."""
    half, high = tape.tape_width_m / 2, tape.height_m / 2
    inward = half * math.hypot(1.0, _flare(tape))       # half the tape's width, along the horizontal
    low, up = tape.bottom_width_m / 2 + _flare(tape) * half - inward, tape.top_width_m / 2 - inward
    return np.array([[low, half - high], [-low, half - high], [-up, high], [up, high]])


def _probes_m(samples_m: Array, tape: Tape) -> Array:
    """Points on the tape, then 12 that it encloses but does not cover, in the middle half of the opening."""
    on_tape = samples_m[:, np.linspace(0, SAMPLES - 1, PROBES).astype(int)].reshape(-1, 2)
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, 4) * tape.bottom_width_m, np.array([-0.1, 0.1, 0.3]) * tape.height_m)
    flat = np.concatenate([on_tape, np.column_stack([x.ravel(), y.ravel()])])
    return np.column_stack([flat, np.zeros(len(flat))])


def _flare(tape: Tape) -> float:
    """Horizontal run of a side per unit of height."""
    return (tape.top_width_m - tape.bottom_width_m) / 2 / tape.height_m
