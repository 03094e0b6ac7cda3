"""The work of `truearc vision`: reads picture files and measures the distance in each."""

import argparse
import csv
import io
import sys
import warnings
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from truearc.cli.common import load_camera, load_labels, make_progress
from truearc.errors import InputError, in_words, load_bytes
from truearc.hw.protocols import CameraFrame
from truearc.robot.config.schema import CameraFile
from truearc.robot.reasons import text
from truearc.robot.types import Sighting
from truearc.robot.vision import find_target
from truearc.sim.printed import make_text

MAX_PIXELS = 50_000_000               # of an image; no webcam is near it, and a header may claim anything
MAX_BYTES = 4 * MAX_PIXELS + 65_536   # of a file: that image without compression, with opacity, and its header
FORMATS = ("JPEG", "PNG", "BMP", "WEBP")
GREY_ALPHA = 4                        # a PNG's kind of colour: grey and opacity
MANY_IMAGES = 200                     # two seconds of work


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


def measure_images(args: argparse.Namespace) -> int:
    """Exit 0 when every file was an image, target seen or not; 2 when one was not (the others are still answered)."""
    camera = load_camera(args.camera)
    labels = load_labels(args.labels) if args.labels else None
    progress = make_progress("vision", args.quiet or len(args.images) < MANY_IMAGES)
    table = csv.writer(sys.stdout, lineterminator="\n")
    table.writerow(["file", "found", "distance_m", "sigma_m", "corners"])
    bad, sizes = 0, set[tuple[int, int]]()
    seen: list[tuple[str, Sighting]] = []
    for done, name in enumerate(args.images):
        progress(done / len(args.images), name)
        try:
            frame = CameraFrame(0, load_image(name))
        except InputError as error:
            print(f"truearc vision: {error}", file=sys.stderr)
            table.writerow([name, "", "", "", ""])
            bad += 1
            continue
        sizes.add((frame.image.shape[1], frame.image.shape[0]))
        sighting = find_target(frame, camera)
        table.writerow(_row(name, sighting))
        if not sighting.found:
            print(f"{name}: not found: {why_not(sighting)}", file=sys.stderr)
        seen.append((name, sighting))
    progress(1.0, "")
    sys.stdout.flush()
    _print_sizes(sizes, camera)
    if labels is not None:
        _print_errors(seen, labels)
    return 2 if bad else 0


def _print_sizes(sizes: set[tuple[int, int]], file: CameraFile) -> None:
    """Of which sizes pictures were that a full-height mode of the sensor was assumed."""
    calibrated = file.camera.width_px, file.camera.height_px
    others = [f"{width} x {height}" for width, height in sorted(sizes - {calibrated})]
    if others:
        print(f"truearc vision: {', '.join(others)}: treated as modes that show the full height of a sensor calibrated "
              f"at {calibrated[0]} x {calibrated[1]}; of cropped or turned pictures the distance is wrong",
              file=sys.stderr)


def why_not(sighting: Sighting) -> str:
    """The reason why the target was not found; empty where it was."""
    return "" if sighting.reason is None else text(sighting.reason)


def _row(name: str, sighting: Sighting) -> list[str]:
    if not sighting.found:
        return [name, "false", "", "", ""]
    corners = ", ".join(f"{x:.2f} {y:.2f}" for x, y in sighting.corners_px)
    return [name, "true", f"{sighting.distance_m:.4f}", f"{sighting.sigma_m:.4f}", corners]


def _print_errors(seen: list[tuple[str, Sighting]], labels: dict[str, float]) -> None:
    errors_m, rows = [], []
    for name, sighting in seen:
        label_m = labels.get(name, labels.get(Path(name).name))
        cells = ["" if label_m is None else f"{label_m:.3f}", "not found", "", ""]
        if sighting.distance_m is not None and sighting.sigma_m is not None:
            cells[1], cells[3] = f"{sighting.distance_m:.3f}", f"{sighting.sigma_m:.3f}"
            if label_m is not None:
                errors_m.append(sighting.distance_m - label_m)
                cells[2] = f"{errors_m[-1]:+.3f}"
        rows.append([Path(name).name, *cells])
    header = ("file", "label_m", "estimate_m", "error_m", "sigma_m")
    print("\n".join(make_text(header, rows, right=range(1, 5))), file=sys.stderr)
    if errors_m:
        rms_m = float(np.sqrt(np.mean(np.square(errors_m))))
        print(f"{len(errors_m)} labelled: mean error {np.mean(errors_m):+.3f} m, root mean square {rms_m:.3f} m",
              file=sys.stderr)
