"""An opening that faces up in MuJoCo: walls around it, whose upper edges are the rim, a lip, and a backboard.

The ball bounces off all of them. It is in once it is well below the rim between the walls, as in a funnel or a net.
Field axes: the opening's centre is above x = 0, y = 0.
"""

import math

import numpy as np
from msgspec import UnsetType

from truearc.robot.config.rig_spec import Target

ROUND = 32                            # sides of what stands for a circle
WALL_M, WALL_HIGH_M = 0.02, 0.5
IN_M = 0.15                           # below the rim, where a ball between the walls stays
BOARD_HALF_M = 3.0
# Chosen: foam balls bounce back with a third to two thirds of their speed
WALL_BOUNCE, BOARD_BOUNCE, CONTACT_S = 0.4, 0.6, 0.02
FRICTION = 0.8
STEPS = 10                            # of the flight's, near a contact


class Goal:
    """The opening of one target."""

    def __init__(self, target: Target) -> None:
        self.target = target
        self._tilt_rad = 0.0 if isinstance(target.tilt_deg, UnsetType) else math.radians(target.tilt_deg)
        self._lip_m = 0.0 if isinstance(target.lip_m, UnsetType) else target.lip_m
        self._corners_m = corners_of(target)

    def xml(self) -> str:
        """Return MuJoCo's bodies of it."""
        middle, half_m = 0.5 * (self._lip_m - WALL_HIGH_M), 0.5 * (self._lip_m + WALL_HIGH_M)
        walls = []
        for begin, end in zip(self._corners_m, np.roll(self._corners_m, -1, axis=0), strict=True):
            along = (end - begin) / np.linalg.norm(end - begin)
            x, y = 0.5 * (begin + end) + 0.5 * WALL_M * np.array([along[1], -along[0]])      # beside the opening
            long = 0.5 * float(np.linalg.norm(end - begin))
            turn_deg = math.degrees(math.atan2(along[1], along[0]))
            walls.append(_box((x, y, middle), (long, 0.5 * WALL_M, half_m), turn_deg, WALL_BOUNCE))
        high_m = self.target.centre_height_m
        parts = [f'<body pos="0 0 {high_m}" euler="0 {-math.degrees(self._tilt_rad)} 0">{"".join(walls)}</body>']
        if not isinstance(board := self.target.backboard, UnsetType):
            place = board.behind_m + 0.5 * WALL_M, 0.0, high_m + 0.5 * board.height_m
            parts.append(_box(place, (0.5 * WALL_M, BOARD_HALF_M, 0.5 * board.height_m), 0.0, BOARD_BOUNCE))
        return "".join(parts)

    def place(self, position_m: np.ndarray) -> tuple[float, float, float]:
        """Return a place along the opening, to its left and above its plane."""
        x, y, z = position_m
        up, cos, sin = z - self.target.centre_height_m, math.cos(self._tilt_rad), math.sin(self._tilt_rad)
        return float(x * cos + up * sin), float(y), float(up * cos - x * sin)

    def holds(self, along_m: float, left_m: float) -> bool:
        """Return whether a place along and to the left is between the walls."""
        begin, end = self._corners_m, np.roll(self._corners_m, -1, axis=0)
        beside = (end - begin)[:, 0] * (left_m - begin[:, 1]) - (end - begin)[:, 1] * (along_m - begin[:, 0])
        return bool((beside >= 0.0).all())

    def word(self, crossed_m: tuple[float, float] | None, inside: bool) -> str:
        """Return the button for a ball that last came down through the rim's plane there."""
        if inside and crossed_m is not None:
            ring = self.target.ring
            return "three" if not isinstance(ring, UnsetType) and math.hypot(*crossed_m) <= ring.radius_m else "two"
        if crossed_m is None:
            return "miss-low"
        along_m, left_m = crossed_m
        if abs(left_m) > self._corners_m[:, 1].max():
            return "miss-left" if left_m > 0.0 else "miss-right"
        return "miss-high" if along_m > 0.0 else "miss-low"


def corners_of(target: Target) -> np.ndarray:
    """Return the corners [n, 2] of the opening, x and y from its centre, counterclockwise."""
    along_m, across_m = target.half_sizes_m
    if target.shape == "rectangle":
        return np.array([[along_m, -across_m], [along_m, across_m], [-along_m, across_m], [-along_m, -across_m]])
    sides = ROUND if isinstance(target.sides, UnsetType) else target.sides
    turns = (np.arange(sides) - 0.5) * 2.0 * math.pi / sides
    return along_m / math.cos(math.pi / sides) * np.column_stack([np.cos(turns), np.sin(turns)])


def _box(place: tuple[float, float, float], half_m: tuple[float, float, float], turn_deg: float, bounce: float) -> str:
    # a ball that gives back this share of its speed is a spring with this damping, for half a period
    stiff, damp = (math.pi**2 + math.log(bounce)**2) / CONTACT_S**2, -2.0 * math.log(bounce) / CONTACT_S
    pos, size = (" ".join(f"{part:.9g}" for part in each) for each in (place, half_m))
    return (f'<geom type="box" contype="1" conaffinity="0" pos="{pos}" size="{size}" euler="0 0 {turn_deg:.9g}" '
            f'friction="{FRICTION} 0 0" priority="1" solref="{-stiff:.9g} {-damp:.9g}" solimp="0.9 0.9 0.001"/>')
