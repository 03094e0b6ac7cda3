"""The work of `truearc vision`: a CSV row per image, and errors against labels."""

import argparse
import csv
import sys
from pathlib import Path

import numpy as np

from truearc.cli.common import make_progress
from truearc.cli.robot.vision_tools.camera_file import load_camera, load_labels
from truearc.cli.robot.vision_tools.images import load_image
from truearc.errors import InputError
from truearc.hw.protocols import CameraFrame
from truearc.robot.config.schema import CameraFile
from truearc.robot.reasons import text
from truearc.robot.types import Sighting
from truearc.robot.vision import find_target
from truearc.sim.printed import make_text

MANY_IMAGES = 200                     # two seconds of work


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
