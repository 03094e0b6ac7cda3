"""Emulated camera with defects, in front of a target at any position, with distractors in view.

Each kind of defect is a function of the lens, the true target's outline in the image (or None) and random numbers that
returns patches for StagedCamera.clutter. Other targets are flat shapes in metres, seen by the same lens from any pose.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from truearc.hw.emulated import camera
from truearc.hw.emulated.camera import Look as PlainLook
from truearc.hw.emulated.nodes import Scene, View

ROUNDS = 4                            # the row where a point is seen and the moment at which that row is exposed
CAMERA_RIGHT = np.array([1.0, 0.0, 0.0])
INCH_M = 0.0254
NEAREST_M = 0.3
LENS_HEIGHT_M = 0.6


def place(distance_m: float, rise_m: float, pitch_deg: float, *, facing_deg: float = 0.0, bearing_deg: float = 0.0,
          roll_deg: float = 0.0, focal_scale: float = 1.0, brightness: float = 1.0) -> View:
    """The target's centre at this horizontal distance and bearing (right is positive), `rise_m` above the lens, turned
    about the vertical by `facing_deg` from squarely facing that way; the optical axis rises by `pitch_deg`."""
    facing, bearing, pitch, roll = (math.radians(angle) for angle in (facing_deg, bearing_deg, pitch_deg, roll_deg))
    # level axes: x right, y up, z backwards
    turned = np.array([[math.cos(facing), 0, math.sin(facing)], [0, 1, 0], [-math.sin(facing), 0, math.cos(facing)]])
    centre_m = np.array([distance_m * math.sin(bearing), rise_m, -distance_m * math.cos(bearing)])
    tilt = np.array([[1, 0, 0], [0, math.cos(pitch), math.sin(pitch)], [0, -math.sin(pitch), math.cos(pitch)]])
    lean = np.array([[math.cos(roll), -math.sin(roll), 0], [math.sin(roll), math.cos(roll), 0], [0, 0, 1]])
    camera_from_level = lean @ np.diag([1.0, -1.0, -1.0]) @ tilt
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = camera_from_level @ turned, camera_from_level @ centre_m
    return View(pose, focal_scale, brightness)


def project_turning(points_m: camera.Array, camera_from_points: camera.Array, lens: camera.Lens, focal_scale: float,
                    turn_deg_s: tuple[float, float], readout_s: float) -> tuple[camera.Array, camera.Array]:
    """As lens.project, of a camera that turns right about the points' own upright axis and up about its own level one;
    `camera_from_points` is of the image's middle row."""
    pixels, ahead_m = camera.project(points_m, camera_from_points, lens, focal_scale)
    if readout_s == 0.0 or not any(turn_deg_s) or (ahead_m <= 0.0).any():     # behind it nothing has a row
        return pixels, ahead_m
    right, up = (math.radians(rate) for rate in turn_deg_s)
    rate = right * camera_from_points[:3, 1] - up * CAMERA_RIGHT      # of the points, as the camera has them
    for _ in range(ROUNDS):
        late_s = readout_s * (camera.distort(pixels, lens)[:, 1] / lens.height_px - 0.5)
        for k, t_s in enumerate(late_s):
            turned = np.eye(4)
            turned[:3, :3], _ = cv2.Rodrigues(rate * t_s)
            seen, ahead = camera.project(points_m[k:k + 1], turned @ camera_from_points, lens, focal_scale)
            pixels[k], ahead_m[k] = seen[0], ahead[0]
    return pixels, ahead_m


@dataclass(frozen=True)
class Look(PlainLook):
    """Effects of lens, sensor and motion on the picture."""

    smear_px: tuple[float, float] = (0.0, 0.0)    # right and down, while the shutter is open
    turn_deg_s: tuple[float, float] = (0.0, 0.0)  # of the camera, right and up; its rows are exposed one after another
    readout_s: float = 0.0            # from the first row to the last
    gamma: float = 1.0                # of the camera's tone curve: what is written is light to the power 1 / gamma


USUAL = Look()


class Patch(NamedTuple):
    """A polygon in front of everything else: it shines, or hides if its colour is black."""

    corners_px: camera.Array                 # (n, 2), as seen
    bgr: tuple[float, float, float]


