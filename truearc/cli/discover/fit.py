"""Fit coefficients and shot-to-shot scatter by maximum a posteriori, from everything that a dataset has.

Report 90 % intervals and which parameters the shots cannot tell apart. The paper's grid search is `truearc paper fit`.
"""

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import truearc as ta
from truearc.cli.common import add_accept, add_terms_from, catalogue_of, listed, make_progress, number, refuse
from truearc.cli.outputs import out_file, refuse_file

EXAMPLE = "truearc fit shots/ --terms gravity,drag,magnus,exit_efficiency -o coefficients.toml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("dataset", metavar="DIR", help="dataset of shots")
    parser.add_argument("-o", "--out", type=out_file, metavar="FILE", help="coefficients.toml to write")
    parser.add_argument("--terms", type=listed(str), metavar="NAMES",
                        help="terms to fit, comma-separated (default: [believe] of rig.toml)")
    add_terms_from(parser)
    add_accept(parser)
    parser.add_argument("--posterior", type=number(int, 1), metavar="N",
                        help="draw N samples of the posterior too, and save them beside --out as .npz")
    parser.add_argument("--seed", type=number(int, 0), help="seed of --posterior (default 0)")


def main(args: argparse.Namespace) -> int:
    """Return 1 where the fit did not settle or the posterior's chains did not mix."""
    from truearc.api.terms import names_of
    if args.posterior is None:
        refuse(args, ("--seed",), "applies with --posterior only")
    elif args.out is not None:
        refuse_file(draws_path(args.out), args.force)
    dataset = ta.load_dataset(args.dataset)
    among, where = catalogue_of(args), "--terms" if args.terms else f"{args.dataset}/rig.toml: believe.terms"
    terms = names_of(args.terms or dataset.rig.believe.terms, where, among)
    fit = ta.fit(dataset, among.find(terms or ()), accept=args.accept, progress=make_progress("fit", args.quiet))
    print(fit)
    if not fit.converged:
        print("truearc fit: the search for the most probable parameters did not settle: shots or rig.toml contradict "
              "each other (see truearc check), or fewer terms are enough; nothing is written", file=sys.stderr)
        return 1
    more, mixed = ({}, True) if args.posterior is None else _sample(fit, args)
    if args.out is not None:
        replace(fit.belief, provenance=fit.belief.provenance | more).save(args.out)
    return 0 if mixed else 1


def _sample(fit: "ta.Fit", args: argparse.Namespace) -> tuple[dict[str, Any], bool]:
    """(what the coefficients file says of the posterior, whether its chains have mixed); draws saved beside --out."""
    from truearc.sim.infer.posterior import save_draws, say_posterior
    drawn = fit.sample(args.posterior, args.seed or 0, make_progress("posterior", args.quiet))
    print("\nposterior:", *say_posterior(drawn), sep="\n")
    if args.out is not None:
        path = draws_path(args.out)
        save_draws(path, drawn)
        print(f"{path}: {args.posterior} draws")
    return {"posterior": {"seed": drawn.seed, "draws": drawn.count}}, drawn.converged


def draws_path(out: Path) -> Path:
    """Where the draws go: home.toml -> home.posterior.npz."""
    return out.with_suffix(".posterior.npz")
