"""Picture files of users: what is a picture, and what is wrong with one that is not."""

import struct
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from doors.jpeg import what_is_damaged
from robot.config import BadInput, in_words

MOST_PX = 50_000_000                  # of an image; no webcam is near it, and a header may claim anything
GREY_ALPHA = 4                        # a PNG's kind of colour: grey, and how much of it is seen through
JPEG_SIZES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}    # markers that state the size


def load_image(name: str, colour: bool = True) -> npt.NDArray[np.uint8]:
    """(height, width, 3) BGR in the sensor's own orientation, or where colour is not needed also (height, width) of a
    grey one; BadInput names the file and what is wrong with it."""
    try:
        data = Path(name).read_bytes()
    except (OSError, ValueError) as error:
        raise BadInput(f"{name}: {in_words(error)}") from error
    try:
        return decode_image(data, colour)
    except BadInput as error:
        raise BadInput(f"{name}: {error}") from error


def decode_image(data: bytes, colour: bool = True) -> npt.NDArray[np.uint8]:
    """As load_image, from a file's bytes; BadInput without its name."""
    if not data:
        raise BadInput("the file is empty")
    try:
        width, height = image_size(data)
    except (struct.error, IndexError) as error:
        raise BadInput("the image is cut short, or corrupt") from error
    if not 0 < width * height <= MOST_PX:
        raise BadInput(f"an image of {width} x {height} pixels; at most {MOST_PX // 1_000_000} million are read")
    _check_whole(data)
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        image = None
    if image is None or image.shape[:2] != (height, width):
        raise BadInput("not an image that can be read, or a corrupt one")
    if image.dtype != np.uint8:
        raise BadInput(f"{image.dtype.itemsize * 8}-bit {image.dtype.name} channels; 8-bit colour is needed")
    if image.ndim == 3 and data.startswith(b"\x89PNG") and data[25] == GREY_ALPHA:      # decoders make colour of it
        image = image[:, :, 0]
    if image.ndim == 3 and image.shape[2] in (3, 4):
        return np.ascontiguousarray(image[:, :, :3])
    if colour or image.ndim != 2:
        raise BadInput("a greyscale image; the tape is known by its colour, so 8-bit colour is needed")
    return np.ascontiguousarray(image, dtype=np.uint8)


def image_size(data: bytes) -> tuple[int, int]:
    """Width and height as the header of a JPEG, PNG, BMP or WebP file states them; struct.error where it is cut short,
    BadInput where it is none of these."""
    if data.startswith(b"\x89PNG\r\n\x1a\n"):
        width, height = struct.unpack_from(">II", data, 16)
        return width, height
    if data.startswith(b"\xff\xd8"):
        return _jpeg_size(data)
    if data.startswith(b"BM"):
        width, height = struct.unpack_from("<ii", data, 18)
        return abs(width), abs(height)
    if data.startswith(b"RIFF") and data[8:12] == b"WEBP":
        return _webp_size(data)
    raise BadInput("not an image (JPEG, PNG, BMP and WebP are read)")


def _jpeg_size(data: bytes) -> tuple[int, int]:
    at = 2
    while True:
        if data[at] != 0xFF:
            raise BadInput("a corrupt JPEG image")
        marker = data[at + 1]
        if marker == 0xFF:            # filling
            at += 1
        elif marker in JPEG_SIZES:
            height, width = struct.unpack_from(">HH", data, at + 5)
            return width, height
        else:
            (length,) = struct.unpack_from(">H", data, at + 2)
            at += 2 + length


def _webp_size(data: bytes) -> tuple[int, int]:
    kind = data[12:16]
    if kind == b"VP8X":
        low_w, high_w, low_h, high_h = struct.unpack_from("<HBHB", data, 24)
        return (low_w | high_w << 16) + 1, (low_h | high_h << 16) + 1
    if kind == b"VP8L":
        (bits,) = struct.unpack_from("<I", data, 21)
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    width, height = struct.unpack_from("<HH", data, 26)
    return width & 0x3FFF, height & 0x3FFF


def _check_whole(data: bytes) -> None:
    """A JPEG or PNG without its end, a JPEG with damaged data: decoders fill the rest with grey and say nothing."""
    if data.startswith(b"\xff\xd8"):
        if data.rfind(b"\xff\xd9") < data.rfind(b"\xff\xda"):
            raise BadInput("the image is cut short")
        damage = what_is_damaged(data)
        if damage:
            raise BadInput(f"a corrupt JPEG image: {damage}")
    elif data.startswith(b"\x89PNG") and b"IEND" not in data[-4096:]:
        raise BadInput("the image is cut short")
