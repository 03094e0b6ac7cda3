"""What an emulated phone has in view: a hall, the robot with a sheet on it, the goal, and trouble that passes.

Everything but the ball is drawn with polygons whose corners are projected. Trouble is what fools trackers of clips:
people who walk through, shadows that move, lamps that flicker, a phone that shakes.
Frame: the field's, x towards the target with x = 0 in its plane, y left, z up. Units: SI unless suffixed.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from truearc.hw.emulated.camera import Lens, distort, project

Array = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]
Point = tuple[float, float, float]
Plane = tuple[float, float, float, float]     # x0, z0, x1, z1 of an upright rectangle, relative to the exit

SHEET_TAG, SHEET_SIDE_M, SHEET_EDGE_M = 586, 0.24, 0.03       # of the family 36h11, on white paper of size A3
SHEET_FROM_EXIT_M = (-0.40, 0.0)      # its centre, ahead of the exit and above it, in the plane of the flight
CHASSIS: Plane = (-0.85, -0.70, 0.02, -0.18)
PLATE: Plane = (-0.20, -0.16, -0.01, 0.16)    # side plate of the launcher, before the ball
CHASSIS_NEAR_M, PLATE_NEAR_M = 0.35, 0.12         # from the ball's path towards the phone
GOAL_M = (0.0, 0.30)                  # depth of what a ball that reaches the target's plane vanishes into
GOAL_HALF_HEIGHT_M = 0.55
WALL_M = 3.0                          # from the flights to the wall behind them
SHIFT = 4                             # binary places of a pixel's fraction, for cv2
FINER = 4                             # of the sheet, each way
DARKER = 0.72                         # light left in a shadow
CHASSIS_BGR, PLATE_BGR, GOAL_BGR = (62.0, 58.0, 70.0), (130.0, 96.0, 70.0), (160.0, 165.0, 172.0)
PEOPLE_BGR = ((60.0, 70.0, 150.0), (120.0, 90.0, 50.0), (70.0, 110.0, 80.0))
WALK_M_S, FLICKER_HZ = 1.3, 100.0     # of people; of lamps on a grid of 50 Hz


@dataclass(frozen=True)
class Trouble:
    """What makes a clip hard.

    people: Number who walk to and fro between the flights and the wall.
    shadows: Number of soft shadows that wander over the wall.
    flicker: Share by which lamps change the light.
    shake_px: Amplitude of the phone's shaking.
    """

    people: int = 0
    shadows: int = 0
    flicker: float = 0.0
    shake_px: float = 0.0


class RobotPose:
    """Exit point (x, y) and heading of the robot, left of x positive."""

    def __init__(self, x_m: float, y_m: float, heading_rad: float) -> None:
        self.key = (x_m, y_m, heading_rad)
        self._cos, self._sin = math.cos(heading_rad), math.sin(heading_rad)

    def to_field(self, ahead_m: float, left_m: float, z_m: float) -> Point:
        """Return a place that is stated from the exit, in field axes."""
        x_m, y_m, _ = self.key
        return (x_m + self._cos * ahead_m - self._sin * left_m, y_m + self._sin * ahead_m + self._cos * left_m, z_m)

    def from_field(self, places_m: Array) -> Array:
        """Return places [n, 3] ahead of the exit, to its left and above the floor."""
        x_m, y_m = (places_m[:, k] - self.key[k] for k in range(2))
        return np.column_stack([self._cos * x_m + self._sin * y_m, self._cos * y_m - self._sin * x_m, places_m[:, 2]])


class Hall:
    """Still pictures of the hall for each pose of the robot, and what hides a ball in them."""

    def __init__(self, lens: Lens, camera_from_field: Array, exit_height_m: float, goal_height_m: float,
                 trouble: Trouble, seed: int) -> None:
        self._lens, self._pose, self._exit_height_m = lens, camera_from_field, exit_height_m
        self.trouble, self._rng = trouble, np.random.default_rng([seed, 8])
        low, high = goal_height_m - GOAL_HALF_HEIGHT_M, goal_height_m + GOAL_HALF_HEIGHT_M
        self._goal = [(x, -0.4, z) for x, z in ((GOAL_M[0], low), (GOAL_M[1], low), (GOAL_M[1], high),
                                                (GOAL_M[0], high))]
        self._post = [(x, 0.0, z) for x, z in ((0.12, 0.0), (0.2, 0.0), (0.2, low), (0.12, low))]
        self._wall = self._draw_wall()
        family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
        cells, edge = 10 * 16, round(10 * 16 * SHEET_EDGE_M / SHEET_SIDE_M)
        tag = np.where(cv2.aruco.generateImageMarker(family, SHEET_TAG, cells) > 0, 205, 24).astype(np.uint8)
        self._sheet = cv2.copyMakeBorder(tag, edge, edge, edge, edge, cv2.BORDER_CONSTANT, value=205)
        self._walks = self._rng.uniform((0.0, 1.0), (12.0, 2.4), (trouble.people, 2))       # begin; towards the wall
        self._wander = self._rng.uniform(0.0, 2.0 * math.pi, (trouble.shadows, 3))
        self._kept: tuple[tuple[float, float, float], Image, Image] | None = None

    def to_pixels(self, places_m: Array) -> tuple[Array, Array]:
        """Return pixels [n, 2] and distances [n] of places in the field."""
        ideal, ahead_m = project(places_m, self._pose, self._lens)
        return distort(ideal, self._lens), ahead_m

    def still(self, pose: RobotPose) -> tuple[Image, Image]:
        """Return the picture without a ball (BGR), and what hides a ball in it (255)."""
        if self._kept is None or self._kept[0] != pose.key:
            picture, front = self._wall.copy(), np.zeros(self._wall.shape[:2], np.uint8)
            self._fill(picture, self._post, GOAL_BGR)
            for part, near_m, colour in ((CHASSIS, CHASSIS_NEAR_M, CHASSIS_BGR), (PLATE, PLATE_NEAR_M, PLATE_BGR)):
                corners = [pose.to_field(x, -near_m, self._exit_height_m + z) for x, z in _corners(part)]
                self._fill(picture, corners, colour)
                self._fill(front, corners, (255.0,))
            self._hang_sheet(picture, pose)
            self._fill(picture, self._goal, GOAL_BGR)
            self._fill(front, self._goal, (255.0,))
            self._kept = pose.key, picture, front
        return self._kept[1], self._kept[2]

    def add_trouble(self, luma: Image, time_s: float) -> Image:
        """Return the brightness of a picture with people, shadows, flicker and shaking at that moment."""
        for number, (begin_s, away_m) in enumerate(self._walks):
            self._walk(luma, number, time_s + begin_s, away_m)
        for phase in self._wander:
            centre = (np.array([0.5, 0.45]) + 0.4 * np.sin(np.array([0.4, 0.7]) * time_s + phase[:2])
                      ) * luma.shape[::-1]
            half = (round(90 + 40 * math.sin(phase[2])), round(60 + 20 * math.cos(phase[2])))
            (x0, y0), (x1, y1) = (np.clip(centre + sign * np.array(half), 0, luma.shape[::-1]).astype(int)
                                  for sign in (-1, 1))
            part = luma[y0:y1, x0:x1]
            if part.size:
                soft = [np.sin(np.pi * (np.arange(side) + 0.5) / side) for side in part.shape]
                part[:] = np.rint(part * (1.0 - (1.0 - DARKER) * np.outer(*soft)))
        if self.trouble.flicker:
            luma = cv2.convertScaleAbs(luma, alpha=1.0 + self.trouble.flicker
                                       * math.sin(2.0 * math.pi * FLICKER_HZ * time_s))
        if self.trouble.shake_px:
            way = self.trouble.shake_px * np.sin(np.array([2 * math.pi * 1.3, 2 * math.pi * 2.1]) * time_s)
            luma = cv2.warpAffine(luma, np.array([[1.0, 0.0, way[0]], [0.0, 1.0, way[1]]]), luma.shape[::-1],
                                  borderMode=cv2.BORDER_REPLICATE)
        return luma

    def _walk(self, luma: Image, number: int, since_s: float, away_m: float) -> None:
        """A person: legs, trunk, arms that swing, head."""
        room_m = 9.0
        way_m = (WALK_M_S * since_s) % (2.0 * room_m)
        x_m = (way_m if way_m < room_m else 2.0 * room_m - way_m) - room_m + 0.3
        swing = 0.28 * math.sin(2.0 * math.pi * 0.9 * since_s)
        level = 0.114 * PEOPLE_BGR[number % 3][0] + 0.587 * PEOPLE_BGR[number % 3][1] + 0.3 * PEOPLE_BGR[number % 3][2]

        def limb(a: tuple[float, float], b: tuple[float, float], wide_m: float, light: float) -> None:
            ends, ahead = self.to_pixels(np.array([(x_m + x, away_m, z) for x, z in (a, b)]))
            wide = max(1, round(wide_m * self._lens.fx_px / float(ahead[0])))
            begin, end = np.rint(ends * 2**SHIFT).astype(int).tolist()
            cv2.line(luma, begin, end, light, wide, cv2.LINE_AA, SHIFT)
        for sign in (-1, 1):
            limb((0.0, 0.9), (sign * swing, 0.08), 0.14, 0.6 * level)
            limb((0.0, 1.4), (-sign * swing, 0.85), 0.09, 1.2 * level)
        limb((0.0, 0.95), (0.0, 1.4), 0.36, level)
        limb((0.0, 1.65), (0.0, 1.70), 0.2, 150.0)

    def _fill(self, picture: Image, corners: list[Point], colour: tuple[float, ...]) -> None:
        pixels, _ = self.to_pixels(np.array(corners))
        cv2.fillPoly(picture, [np.rint(pixels * 2**SHIFT).astype(np.int32)], colour, cv2.LINE_AA, SHIFT)

    def _hang_sheet(self, picture: Image, pose: RobotPose) -> None:
        half = SHEET_SIDE_M / 2.0 + SHEET_EDGE_M
        (ahead_m, up_m), rows = SHEET_FROM_EXIT_M, picture.shape[0]
        corners = [pose.to_field(ahead_m + x * half, 0.0, self._exit_height_m + up_m + z * half)
                   for x, z in ((-1, 1), (1, 1), (1, -1), (-1, -1))]
        seen, _ = self.to_pixels(np.array(corners))
        (x0, y0), (x1, y1) = np.floor(seen.min(axis=0)).astype(int) - 2, np.ceil(seen.max(axis=0)).astype(int) + 3
        if x0 < 0 or y0 < 0 or x1 > picture.shape[1] or y1 > rows:
            return
        size, side = ((x1 - x0) * FINER, (y1 - y0) * FINER), len(self._sheet)
        flat = np.array([[0, 0], [side, 0], [side, side], [0, side]], np.float32) - np.float32(0.5)
        turn = cv2.getPerspectiveTransform(flat, ((seen - [x0, y0] + 0.5) * FINER - 0.5).astype(np.float32))
        paper, cover = (cv2.resize(cv2.warpPerspective(one, turn, size, flags=cv2.INTER_AREA), (x1 - x0, y1 - y0),
                                   interpolation=cv2.INTER_AREA).astype(np.float64)
                        for one in (self._sheet, np.full_like(self._sheet, 255)))
        share = (cover / 255.0)[..., None]
        part = picture[y0:y1, x0:x1]
        part[:] = np.rint(part * (1.0 - share) + paper[..., None])

    def _draw_wall(self) -> Image:
        """A wall of blocks with posters, above a floor with a line."""
        height, width = self._lens.height_px, self._lens.width_px
        coarse = self._rng.normal(0.0, 11.0, (height // 40 + 2, width // 40 + 2)).astype(np.float32)
        fine = self._rng.normal(0.0, 7.0, (height, width)).astype(np.float32)
        light = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC) + cv2.GaussianBlur(fine, (0, 0), 1.2)
        wall: Image = np.clip(light[..., None] + np.array([138.0, 146.0, 150.0]), 30, 225).astype(np.uint8)
        foot, _ = self.to_pixels(np.array([(-20.0, WALL_M, 0.0), (20.0, WALL_M, 0.0)]))
        for z_m in np.arange(0.0, 9.0, 0.4):
            ends, _ = self.to_pixels(np.array([(-20.0, WALL_M, z_m), (20.0, WALL_M, z_m)]))
            begin, end = np.rint(ends).astype(int).tolist()
            cv2.line(wall, begin, end, (118, 122, 125), 1, cv2.LINE_AA)
        for _ in range(7):
            x_m, z_m, wide_m, high_m = self._rng.uniform((-9.5, 1.0, 0.4, 0.4), (1.5, 3.5, 1.6, 1.1))
            colour = tuple(float(part) for part in self._rng.uniform(40.0, 220.0, 3))
            self._fill(wall, [(x_m + x, WALL_M, z_m + z) for x, z in ((0, 0), (wide_m, 0), (wide_m, high_m),
                                                                      (0, high_m))], colour)
        floor = np.array([foot[0], foot[1], [width + 9, height + 9], [-9, height + 9]])
        cv2.fillPoly(wall, [np.rint(floor * 2**SHIFT).astype(np.int32)], (96, 104, 108), cv2.LINE_AA, SHIFT)
        self._fill(wall, [(-20.0, 0.9, 0.0), (20.0, 0.9, 0.0), (20.0, 0.95, 0.0), (-20.0, 0.95, 0.0)],
                   (190.0, 190.0, 190.0))
        return wall


def _corners(part: Plane) -> list[tuple[float, float]]:
    x0, z0, x1, z1 = part
    return [(x0, z0), (x1, z0), (x1, z1), (x0, z1)]
