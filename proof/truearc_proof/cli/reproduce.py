"""Print the paper's Table I, Table II and Figures 8 to 10 on recordings of the emulated robot.

The paper's own numbers stand beside them, with intervals, baselines and our gate. Recordings are kept, and a run that
was broken off goes on.
"""

import argparse
from pathlib import Path

from truearc_proof.reproduce.settings import QUICK_DRAWS, Settings

GROUP = "proof"
SUMMARY = "the paper's tables and figures beside ours"
EXAMPLE = "truearc reproduce -o reproduction --quick"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    defaults = Settings()
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="DIR", help="folder for all that is made")
    parser.add_argument("--seeds", type=int, metavar="N", help=f"repetitions that the intervals are over "
                        f"({defaults.draws}; {QUICK_DRAWS} with --quick)")
    parser.add_argument("--seed", type=int, default=defaults.base_seed, help="of all recordings and draws")
    parser.add_argument("--quick", action="store_true", help="minutes instead of an hour or more: everything is "
                        "there, but from too little data to conclude anything")
    parser.add_argument("--recordings", type=Path, metavar="DIR", help="recordings to use and to add to (default: "
                        "recordings/ in the output folder)")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="a running Dask cluster, tcp://host:port, whose workers "
                        "see the recordings' folder (default: this machine's cores)")
    parser.add_argument("--workers", type=int, metavar="N", help="processes on this machine (default: one a core)")


def main(args: argparse.Namespace) -> int:
    """Return 0 when the report is written."""
    from truearc_proof.cli.reproduce_run import reproduce
    return reproduce(args)
