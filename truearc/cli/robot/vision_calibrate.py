"""Calibrate a camera and write camera.toml with its uncertainties.

With --board: focal length, axis and lens distortion from pictures of a chessboard or ChArUco board, held at many slants
all over the picture. With --distances: a better focal length from pictures of the target whose horizontal distance
(lens to tape centre) was measured with a tape; three are enough.
"""

import argparse

from truearc.cli.common import number, refuse
from truearc.cli.outputs import out_file
from truearc.errors import InputError

EXAMPLE = "truearc vision-calibrate --distances taped.csv --camera camera.toml -o camera-here.toml"
SMALLEST_M = 1e-6                     # of a standard deviation


def add_arguments(parser: argparse.ArgumentParser) -> None:
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


def main(args: argparse.Namespace) -> int:
    """Return 0 when a camera was written."""
    if bool(args.board) == bool(args.distances):
        raise InputError("--board or --distances: one of the two is needed")
    if args.board:
        refuse(args, ("--tape-sigma", "--bias-sigma"), "applies with --distances only")
    from truearc.cli.robot.vision_tools.calibration import calibrate_camera
    return calibrate_camera(args)
