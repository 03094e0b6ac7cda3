"""What stands still before a still camera, and how far each picture differs from it.

The background is the median of pictures of the last two seconds, so that a ball, which is at one place for less than
half of that time, is not part of it, and a person who stands still is.
"""

from collections import deque
from collections.abc import Iterator

import cv2
import numpy as np
import numpy.typing as npt

from truearc.sim.video.frames import Clip, Frame, Image

MEMORY_S, SAMPLES = 2.0, 15          # a break of half of that begins anew
RENEWED = 4                           # samples after which the median is taken again
SPARSE = 8                            # of rows and columns, one of which tells of the light and the noise
FADED = 0.5                           # more or less light than this share is another scene
SMALLER = 4                           # the picture is reduced by this to find its movement
# Measured on rendered clips: one place 0.54 to 0.65 and 0.4 pixels; zoomed or turned by a hundredth 0.04 to 0.11
SHARP, SAME_PX, EDGE = 0.2, 1.5, 20.0             # peak and shift of two pictures' correlation; grey levels of an edge
EXPLAINED = 0.75                      # share of its difference that is left if the whole picture has moved


class Background:
    """The median of recent pictures, and their noise."""

    def __init__(self) -> None:
        self._samples: deque[Frame] = deque(maxlen=SAMPLES)
        self._fresh = 0
        self._looked: npt.NDArray[np.float32] | None = None
        self.luma: Image = np.empty((0, 0), np.uint8)
        self.chroma: Image = np.empty((0, 0, 0), np.uint8)

    def add(self, frame: Frame, settle: bool = True) -> None:
        """Take a picture as a sample if it is time for one; settle: take the median again when enough are fresh."""
        if self._samples and 0.0 <= frame.time_s - self._samples[-1].time_s < MEMORY_S / SAMPLES:
            return
        if self._samples and frame.time_s - self._samples[-1].time_s > MEMORY_S / 2.0:      # filmed with breaks
            self._samples.clear()
            self._fresh = RENEWED
        self._samples.append(frame)
        self._fresh += 1
        if settle and (self._fresh >= RENEWED or not self.luma.size):
            self.settle()

    def settle(self) -> None:
        """Take the median of the samples."""
        self.luma = _median([frame.luma for frame in self._samples])
        self.chroma = _median([frame.chroma for frame in self._samples])
        self._fresh = 0

    def difference(self, frame: Frame) -> tuple[Image, float]:
        """Return how far a picture differs from the background, colours included, and the noise of that (one sd).

        A change of all of the light, as of an exposure that adapts or a lamp that flickers, is divided out first.
        """
        few, own = self.luma[::SPARSE, ::SPARSE].astype(np.float32), frame.luma[::SPARSE, ::SPARSE].astype(np.float32)
        gain = float(np.median((few + 1.0) / (own + 1.0)))
        luma = cv2.convertScaleAbs(frame.luma, alpha=gain) if 0.01 < abs(gain - 1.0) < FADED else frame.luma
        noise = 1.48 * float(np.median(np.abs(few - luma[::SPARSE, ::SPARSE])))
        colours = cv2.add(*(cv2.absdiff(a, b) for a, b in zip(frame.chroma, self.chroma, strict=True)))
        colours = cv2.resize(colours, luma.shape[::-1], interpolation=cv2.INTER_LINEAR)
        return np.asarray(cv2.add(cv2.absdiff(luma, self.luma), colours), dtype=np.uint8), noise

    def shift_px(self, frame: Frame) -> float:
        """Return how far the whole picture has moved since the last one that was asked about (phase correlation)."""
        size = (frame.luma.shape[1] // SMALLER, frame.luma.shape[0] // SMALLER)
        now = cv2.resize(frame.luma, size, interpolation=cv2.INTER_AREA).astype(np.float32)
        before, self._looked = now if self._looked is None else self._looked, now
        window = cv2.createHanningWindow(size, cv2.CV_32F)
        (x_px, y_px), _ = cv2.phaseCorrelate(before.copy(), now.copy(), window)       # multiplies them in place
        there = cv2.warpAffine(before, np.array([[1.0, 0.0, x_px], [0.0, 1.0, y_px]]), size,
                               borderMode=cv2.BORDER_REPLICATE)
        still, moved = float(np.abs(now - before).mean()), float(np.abs(now - there).mean())
        return SMALLER * float(np.hypot(x_px, y_px)) if moved < EXPLAINED * still else 0.0


def is_same_view(one: Image, other: Image) -> bool:
    """Return whether two backgrounds are of one place of the camera: edges at the same pixels (phase correlation).

    Edges are clipped, or those of a robot that has moved would count more than all of the hall's. Three of the
    picture's quarters must agree: a camera that is turned or zoomed shifts them differently.
    """
    edges = [cv2.Laplacian(one_of.astype(np.float32), cv2.CV_32F).clip(-EDGE, EDGE) for one_of in (
        cv2.resize(part, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA) for part in (one, other))]
    rows, columns = (side // 2 for side in edges[0].shape)
    window, alike = cv2.createHanningWindow((columns, rows), cv2.CV_32F), 0
    for top in (0, rows):
        for left in (0, columns):
            before, after = (np.ascontiguousarray(part[top:top + rows, left:left + columns]) for part in edges)
            shift_px, sharp = cv2.phaseCorrelate(before, after, window)
            alike += sharp > SHARP and 2.0 * float(np.hypot(*shift_px)) < SAME_PX
    return alike >= 3


def _median(pictures: list[Image]) -> Image:
    """The median picture, by partial bubble sort of whole pictures: two fast operations for each exchange."""
    sorted_ = list(pictures)
    for end in range(len(sorted_) - 1, (len(sorted_) - 1) // 2 - 1, -1):
        for k in range(end):
            sorted_[k], sorted_[k + 1] = (np.minimum(sorted_[k], sorted_[k + 1]),
                                          np.maximum(sorted_[k], sorted_[k + 1]))
    return np.ascontiguousarray(sorted_[(len(sorted_) - 1) // 2])


def differences(clip: Clip, scene: Background | None = None) -> Iterator[tuple[Frame, Image, float]]:
    """Yield each frame of a clip with its difference from the background `scene` and the noise of that.

    The first seconds are read twice: their background is the median of all of them.
    """
    scene = scene or Background()
    for frame in clip.frames():
        if frame.time_s > MEMORY_S:
            break
        scene.add(frame, settle=False)
    scene.settle()
    for frame in clip.frames():
        if frame.time_s > MEMORY_S:
            scene.add(frame)
        yield frame, *scene.difference(frame)
