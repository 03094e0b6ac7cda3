"""Check an exported gate: its contract, that it repeats itself, and that it rates rows alone as it does together.

With --weights also that onnxruntime agrees in p with the trainer's own float64, within a tolerance: the graph
of a gate with physics carries its flights as a polynomial.
"""

import argparse

import truearc as ta
from truearc.model_export.tolerances import NETWORK_TOLERANCE, PHYSICS_TOLERANCE

EXAMPLE = "truearc verify gate.onnx --weights weights/ --data shots/"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("gate", metavar="FILE", help="ONNX file, as `truearc export` writes it")
    parser.add_argument("--weights", metavar="DIR", help="the weights it was exported from; tolerance: "
                        f"{NETWORK_TOLERANCE:g} for a network, {PHYSICS_TOLERANCE:g} for a gate with physics")
    parser.add_argument("--data", metavar="DIR", action="append", default=[], help="datasets whose shots to rate too")


def main(args: argparse.Namespace) -> int:
    """Return 1 where a check failed."""
    found = ta.verify_gate(args.gate, args.weights, {name: ta.load_dataset(name) for name in args.data})
    print(found)
    return 0 if found.passed else 1
