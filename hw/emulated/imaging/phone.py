"""An emulated phone on a tripod beside the flights: lens, exposure, rolling shutter, noise, coding, and its clips.

A ball is the mean of disks at moments of the exposure, each row at its own time; a lens blurs it, and what stands
before it hides it. Frames are coded by PyAV with their true times; where nothing is to be filmed there are none.
Frame: the field's (truearc.hw.emulated.imaging.hall). Units: SI unless suffixed.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from truearc.errors import InputError
from truearc.hw.emulated.camera import Lens
from truearc.hw.emulated.imaging.hall import Array, Hall, Image, RobotPose, Trouble

TICKS = 90_000                        # of the clip's clock a second
NOISE_TILE_PX = 131, 97               # by which the tile of noise may be shifted
BLUR_STEP_PX = 1.5                    # of a moving ball, between two moments of an exposure
MOST_MOMENTS = 12
MARGIN_PX = 4
DARK, SEAMS = 0.45, 0.12              # light on a ball's unlit side; contrast of its pattern
BALL_BGR = {"yellow": (62.0, 205.0, 226.0), "orange": (40.0, 120.0, 225.0), "grey": (150.0, 150.0, 150.0)}


@dataclass(frozen=True)
class Phone:
    """How a clip is filmed.

    width_px, height_px, rate_hz: Of its pictures.
    exposure_s, readout_s: Of a row; from the first row to the last.
    place_m: x of the middle of the view, distance from the flights, height above the floor.
    view_m: Width that is seen in the plane of the flights.
    tilt_deg, pitch_deg: By which the phone is not level: the far end seen higher; it looks up.
    bend: Of the lens, the first coefficient of Brown's model.
    noise, blur_px: Standard deviations of a pixel, of 255, and of the lens.
    lost_share: Of frames that are dropped, at random.
    clock: Share by which its clock is fast.
    codec, quality: Of PyAV; constant rate factor.
    """

    width_px: int = 1280
    height_px: int = 720
    rate_hz: float = 60.0
    exposure_s: float = 0.004
    readout_s: float = 0.012
    place_m: tuple[float, float, float] = (-4.2, 10.0, 1.7)
    view_m: float = 9.8
    tilt_deg: float = 0.4
    pitch_deg: float = 0.6
    bend: float = -0.004
    noise: float = 2.5
    blur_px: float = 0.7
    lost_share: float = 0.0
    clock: float = 2e-5
    codec: str = "libx264"
    quality: int = 20
    ball: str = "yellow"
    trouble: Trouble = field(default_factory=Trouble)

    @property
    def lens(self) -> Lens:
        """Pinhole and distortion."""
        focal_px = self.width_px * self.place_m[1] / self.view_m
        return Lens(self.width_px, self.height_px, focal_px, focal_px, (self.width_px - 1) / 2.0,
                    (self.height_px - 1) / 2.0, (self.bend, 0.0, 0.0, 0.0, 0.0))

    def from_field(self) -> Array:
        """Return the transform [4, 4] from the field to the camera: x right, y down, z ahead."""
        pitch, tilt = math.radians(self.pitch_deg), math.radians(self.tilt_deg)
        level = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
        up = np.array([[1.0, 0.0, 0.0], [0.0, math.cos(pitch), math.sin(pitch)],
                       [0.0, -math.sin(pitch), math.cos(pitch)]])
        turn = np.array([[math.cos(tilt), math.sin(tilt), 0.0], [-math.sin(tilt), math.cos(tilt), 0.0],
                         [0.0, 0.0, 1.0]])
        transform = np.eye(4)
        transform[:3, :3] = turn @ up @ level
        transform[:3, 3] = -transform[:3, :3] @ np.array([self.place_m[0], -self.place_m[1], self.place_m[2]])
        return transform


class Path3D(NamedTuple):
    """The way of one ball.

    Fields:
        shot: Its number.
        time_s: Rising [n].
        place_m: In the field [n, 3].
        radius_m: Of the ball.
        spin_rev_s: Backspin.
        pose: Of the robot at its release.
        seen_s: From its release until it arrived.
    """

    shot: int
    time_s: Array
    place_m: Array
    radius_m: float
    spin_rev_s: float
    pose: RobotPose
    seen_s: tuple[float, float]


class Seen(NamedTuple):
    """The truth of one ball in one frame, for benchmarks: clip time; launcher axes; pixels, as its rows are exposed."""

    shot: int
    time_s: float
    x_m: float
    y_m: float
    z_m: float
    x_px: float
    y_px: float
    diameter_px: float


class SideCamera:
    """Films clips; the same seed, phone and balls give the same pictures."""

    def __init__(self, phone: Phone, exit_height_m: float, goal_height_m: float, seed: int) -> None:
        self.phone, self._rng = phone, np.random.default_rng([seed, 9])
        self._hall = Hall(phone.lens, phone.from_field(), exit_height_m, goal_height_m, phone.trouble, seed)
        size = phone.height_px + NOISE_TILE_PX[1], phone.width_px + NOISE_TILE_PX[0]
        self._level = max(round(4.0 * phone.noise), 1)    # noise is added to a picture that is darker by this
        self._noise: Image = np.clip(np.rint(self._rng.normal(self._level, phone.noise, size)), 0, 255).astype(np.uint8)
        self._still: tuple[Any, Image, Image, Image] | None = None

    def film(self, path: Path, balls: Sequence[Path3D], poses: Sequence[tuple[float, RobotPose]],
             spans_s: Sequence[tuple[float, float]]) -> list[Seen]:
        """Write a clip; return where its balls truly were.

        Args:
            path: MP4 file to write.
            balls: By release.
            poses: Of the robot, each from a time on; the first holds before it.
            spans_s: Times that are filmed, rising; where one ends and the next begins, frames are missing.
        """
        times = self._times(spans_s)
        seen: list[Seen] = []
        pixels = [self._hall.to_pixels(ball.place_m) for ball in balls]
        changes = np.array([time_s for time_s, _ in poses])
        codec = _Coder(path, self.phone)
        for time_s in times:
            pose = poses[max(int(np.searchsorted(changes, time_s, side="right")) - 1, 0)][1]
            luma, colours, front = self._background(pose)
            for ball, (way_px, ahead_m) in zip(balls, pixels, strict=True):
                if ball.time_s[0] <= time_s <= ball.time_s[-1]:
                    drawn = self._draw(luma, colours, front, ball, way_px, ahead_m, time_s)
                    if ball.seen_s[0] <= time_s <= ball.seen_s[1]:
                        seen.append(self._truth(ball, time_s, times[0], drawn))
            luma = self._hall.add_trouble(luma, time_s)
            left, top = (int(self._rng.integers(0, most)) for most in NOISE_TILE_PX)
            noisy = cv2.add(luma, self._noise[top:top + luma.shape[0], left:left + luma.shape[1]])
            codec.write(np.concatenate([noisy.ravel(), colours.ravel()]).reshape(-1, luma.shape[1]),
                        (time_s - times[0]) * (1.0 + self.phone.clock))
        codec.close()
        return seen

    def _times(self, spans_s: Sequence[tuple[float, float]]) -> Array:
        first = math.floor(spans_s[0][0] * self.phone.rate_hz)
        number = np.arange(first, math.ceil(spans_s[-1][1] * self.phone.rate_hz) + 1)
        times: Array = number / self.phone.rate_hz
        kept = np.zeros(len(times), bool)
        for begin_s, end_s in spans_s:
            kept |= (times >= begin_s) & (times <= end_s)
        if self.phone.lost_share:
            kept &= self._rng.uniform(size=len(times)) >= self.phone.lost_share
        return times[kept]

    def _background(self, pose: RobotPose) -> tuple[Image, Image, Image]:
        """Brightness, less the level of the noise; colour differences; and what hides a ball."""
        if self._still is None or self._still[0] != pose.key:
            picture, front = self._hall.still(pose)
            planar = cv2.cvtColor(picture, cv2.COLOR_BGR2YUV_I420)
            rows, columns = picture.shape[:2]
            luma = cv2.subtract(planar[:rows], np.full_like(planar[:rows], self._level))
            self._still = pose.key, luma, planar[rows:].reshape(2, rows // 2, columns // 2), front
        return self._still[1].copy(), self._still[2].copy(), self._still[3]

    def _draw(self, luma: Image, colours: Image, front: Image, ball: Path3D, way_px: Array, ahead_m: Array,
              time_s: float) -> tuple[float, float, float]:
        """Blend a ball into a picture; return its centre and diameter in pixels, as its row is exposed."""
        phone, rows = self.phone, luma.shape[0]

        def at(moments: npt.NDArray[Any]) -> tuple[Array, Array, Array]:
            x, y, far = (np.interp(moments, ball.time_s, one) for one in (*way_px.T, ahead_m))
            return x, y, phone.lens.fx_px * ball.radius_m / far

        row_s = time_s
        for _ in range(4):            # the moment at which the row of the centre is exposed
            x, y, radius = (float(one[0]) for one in at(np.array([row_s])))
            row_s = time_s + phone.readout_s * (y / rows - 0.5)
        near = at(np.array([row_s - 0.5 * phone.exposure_s, row_s + 0.5 * phone.exposure_s]))
        length = float(np.hypot(near[0][1] - near[0][0], near[1][1] - near[1][0]))
        reach = radius + 0.5 * length + MARGIN_PX
        # even corners, as the colour differences have half the resolution
        x0, y0 = (max(int(v - reach) // 2 * 2, 0) for v in (x, y))
        x1, y1 = (min(int(v + reach) // 2 * 2 + 2, most) for v, most in ((x, luma.shape[1]), (y, rows)))
        if x1 - x0 < 2 or y1 - y0 < 2:
            return x, y, 2.0 * radius
        ys, xs = np.arange(y0, y1, dtype=np.float64), np.arange(x0, x1, dtype=np.float64)
        count = min(max(round(length / BLUR_STEP_PX), 1), MOST_MOMENTS)
        cover, light = np.zeros((len(ys), len(xs))), np.zeros((len(ys), len(xs)))
        for part in (np.arange(count) + 0.5) / count - 0.5:
            moments = time_s + phone.readout_s * (ys / rows - 0.5) + part * phone.exposure_s
            cx, cy, r = (one[:, None] for one in at(moments))
            dx, dy = (xs[None] - cx) / r, (ys[:, None] - cy) / r
            away = np.hypot(dx, dy)
            inside = np.clip((1.0 - away) * r + 0.5, 0.0, 1.0)
            turn = np.arctan2(dy, dx) - 2.0 * math.pi * ball.spin_rev_s * (row_s - ball.seen_s[0])
            lit = DARK + (1.0 - DARK) * np.clip(0.75 * np.sqrt(np.clip(1.0 - away ** 2, 0.0, 1.0)) - 0.5 * dy
                                                - 0.2 * dx, 0.0, 1.0)
            cover += inside / count
            light += inside / count * lit * (1.0 - SEAMS * (np.sin(3.0 * turn) > 0.6) * (away > 0.35))
        cover, light = (cv2.GaussianBlur(one, (0, 0), phone.blur_px) for one in (cover, light))
        free = 1.0 - front[y0:y1, x0:x1] / 255.0
        blue, green, red = BALL_BGR[phone.ball]
        tone = 0.114 * blue + 0.587 * green + 0.299 * red
        part = luma[y0:y1, x0:x1]
        part[:] = np.clip(np.rint(part * (1.0 - cover * free) + (light * tone - cover * self._level) * free), 0, 255)
        for plane, colour in zip(colours, (0.564 * (blue - tone), 0.713 * (red - tone)), strict=True):
            half = [cv2.resize(one * free, ((x1 - x0) // 2, (y1 - y0) // 2), interpolation=cv2.INTER_AREA)
                    for one in (cover, light)]
            tint = plane[y0 // 2:y1 // 2, x0 // 2:x1 // 2]
            tint[:] = np.clip(np.rint(tint * (1.0 - half[0]) + half[0] * 128.0 + half[1] * colour), 0, 255)
        return x, y, 2.0 * radius

    def _truth(self, ball: Path3D, time_s: float, first_s: float, drawn: tuple[float, float, float]) -> Seen:
        place = np.array([[np.interp(time_s, ball.time_s, one) for one in ball.place_m.T]])
        x_m, y_m, z_m = ball.pose.from_field(place)[0]
        clip_s = (time_s - first_s) * (1.0 + self.phone.clock)
        return Seen(ball.shot, clip_s, float(x_m), float(y_m), float(z_m), *drawn)


class _Coder:
    """A clip that is being written."""

    def __init__(self, path: Path, phone: Phone) -> None:
        try:
            import av
        except ImportError as error:
            raise InputError("filming needs PyAV: pip install 'truearc[video]'") from error
        self._new_frame = av.VideoFrame.from_ndarray
        self._container = av.open(str(path), "w")
        stream: Any = self._container.add_stream(phone.codec, rate=Fraction(phone.rate_hz).limit_denominator(1000))
        stream.width, stream.height, stream.pix_fmt = phone.width_px, phone.height_px, "yuv420p"
        stream.options = {"crf": str(phone.quality), "preset": "ultrafast",
                          **({"x265-params": "log-level=none"} if phone.codec == "libx265" else {})}
        stream.codec_context.time_base = Fraction(1, TICKS)
        stream.codec_context.thread_count = 1
        self._stream = stream

    def write(self, planar: Image, time_s: float) -> None:
        """Add a picture."""
        frame = self._new_frame(planar, format="yuv420p")
        frame.pts, frame.time_base = round(TICKS * time_s), Fraction(1, TICKS)
        self._container.mux(self._stream.encode(frame))

    def close(self) -> None:
        """End the file."""
        self._container.mux(self._stream.encode(None))
        self._container.close()
