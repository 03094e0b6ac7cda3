"""Advise a robot that runs its own program: read its NetworkTables keys and publish the gate's verdict.

No commands are sent to the robot. Each tick computes its verdict with the same code as `truearc run` and is recorded;
`truearc session replay --check` recomputes it. With --check, the command only examines the keys and prints one line
about each; the exit code is 1 if any key cannot be used.
"""

import argparse
import sys
from pathlib import Path

from truearc.cli.common import SHIPPED, number, refuse
from truearc.errors import InputError
from truearc_frc.table import LISTEN_S

EXAMPLE = "truearc advise --nt 10.25.4.2 --map shots.toml --gate gate.onnx --aim aim.json --rig rig.toml"
PROGRESS = False
GROUP, SUMMARY = "robot", "publish the gate's verdict to a robot that runs its own program"
RATE_HZ, FRESH_S, SIGMA_M = 50, 0.5, 0.05


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("--nt", required=True, metavar="TEAM|ADDRESS", help="team number, or host[:port], of the "
                        "robot's NetworkTables server")
    parser.add_argument("--map", required=True, metavar="MAP", help="which keys say what: a shots.toml, or a map that "
                        "comes with truearc (docs/how-to/importing.md)")
    parser.add_argument("--gate", type=Path, help="exported model; needed without --check")
    parser.add_argument("--rig", type=Path, metavar="RIG.toml", help="ball, wheels and target (default: those of "
                        "--config)")
    how = parser.add_mutually_exclusive_group()
    how.add_argument("--aim", type=Path, metavar="FILE", help="aim file of `truearc aim --robot`: set points are "
                     "published, too")
    how.add_argument("--belief", type=Path, metavar="FILE", help="make that aim file of this belief first (needs "
                     "truearc[sim])")
    parser.add_argument("--config", type=Path, default=SHIPPED, metavar="FILE", help="launcher.toml whose [gate] holds "
                        "(default: the shipped one)")
    parser.add_argument("--out", type=Path, default=Path("sessions"), help="folder to make the session's folder in")
    parser.add_argument("--rate", type=number(int, 20, 1000), default=RATE_HZ, metavar="HZ",
                        help=f"advice a second ({RATE_HZ})")
    parser.add_argument("--fresh", type=number(float, 0.02, 5.0), default=FRESH_S, metavar="S", help="a key that has "
                        f"not changed for so long is stale ({FRESH_S})")
    parser.add_argument("--sigma", type=number(float, 0.0, 5.0), default=SIGMA_M, metavar="M", help="standard error "
                        f"of the robot's distance ({SIGMA_M})")
    parser.add_argument("--check", action="store_true", help="only look at the keys, and advise nothing")
    parser.add_argument("--seconds", type=number(float, 0.5, 600.0), metavar="S", help="with --check: to listen "
                        f"({LISTEN_S:g})")
    parser.add_argument("--json", action="store_true", help="with --check: findings as JSON")


def main(args: argparse.Namespace) -> int:
    """Return 0 when a signal ended it with a complete recording; with --check, 1 if any check failed."""
    from truearc_frc.advise_session import advise, check
    if args.check:
        refuse(args, ("--gate", "--aim", "--belief", "--rig"), "does not apply with --check: nothing is advised")
        return check(args)
    refuse(args, ("--seconds", "--json"), "applies with --check only")
    if args.gate is None:
        raise InputError("--gate is needed: the model that is asked")
    ticks, folder = advise(args)
    print(f"{folder}: {ticks} ticks")
    print(f"look at it: truearc session replay {folder}", file=sys.stderr)
    return 0
