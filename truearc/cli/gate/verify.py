"""Check a file for the robot: an exported gate, or an aim file.

Of a gate: its contract, that it repeats itself, and that it rates rows alone as it does together. With --weights
also that onnxruntime agrees in p with the trainer's own float64, within a tolerance: the graph of a gate with physics
carries its flights as a polynomial. Of an aim file: that its set points score as much as the best that the simulator
finds.
"""

import argparse
from pathlib import Path

import truearc as ta
from truearc.cli.common import load_any_rig, refuse
from truearc.errors import load_bytes
from truearc.model_export.tolerances import NETWORK_TOLERANCE, PHYSICS_TOLERANCE

EXAMPLE = "truearc verify gate.onnx --weights weights/ --data shots/"
PROGRESS = False


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("file", metavar="FILE", help="ONNX file, as `truearc export` writes it, or an aim file, as "
                        "`truearc aim --robot` does")
    parser.add_argument("--weights", metavar="DIR", help="the weights a gate was exported from; tolerance: "
                        f"{NETWORK_TOLERANCE:g} for a network, {PHYSICS_TOLERANCE:g} for a gate with physics")
    parser.add_argument("--data", metavar="DIR", action="append", default=[], help="datasets whose shots a gate is to "
                        "rate too")
    parser.add_argument("--belief", metavar="FILE", help="coefficients.toml that an aim file was made of")
    parser.add_argument("--rig", metavar="FILE", help="launcher.toml or rig.toml that an aim file is for")


def main(args: argparse.Namespace) -> int:
    """Return 1 where a check failed."""
    data = load_bytes(Path(args.file))
    if data.lstrip()[:1] == b"{":
        if b'"truearc.aim/' not in data:
            raise ta.InputError(f"{args.file}: neither an ONNX file nor an aim file; of weights give the file that "
                                "`truearc export` wrote, and their folder as --weights")
        return _verify_aim(args)
    refuse(args, ("--belief", "--rig"), "applies to an aim file only")
    found = ta.verify_gate(args.file, args.weights, {name: ta.load_dataset(name) for name in args.data})
    print(found)
    return 0 if found.passed else 1


def _verify_aim(args: argparse.Namespace) -> int:
    refuse(args, ("--weights", "--data"), "applies to a gate only")
    if not (args.belief and args.rig):
        raise ta.InputError(f"{args.file}: an aim file; --belief and --rig are needed to check it")
    check = ta.verify_aim(args.file, ta.load_belief(args.belief), load_any_rig(args.rig))
    print(f"{args.file}: {check}")
    return 0
