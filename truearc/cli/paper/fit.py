"""Find the drag and lift coefficient that reproduce most recorded outcomes, by the paper's grid search.

Every pair from 0 to 5 is ranked by three-point accuracy, then two-point accuracy, then deviation.
"""

import argparse
from typing import TYPE_CHECKING

import truearc as ta
from truearc.cli.common import add_accept, fixed, make_progress
from truearc.cli.outputs import out_file
from truearc.errors import save_whole
from truearc.sim.paper.settings import STEP

if TYPE_CHECKING:
    from truearc.api.fitting import GridSearch

EXAMPLE = "truearc paper fit shots/ -o coefficients.toml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("dataset", metavar="DIR", help="dataset of shots")
    parser.add_argument("-o", "--out", type=out_file, metavar="FILE", help="coefficients.toml to write")
    parser.add_argument("--step", type=float, default=STEP, help="step of the grid; divides 5")
    parser.add_argument("--map", type=out_file, metavar="FILE", help="npz to write the whole map to: axis, "
                        "share_three, share_two, mean_deviation_m (nan where no three is reproduced), tied; rows cd, "
                        "columns cl")
    parser.add_argument("--picture", type=out_file, metavar="FILE", help="png to draw the map to")
    parser.add_argument("--tied", type=out_file, metavar="FILE",
                        help="csv to write all tied pairs to, the chosen one first")
    add_accept(parser)


def main(args: argparse.Namespace) -> int:
    """Return 0 when a pair was chosen."""
    found = ta.fit(ta.load_dataset(args.dataset), method="grid", step=args.step, accept=args.accept,
                   progress=make_progress("fit", args.quiet))
    print(found)
    _write(args, found)
    return 0


def _write(args: argparse.Namespace, found: "GridSearch") -> None:
    from truearc.sim.printed import save_csv
    from truearc.sim.report import make_png
    if args.out is not None:
        found.belief.save(args.out)
    if args.tied is not None:
        table = found.table()
        save_csv(args.tied, table.columns, [[f"{cd:.6g}", f"{cl:.6g}", fixed(mean_m, 6), fixed(median_m, 6)]
                                                  for cd, cl, mean_m, median_m in table.rows])
    if args.picture is not None:
        save_whole(args.picture, make_png(found.plot()))
    if args.map is not None:
        found.save_map(args.map)
