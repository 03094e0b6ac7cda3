"""`truearc vision`: images to distances."""

import argparse
import csv
import re
import sys
from importlib.resources import files
from pathlib import Path

import numpy as np

from truearc.cli.progress import make_progress
from truearc.cli.robot.images import load_image
from truearc.hw.readings import CameraFrame
from truearc.robot.config.schema import CameraFile, Config, InputError, in_words, load_text, load_toml
from truearc.robot.reasons import text
from truearc.robot.types import Sighting
from truearc.robot.vision import detect
from truearc.sim.tables import make_text

DESCRIPTION = ("Find the retro-reflective target in images; CSV on stdout, reasons on stderr. Distances are "
               "horizontal, lens to tape centre, along the line of sight. Corners are x y pairs in pixels: bottom "
               "right, bottom left, top left, top right. A file that is no image has an empty `found`. "
               "A picture of another size than the camera's is taken for another mode of its sensor that shows the "
               "full height: one that was cropped or turned gets a wrong distance. "
               "See also `truearc vision calibrate` and `truearc vision tune`.")
EXAMPLE = "truearc vision photos/*.jpg --camera lifecam_hd3000_480p --labels labels.csv"
MANY_IMAGES = 200                     # two seconds of work


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("images", nargs="+", metavar="IMAGE", help="8-bit colour image (JPEG, PNG, BMP, WebP)")
    parser.add_argument("--camera", metavar="FILE",
                        help="camera.toml or launcher.toml, or the name of a packaged camera "
                             f"({', '.join(_packaged())}); without it, the packaged launcher.toml")
    parser.add_argument("--labels", metavar="FILE",
                        help="CSV with columns file,label_distance_m: prints an error table")


def main(args: argparse.Namespace) -> int:
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
        sighting = detect(frame, camera.camera, camera.tape, camera.vision)
        table.writerow(_row(name, sighting))
        if not sighting.found:
            print(f"{name}: not found: {_why(sighting)}", file=sys.stderr)
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
        print(f"truearc vision: {', '.join(others)}: taken for modes that show the full height of a sensor calibrated "
              f"at {calibrated[0]} x {calibrated[1]}; of cropped or turned pictures the distance is wrong",
              file=sys.stderr)


def load_camera(name: str | None) -> CameraFile:
    """The camera, tape and vision sections of a file, of a packaged camera, or of the packaged launcher.toml."""
    path = Path(str(files("truearc.robot") / "launcher.toml")) if name is None else Path(name)
    if name in _packaged():
        path = Path(str(files("truearc.robot") / "cameras" / f"{name}.toml"))
    if re.search(r"^\s*\[gate\]", load_text(path), re.MULTILINE) is None:
        return load_toml(path, CameraFile)
    config = load_toml(path, Config)
    return CameraFile(config.camera, config.tape, config.vision)


def _packaged() -> list[str]:
    cameras = files("truearc.robot") / "cameras"
    return sorted(entry.name.removesuffix(".toml") for entry in cameras.iterdir() if entry.name.endswith(".toml"))


def _row(name: str, sighting: Sighting) -> list[str]:
    if not sighting.found:
        return [name, "false", "", "", ""]
    corners = ", ".join(f"{x:.2f} {y:.2f}" for x, y in sighting.corners_px)
    return [name, "true", f"{sighting.distance_m:.4f}", f"{sighting.sigma_m:.4f}", corners]


def _why(sighting: Sighting) -> str:
    return "" if sighting.reason is None else text(sighting.reason)


def load_labels(path: str, columns: tuple[str, ...] = ("label_distance_m",)) -> dict[str, float]:
    """File name -> distance, from the first of these columns that is there; rows without a distance are left out."""
    labels: dict[str, float] = {}
    try:
        with open(path, encoding="utf-8-sig", newline="") as stream:
            rows = csv.DictReader(stream)
            names = rows.fieldnames or ()
            column = next((name for name in columns if name in names), None)
            if column is None or "file" not in names:
                raise InputError(f"{path}:1: missing column {columns[0] if 'file' in names else 'file'!r}")
            for row in rows:
                if None in row:           # a comma too many, such as a decimal one
                    raise InputError(f"{path}:{rows.line_num}: more cells than columns: is a decimal point a comma?")
                if row[column]:
                    labels[row["file"]] = _number(row[column], f"{path}:{rows.line_num}: {column}")
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: {in_words(error)}") from error
    return labels


def _number(text: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not 0.0 < value < 1e4:
        raise InputError(f"{where}: {text!r} is not a distance in metres")
    return value


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
