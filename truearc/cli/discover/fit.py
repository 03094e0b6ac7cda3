"""truearc fit: coefficients and shot-to-shot scatter, by maximum a posteriori."""

import argparse

from truearc.cli.options import refuse
from truearc.cli.terms_from import add_terms_from

DESCRIPTION = ("Fit the coefficients of the simulation's terms and the shot-to-shot scatter by maximum a posteriori, "
               "from everything that a dataset has; report 90 % intervals and which parameters the shots cannot tell "
               "apart. The paper's grid search is `truearc paper fit`.")
EXAMPLE = "truearc fit shots/ --terms gravity,drag,magnus,exit_efficiency -o coefficients.toml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("dataset", metavar="DIR", help="dataset of shots")
    parser.add_argument("-o", "--out", metavar="FILE", help="coefficients.toml to write")
    parser.add_argument("--terms", metavar="NAMES", help="terms to fit, comma-separated (default: [believe] of "
                        "rig.toml)")
    add_terms_from(parser)
    parser.add_argument("--posterior", type=int, metavar="N", help="draw N samples of the posterior too, and save them "
                                                                   "beside --out as .npz")
    parser.add_argument("--seed", type=int, help="seed of --posterior (default 0)")


def main(args: argparse.Namespace) -> int:
    """Return 0 when the fit converged, else 1."""
    if args.posterior is None:
        refuse(args, ("--seed",), "applies with --posterior only")
    from truearc.cli.discover.fit_ml import run_fit
    return run_fit(args)
