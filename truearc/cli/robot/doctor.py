"""Look at everything a run needs and say in one line each how it is and what to do about it.

Without --set it changes nothing but an exposure that the configuration fixes, without --move it moves nothing; stop a
running robot first, which holds camera and button box. Exit 1 if anything fails.
"""

import argparse
from pathlib import Path

from truearc.cli.common import number, refuse

EXAMPLE = "truearc doctor --config launcher.toml --gate gate.onnx --out sessions"
PROGRESS = False


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--config", type=Path, required=True, help="launcher.toml")
    parser.add_argument("--gate", type=Path, help="model, as for truearc run")
    parser.add_argument("--aim", type=Path, metavar="FILE", help="aim file, as for truearc run")
    parser.add_argument("--out", type=Path, default=Path("sessions"), help="folder for sessions, as for truearc run")
    parser.add_argument("--endpoints", type=Path, metavar="JSON", help="flat_endpoints.json of the axes' firmware: "
                        "their watchdogs and encoder filters are asked, too")
    parser.add_argument("--move", action="store_true", help="also turn the wheels slowly, and the hood to its limit "
                        "switch and back, once you have typed yes: directions, scales, lags, the switch")
    parser.add_argument("--priority", type=number(int, 1, 99), default=50, metavar="P", help="as for truearc run")
    parser.add_argument("--seconds", type=number(float, 0.5, 600.0), default=2.0, metavar="S",
                        help="to listen to the bus")
    parser.add_argument("--set", action="store_true", help="compare the watchdogs and limits that the axes keep with "
                        "the rig, and write and save what differs after a yes; with --endpoints")
    parser.add_argument("--yes", action="store_true", help="with --set or --move: do not ask; with --move, "
                        "all balls are out, and hands away")
    parser.add_argument("--json", action="store_true", help="findings as JSON")


def main(args: argparse.Namespace) -> int:
    """Return 0 when no check failed, else 1."""
    from truearc.cli.robot.doctor_checks import check_robot, set_devices
    if args.set:
        refuse(args, ("--move",), "apart from --set: what is written first is looked at first")
        return set_devices(args)
    return check_robot(args)
