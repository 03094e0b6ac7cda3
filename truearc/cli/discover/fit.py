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
from truearc.sim.printed import Progress, part_of

EXAMPLE = "truearc fit shots/ --terms gravity,drag,magnus,exit_efficiency -o coefficients.toml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("datasets", metavar="DIR", nargs="+", help="dataset of shots; several, of sessions or rigs, "
                        "are pooled: what they have in common, and by how much they differ")
    parser.add_argument("-o", "--out", type=out_file, metavar="FILE", help="coefficients.toml to write")
    parser.add_argument("--terms", type=listed(str), metavar="NAMES",
                        help="terms to fit, comma-separated (default: [believe] of rig.toml)")
    add_terms_from(parser)
    add_accept(parser)
    parser.add_argument("--posterior", type=number(int, 1), metavar="N",
                        help="draw N samples of the posterior too, and save them beside --out as .npz")
    parser.add_argument("--seed", type=number(int, 0), help="seed of --posterior, or of pooling (default 0)")


def main(args: argparse.Namespace) -> int:
    """Return 1 where the fit did not settle or the posterior's chains did not mix."""
    if len(args.datasets) > 1:
        refuse(args, ("--posterior",), "applies to one dataset only")
        return _pool(args)
    if args.posterior is None:
        refuse(args, ("--seed",), "applies with --posterior or several datasets only")
    elif args.out is not None:
        refuse_file(draws_path(args.out), args.force)
    fit = _fit(args, args.datasets[0], make_progress("fit", args.quiet))
    print(fit)
    if not fit.converged:
        return _refuse_unsettled(args.datasets[0])
    more, mixed = ({}, True) if args.posterior is None else _sample(fit, args)
    if args.out is not None:
        replace(fit.belief, provenance=fit.belief.provenance | more).save(args.out)
    return 0 if mixed else 1


def _fit(args: argparse.Namespace, path: str, progress: Progress) -> "ta.Fit":
    from truearc.api.terms import names_of
    dataset = ta.load_dataset(path)
    among, where = catalogue_of(args), "--terms" if args.terms else f"{path}/rig.toml: believe.terms"
    terms = names_of(args.terms or dataset.rig.believe.terms, where, among)
    return ta.fit(dataset, among.find(terms or ()), accept=args.accept, progress=progress)


def _refuse_unsettled(path: str) -> int:
    print(f"truearc fit: {path}: the search for the most probable parameters did not settle: shots or rig.toml "
          "contradict each other (see truearc check), or fewer terms are enough; nothing is written", file=sys.stderr)
    return 1


def _pool(args: argparse.Namespace) -> int:
    fits, progress = [], make_progress("fit", args.quiet)
    for done, path in enumerate(args.datasets):
        fits.append(_fit(args, path, part_of(progress, done / len(args.datasets), 1.0 / len(args.datasets))))
        if not fits[-1].converged:
            return _refuse_unsettled(path)
    pooled = ta.pool(fits, seed=args.seed or 0)
    print(pooled)
    if args.out is not None:
        pooled.belief.save(args.out)
    return 0


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
