"""Fit coefficients and shot-to-shot scatter by maximum a posteriori, from everything that a dataset has.

Report 90 % intervals and which parameters the shots cannot tell apart. The paper's grid search is `truearc paper fit`.
"""

import argparse
import sys

import truearc as ta
from truearc.cli.common import add_accept, add_terms_from, catalogue_of, listed, make_progress, number, refuse
from truearc.cli.outputs import out_file
from truearc.sim.progress import Progress, part_of

EXAMPLE = "truearc fit shots/ --terms gravity,drag,magnus,exit_efficiency -o coefficients.toml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("datasets", metavar="DIR", nargs="+", help="dataset of shots; several, of sessions or rigs, "
                        "are pooled: what they have in common, and by how much they differ")
    parser.add_argument("-o", "--out", type=out_file, metavar="FILE", help="coefficients.toml to write")
    parser.add_argument("--terms", type=listed(str), metavar="NAMES",
                        help="terms to fit, comma-separated (default: [believe] of rig.toml)")
    add_terms_from(parser)
    add_accept(parser)
    parser.add_argument("--seed", type=number(int, 0), help="seed of pooling (default 0)")


def main(args: argparse.Namespace) -> int:
    """Return 1 where the fit did not settle."""
    if len(args.datasets) > 1:
        return _pool(args)
    refuse(args, ("--seed",), "applies with several datasets only")
    fit = _fit(args, args.datasets[0], make_progress("fit", args.quiet))
    print(fit)
    if not fit.converged:
        return _refuse_unsettled(args.datasets[0])
    if args.out is not None:
        fit.belief.save(args.out)
    return 0


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
