"""truearc predict-gate."""

import argparse
import sys
from pathlib import Path

from truearc.model_export.predict import make_ratings
from truearc.robot.config.schema import InputError
from truearc.robot.gate.model import load_gate
from truearc.sim.data.dataset import load_dataset

DESCRIPTION = """What a gate makes of each shot of a dataset, as CSV: shot_id,p_two,p_three,in_domain,novelty
(novelty over 1: further than that from all that was recorded)."""
EXAMPLE = "truearc predict-gate gate.onnx shots/ -o ratings.csv"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("gate", metavar="FILE", help="ONNX file, as `truearc export` writes it")
    parser.add_argument("dataset", metavar="DIR", help="dataset of shots")
    parser.add_argument("-o", "--out", metavar="FILE", help="CSV file to write (standard output)")


def main(args: argparse.Namespace) -> int:
    gate = load_gate(args.gate)
    text = make_ratings(gate, load_dataset(args.dataset).shots, args.dataset)
    if args.out is None:
        sys.stdout.write(text)
        return 0
    try:
        Path(args.out).write_text(text, encoding="utf-8", newline="")
    except OSError as error:
        raise InputError(f"{args.out}: {error.strerror or error}") from error
    return 0
