"""Write trained weights as an ONNX file that carries its contract, domain and provenance."""

import argparse

import truearc as ta
from truearc.cli.outputs import out_file

EXAMPLE = "truearc export weights/ -o gate.onnx"
PROGRESS = False


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("weights", metavar="DIR",
                        help="weights directory, as `truearc train` and `truearc paper train` write it")
    parser.add_argument("-o", "--out", type=out_file, required=True, metavar="FILE", help="ONNX file to write")


def main(args: argparse.Namespace) -> int:
    """Return 0 once the file is written and read back."""
    from truearc.robot.gate.model import load_gate
    data = ta.export_weights(args.weights, args.out)
    print(f"{args.out}: {len(data)} bytes, sha256 {load_gate(args.out).sha256}")
    return 0
