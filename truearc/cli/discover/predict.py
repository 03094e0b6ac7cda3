"""Forecast the height and outcome of each shot of a dataset by the simulation, or its probabilities by a gate.

By the simulation: shot_id,height_m,deviation_m,outcome,note: the height at the first crossing of x = distance, and that
minus the target's centre; both are empty where the ball meets the floor or turns back first. The note says so, and
names settings outside the range of the shots that the coefficients were fitted to. With --gate:
shot_id,p_two,p_three,in_domain,novelty (novelty over 1: further than that from all recorded shots).
"""

import argparse
import sys

import truearc as ta
from truearc.cli import common
from truearc.cli.outputs import out_file

EXAMPLE = "truearc predict shots/ --cd 0.91 --cl 0.06 -o predicted.csv"
LONG = 50_000                         # shots that take over two seconds: progress is shown


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("dataset", metavar="DIR", help="dataset of shots (rig.toml and shots.csv or .parquet)")
    parser.add_argument("--gate", metavar="FILE", help="ONNX file, as `truearc export` writes it")
    parser.add_argument("--cd", type=common.number(float, 0.0), help="drag coefficient of the paper's Eq. 3")
    parser.add_argument("--cl", type=common.number(float), help="lift coefficient of the paper's Eq. 2")
    parser.add_argument("--coefficients", metavar="FILE", help="coefficients.toml, instead of --cd and --cl")
    common.add_terms_from(parser)
    common.add_accept(parser)
    parser.add_argument("-o", "--out", type=out_file, metavar="FILE", help="CSV to write instead of standard output")


def main(args: argparse.Namespace) -> int:
    """Return 0 once every row is written."""
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
