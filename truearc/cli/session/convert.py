"""Write a recorded session as one file that other programs open.

MCAP for Foxglove, Lichtblick and PlotJuggler, CSV or Parquet with one row per tick (and one more file, FILE.trials,
with one row per marked trial), WPILOG for AdvantageScope (with truearc-frc). With --belief an MCAP also shows the
flight of each marked shot as the belief has it.
"""

import argparse
from importlib.metadata import entry_points
from pathlib import Path

from truearc.cli import common
from truearc.cli.outputs import out_file
from truearc.hw.plugins import EXPORTS

EXAMPLE = "truearc session convert sessions/monday --to mcap -o monday.mcap"
OWN = ("csv", "mcap", "parquet")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("session", type=Path, help="recorded session folder")
    parser.add_argument("--to", required=True, choices=formats(), help="format")
    parser.add_argument("--belief", type=Path, metavar="FILE", help="with --to mcap: coefficients.toml by which the "
                        "flights of marked shots are drawn (needs truearc[sim]); without it none is")
    common.add_terms_from(parser)
    parser.add_argument("-o", "--out", type=out_file, required=True, metavar="FILE", help="file to write")


def formats() -> list[str]:
    """Formats of truearc, of installed distributions, and WPILOG, which says what to install."""
    return sorted({*OWN, "wpilog", *(point.name for point in entry_points(group=EXPORTS))})


def main(args: argparse.Namespace) -> int:
    """Return 0 when the file is written."""
    from truearc.cli.session.convert_formats import convert
    return convert(args)
