"""Image files that are damaged in every way: an image or a InputError with words, never anything else."""

import struct
import sys
import zlib

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from truearc.cli import vision_images as images
from truearc.cli.vision_images import MAX_PIXELS, decode_image, image_size, load_image
from truearc.errors import InputError

GREY_ALPHA = 4, (b"\0" + bytes(range(160))) * 60
RANDOM = np.random.default_rng(1)
PICTURE = cv2.GaussianBlur(RANDOM.integers(0, 256, (60, 80, 3), dtype=np.uint8), (5, 5), 0)
WHOLE = {end: cv2.imencode(end, PICTURE)[1].tobytes() for end in (".jpg", ".png", ".bmp", ".webp")}


@pytest.mark.parametrize("end", WHOLE)
def test_what_is_written_is_read(end):
    assert image_size(WHOLE[end]) == (80, 60)
    assert decode_image(WHOLE[end]).shape == (60, 80, 3)
    assert image_size(cv2.imencode(end, PICTURE[:7, :5])[1].tobytes()) == (5, 7)


@pytest.mark.parametrize("how", [cv2.IMWRITE_WEBP_QUALITY])
def test_lossless_webp_states_its_size_elsewhere(how):
    data = cv2.imencode(".webp", PICTURE, [how, 101])[1].tobytes()
    assert data[12:16] == b"VP8L" and image_size(data) == (80, 60)
    assert np.array_equal(decode_image(data), PICTURE)


def png_of(width: int, height: int, kind: int = 2, pixels: bytes = b"") -> bytes:
    """A PNG that claims a size and has these pixels."""
    header = b"IHDR" + struct.pack(">IIBBBBB", width, height, 8, kind, 0, 0, 0)
    parts = (header, b"IDAT" + zlib.compress(pixels), b"IEND")
    return b"\x89PNG\r\n\x1a\n" + b"".join(struct.pack(">I", len(part) - 4) + part + struct.pack(">I", zlib.crc32(part))
                                           for part in parts)


@pytest.mark.parametrize(("data", "named"), [
    (b"", "empty"), (b"GIF89a....", "JPEG, PNG, BMP and WebP"), (b"\x89PNG\r\n\x1a\n", "corrupt"),
    (b"\xff\xd8", "corrupt"), (b"\xff\xd8\x00\x00", "corrupt"), (WHOLE[".png"][:-40], "cut short"),
    (WHOLE[".jpg"][:-40], "cut short"), (png_of(60_000, 60_000), f"more than {MAX_PIXELS // 1_000_000} million"),
    (png_of(10_000, 10_000), f"more than {MAX_PIXELS // 1_000_000} million"),
    (png_of(0, 5), "corrupt"), (png_of(80, 60), "corrupt"),
    (cv2.imencode(".png", PICTURE[:, :, 0])[1].tobytes(), "greyscale"),
    (png_of(80, 60, *GREY_ALPHA), "greyscale"),
    (cv2.imencode(".png", PICTURE.astype(np.uint16))[1].tobytes(), "16-bit"),
])
def test_what_is_wrong_is_said(data, named):
    with pytest.raises(InputError, match=named):
        decode_image(data)


def test_grey_is_enough_for_a_board_and_files_have_a_limit(monkeypatch, tmp_path):
    assert decode_image(cv2.imencode(".png", PICTURE[:, :, 0])[1].tobytes(), colour=False).shape == (60, 80)
    assert decode_image(png_of(80, 60, *GREY_ALPHA), colour=False).tolist() == [list(range(0, 160, 2))] * 60
    path = tmp_path / "large.bmp"
    path.write_bytes(WHOLE[".bmp"])
    monkeypatch.setattr(images, "MAX_BYTES", 1000)
    with pytest.raises(InputError, match=r"large.bmp: is longer than 1000 bytes"):
        load_image(str(path))


@settings(max_examples=500, deadline=None)
@given(st.sampled_from(sorted(WHOLE)), st.lists(st.tuples(st.integers(0, 20_000), st.binary(max_size=6),
                                                          st.integers(0, 60)), min_size=1, max_size=5),
       st.one_of(st.none(), st.integers(0, 20_000)))
def test_any_damage_is_an_image_or_told(end, changes, length):
    data = bytearray(WHOLE[end])
    for place, put, gone in changes:
        at = place % len(data) if place % 2 else place % 60
        data[at:at + gone] = put
        if not data:
            break
    try:
        image = decode_image(bytes(data[:length]))
    except InputError as error:
        assert str(error)
    else:
        assert image.dtype == np.uint8 and image.ndim == 3 and image.shape[2] == 3


@pytest.mark.parametrize("end", WHOLE)
def test_the_base_install_reads_pictures_without_pillow(monkeypatch, end):
    monkeypatch.setitem(sys.modules, "PIL", None)
    assert image_size(WHOLE[end]) is None and decode_image(WHOLE[end]).shape == (60, 80, 3)
    with pytest.raises(InputError):
        decode_image(WHOLE[end][:30])
