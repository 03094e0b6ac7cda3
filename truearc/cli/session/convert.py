"""Write a recorded session as one file that other programs open.

WPILOG for AdvantageScope, MCAP for Foxglove, Lichtblick and PlotJuggler, CSV or Parquet with one row per tick (and one
more file, FILE.trials, with one row per marked trial). With --belief an MCAP also shows the flight of each marked shot
as the belief has it.
"""

import argparse
from pathlib import Path

from truearc.cli import common
from truearc.cli.outputs import out_file

EXAMPLE = "truearc session convert sessions/monday --to wpilog -o monday.wpilog"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("session", type=Path, help="recorded session folder")
    parser.add_argument("--to", required=True, choices=("csv", "mcap", "parquet", "wpilog"), help="format")
    parser.add_argument("--belief", type=Path, metavar="FILE", help="with --to mcap: coefficients.toml by which the "
                        "flights of marked shots are drawn (needs truearc[sim]); without it none is")
    common.add_terms_from(parser)
    parser.add_argument("-o", "--out", type=out_file, required=True, metavar="FILE", help="file to write")


def main(args: argparse.Namespace) -> int:
    """Return 0 when the file is written."""
    from truearc.cli.session.convert_formats import convert
    return convert(args)
