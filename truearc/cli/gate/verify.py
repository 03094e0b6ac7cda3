"""truearc verify: an ONNX file against its trainer and its contract."""

import argparse

import truearc as ta
from truearc.model_export.tolerances import NETWORK_TOLERANCE, PHYSICS_TOLERANCE

DESCRIPTION = f"""Check an exported gate: its contract, that it repeats itself and rates rows alone as it does together,
and, with --weights, that onnxruntime agrees in p with the trainer's own float64: to {NETWORK_TOLERANCE:g} for a
network, to {PHYSICS_TOLERANCE:g} for a gate with physics, whose flights the graph carries as a polynomial."""
EXAMPLE = "truearc verify gate.onnx --weights weights/ --data shots/"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("gate", metavar="FILE", help="ONNX file, as `truearc export` writes it")
    parser.add_argument("--weights", metavar="DIR", help="the weights it was exported from")
    parser.add_argument("--data", metavar="DIR", action="append", default=[], help="datasets whose shots to rate too")


def main(args: argparse.Namespace) -> int:
    """Return 1 where a check failed."""
    from truearc.model_export.verify import verify_gate
    found = verify_gate(args.gate, args.weights, {name: ta.load_dataset(name) for name in args.data})
    print(found)
    return 0 if found.passed else 1
