"""Compare two tables of set points: where they differ, and by how many points a ball, by a belief.

Tables are CSV files with distance_m, hood_deg and motor_ratio or motor_rad_s (or in other units: distance_ft,
motor_rpm), or JSON or Java as `truearc aim` writes them. Between rows they are straight, as robots interpolate.
"""

import argparse

import truearc as ta
from truearc.cli import common

EXAMPLE = "truearc compare hand_made.csv aim.csv --belief belief.toml --rig rig.toml"
PROGRESS = False


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("old", metavar="OLD", help="table of set points")
    parser.add_argument("new", metavar="NEW", help="another")
    parser.add_argument("--belief", required=True, metavar="FILE", help="coefficients.toml that points are forecast by")
    parser.add_argument("--rig", required=True, metavar="FILE", help="rig.toml of a dataset, or launcher.toml")
    common.add_terms_from(parser)


def main(args: argparse.Namespace) -> int:
    """Return 0 once both are compared."""
    rig, belief = common.load_any_rig(args.rig), ta.load_belief(args.belief, common.catalogue_of(args))
    print(ta.compare(ta.load_set_points(args.old, rig), ta.load_set_points(args.new, rig), belief, rig))
    return 0
