"""What a camera makes of the light that its sensor has measured."""

import cv2
import numpy as np

from truearc.hw.emulated.imaging.image_degradation import Image, Look


def tone(image: Image, look: Look) -> Image:
    """The image as the camera's tone curve writes it."""
    if look.gamma == 1.0:
        return image
    curve = np.rint(255 * np.linspace(0.0, 1.0, 256) ** (1 / look.gamma)).astype(np.uint8)
    written: Image = cv2.LUT(image, curve)
    return written
