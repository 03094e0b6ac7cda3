"""Picture files of users, decoded by OpenCV; a file that is not a picture is refused with the reason."""

import io
import warnings

import cv2
import numpy as np
import numpy.typing as npt

from truearc.errors import InputError, in_words, load_bytes

MAX_PIXELS = 50_000_000               # of an image; no webcam is near it, and a header may claim anything
MAX_BYTES = 4 * MAX_PIXELS + 65_536   # of a file: that image without compression, with opacity, and its header
FORMATS = ("JPEG", "PNG", "BMP", "WEBP")
GREY_ALPHA = 4                        # a PNG's kind of colour: grey and opacity


def load_image(name: str, colour: bool = True) -> npt.NDArray[np.uint8]:
    """(height, width, 3) BGR in the sensor's own orientation, or where colour is not needed also (height, width) of a
    grey one; InputError names the file and what is wrong with it."""
    data = load_bytes(name, MAX_BYTES)
    try:
        return decode_image(data, colour)
    except (InputError, OSError, ValueError) as error:
        raise InputError(f"{name}: {in_words(error)}") from error


def decode_image(data: bytes, colour: bool = True) -> npt.NDArray[np.uint8]:
    """As load_image, from a file's bytes; InputError without its name."""
    if not data:
        raise InputError("the file is empty")
    size = image_size(data)
    _check_end(data)
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        image = None
    if image is None or size not in (None, (image.shape[1], image.shape[0])):
        raise InputError("not an image that can be read, or a corrupt one")
    if image.dtype != np.uint8:
        raise InputError(f"{image.dtype.itemsize * 8}-bit {image.dtype.name} channels; 8-bit colour is needed")
    if image.ndim == 3 and data.startswith(b"\x89PNG") and data[25] == GREY_ALPHA:      # decoders make colour of it
        image = image[:, :, 0]
    if image.ndim == 3 and image.shape[2] in (3, 4):
        return np.ascontiguousarray(image[:, :, :3])
    if colour or image.ndim != 2:
        raise InputError("a greyscale image; the tape is known by its colour, so 8-bit colour is needed")
    return np.ascontiguousarray(image, dtype=np.uint8)


def image_size(data: bytes) -> tuple[int, int] | None:
    """Return width and height in pixels as the header of a JPEG, PNG, BMP or WebP file states them.

    None on a robot's base install, which lacks Pillow: there OpenCV's own limit (2^30 pixels) holds.

    Raises:
        InputError: The header is of none of these formats, is corrupt, or states more than MAX_PIXELS.
    """
    try:
        from PIL import Image, UnidentifiedImageError
    except ModuleNotFoundError:
        return None
    try:
        with warnings.catch_warnings(action="ignore"), Image.open(io.BytesIO(data), formats=FORMATS) as image:
            width, height = image.size
    except Image.DecompressionBombError as error:
        raise InputError(f"an image of more than {MAX_PIXELS // 1_000_000} million pixels") from error
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError, LookupError) as error:
        raise InputError("not an image (JPEG, PNG, BMP and WebP are read), or a corrupt one") from error
    if width * height > MAX_PIXELS:
        raise InputError(f"an image of {width} x {height}, more than {MAX_PIXELS // 1_000_000} million pixels")
    return width, height


def _check_end(data: bytes) -> None:
    """Refuse a JPEG or PNG without its end: decoders fill the rest with grey and report no error."""
    cut_jpeg = data.startswith(b"\xff\xd8") and data.rfind(b"\xff\xd9") < data.rfind(b"\xff\xda")
    if cut_jpeg or (data.startswith(b"\x89PNG") and b"IEND" not in data[-4096:]):
        raise InputError("the image is cut short")
