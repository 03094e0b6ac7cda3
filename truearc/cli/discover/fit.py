"""truearc fit: coefficients from a dataset; one file a method."""

import argparse
from collections.abc import Callable, Mapping

from truearc.cli.discover import fit_ml
from truearc.cli.paper import fit_grid
from truearc.robot.config.schema import InputError

DESCRIPTION = ("Find the drag and lift coefficient under which the simulator agrees best with recorded outcomes. "
               "grid: the seed's search, every pair from 0 to 5, by three-point accuracy, then two-point accuracy, "
               "then deviation. ml: maximum likelihood of everything recorded, with the scatter from shot to shot, "
               "90 % intervals, and what the shots cannot tell apart.")
EXAMPLE = "truearc fit shots/ --method grid -o coefficients.toml"
METHODS: Mapping[str, Callable[[argparse.Namespace], int]] = {"grid": fit_grid.main, "ml": fit_ml.main}
# What one method would not heed of the other's.
FOREIGN = {"grid": ("map", "picture", "tied"), "ml": ("terms", "posterior", "terms_from")}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("dataset", metavar="DIR", help="dataset of shots")
    parser.add_argument("--method", choices=tuple(METHODS), default="grid", help="%(default)s")
    parser.add_argument("-o", "--out", metavar="FILE", help="coefficients.toml to write")
    fit_grid.add_arguments(parser)
    fit_ml.add_arguments(parser)


def main(args: argparse.Namespace) -> int:
    for method, options in FOREIGN.items():
        for option in options if method != args.method else ():
            if getattr(args, option) is not None:
                typed = option.replace("_", "-")
                raise InputError(f"--{typed}: --method {args.method} makes no use of it; --method {method} does")
    return METHODS[args.method](args)
