"""Commands that fit coefficients and forecast shots by them: `fit`, `predict`."""

import argparse
import sys

import truearc as ta
from truearc.cli import common
from truearc.cli.outputs import out_file
from truearc.sim.printed import Progress, part_of

LONG = 50_000                         # shots that take over two seconds: progress is shown


def fit_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("datasets", metavar="DIR", nargs="+", help="dataset of shots; several, of sessions or rigs, "
                        "are pooled: what they have in common, and by how much they differ")
    parser.add_argument("-o", "--out", type=out_file, metavar="FILE", help="coefficients.toml to write")
    parser.add_argument("--terms", type=common.listed(str), metavar="NAMES",
                        help="terms to fit, comma-separated (default: [believe] of rig.toml)")
    common.add_terms_from(parser)
    common.add_accept(parser)
    parser.add_argument("--seed", type=common.number(int, 0), help="seed of pooling (default 0)")


def fit(args: argparse.Namespace) -> int:
    """Fit coefficients and shot-to-shot scatter by maximum a posteriori, from everything that a dataset has.

    Report 90 % intervals and which parameters the shots cannot tell apart. The paper's grid search is `truearc paper
    fit`. Exit 1 where the fit did not settle.
    """
    if len(args.datasets) > 1:
        return _pool(args)
    common.refuse(args, ("--seed",), "applies with several datasets only")
    fit = _fit(args, args.datasets[0], common.make_progress("fit", args.quiet))
    print(fit)
    if not fit.converged:
        return _refuse_unsettled(args.datasets[0])
    if args.out is not None:
        fit.belief.save(args.out)
    return 0


def _fit(args: argparse.Namespace, path: str, progress: Progress) -> "ta.Fit":
    from truearc.api.arguments import names_of
    dataset = ta.load_dataset(path)
    among, where = common.catalogue_of(args), "--terms" if args.terms else f"{path}/rig.toml: believe.terms"
    terms = names_of(args.terms or dataset.rig.believe.terms, where, among)
    return ta.fit(dataset, among.find(terms or ()), accept=args.accept, progress=progress)


def _refuse_unsettled(path: str) -> int:
    print(f"truearc fit: {path}: the search for the most probable parameters did not settle: shots or rig.toml "
          "contradict each other (see truearc check), or fewer terms are enough; nothing is written", file=sys.stderr)
    return 1


def _pool(args: argparse.Namespace) -> int:
    fits, progress = [], common.make_progress("fit", args.quiet)
    for done, path in enumerate(args.datasets):
        fits.append(_fit(args, path, part_of(progress, done / len(args.datasets), 1.0 / len(args.datasets))))
        if not fits[-1].converged:
            return _refuse_unsettled(path)
    pooled = ta.pool(fits, seed=args.seed or 0)
    print(pooled)
    if args.out is not None:
        pooled.belief.save(args.out)
    return 0


def predict_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("dataset", metavar="DIR", help="dataset of shots (rig.toml and shots.csv or .parquet)")
    parser.add_argument("--gate", metavar="FILE", help="ONNX file, as `truearc export` writes it")
    parser.add_argument("--cd", type=common.number(float, 0.0), help="drag coefficient of the paper's Eq. 3")
    parser.add_argument("--cl", type=common.number(float), help="lift coefficient of the paper's Eq. 2")
    parser.add_argument("--coefficients", metavar="FILE", help="coefficients.toml, instead of --cd and --cl")
    common.add_terms_from(parser)
    common.add_accept(parser)
    parser.add_argument("-o", "--out", type=out_file, metavar="FILE", help="CSV to write instead of standard output")


def predict(args: argparse.Namespace) -> int:
    """Forecast the height and outcome of each shot of a dataset by the simulation, or its probabilities by a gate.

    By the simulation: shot_id,height_m,deviation_m,outcome,note: the height at the first crossing of x = distance, and
    that minus the target's centre; both are empty where the ball meets the floor or turns back first. The note says so,
    and names settings outside the range of the shots that the coefficients were fitted to. With --gate:
    shot_id,p_two,p_three,in_domain,novelty (novelty over 1: further than that from all recorded shots).
    """
    common.print_or_write(args.out, _by_simulation(args) if args.gate is None else _by_gate(args))
    return 0


def _by_gate(args: argparse.Namespace) -> str:
    common.refuse(args, ("--cd", "--cl", "--coefficients", "--terms-from"), "does not apply with --gate")
    return ta.predict(_plausible(args), gate=args.gate, accept=args.accept).to_csv()


def _plausible(args: argparse.Namespace) -> "ta.Dataset":
    """Return the dataset; what is accepted or only warns is on stderr, as the table goes to stdout."""
    dataset = ta.paper.check_plausible(ta.load_dataset(args.dataset), args.accept)
    for objection in dataset.accepted:
        print(f"warning: {objection}", file=sys.stderr)
    return dataset


def _by_simulation(args: argparse.Namespace) -> str:
    belief = _belief(args)
    dataset = _plausible(args)
    forecast = ta.predict(dataset, belief, accept=args.accept,
                          progress=common.make_progress("predict", args.quiet or len(dataset.shots) < LONG))
    rows = tuple((name, common.fixed(height_m, 9), common.fixed(deviation_m, 9), outcome, note)
                 for name, height_m, deviation_m, outcome, note in forecast.rows)
    if noted := sum(note != "" for *_, note in rows):
        print(f"{noted} of {len(rows)} forecasts have a note: outside the fitted range, of another rig, or without a "
              "height", file=sys.stderr)
    return ta.Table(forecast.columns, rows).to_csv()


def _belief(args: argparse.Namespace) -> "ta.Belief":
    """Return the belief of the file or of both options; InputError when neither or both are given."""
    if args.coefficients is not None:
        if (args.cd, args.cl) != (None, None):
            raise ta.InputError("--coefficients and --cd, --cl exclude each other")
        return ta.load_belief(args.coefficients, common.catalogue_of(args))
    common.refuse(args, ("--terms-from",), "applies with --coefficients only, whose file names the terms")
    for option, value in (("--cd", args.cd), ("--cl", args.cl)):
        if value is None:
            raise ta.InputError(f"{option} is needed (or --coefficients FILE)")
    from truearc.sim.infer.belief import point_belief
    return point_belief({"drag": {"cd": args.cd}, "magnus": {"cl": args.cl}})
