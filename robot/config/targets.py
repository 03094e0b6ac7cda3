"""The target of rig.toml: an opening that faces the launcher, or one that faces up, with its shape."""

import math
from collections.abc import Iterator
from typing import Any, Literal

import msgspec
from msgspec import UNSET, Struct, UnsetType

from truearc.errors import InputError


class Backboard(Struct, frozen=True):
    """An upright board behind an opening that faces up, as wide as any ball comes."""

    behind_m: float                   # from the opening's centre to the board, horizontally
    height_m: float                   # of its upper edge above the rim; its lower edge is at the rim


class Ring(Struct, frozen=True):
    """A circle about the centre of an opening that faces up, inside of which a ball scores more."""

    radius_m: float
    points: float


# what the rim of an opening that faces up is like: its shape, and the keys that state how large it is
SIZES = {"circle": ("radius_m",), "rectangle": ("length_m", "width_m"), "polygon": ("across_flats_m", "sides")}
POINTS = 2.0, 3.0                     # of a ball through the outer and through the inner part of an upright one
POINTS_UP = 1.0                       # of a hit, where no points are stated: as most games count
# the side on which a ball misses, in the words of upright openings and of those that face up
SIDES_UP = {"low": "short", "high": "long"}
SIDES_UPRIGHT = {word: upright for upright, word in SIDES_UP.items()}
HEIGHTS = ("three_half_height_m", "two_half_height_m")               # of an upright opening
FACING_UP = (*(key for keys in SIZES.values() for key in keys), "shape", "tilt_deg", "lip_m", "points", "ring",
             "backboard")


class Target(Struct, frozen=True):
    """An opening: upright, which faces the launcher, or one that faces up.

    The half heights are of an upright one. Of one that faces up they are derived: half its length toward the launcher,
    and the radius of its ring. All keys below them are of one that faces up; they are not written where they are not
    stated, so that hashes stay.
    """

    centre_height_m: float                # of the rim's centre, where it faces up
    three_half_height_m: float = 0.07     # Eq. 13 of the paper
    two_half_height_m: float = 0.35       # Eq. 14 of the paper
    facing: Literal["front", "up"] | UnsetType = UNSET
    shape: Literal["circle", "rectangle", "polygon"] | UnsetType = UNSET
    radius_m: float | UnsetType = UNSET
    length_m: float | UnsetType = UNSET           # along the way of the ball
    width_m: float | UnsetType = UNSET
    across_flats_m: float | UnsetType = UNSET     # of a regular polygon with a flat toward the launcher
    sides: int | UnsetType = UNSET                # an even number
    tilt_deg: float | UnsetType = UNSET           # of the rim, about the axis across; positive: its far end is higher
    lip_m: float | UnsetType = UNSET              # height of an edge around it, above the plane in which a ball scores
    points: float | UnsetType = UNSET             # of a hit; POINTS_UP where not stated
    ring: Ring | UnsetType = UNSET
    backboard: Backboard | UnsetType = UNSET

    def __post_init__(self) -> None:
        if self.faces_up:
            inner = 0.0 if isinstance(self.ring, UnsetType) else self.ring.radius_m
            msgspec.structs.force_setattr(self, "three_half_height_m", inner)
            msgspec.structs.force_setattr(self, "two_half_height_m", self.half_sizes_m[0])

    @property
    def faces_up(self) -> bool:
        return self.facing == "up"

    @property
    def half_sizes_m(self) -> tuple[float, float]:
        """Half the length toward the launcher and half the width of an opening that faces up; 0 what is not stated."""
        def of(size_m: float | UnsetType) -> float:
            return 0.0 if isinstance(size_m, UnsetType) else size_m

        if self.shape == "circle":
            return of(self.radius_m), of(self.radius_m)
        if self.shape == "rectangle":
            return 0.5 * of(self.length_m), 0.5 * of(self.width_m)
        sides = 4 if isinstance(self.sides, UnsetType) else max(self.sides, 4)
        corners = 1.0 / math.cos(math.pi / sides) if sides % 4 else 1.0           # at the left and the right
        return 0.5 * of(self.across_flats_m), 0.5 * of(self.across_flats_m) * corners

    @property
    def hit_or_miss(self) -> bool:
        """Whether every hit counts the same: there is no inner opening, and hits are recorded as two."""
        return self.three_half_height_m == 0.0

    def word(self, outcome: str) -> str:
        """Return the driver's word for an outcome: hit, if every hit counts the same."""
        return "hit" if self.hit_or_miss and outcome in ("two", "three") else outcome

    @property
    def worth(self) -> tuple[float, float]:
        """Points of a ball through the opening, and through its inner part."""
        if not self.faces_up:
            return POINTS
        hit = POINTS_UP if isinstance(self.points, UnsetType) else self.points
        return hit, hit if isinstance(self.ring, UnsetType) else self.ring.points

    def button(self, name: str) -> str:
        """Return what a button of the box, or a mark, is called at this opening."""
        if not self.faces_up:
            return name
        words = {"two": self.word("two")} | {f"miss-{side}": word for side, word in SIDES_UP.items()}
        return words.get(name, name.removeprefix("miss-"))

    def noted(self, outcome: str, side: str) -> tuple[str, str]:
        """Return an outcome and its side in the words of this opening; a ball that went into one that faces up has no
        side."""
        if not self.faces_up:
            return outcome, SIDES_UPRIGHT.get(side, side)
        return outcome, SIDES_UP.get(side, side) if outcome in ("", "miss") else ""


