"""Whether an image was exposed for tape under a ring light: dark, except for what shines.

A camera that chooses its own exposure brightens the room until the tape is white; then colours and edges lie.
"""

import numpy as np
import numpy.typing as npt

from truearc.hw.reason import Reason
from truearc.robot.reasons import IMAGE_BRIGHT, IMAGE_BURNT

STRIDE = 16                           # pixels looked at: every sixteenth column of every sixteenth row
BRIGHT = 150                          # of 255: more than half of an image this bright is not a dark one
BURNT, BURNT_SHARE = 250, 0.3


def check_exposure(image: npt.NDArray[np.uint8]) -> Reason | None:
    """None for an image (h, w, 3) that may be used; else what is wrong with its exposure."""
    blue, green, red = np.ascontiguousarray(image[::STRIDE, ::STRIDE].transpose(2, 0, 1))
    if np.count_nonzero(np.maximum(np.maximum(blue, green), red) >= BRIGHT) > 0.5 * blue.size:
        return IMAGE_BRIGHT()
    if np.count_nonzero(np.minimum(np.minimum(blue, green), red) >= BURNT) > BURNT_SHARE * blue.size:
        return IMAGE_BURNT()
    return None


def is_dark(image: npt.NDArray[np.uint8], value: int) -> bool:
    """Whether nothing in an image (h, w, 3) reaches this brightness, where it is looked at."""
    return bool(image[::STRIDE, ::STRIDE].max() < value)
