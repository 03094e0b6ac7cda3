"""truearc verify: an ONNX file against its trainer and its contract."""

import argparse
from typing import TYPE_CHECKING

from truearc.model_export.tolerances import NETWORK_TOLERANCE, PHYSICS_TOLERANCE

if TYPE_CHECKING:
    import numpy as np

    from truearc.model_export.trained import Trained
    from truearc.robot.gate.model import Gate

DESCRIPTION = f"""Check an exported gate: its contract, that it repeats itself and rates rows alone as it does together,
and, with --weights, that onnxruntime agrees in p with the trainer's own float64: to {NETWORK_TOLERANCE:g} for a
network, to {PHYSICS_TOLERANCE:g} for a gate with physics, whose flights the graph carries as a polynomial."""
EXAMPLE = "truearc verify gate.onnx --weights weights/ --data shots/"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("gate", metavar="FILE", help="ONNX file, as `truearc export` writes it")
    parser.add_argument("--weights", metavar="DIR", help="the weights it was exported from")
    parser.add_argument("--data", metavar="DIR", action="append", default=[], help="datasets whose shots to rate too")


def main(args: argparse.Namespace) -> int:
    """Return 0 when every check passed, else 1."""
    from truearc.model_export.predict import features_of
    from truearc.model_export.trained import load_trained
    from truearc.model_export.verify import domain_grid, is_exported_from
    from truearc.robot.gate.contract import FEATURES
    from truearc.robot.gate.model import load_gate
    from truearc.sim.data.dataset import load_dataset
    gate = load_gate(args.gate)
    trained = load_trained(args.weights) if args.weights else None
    domain = ", ".join(f"{feature.name} {low:.3f} to {high:.3f}"
                       for feature, (low, high) in zip(FEATURES, gate.domain, strict=True))
    print(f"{args.gate}: sha256 {gate.sha256}\ncontract: agrees\ndomain: {domain}")
    sets = [("grid over the domain", domain_grid(gate))]
    sets += [(name, features_of(load_dataset(name).shots, name)) for name in args.data]
    passed = [_check(gate, trained, name, features) for name, features in sets]
    if trained is None:
        print("not compared with the trainer (no --weights)")
    elif not is_exported_from(gate, args.weights):
        print(f"{args.weights}: FAILED: not the weights that this gate was exported from")
        passed.append(False)
    return 0 if all(passed) else 1


def _check(gate: "Gate", trained: "Trained | None", name: str, features: "np.ndarray") -> bool:
    from truearc.model_export.verify import NOVELTY_TOLERANCE, compare, find_faults
    faults = find_faults(gate, features) if len(features) else []
    if trained is not None:
        result = compare(gate, trained, features)
        aside = f" ({len(features) - result.rows} outside the domain left out)" if result.rows < len(features) else ""
        print(f"{name}: {result.rows} rows{aside}, max |dp| {result.worst:.2e}, {result.flips} class flips at 0.5, "
              f"max |d novelty| {result.novelty:.1e}")
        if not result.passed:
            faults.append(f"onnxruntime and trainer differ by more than {trained.tolerance:g} in p "
                          f"or {NOVELTY_TOLERANCE:g} in novelty")
    for fault in faults:
        print(f"{name}: FAILED: {fault}")
    if trained is None and not faults:
        print(f"{name}: {len(features)} rows, repeatable, alone as together")
    return not faults
