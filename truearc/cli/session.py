"""The commands for recorded sessions: `session replay`, `recover` and `convert`."""

import argparse
import sys
from importlib.metadata import entry_points
from pathlib import Path

from truearc.cli import common
from truearc.errors import EXPORTS, OTHER_FORMATS


def replay_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("session", type=Path, help="recorded session folder")
    parser.add_argument("--check", action="store_true", help="fail on a recording that was cut short, too; with "
                        "--config or --gate, on any output that changes")
    parser.add_argument("--from", dest="depth", choices=("inputs", "frames"), default="inputs",
                        help="frames: recompute the inputs, too, from can0.log and the images that were kept")
    parser.add_argument("--config", type=Path, metavar="TOML", help="replay the inputs with this launcher.toml "
                        "instead, and say which outputs change")
    parser.add_argument("--gate", type=Path, metavar="ONNX", help="... or with this model")


def replay(args: argparse.Namespace) -> int:
    """Recompute every output of a recording, from its inputs or from its raw CAN frames and images.

    Exit 1 on the first difference. With another configuration or model: which outputs would have differed.
    """
    from truearc.cli.session_work import replay_as_recorded, replay_with
    if args.config is None and args.gate is None:
        return replay_as_recorded(args)
    if args.depth == "frames":
        common.refuse(args, ("--config", "--gate"), "--from frames recomputes what was; the inputs stay as recorded")
    return replay_with(args)


def recover_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("session", type=Path, help="recorded session folder")


def recover(args: argparse.Namespace) -> int:
    """Repair a truncated recording (power loss, kill, full disk).

    No complete record is lost, and the damaged files are kept in SESSION/damaged.
    """
    from truearc.robot.recording.session import CAN, INDEX
    from truearc.robot.recording.upkeep import recover
    recovered = recover(args.session)
    absent = [name for name in (CAN, INDEX) if not (args.session / name).exists()]
    counts = f"{recovered.ticks} ticks, {recovered.trials} trials"
    print(f"{args.session}: " + ("whole now" if recovered.repairs else "was whole") + f", {counts}")
    for repair in recovered.repairs:
        print(f"  {repair}")
    for name in absent:
        print(f"  {name} is not there, and cannot be made again", file=sys.stderr)
    return 0


def convert_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("session", type=Path, help="recorded session folder")
    # of truearc, of installed distributions, and of those that say what to install
    formats = {"csv", "mcap", "parquet", *OTHER_FORMATS, *(point.name for point in entry_points(group=EXPORTS))}
    parser.add_argument("--to", required=True, choices=sorted(formats), help="format")
    parser.add_argument("--belief", type=Path, metavar="FILE", help="with --to mcap: coefficients.toml by which the "
                        "flights of marked shots are drawn (needs truearc[sim]); without it none is")
    common.add_terms_from(parser)
    parser.add_argument("-o", "--out", type=common.out_file, required=True, metavar="FILE", help="file to write")


def convert(args: argparse.Namespace) -> int:
    """Write a recorded session as one file that other programs open.

    MCAP for Foxglove, Lichtblick and PlotJuggler, CSV or Parquet with one row per tick (and one more file, FILE.trials,
    with one row per marked trial), and the formats of other distributions. With
    --belief an MCAP also shows the flight of each marked shot as the belief has it.
    """
    from truearc.cli.session_work import convert
    return convert(args)
