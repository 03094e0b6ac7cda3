"""Serve a page on this machine with sliders for the settings of target detection.

It shows pictures, or the live camera, with the mask, the regions, and why each is the target or not. Recorded pictures
can all be run through changed settings at once; Save writes them to --out.
"""

import argparse

from truearc.cli.outputs import out_file

EXAMPLE = "truearc vision-tune sessions/first --camera camera.toml -o camera-tuned.toml"
PROGRESS = False


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("sources", nargs="*", metavar="IMAGE|FOLDER",
                        help="pictures, folders of pictures, or recorded sessions; none: the live camera")
    parser.add_argument("--camera", metavar="FILE", help="where to begin: as for `truearc vision`")
    parser.add_argument("-o", "--out", type=out_file, metavar="FILE", default="camera.toml",
                        help="file that Save writes")
    parser.add_argument("--port", type=int, default=5807, help="of the page; 0 picks a free one")
    parser.add_argument("--host", default="127.0.0.1", help="of the page; the default is this machine only")


def main(args: argparse.Namespace) -> int:
    """Serve until interrupted."""
    from truearc.cli.robot.vision_tools.tuner import serve_tuner
    return serve_tuner(args)
