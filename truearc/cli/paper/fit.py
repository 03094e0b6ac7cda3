"""truearc paper fit: drag and lift coefficients by the paper's grid search."""

import argparse

from truearc.cli.options import refuse
from truearc.sim.paper.settings import STEP

DESCRIPTION = """Find the drag and lift coefficient under which the simulator agrees best with recorded outcomes, by the
paper's search: every pair from 0 to 5, ranked by three-point accuracy, then two-point accuracy, then deviation."""
EXAMPLE = "truearc paper fit shots/ -o coefficients.toml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("dataset", metavar="DIR", help="dataset of shots")
    parser.add_argument("-o", "--out", metavar="FILE", help="coefficients.toml to write")
    parser.add_argument("--step", type=float, default=STEP, help="step of the grid; divides 5 (default %(default)s)")
    parser.add_argument("--map", metavar="FILE", help="npz to write the whole map to: axis, share_three, share_two, "
                                                      "mean_deviation_m (nan where no three is reproduced), tied; "
                                                      "rows cd, columns cl")
    parser.add_argument("--picture", metavar="FILE", help="png to draw the map to")
    parser.add_argument("--tied", metavar="FILE", help="csv to write all tied pairs to, the chosen one first")
    parser.add_argument("--bootstrap", type=int, metavar="N", help="resample the shots N times, for intervals")
    parser.add_argument("--seed", type=int, help="seed of --bootstrap (default 0)")


def main(args: argparse.Namespace) -> int:
    """Return 0 when a pair was chosen."""
    if args.bootstrap is None:
        refuse(args, ("--seed",), "applies with --bootstrap only")
    from truearc.cli.paper.fit_grid import run_grid_fit
    return run_grid_fit(args)