class StagedCamera(camera.EmulatedCamera):
    """An emulated camera whose `expose` gives pictures of a scene with a defect."""

    def __init__(self, scene: Scene, lens: camera.Lens, tape: camera.TapeSize, seed: int, *,
                 look: Look = USUAL) -> None:
        super().__init__(scene, lens, tape, seed, look)
        self._damage = look
        self._black = False
        self._patches: tuple[Patch, ...] = ()

    def black(self, on: bool = True) -> None:
        """Show nothing but noise from now on, as with a lens cap on."""
        self._black = on

    def clutter(self, patches: tuple[Patch, ...]) -> None:
        """Place these in front of the scene from now on, instead of any earlier ones."""
        self._patches = patches

    def _draw(self, noise: camera.Image, dice: npt.NDArray[np.int64], exposure: float) -> camera.Image:
        if self._black:
            return tone(noise, self._damage.gamma)
        image = super()._draw(noise, dice, exposure)
        for patch in self._patches:
            self._paint(image, noise, patch)
        return tone(image, self._damage.gamma)

    def _project(self, view: View) -> tuple[camera.Array, camera.Array]:
        return project_turning(self._outline_m, view.camera_from_target, self._lens, view.focal_scale,
                               self._damage.turn_deg_s, self._damage.readout_s)

    def _spread(self, plane: camera.Plane) -> camera.Plane:
        blurred = super()._spread(plane)
        return cv2.filter2D(blurred, -1, _smear(self._damage.smear_px)) if any(self._damage.smear_px) else blurred

    def _paint(self, image: camera.Image, dark: camera.Image, patch: Patch) -> None:
        """Put a patch into an image; where it hides, `dark` (the sensor's noise) is seen."""
        low = np.maximum(np.floor(patch.corners_px.min(axis=0)).astype(int) - camera.HALO_MARGIN_PX, 0)
        high = np.minimum(np.ceil(patch.corners_px.max(axis=0)).astype(int) + camera.HALO_MARGIN_PX, image.shape[1::-1])
        if (high - low < 1).any():
            return
        part = np.s_[low[1]:high[1], low[0]:high[0]]
        filled = np.zeros(image[part].shape[:2], np.uint8)
        cv2.fillPoly(filled, [np.rint((patch.corners_px - low) * 16).astype(np.int32)], 255, cv2.LINE_AA, 4)
        cover = self._spread(np.divide(filled, 255, dtype=np.float32))[..., None]
        if any(patch.bgr):
            image[part] = cv2.add(image[part], (cover * np.array(patch.bgr, np.float32)).astype(np.uint8))
        else:
            image[part] = (image[part] * (1 - cover) + dark[part] * cover).astype(np.uint8)


def tone(image: camera.Image, gamma: float) -> camera.Image:
    """Return the image after the camera's tone curve, from the light that its sensor has measured."""
    if gamma == 1.0:
        return image.copy()
    curve = np.rint(255 * np.linspace(0.0, 1.0, 256) ** (1 / gamma)).astype(np.uint8)
    written: camera.Image = cv2.LUT(image, curve)
    return written


def _smear(along_px: tuple[float, float]) -> camera.Plane:
    """A kernel that spreads a point evenly over this straight way, about its middle."""
    reach = math.ceil(max(abs(part) for part in along_px) / 2) + 1
    kernel = np.zeros((2 * reach + 1, 2 * reach + 1), np.float32)
    for share in np.linspace(-0.5, 0.5, 16 * reach + 1):
        x, y = (reach + share * part for part in along_px)
        column, row = int(x), int(y)
        kernel[row:row + 2, column:column + 2] += np.outer([row + 1 - y, y - row], [column + 1 - x, x - column])
    kernel /= kernel.sum()
    return kernel


def lights(lens: camera.Lens, outline: camera.Array | None, random: np.random.Generator) -> tuple[Patch, ...]:
    """Return lamps and signs of any colour, many of them green, as bars, wedges and discs."""
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


def frames(lens: camera.Lens, outline: camera.Array | None, random: np.random.Generator) -> tuple[Patch, ...]:
    """Return irregular outlines of green light: three or four bars end to end, open or closed, like tubes and door
    frames."""
    at = random.uniform(0.15, 0.85, 2) * (lens.width_px, lens.height_px)
    size = random.uniform(15, 150, 2)
    corners = at + np.array([[-1, -1], [-1, 1], [1, 1], [1, -1]]) * size / 2 + random.normal(0, 0.2, (4, 2)) * size
    wide = float(random.uniform(2, 12))
    bars = 3 + int(random.integers(0, 2))
    level = float(random.uniform(0.4, 1.0))
    return tuple(_bar(corners[k], corners[(k + 1) % 4], wide, level) for k in range(bars))


def floor_reflection(lens: camera.Lens, outline: camera.Array | None, random: np.random.Generator) -> tuple[Patch, ...]:
    """Return the target again, upside down, below its position, dimmer and broken."""
    if outline is None:
        return lights(lens, outline, random)
    level = float(random.uniform(0.3, 1.0))
    mirror = float(outline[:, 1].max() + random.uniform(10, 120))
    turned = np.column_stack([outline[:, 0], 2 * mirror - outline[:, 1]])
    return _outline_bars(turned, level)


