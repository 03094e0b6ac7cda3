"""Commands for cameras: `vision`, `vision-calibrate`, `vision-tune`."""

import argparse

from truearc.cli.common import number, packaged_cameras, refuse
from truearc.cli.outputs import out_file
from truearc.errors import InputError

SMALLEST_M = 1e-6                     # of a standard deviation


def vision_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("images", nargs="+", metavar="IMAGE", help="8-bit colour image (JPEG, PNG, BMP, WebP)")
    parser.add_argument("--camera", metavar="FILE",
                        help="camera.toml or launcher.toml, or the name of a packaged camera "
                             f"({', '.join(packaged_cameras())}); without it, the packaged launcher.toml")
    parser.add_argument("--labels", metavar="FILE",
                        help="CSV with columns file,label_distance_m: prints an error table")


def vision(args: argparse.Namespace) -> int:
    """Find the retro-reflective target in images; CSV on stdout, reasons on stderr.

    Distances are horizontal, lens to tape centre, along the line of sight. Corners are x y pairs in pixels: bottom
    right, bottom left, top left, top right. A file that cannot be read as an image has an empty `found`. A picture of
    another size than the camera's is treated as another mode of its sensor that shows the full height: one that was
    cropped or turned gets a wrong distance. See also `truearc vision-calibrate` and `truearc vision-tune`.
    Exit 2 where a file was not an image; the others are answered all the same.
    """
    from truearc.cli.vision_images import measure_images
    return measure_images(args)


def vision_calibrate_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("images", nargs="*", metavar="IMAGE",
                        help="pictures of the board; with --distances, only these of the files it names")
    parser.add_argument("--board", metavar="BOARD",
                        help="chessboard:COLUMNSxROWS:SQUARE_M (inner corners) or "
                             "charuco:COLUMNSxROWS:SQUARE_M:MARKER_M:DICT_4X4_50 (squares)")
    parser.add_argument("--distances", metavar="CSV",
                        help="columns file,distance_m (or label_distance_m); files lie beside it or are given as IMAGE")
    parser.add_argument("--camera", metavar="FILE", help="where to begin: as for `truearc vision`")
    parser.add_argument("--tape-sigma", type=number(float, SMALLEST_M, 10.0), metavar="M",
                        help="standard deviation of one taped distance, metres (default 0.01)")
    parser.add_argument("--bias-sigma", type=number(float, SMALLEST_M, 10.0), metavar="M",
                        help="how well it is known that the tape began below the lens, metres (default 0.02)")
    parser.add_argument("-o", "--out", type=out_file, metavar="FILE",
                        help="camera.toml to write; without it, on stdout")


def vision_calibrate(args: argparse.Namespace) -> int:
    """Calibrate a camera and write camera.toml with its uncertainties.

    With --board: focal length, axis and lens distortion from pictures of a chessboard or ChArUco board, held at many
    slants all over the picture. With --distances: a better focal length from pictures of the target whose horizontal
    distance (lens to tape centre) was measured with a tape; three are enough.
    """
    if bool(args.board) == bool(args.distances):
        raise InputError("--board or --distances: one of the two is needed")
    if args.board:
        refuse(args, ("--tape-sigma", "--bias-sigma"), "applies with --distances only")
    from truearc.cli.vision_calibration import calibrate_camera
    return calibrate_camera(args)


def vision_tune_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("sources", nargs="*", metavar="IMAGE|FOLDER",
                        help="pictures, folders of pictures, or recorded sessions; none: the live camera")
    parser.add_argument("--camera", metavar="FILE", help="where to begin: as for `truearc vision`")
    parser.add_argument("-o", "--out", type=out_file, metavar="FILE", default="camera.toml",
                        help="file that Save writes")
    parser.add_argument("--port", type=int, default=5807, help="of the page; 0 picks a free one")
    parser.add_argument("--host", default="127.0.0.1", help="of the page; the default is this machine only")


def vision_tune(args: argparse.Namespace) -> int:
    """Serve a page on this machine with sliders for the settings of target detection.

    It shows pictures, or the live camera, with the mask, the regions, and why each is the target or not. Recorded
    pictures can all be run through changed settings at once; Save writes them to --out.
    """
    from truearc.cli.vision_tuner import serve_tuner
    return serve_tuner(args)
