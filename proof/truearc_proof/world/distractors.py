"""Distractors of the target detection: lights, glare, reflections, occluders, and targets of other years.

Each kind is a function of the lens, the true target's outline in the image (or None) and random numbers, and gives
patches for StagedCamera.clutter. Other targets are flat shapes in metres, seen by the same lens from anywhere.
"""

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from truearc.hw.emulated.camera import TAPE_BGR, Array, Lens, distort, project
from truearc_proof.world.camera_damage import Patch
from truearc_proof.world.placing import place

Kind = Callable[[Lens, Array | None, np.random.Generator], tuple[Patch, ...]]

INCH_M = 0.0254
NEAREST_M = 0.3
LENS_HEIGHT_M = 0.6


def lights(lens: Lens, outline: Array | None, random: np.random.Generator) -> tuple[Patch, ...]:
    """Lamps and signs of any colour, many of them green, as bars, wedges and discs."""
    patches = []
    for _ in range(int(random.integers(2, 9))):
        corners = int(random.integers(3, 9))
        angle = np.arange(corners) * 2 * np.pi / corners
        if corners < 7:
            angle = np.sort(random.uniform(0, 2 * np.pi, corners))
        size = random.uniform(4, 70, 2) * lens.width_px / 640
        at = random.uniform(0, 1, 2) * (lens.width_px, lens.height_px)
        patches.append(Patch(at + np.column_stack([np.cos(angle), np.sin(angle)]) * size, _shine(random)))
    return tuple(patches)


def frames(lens: Lens, outline: Array | None, random: np.random.Generator) -> tuple[Patch, ...]:
    """Irregular outlines of green light: three or four bars end to end, open or closed, like tubes and door frames."""
    at = random.uniform(0.15, 0.85, 2) * (lens.width_px, lens.height_px)
    size = random.uniform(15, 150, 2)
    corners = at + np.array([[-1, -1], [-1, 1], [1, 1], [1, -1]]) * size / 2 + random.normal(0, 0.2, (4, 2)) * size
    wide = float(random.uniform(2, 12))
    bars = 3 + int(random.integers(0, 2))
    level = float(random.uniform(0.4, 1.0))
    return tuple(_bar(corners[k], corners[(k + 1) % 4], wide, level) for k in range(bars))


def floor_reflection(lens: Lens, outline: Array | None, random: np.random.Generator) -> tuple[Patch, ...]:
    """The target again, upside down, below where it is, dimmer and broken."""
    if outline is None:
        return lights(lens, outline, random)
    level = float(random.uniform(0.3, 1.0))
    mirror = float(outline[:, 1].max() + random.uniform(10, 120))
    turned = np.column_stack([outline[:, 0], 2 * mirror - outline[:, 1]])
    return _outline_bars(turned, level)


def second_goal(lens: Lens, outline: Array | None, random: np.random.Generator) -> tuple[Patch, ...]:
    """Another half hexagon of the same make, somewhere else."""
    return _shape(HALF_HEXAGON, lens, random, (1.5, 2.6))


def other_target(lens: Lens, outline: Array | None, random: np.random.Generator) -> tuple[Patch, ...]:
    """A target of another year, at any height on any wall."""
    return _shape(OTHERS[int(random.integers(0, len(OTHERS)))], lens, random, (0.4, 2.8))


def in_the_way(lens: Lens, outline: Array | None, random: np.random.Generator) -> tuple[Patch, ...]:
    """A dark bar, arm or robot before a part of the target."""
    if outline is None:
        return lights(lens, outline, random)
    low, high = outline.min(axis=0), outline.max(axis=0)
    size = (high - low) * random.uniform(0.08, 0.7, 2) + 2
    at = low + (high - low) * random.uniform(0, 1, 2)
    angle = float(random.uniform(0, np.pi))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return (Patch(at + (np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * size / 2) @ turn.T, (0.0, 0.0, 0.0)),)


def glare(lens: Lens, outline: Array | None, random: np.random.Generator) -> tuple[Patch, ...]:
    """A bright thing that touches the target."""
    if outline is None:
        return lights(lens, outline, random)
    at = outline[int(random.integers(0, len(outline)))] + random.normal(0, 6, 2)
    angle = np.arange(10) * np.pi / 5
    size = random.uniform(3, 30, 2)
    return (Patch(at + np.column_stack([np.cos(angle), np.sin(angle)]) * size, _shine(random)),)


KINDS: tuple[Kind, ...] = (lights, frames, floor_reflection, second_goal, other_target, in_the_way, glare)


def _shine(random: np.random.Generator) -> tuple[float, float, float]:
    level = float(random.uniform(0.3, 1.2))
    if random.random() < 0.6:
        blue, green, red = (level * part for part in TAPE_BGR)
    else:
        blue, green, red = (float(part) for part in random.uniform(20, 255, 3))
    return blue, green, red