def second_goal(lens: camera.Lens, outline: camera.Array | None, random: np.random.Generator) -> tuple[Patch, ...]:
    """Return another half hexagon of the same make, elsewhere."""
    return _shape(HALF_HEXAGON, lens, random, (1.5, 2.6))


def other_target(lens: camera.Lens, outline: camera.Array | None, random: np.random.Generator) -> tuple[Patch, ...]:
    """Return a target of another year, at any height on any wall."""
    return _shape(OTHERS[int(random.integers(0, len(OTHERS)))], lens, random, (0.4, 2.8))


def in_the_way(lens: camera.Lens, outline: camera.Array | None, random: np.random.Generator) -> tuple[Patch, ...]:
    """Return a dark bar, arm or robot in front of a part of the target."""
    if outline is None:
        return lights(lens, outline, random)
    low, high = outline.min(axis=0), outline.max(axis=0)
    size = (high - low) * random.uniform(0.08, 0.7, 2) + 2
    at = low + (high - low) * random.uniform(0, 1, 2)
    angle = float(random.uniform(0, np.pi))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return (Patch(at + (np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * size / 2) @ turn.T, (0.0, 0.0, 0.0)),)


def glare(lens: camera.Lens, outline: camera.Array | None, random: np.random.Generator) -> tuple[Patch, ...]:
    """Return a bright object that touches the target."""
    if outline is None:
        return lights(lens, outline, random)
    at = outline[int(random.integers(0, len(outline)))] + random.normal(0, 6, 2)
    angle = np.arange(10) * np.pi / 5
    size = random.uniform(3, 30, 2)
    return (Patch(at + np.column_stack([np.cos(angle), np.sin(angle)]) * size, _shine(random)),)


Kind = Callable[[camera.Lens, camera.Array | None, np.random.Generator], tuple[Patch, ...]]
KINDS: tuple[Kind, ...] = (lights, frames, floor_reflection, second_goal, other_target, in_the_way, glare)


def _tape(level: float) -> tuple[float, float, float]:
    """The tape's colour, so bright."""
    blue, green, red = camera.TAPE_BGR
    return level * blue, level * green, level * red


def _shine(random: np.random.Generator) -> tuple[float, float, float]:
    level = float(random.uniform(0.3, 1.2))
    if random.random() < 0.6:
        return _tape(level)
    blue, green, red = random.uniform(20, 255, 3).tolist()
    return blue, green, red


def _bar(begin: camera.Array, end: camera.Array, wide_px: float, level: float) -> Patch:
    along = (end - begin) / max(float(np.hypot(*(end - begin))), 1e-9)
    side = np.array([along[1], -along[0]]) * wide_px / 2
    return Patch(np.array([begin + side, end + side, end - side, begin - side]), _tape(level))


def _outline_bars(outline: camera.Array, level: float) -> tuple[Patch, ...]:
    """The tape's outline (8, 2) of truearc.hw.emulated.camera as three strips."""
    return tuple(Patch(outline[list(corners)], _tape(level)) for corners in ((0, 1, 5, 4), (1, 2, 6, 5), (3, 0, 4, 7)))


def _shape(strips_m: tuple[camera.Array, ...], lens: camera.Lens, random: np.random.Generator,
           heights_m: tuple[float, float]) -> tuple[Patch, ...]:
    """Flat strips (n, 2) of tape in metres, on a wall somewhere before a camera that looks up by some degrees."""
    away_m, height_m = float(random.uniform(1.2, 11.0)), float(random.uniform(*heights_m))
    view = place(away_m, height_m - LENS_HEIGHT_M, float(random.uniform(5, 30)),
                 facing_deg=float(random.uniform(-50, 50)), bearing_deg=float(random.uniform(-20, 20)))
    blue, green, red = (float(random.uniform(0.5, 1.0)) * part for part in camera.TAPE_BGR)
    patches = []
    for strip in strips_m:
        ideal, depth_m = camera.project(np.column_stack([strip, np.zeros(len(strip))]), view.camera_from_target, lens)
        if depth_m.min() > NEAREST_M:
            patches.append(Patch(camera.distort(ideal, lens), (blue, green, red)))
    return tuple(patches)


def _box(x: float, y: float, wide: float, high: float, lean_deg: float = 0.0) -> camera.Array:
    """A rectangle of tape in inches about (x, y), leaning to the right."""
    angle = np.radians(lean_deg)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    corners = np.array([[-wide, -high], [wide, -high], [wide, high], [-wide, high]]) / 2
    return np.asarray((corners @ turn.T + (x, y)) * INCH_M, dtype=np.float64)


def _polygon(corners_in: list[tuple[float, float]], wide_in: float) -> tuple[camera.Array, ...]:
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
OTHERS: tuple[tuple[camera.Array, ...], ...] = (
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
