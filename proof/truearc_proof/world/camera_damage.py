"""An emulated camera with things wrong with it: motion, exposure, tone curve, things in the way, frames that stop."""

import math
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from truearc.hw.emulated.camera import HALO_MARGIN_PX, Array, EmulatedCamera, Image, Lens, Plane, TapeSize
from truearc.hw.emulated.camera import Look as PlainLook
from truearc.hw.emulated.nodes import Scene, View
from truearc.hw.protocols import CameraFrame
from truearc_proof.world.shutter import project_turning


@dataclass(frozen=True)
class Look(PlainLook):
    """What lens, sensor and motion do to the picture."""

    smear_px: tuple[float, float] = (0.0, 0.0)    # right and down, while the shutter is open
    turn_deg_s: tuple[float, float] = (0.0, 0.0)  # of the camera, right and up; its rows are exposed one after another
    readout_s: float = 0.0            # from the first row to the last
    gamma: float = 1.0                # of the camera's tone curve: what is written is light to the power 1 / gamma


USUAL = Look()


class Patch(NamedTuple):
    """A polygon before everything else: it shines, or where its colour is black it hides."""

    corners_px: Array                 # (n, 2), as seen
    bgr: tuple[float, float, float]


class StagedCamera(EmulatedCamera):
    """truearc.hw.protocols.Camera on an emulated world; whoever owns the clock calls `step`."""

    def __init__(self, scene: Scene, lens: Lens, tape: TapeSize, fps: float, latency_s: float, seed: int, *,
                 look: Look = USUAL) -> None:
        """`latency_s` runs from the middle of the exposure until the frame can be read."""
        super().__init__(scene, lens, tape, seed, look)
        self._damage = look
        self._period_ns, self._latency_ns = round(1e9 / fps), round(latency_s * 1e9)
        self._due_ns: int | None = None
        self._now_ns = 0
        self._waiting: deque[CameraFrame] = deque()
        self._frozen, self._black = False, False
        self._patches: tuple[Patch, ...] = ()

    def freeze(self, on: bool = True) -> None:
        """The camera gives no more images, as one whose driver hangs."""
        self._frozen = on

    def black(self, on: bool = True) -> None:
        """Images keep coming and show nothing but noise, as with a lens cap on."""
        self._black = on

    def clutter(self, patches: tuple[Patch, ...]) -> None:
        """From now on these stand before the scene, instead of any earlier ones."""
        self._patches = patches

    def step(self, t_ns: int) -> None:
        """Bring the camera to `t_ns`; takes one image when one is due (late steps do not make up for missed ones)."""
        self._now_ns = t_ns
        if self._due_ns is None:
            self._due_ns = t_ns
        if t_ns < self._due_ns:
            return
        self._due_ns += ((t_ns - self._due_ns) // self._period_ns + 1) * self._period_ns
        if not self._frozen:
            self._waiting.append(self.expose(t_ns))

    def read(self) -> CameraFrame | None:
        """The newest image that has arrived and was not yet read, or None."""
        newest = None
        while self._waiting and self._waiting[0].t_ns + self._latency_ns <= self._now_ns:
            newest = self._waiting.popleft()
        return newest

    def close(self) -> None:
        self._waiting.clear()

    def _draw(self, noise: Image, dice: npt.NDArray[np.int64], exposure: float) -> Image:
        if self._black:
            return tone(noise, self._damage.gamma)
        image = super()._draw(noise, dice, exposure)
        for patch in self._patches:
            self._paint(image, noise, patch)
        return tone(image, self._damage.gamma)

    def _project(self, view: View) -> tuple[Array, Array]:
        return project_turning(self._outline_m, view.camera_from_target, self._lens, view.focal_scale,
                               self._damage.turn_deg_s, self._damage.readout_s)

    def _spread(self, plane: Plane) -> Plane:
        blurred = super()._spread(plane)
        return cv2.filter2D(blurred, -1, _smear(self._damage.smear_px)) if any(self._damage.smear_px) else blurred

    def _paint(self, image: Image, dark: Image, patch: Patch) -> None:
        """Put a patch into an image; where it hides, `dark` (the sensor's noise) is seen."""
        low = np.maximum(np.floor(patch.corners_px.min(axis=0)).astype(int) - HALO_MARGIN_PX, 0)
        high = np.minimum(np.ceil(patch.corners_px.max(axis=0)).astype(int) + HALO_MARGIN_PX, image.shape[1::-1])
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


def tone(image: Image, gamma: float) -> Image:
    """The image as the camera's tone curve writes the light that its sensor has measured."""
    if gamma == 1.0:
        return image.copy()
    curve = np.rint(255 * np.linspace(0.0, 1.0, 256) ** (1 / gamma)).astype(np.uint8)
    written: Image = cv2.LUT(image, curve)
    return written


def _smear(along_px: tuple[float, float]) -> Plane:
    """A kernel that spreads a point evenly over this straight way, about its middle."""
    reach = math.ceil(max(abs(part) for part in along_px) / 2) + 1
    kernel = np.zeros((2 * reach + 1, 2 * reach + 1), np.float32)
    for share in np.linspace(-0.5, 0.5, 16 * reach + 1):
        x, y = (reach + share * part for part in along_px)
        column, row = int(x), int(y)
        kernel[row:row + 2, column:column + 2] += np.outer([row + 1 - y, y - row], [column + 1 - x, x - column])
    kernel /= kernel.sum()
    return kernel
