"""The work of `truearc fit`: maximum a posteriori of everything that a dataset has."""

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import truearc as ta
from truearc.cli.files import names_in
from truearc.cli.progress import make_progress
from truearc.cli.terms_from import catalogue_of
from truearc.robot.config.schema import InputError


def run_fit(args: argparse.Namespace) -> int:
    """Return 1 where the fit did not settle or the posterior's chains did not mix."""
    _check(args)
    names, dataset = names_in("--terms", args.terms), ta.load_dataset(args.dataset)
    terms = catalogue_of(args).find(dataset.rig.believe.terms if names is None else names)
    fit = ta.fit(dataset, terms, progress=make_progress("fit", args.quiet))
    print(fit)
    if not fit.converged:
        print("truearc fit: the search for the most probable parameters did not settle; nothing is written",
              file=sys.stderr)
        return 1
    more, mixed = ({}, True) if args.posterior is None else _sample(fit, args)
    if args.out is not None:
        replace(fit.belief, provenance=fit.belief.provenance | more).save(args.out)
    return 0 if mixed else 1


def _check(args: argparse.Namespace) -> None:
    if args.out is not None and not Path(args.out).parent.is_dir():
        raise InputError(f"{args.out}: there is no directory to write it to")
    if args.posterior is not None and args.posterior < 1:
        raise InputError(f"--posterior is {args.posterior}; at least 1 sample is needed")
    if args.seed is not None and args.seed < 0:
        raise InputError(f"--seed is {args.seed}; it cannot be negative")


def _sample(fit: "ta.Fit", args: argparse.Namespace) -> tuple[dict[str, Any], bool]:
    """(what the coefficients file says of the posterior, whether its chains have mixed); draws saved beside --out."""
    from truearc.sim.infer.posterior import save_draws, say_posterior
    drawn = fit.sample(args.posterior, args.seed or 0, make_progress("posterior", args.quiet))
    print("\nposterior:", *say_posterior(drawn), sep="\n")
    if args.out is not None:
        path = Path(args.out).with_suffix(".posterior.npz")
        save_draws(path, drawn)
        print(f"{path}: {args.posterior} draws")
    return {"posterior": {"seed": drawn.seed, "draws": drawn.count}}, drawn.converged
