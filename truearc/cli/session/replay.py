"""Recompute every output of a recording, from its inputs or from its raw CAN frames and images.

Exit 1 on the first difference. With another configuration or model: which outputs would have differed.
"""

import argparse
from pathlib import Path

from truearc.cli.common import refuse

EXAMPLE = "truearc session replay sessions/monday --check"
PROGRESS = False


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("session", type=Path, help="recorded session folder")
    parser.add_argument("--check", action="store_true", help="fail on a recording that was cut short, too; with "
                        "--config or --gate, on any output that changes")
    parser.add_argument("--from", dest="depth", choices=("inputs", "frames"), default="inputs",
                        help="frames: recompute the inputs, too, from can0.log and the images that were kept")
    parser.add_argument("--config", type=Path, metavar="TOML", help="replay the inputs with this launcher.toml "
                        "instead, and say which outputs change")
    parser.add_argument("--gate", type=Path, metavar="ONNX", help="... or with this model")


def main(args: argparse.Namespace) -> int:
    """Return 0 when every output was recomputed bit-equal, 1 where one differs."""
    from truearc.cli.session.replay_session import replay_as_recorded, replay_with
    if args.config is None and args.gate is None:
        return replay_as_recorded(args)
    if args.depth == "frames":
        refuse(args, ("--config", "--gate"), "--from frames recomputes what was; the inputs stay as recorded")
    return replay_with(args)
