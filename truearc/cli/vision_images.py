"""Implementation of `truearc vision`, which measures distances in picture files, and of `truearc vision-calibrate`."""

import argparse
import csv
import io
import re
import sys
import warnings
from pathlib import Path

import cv2
import msgspec
import numpy as np
import numpy.typing as npt
from msgspec.structs import replace

from truearc.cli.common import load_camera, load_labels, make_progress, print_or_write
from truearc.errors import InputError, in_words, load_bytes, make_toml
from truearc.hw.protocols import CameraFrame
from truearc.robot.config.schema import CameraConfig, CameraFile
from truearc.robot.reasons import text
from truearc.robot.types import Sighting
from truearc.robot.vision import calibration as boards
from truearc.robot.vision import detect, find_target
from truearc.robot.vision.calibration import LEAST, TapedFit, fit_taped
from truearc.sim.printed import make_text

MAX_PIXELS = 50_000_000               # of an image; no webcam is near it, and a header may claim anything
MAX_BYTES = 4 * MAX_PIXELS + 65_536   # of a file: that image without compression, with opacity, and its header
FORMATS = ("JPEG", "PNG", "BMP", "WEBP")
GREY_ALPHA = 4                        # a PNG's kind of colour: grey and opacity
MANY_IMAGES = 200                     # two seconds of work


def load_image(name: str, colour: bool = True) -> npt.NDArray[np.uint8]:
    """Load an image, (height, width, 3) BGR in the sensor's own orientation.

    If colour is not needed, a grey image may be (height, width). InputError names the file and what is wrong with it.
    """
    data = load_bytes(name, MAX_BYTES)
    try:
        return decode_image(data, colour)
    except (InputError, OSError, ValueError) as error:
        raise InputError(f"{name}: {in_words(error)}") from error


def decode_image(data: bytes, colour: bool = True) -> npt.NDArray[np.uint8]:
    """Decode a file's bytes as load_image does; InputError without its name."""
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
    """Return 0 if every file was an image, target found or not; 2 if one was not (the others are still answered)."""
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
    """Return the reason why the target was not found; empty if it was."""
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


# --- calibration: a camera from a board, or its focal length from taped distances

TAPE_SIGMA_M, BIAS_SIGMA_M = 0.01, 0.02       # without --tape-sigma and --bias-sigma
NUMBER = r"(\d+\.?\d*|\.\d+)"
CHESSBOARD = re.compile(rf"chessboard:(\d+)x(\d+):{NUMBER}")
CHARUCO = re.compile(rf"charuco:(\d+)x(\d+):{NUMBER}:{NUMBER}:(DICT_\w+)")


def calibrate_camera(args: argparse.Namespace) -> int:
    """Calibrate and write the camera; args: those of `truearc vision-calibrate`."""
    file = load_camera(args.camera)
    camera = _from_board(args, file.camera) if args.board else _from_tape(args, file)
    print_or_write(args.out, make_toml(msgspec.to_builtins(replace(file, camera=camera))))
    return 0


def _from_board(args: argparse.Namespace, camera: CameraConfig) -> CameraConfig:
    board = parse_board(args.board)
    progress = make_progress("vision-calibrate", args.quiet)
    views: list[boards.BoardView] = []
    names: list[str] = []
    size = (0, 0)
    for done, name in enumerate(args.images):
        progress(done / len(args.images), name)
        image = load_image(name, colour=False)
        if views and (image.shape[1], image.shape[0]) != size:
            raise InputError(f"{name}: {image.shape[1]} x {image.shape[0]} pixels, but {names[0]} has {size[0]} x "
                           f"{size[1]}")
        view = boards.find_board(image, board)
        if view is None:
            print(f"{name}: the board was not found", file=sys.stderr)
            continue
        size = (image.shape[1], image.shape[0])
        same = next((there for there, other in zip(names, views, strict=True) if boards.is_same(view, other)), None)
        if same is not None:
            print(f"{name}: the same view as {same}, left out", file=sys.stderr)
            continue
        views.append(view)
        names.append(name)
    progress(1.0, "")
    if len(views) < boards.LEAST_VIEWS:
        raise InputError(f"the board was found in {len(views)} of {len(args.images)} images, the same view counted "
                         f"once; {boards.LEAST_VIEWS} that differ are needed, ten at different slants are better")
    begin = replace(camera, width_px=size[0], height_px=size[1], fx_px=camera.fx_px * size[1] / camera.height_px,
                    fy_px=camera.fy_px * size[1] / camera.height_px)
    try:
        fit = boards.calibrate(views, begin)
    except cv2.error as error:
        raise InputError("these views do not determine a camera: they are too alike; slant the board more") from error
    for name, error_px in zip(names, fit.error_px, strict=True):
        print(f"{name}: corners off by {error_px:.2f} px", file=sys.stderr)
    found = fit.camera
    if fit.slant_deg < boards.LEAST_SLANT_DEG:
        raise InputError(f"these views leave the focal length open: no board is slanted by more than "
                       f"{fit.slant_deg:.0f} degrees; slant it by 20 to 30 degrees, to all sides")
    if found.focal_sigma > boards.MOST_FOCAL_SIGMA:
        raise InputError(f"these views leave the focal length open by {found.focal_sigma:.0%}, and more than "
                       f"{boards.MOST_FOCAL_SIGMA:.0%} is too much: slant the board by 20 to 30 degrees, to all sides")
    print(f"focal length {found.fx_px:.1f} px +- {found.focal_sigma:.2%}, axis at {found.cx_px:.1f} {found.cy_px:.1f} "
          f"+- {found.centre_sigma_px:.1f} px, from {len(views)} views", file=sys.stderr)
    return found


