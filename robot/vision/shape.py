"""The tape's geometry in the target's own frame, metres.

x right and y up as the viewer sees them, z towards the viewer, origin midway between the outer top and bottom edges.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from robot.config import Tape

Array = npt.NDArray[np.float64]
PROBES = 9                            # points on each of the tape's three straights


@dataclass(frozen=True)
class Shape:
    """What vision looks for. The arrays are shared and not to be written."""

    corners_m: Array                  # (4, 3) outer corners: bottom right, bottom left, top left, top right
    probes_m: Array                   # (3 PROBES + 12, 3): first on the tape, then inside its opening
    tip_share: float                  # part of the top width that each of the tape's two cut ends covers


@lru_cache(maxsize=8)
def make_shape(tape: Tape) -> Shape:
    """The shape of a tape of these dimensions (kept: a tape does not change from image to image)."""
    tip = tape.tape_width_m * math.hypot(1.0, _flare(tape)) / tape.top_width_m
    return Shape(outer_corners_m(tape), np.concatenate([_middle_line_m(tape), _hollow_m(tape)]), tip)


def outer_corners_m(tape: Tape) -> Array:
    """(4, 3): bottom right, bottom left, top left, top right."""
    top, bottom, high = tape.top_width_m / 2, tape.bottom_width_m / 2, tape.height_m / 2
    return np.array([[bottom, -high, 0.0], [-bottom, -high, 0.0], [-top, high, 0.0], [top, high, 0.0]])


def _middle_line_m(tape: Tape) -> Array:
    """(3 PROBES, 3): points along the middle of the tape, clear of its corners and ends."""
    top, bottom, high = tape.top_width_m / 2, tape.bottom_width_m / 2, tape.height_m / 2
    half = tape.tape_width_m / 2
    inward = half * math.hypot(1.0, _flare(tape))
    along = np.linspace(0.1, 0.9, PROBES)
    low_end, high_end = bottom + _flare(tape) * half - inward, top - inward
    side_x = low_end + (high_end - low_end) * along
    side_y = (half - high) + (2 * high - half) * along
    bottom_x = np.linspace(-0.8, 0.8, PROBES) * bottom
    x = np.concatenate([side_x, -side_x, bottom_x])
    y = np.concatenate([side_y, side_y, np.full(PROBES, half - high)])
    return np.column_stack([x, y, np.zeros_like(x)])


def _hollow_m(tape: Tape) -> Array:
    """(12, 3): points that the tape encloses but does not cover, in the middle half of the opening."""
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, 4) * tape.bottom_width_m, np.array([-0.1, 0.1, 0.3]) * tape.height_m)
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])


def _flare(tape: Tape) -> float:
    """Horizontal run of a side per unit of height."""
    return (tape.top_width_m - tape.bottom_width_m) / 2 / tape.height_m
