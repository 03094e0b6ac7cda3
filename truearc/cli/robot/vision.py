"""Find the retro-reflective target in images; CSV on stdout, reasons on stderr.

Distances are horizontal, lens to tape centre, along the line of sight. Corners are x y pairs in pixels: bottom right,
bottom left, top left, top right. A file that cannot be read as an image has an empty `found`. A picture of another
size than the camera's is treated as another mode of its sensor that shows the full height: one that was cropped or
turned gets a wrong distance. See also `truearc vision-calibrate` and `truearc vision-tune`.
"""

import argparse

from truearc.cli.robot.vision_tools.camera_file import packaged_cameras

EXAMPLE = "truearc vision photos/*.jpg --camera lifecam_hd3000_480p --labels labels.csv"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("images", nargs="+", metavar="IMAGE", help="8-bit colour image (JPEG, PNG, BMP, WebP)")
    parser.add_argument("--camera", metavar="FILE",
                        help="camera.toml or launcher.toml, or the name of a packaged camera "
                             f"({', '.join(packaged_cameras())}); without it, the packaged launcher.toml")
    parser.add_argument("--labels", metavar="FILE",
                        help="CSV with columns file,label_distance_m: prints an error table")


def main(args: argparse.Namespace) -> int:
    """Return 0 when every file was an image, 2 when one was not; the others are answered all the same."""
    from truearc.cli.robot.vision_tools.measure import measure_images
    return measure_images(args)
