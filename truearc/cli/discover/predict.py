"""truearc predict: heights and outcomes by the simulation, or probabilities by a gate, row by row."""

import argparse
import csv
import math
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from truearc.cli.options import refuse
from truearc.cli.progress import make_progress
from truearc.cli.terms_from import add_terms_from, catalogue_of
from truearc.robot.config.schema import InputError
from truearc.sim.progress import Progress

if TYPE_CHECKING:
    from truearc.sim.data.dataset import Dataset
    from truearc.sim.infer.belief import Belief

DESCRIPTION = ("Fly each shot of a dataset with the paper's simulator and print shot_id,height_m,deviation_m,outcome: "
               "height at the first crossing of x = distance, and that minus the target's centre; both empty where the "
               "ball meets the floor or turns back first. With --gate: what a gate gives each shot instead, as "
               "shot_id,p_two,p_three,in_domain,novelty (novelty over 1: further than that from all recorded shots).")
EXAMPLE = "truearc predict shots/ --cd 0.91 --cl 0.06 -o predicted.csv"
LONG = 50_000                         # shots that take over two seconds
HEADER = ("shot_id", "height_m", "deviation_m", "outcome")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("dataset", metavar="DIR", help="dataset of shots (rig.toml and shots.csv or .parquet)")
    parser.add_argument("--gate", metavar="FILE", help="ONNX file, as `truearc export` writes it")
    parser.add_argument("--cd", type=float, help="drag coefficient of the paper's Eq. 3")
    parser.add_argument("--cl", type=float, help="lift coefficient of the paper's Eq. 2")
    parser.add_argument("--coefficients", metavar="FILE", help="coefficients.toml, instead of --cd and --cl")
    add_terms_from(parser)
    parser.add_argument("-o", "--out", metavar="FILE", help="CSV to write instead of standard output")


def main(args: argparse.Namespace) -> int:
    """Return 0 when every row is answered."""
    if args.gate is not None:
        refuse(args, ("--cd", "--cl", "--coefficients", "--terms-from"), "does not apply with --gate")
        from truearc.cli.gate.predict_gate import predict_by_gate
        return predict_by_gate(args)
    from truearc.sim.data.dataset import load_dataset
    belief = _belief(args)
    dataset = load_dataset(args.dataset)
    rows = list(_rows(dataset, belief, _progress(len(dataset.shots), args.quiet)))
    if args.out is None:
        _write(sys.stdout, rows)
        return 0
    try:
        with Path(args.out).open("w", encoding="utf-8", newline="") as file:
            _write(file, rows)
    except OSError as error:
        raise InputError(f"{args.out}: {error.strerror}") from error
    return 0


def _progress(shots: int, quiet: bool) -> Progress:
    """Shown for work that lasts only."""
    return make_progress("predict", quiet or shots < LONG)


def _belief(args: argparse.Namespace) -> "Belief":
    """From the file or from both options; InputError when neither or both say."""
    from truearc.sim.infer.belief import load_belief, point_belief
    pair = (args.cd, args.cl)
    if args.coefficients is not None:
        if pair != (None, None):
            raise InputError("--coefficients and --cd, --cl exclude each other")
        return load_belief(args.coefficients, catalogue_of(args))
    refuse(args, ("--terms-from",), "applies with --coefficients only, whose file names the terms")
    for option, value in zip(("--cd", "--cl"), pair, strict=True):
        if value is None:
            raise InputError(f"{option} is needed (or --coefficients FILE)")
        if not math.isfinite(value):
            raise InputError(f"{option}: {value} is not a finite number")
    return point_belief({"drag": {"cd": args.cd}, "magnus": {"cl": args.cl}})


def _rows(dataset: "Dataset", belief: "Belief",
          progress: Progress) -> Iterable[tuple[str, str, str, str]]:
    from truearc.sim.data.shot_conditions import circumstances_of
    from truearc.sim.discover.detect.covariates import every_column
    from truearc.sim.infer.curve import along
    from truearc.sim.physics.catalogue import effective
    from truearc.sim.physics.simulate import classify, opening_of, predict
    if dataset.facts.target is None:
        raise InputError("rig.toml: [target] is needed to tell deviation and outcome")
    circumstances = along(belief.curves, circumstances_of(dataset), every_column(dataset), len(dataset.shots))
    among = belief.catalogue
    opening = opening_of(dataset.facts, effective(belief.coefficients, circumstances, among), among)
    height_m = predict(dataset.facts, belief.coefficients, dataset.shots, progress, circumstances, among).height_m
    deviation_m = height_m - opening.centre_m
    outcome = classify(dataset.facts, height_m, opening)
    for row, name in enumerate(dataset.shots.shot_id):
        yield name, _text(height_m[row]), _text(deviation_m[row]), str(outcome[row])


def _text(number: float) -> str:
    return "" if math.isnan(number) else f"{number:.9f}"


def _write(file: TextIO, rows: list[tuple[str, str, str, str]]) -> None:
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(HEADER)
    writer.writerows(rows)
