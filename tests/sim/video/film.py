"""Clips drawn for tests, by code that shares nothing with the tracker: balls on parabolas before a textured wall."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import av
import numpy as np

SUB = 3                               # places within a pixel, across and down, that are averaged
MOMENTS = 7                           # of an exposure


@dataclass(frozen=True)
class Throw:
    """A ball in the air. Pixels, seconds, y down; it is seen from `begin_s` to `end_s`."""

    begin_s: float
    end_s: float
    x_px: float
    y_px: float
    vx_px_s: float
    vy_px_s: float
    g_px_s2: float
    diameter_px: float = 24.0
    colour: tuple[float, float, float] = (210.0, 120.0, 40.0)

    def place(self, time_s: float) -> tuple[float, float]:
        """Where its centre is."""
        t = time_s - self.begin_s
        return self.x_px + self.vx_px_s * t, self.y_px + self.vy_px_s * t + 0.5 * self.g_px_s2 * t * t


@dataclass(frozen=True)
class Scene:
    """How a clip is filmed: exposure, rolling shutter (first to last row) and noise of a pixel."""

    width: int = 640
    height: int = 360
    rate_hz: float = 60.0
    exposure_s: float = 0.004
    readout_s: float = 0.0
    noise: float = 2.0
    seed: int = 1
    shake_px: float = 0.0


def wall(scene: Scene) -> np.ndarray:
    """A wall with soft blotches, a grid and a dark post."""
    rng = np.random.default_rng(scene.seed)
    rows, columns = np.mgrid[0:scene.height, 0:scene.width]
    picture = np.full((scene.height, scene.width, 3), 120.0)
    for _ in range(25):
        fx, fy, phase = [*rng.normal(0.0, 0.05, 2).tolist(), rng.uniform(0.0, 6.3)]
        picture += (rng.normal(0.0, 5.0, 3) * np.cos(fx * columns + fy * rows + phase)[..., None])
    picture[(columns % 80 < 2) | (rows % 60 < 2)] -= 25.0
    picture[:, 500:508] = 60.0
    return picture.clip(20.0, 235.0)


def draw_ball(picture: np.ndarray, throw: Throw, time_s: float, scene: Scene) -> None:
    """Blend a shaded ball into a picture, swept over the exposure; rows see it later by the rolling shutter."""
    x, y = throw.place(time_s)
    reach = throw.diameter_px + 0.5 * scene.exposure_s * np.hypot(throw.vx_px_s, throw.vy_px_s) + 30.0
    left, right = int(max(x - reach, 0)), int(min(x + reach, scene.width))
    top, bottom = int(max(y - reach, 0)), int(min(y + reach, scene.height))
    if left >= right or top >= bottom:
        return
    fine = (np.arange(SUB) + 0.5) / SUB - 0.5
    ys, xs = (np.arange(top, bottom)[:, None] + fine).ravel(), (np.arange(left, right)[:, None] + fine).ravel()
    cover, shade = np.zeros((len(ys), len(xs))), np.zeros((len(ys), len(xs)))
    rows_s = time_s + scene.readout_s * (ys / scene.height - 0.5)
    for part in (np.arange(MOMENTS) + 0.5) / MOMENTS - 0.5:
        t = rows_s + part * scene.exposure_s - throw.begin_s
        cx = throw.x_px + throw.vx_px_s * t
        cy = throw.y_px + throw.vy_px_s * t + 0.5 * throw.g_px_s2 * t * t
        dx, dy = xs[None] - cx[:, None], (ys - cy)[:, None]
        square = (dx ** 2 + dy ** 2) / (throw.diameter_px / 2.0) ** 2
        inside = square < 1.0
        cover += inside
        shade += inside * (0.55 + 0.45 * np.sqrt(np.clip(1.0 - square, 0.0, 1.0)) - 0.15 * dy / throw.diameter_px)
    def pixels(fine_: np.ndarray) -> np.ndarray:
        return fine_.reshape(bottom - top, SUB, right - left, SUB).mean(axis=(1, 3)) / MOMENTS
    alpha, light = pixels(cover)[..., None], pixels(shade)[..., None]
    region = picture[top:bottom, left:right]
    region[:] = region * (1.0 - alpha) + light * np.array(throw.colour)


def film(path: Path, throws: Sequence[Throw], duration_s: float, scene: Scene = Scene(), *,
         times_s: Sequence[float] | None = None, extra: Callable[[np.ndarray, float], None] | None = None,
         codec: str = "libx264") -> list[float]:
    """Write a clip; return the times of its frames.

    Args:
        path: MP4 file to write.
        throws: Balls in the air.
        duration_s: Of the clip.
        scene: How it is filmed.
        times_s: Of the frames, if they are not even.
        extra: Draws what else moves into a picture of a time.
        codec: Of PyAV.
    """
    times = list(times_s) if times_s is not None else list(np.arange(round(duration_s * scene.rate_hz)) / scene.rate_hz)
    rng, still = np.random.default_rng(scene.seed + 100), wall(scene)
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=Fraction(scene.rate_hz).limit_denominator(1000))
        stream.width, stream.height, stream.pix_fmt = scene.width, scene.height, "yuv420p"
        stream.options = {"crf": "18", "preset": "ultrafast"}
        stream.codec_context.time_base = Fraction(1, 90000)
        for t in times:
            picture = still.copy()
            if scene.shake_px:
                picture = np.roll(picture, round(scene.shake_px * np.sin(9.0 * t)), axis=1)
            if extra is not None:
                extra(picture, t)
            for throw in throws:
                if throw.begin_s <= t <= throw.end_s:
                    draw_ball(picture, throw, t, scene)
            picture += rng.normal(0.0, scene.noise, picture.shape[:2])[..., None]
            frame = av.VideoFrame.from_ndarray(picture.clip(0, 255).astype(np.uint8), format="rgb24")
            frame.pts, frame.time_base = round(90000 * t), Fraction(1, 90000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return times