def parse_board(text: str) -> boards.Board:
    """Return the board that --board names; InputError explains the format."""
    board = None
    if match := CHESSBOARD.fullmatch(text):
        board = boards.Board(int(match[1]), int(match[2]), float(match[3]))
    elif (match := CHARUCO.fullmatch(text)) and match[5] in dir(cv2.aruco) and float(match[4]) > 0.0:
        board = boards.Board(int(match[1]), int(match[2]), float(match[3]), float(match[4]), match[5])
    if (board is None or min(board.columns, board.rows) < 3 or max(board.columns, board.rows) >= 100
            or not board.marker_m < board.square_m < 10.0):
        raise InputError(f"--board {text!r}: give chessboard:9x6:0.025 (inner corners, square in metres) or "
                       "charuco:8x11:0.015:0.011:DICT_4X4_50 (squares, square and marker in metres)")
    return board


def _from_tape(args: argparse.Namespace, file: CameraFile) -> CameraConfig:
    taped = load_labels(args.distances, ("distance_m", "label_distance_m"))
    given = {Path(name).name: name for name in args.images}
    unknown = [name for name in given if name not in {Path(one).name for one in taped}]
    if unknown:
        raise InputError(f"{args.distances}: no distance for {', '.join(unknown)}")
    names = [name for name in taped if not given or Path(name).name in given]
    frames = [CameraFrame(0, load_image(given.get(Path(name).name, str(Path(args.distances).parent / name))))
              for name in names]
    fit = fit_taped(frames, [taped[name] for name in names], file.camera, file.tape, file.vision,
                    tape_sigma_m=args.tape_sigma or TAPE_SIGMA_M, bias_sigma_m=args.bias_sigma or BIAS_SIGMA_M)
    if fit is None:
        raise InputError(f"{args.distances}: " + _why_not(frames, names, taped, file))
    _print_fit(names, taped, fit)
    return fit.camera


def _why_not(frames: list[CameraFrame], names: list[str], taped: dict[str, float], file: CameraFile) -> str:
    seen = [(name, sighting.distance_m) for name, frame in zip(names, frames, strict=True)
            if (sighting := detect(frame, file.camera, file.tape, file.vision)).distance_m is not None]
    if len(seen) < LEAST:
        return f"the target was found in fewer than {LEAST} of {len(names)} images"
    name, seen_m = seen[0]
    return (f"no focal length makes these distances those that are seen, such as {Path(name).name}: {taped[name]:g} m "
            f"taped, {seen_m:.2f} m seen. Are they in metres?")


def _print_fit(names: list[str], taped: dict[str, float], fit: TapedFit) -> None:
    rows = []
    found = iter(zip(fit.residual_m, fit.expected_m, strict=True))
    for name, sighting in zip(names, fit.sightings, strict=True):
        cells = ["", "", f"not found: {why_not(sighting)}"]
        if sighting.distance_m is not None:
            residual_m, expected_m = next(found)
            cells = [f"{sighting.distance_m:.3f}", f"{residual_m:+.3f}", f"{expected_m:.3f}"]
        rows.append([Path(name).name, f"{taped[name]:.3f}", *cells])
    header = ("file", "taped_m", "seen_m", "residual_m", "expected_m")
    print("\n".join(make_text(header, rows, right=range(1, 4))), file=sys.stderr)
    camera = fit.camera
    print(f"focal lengths x {fit.scale:.4f} +- {camera.focal_sigma:.4f}, bias {camera.bias_m:+.3f} +- "
          f"{camera.bias_sigma_m:.3f} m, correlation {fit.correlation:+.2f}", file=sys.stderr)
    print(f"residuals: root mean square {float(np.sqrt(np.mean(np.square(fit.residual_m)))):.3f} m"
          + (f"; {fit.inflated:.1f} times what was expected, so the sigmas were widened as much" if fit.inflated > 1.0
             else ""), file=sys.stderr)
