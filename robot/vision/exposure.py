"""Whether an image was exposed for tape under a ring light: dark, but for what shines.

A camera that chooses its own exposure brightens the room until the tape is white; then colours and edges lie.
"""

import cv2
import numpy as np
import numpy.typing as npt

STRIDE = 16                           # pixels looked at: every sixteenth column of every sixteenth row
BRIGHT = 150                          # of 255: more than half of an image this bright is not a dark one
BURNT, BURNT_SHARE = 250, 0.3


def check_exposure(image: npt.NDArray[np.uint8]) -> str:
    """"" for an image (h, w, 3) that may be looked at; else what is wrong with its exposure."""
    few = image[::STRIDE, ::STRIDE]
    brightest = few.max(axis=2)
    if int(cv2.countNonZero((brightest >= BRIGHT).astype(np.uint8))) > 0.5 * brightest.size:
        return "the picture is bright all over: the exposure is too long, or not locked"
    if int(cv2.countNonZero((few.min(axis=2) >= BURNT).astype(np.uint8))) > BURNT_SHARE * brightest.size:
        return "large parts of the picture are burnt out: the exposure is too long, or not locked"
    return ""