def _bar(begin: Array, end: Array, wide_px: float, level: float) -> Patch:
    along = (end - begin) / max(float(np.hypot(*(end - begin))), 1e-9)
    side = np.array([along[1], -along[0]]) * wide_px / 2
    blue, green, red = (level * part for part in TAPE_BGR)
    return Patch(np.array([begin + side, end + side, end - side, begin - side]), (blue, green, red))


def _outline_bars(outline: Array, level: float) -> tuple[Patch, ...]:
    """The tape's outline (8, 2) of truearc.hw.emulated.camera as three strips."""
    blue, green, red = (level * part for part in TAPE_BGR)
    return tuple(Patch(outline[list(corners)], (blue, green, red))
                 for corners in ((0, 1, 5, 4), (1, 2, 6, 5), (3, 0, 4, 7)))


def _shape(strips_m: tuple[Array, ...], lens: Lens, random: np.random.Generator,
           heights_m: tuple[float, float]) -> tuple[Patch, ...]:
    """Flat strips (n, 2) of tape in metres, on a wall somewhere before a camera that looks up by some degrees."""
    away_m, height_m = float(random.uniform(1.2, 11.0)), float(random.uniform(*heights_m))
    view = place(away_m, height_m - LENS_HEIGHT_M, float(random.uniform(5, 30)),
                 facing_deg=float(random.uniform(-50, 50)), bearing_deg=float(random.uniform(-20, 20)))
    blue, green, red = (float(random.uniform(0.5, 1.0)) * part for part in TAPE_BGR)
    patches = []
    for strip in strips_m:
        ideal, depth_m = project(np.column_stack([strip, np.zeros(len(strip))]), view.camera_from_target, lens)
        if depth_m.min() > NEAREST_M:
            patches.append(Patch(distort(ideal, lens), (blue, green, red)))
    return tuple(patches)


def _box(x: float, y: float, wide: float, high: float, lean_deg: float = 0.0) -> Array:
    """A rectangle of tape in inches about (x, y), leaning to the right."""
    angle = np.radians(lean_deg)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    corners = np.array([[-wide, -high], [wide, -high], [wide, high], [-wide, high]]) / 2
    return np.asarray((corners @ turn.T + (x, y)) * INCH_M, dtype=np.float64)


def _polygon(corners_in: list[tuple[float, float]], wide_in: float) -> tuple[Array, ...]:
    """Strips of tape along an open line of corners, in inches."""
    strips = []
    for (x0, y0), (x1, y1) in pairwise(corners_in):
        dx, dy = x1 - x0, y1 - y0
        side = np.array([-dy, dx]) / np.hypot(dx, dy) * wide_in / 2
        middle = np.array([(x0, y0), (x1, y1)])
        strips.append(np.asarray(np.concatenate([middle + side, (middle - side)[::-1]]) * INCH_M, dtype=np.float64))
    return tuple(strips)


HALF_HEXAGON = _polygon([(-18.5, 8.5), (-9.3, -7.5), (9.3, -7.5), (18.5, 8.5)], 2)
# FIRST's games, from their manuals: 2012/2013 frames, 2014 hot goal, 2016 U, 2017 boiler and peg, 2019 hatch, 2022 hub;
# then shapes that only resemble ours
OTHERS: tuple[tuple[Array, ...], ...] = (
    _polygon([(-11, 8), (-11, -8), (11, -8), (11, 8), (-11, 8)], 2),
    _polygon([(-29, 8), (-29, -8), (29, -8), (29, 8), (-29, 8)], 4),
    (_box(0, 0, 4, 32), _box(-16, 18, 23.5, 4)),
    _polygon([(-9, 6), (-9, -5), (9, -5), (9, 6)], 2),
    (_box(0, 4, 15, 4), _box(0, -4, 15, 2)),
    (_box(-4.1, 0, 2, 5), _box(4.1, 0, 2, 5)),
    (_box(-5.6, 0, 2, 5.5, 14.5), _box(5.6, 0, 2, 5.5, -14.5)),
    tuple(_box(x, 0, 5, 2) for x in (-21, -10.5, 0, 10.5, 21)),
    _polygon([(-18.5, -8), (-9.3, 8), (9.3, 8), (18.5, -8)], 2),
    _polygon([(-12, 14), (0, -10), (12, 14)], 2),
    _polygon([(-18.5, 0), (-9.3, -16), (9.3, -16), (18.5, 0), (9.3, 16), (-9.3, 16), (-18.5, 0)], 2),
    _polygon([(-14, 10), (-12, -10), (12, -10), (14, 10)], 3),
    _polygon([(-26, 6), (-10, -6), (10, -6), (26, 6)], 2),
)
