"""truearc predict-gate: the gate's probabilities, row by row."""

import argparse
import sys

import truearc as ta
from truearc.cli.files import write_out

DESCRIPTION = """What a gate makes of each shot of a dataset, as CSV: shot_id,p_two,p_three,in_domain,novelty
(novelty over 1: further than that from all that was recorded)."""
EXAMPLE = "truearc predict-gate gate.onnx shots/ -o ratings.csv"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("gate", metavar="FILE", help="ONNX file, as `truearc export` writes it")
    parser.add_argument("dataset", metavar="DIR", help="dataset of shots")
    parser.add_argument("-o", "--out", metavar="FILE", help="CSV file to write (standard output)")


def main(args: argparse.Namespace) -> int:
    """Return 0 once every row is written."""
    text = ta.predict(ta.load_dataset(args.dataset), gate=args.gate).to_csv()
    if args.out is None:
        sys.stdout.write(text)
    else:
        write_out(args.out, text)
    return 0