def misplaced(table: Any) -> Iterator[tuple[str, str]]:
    """Yield the dotted key of each number in the contents of rig.toml that an opening that faces up does not have."""
    target = table.get("target", {}) if isinstance(table, dict) else {}
    if isinstance(target, dict) and target.get("facing") == "up":
        yield from ((f"target.{key}", "is of an upright opening; one that faces up has a shape with sizes, and a table "
                     "[target.ring] if a part of it scores more") for key in HEIGHTS if key in target)


def refuse_up(target: Target | None, doing: str) -> None:
    """Raise InputError for an opening that faces up, where `doing` does not know it yet."""
    if target is not None and target.faces_up:
        raise InputError(f"rig.toml: target.facing: is up, and {doing} knows only openings that face front so far")


def target_errors(target: Target, ball_radius_m: float) -> Iterator[tuple[str, str]]:
    """Yield the key in [target] of each statement that contradicts another, or the ball, and what is wrong with it."""
    if not target.faces_up:
        yield from ((key, 'is of an opening that faces up; state facing = "up" for one') for key in FACING_UP
                    if getattr(target, key) is not UNSET)
        if target.three_half_height_m > target.two_half_height_m:
            yield "three_half_height_m", "exceeds two_half_height_m, but three lies inside two"
    elif isinstance(target.shape, UnsetType):
        yield "shape", f"missing key; an opening that faces up is one of {', '.join(SIZES)}"
    else:
        yield from _shape_errors(target, target.shape, ball_radius_m)
        yield from _inside_errors(target)


def _shape_errors(target: Target, own: str, ball_radius_m: float) -> Iterator[tuple[str, str]]:
    for shape, keys in SIZES.items():
        for key in keys:
            if shape != own and getattr(target, key) is not UNSET:
                yield key, f"is the size of a {shape}, but the shape is {own}"
            if shape == own and getattr(target, key) is UNSET:
                yield key, f"missing key; a {shape} has {' and '.join(keys)}"
    if not isinstance(target.sides, UnsetType) and (target.sides < 4 or target.sides % 2 or target.sides > 64):
        yield "sides", f"{target.sides} must be an even number from 4 to 64; one side faces the launcher"
    for key, half_m in zip(SIZES[own], target.half_sizes_m, strict=False):
        if 0.0 < half_m < ball_radius_m:
            yield key, (f"the opening is {2.0 * half_m:g} m from edge to edge, less than the ball's "
                        f"{2.0 * ball_radius_m:g} m: no ball goes in")


def _inside_errors(target: Target) -> Iterator[tuple[str, str]]:
    ring, board, (along_m, across_m) = target.ring, target.backboard, target.half_sizes_m
    if not isinstance(ring, UnsetType) and ring.radius_m >= min(along_m, across_m):
        yield "ring.radius_m", (f"{ring.radius_m:g} is not inside the opening, which ends {min(along_m, across_m):g} m "
                                "from its centre")
    if not isinstance(board, UnsetType) and 0.0 < board.behind_m < along_m:
        yield "backboard.behind_m", (f"{board.behind_m:g} is inside the opening, which ends {along_m:g} m behind its "
                                     "centre")
