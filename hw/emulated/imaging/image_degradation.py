"""What spoils a picture: blur, motion, bloom, noise, and things that stand in the way or shine."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from truearc.hw.emulated.imaging.lens import Array, Plane

Image = npt.NDArray[np.uint8]

TAPE_BGR = (113.0, 213.0, 6.0)        # of the tape under a green ring light, well exposed
DARK_BGR = (4.0, 6.0, 1.5)            # mean of an unlit pixel
HALO_BLUR_PX = 6.0
HALO_MARGIN_PX = 16                   # kept around what shines, for its halo and blur


@dataclass(frozen=True)
class Look:
    """What lens, sensor and motion do to the picture."""

    noise: float = 2.2                # standard deviation of a channel, of 255
    blur_px: float = 0.6              # of the lens, one standard deviation
    halo_share: float = 0.1           # bloom: light that strays HALO_BLUR_PX far
    shake_px: float = 0.3
    smear_px: tuple[float, float] = (0.0, 0.0)    # right and down, while the shutter is open
    turn_deg_s: tuple[float, float] = (0.0, 0.0)  # of the camera, right and up; its rows are exposed one after another
    readout_s: float = 0.0            # from the first row to the last
    gain: float = 1.0                 # exposure: light times this, before the sensor clips
    gamma: float = 1.0                # of the camera's tone curve: what is written is light to the power 1 / gamma


USUAL = Look()


class Patch(NamedTuple):
    """A polygon before everything else: it shines, or where its colour is black it hides."""

    corners_px: Array                 # (n, 2), as seen
    bgr: tuple[float, float, float]


def paint(image: Image, dark: Image, patch: Patch, look: Look) -> None:
    """Put a patch into an image; where it hides, `dark` (the sensor's noise) is seen."""
    low = np.maximum(np.floor(patch.corners_px.min(axis=0)).astype(int) - HALO_MARGIN_PX, 0)
    high = np.minimum(np.ceil(patch.corners_px.max(axis=0)).astype(int) + HALO_MARGIN_PX, image.shape[1::-1])
    if (high - low < 1).any():
        return
    part = np.s_[low[1]:high[1], low[0]:high[0]]
    filled = np.zeros(image[part].shape[:2], np.uint8)
    cv2.fillPoly(filled, [np.rint((patch.corners_px - low) * 16).astype(np.int32)], 255, cv2.LINE_AA, 4)
    cover = spread(np.divide(filled, 255, dtype=np.float32), look)[..., None]
    if any(patch.bgr):
        image[part] = cv2.add(image[part], (cover * np.array(patch.bgr, np.float32)).astype(np.uint8))
    else:
        image[part] = (image[part] * (1 - cover) + dark[part] * cover).astype(np.uint8)


def spread(plane: Plane, look: Look) -> Plane:
    """Light as the lens and the motion while the shutter is open spread it."""
    side = 2 * math.ceil(3 * look.blur_px) + 1
    blurred: Plane = cv2.GaussianBlur(plane, (side, side), look.blur_px)
    if any(look.smear_px):
        blurred = cv2.filter2D(blurred, -1, _smear(look.smear_px))
    return blurred


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
