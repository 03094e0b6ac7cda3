"""The work of `truearc train`: the gate, its hold-out measures and its files."""

import argparse
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

from truearc.cli.progress import make_progress
from truearc.robot.config.schema import InputError
from truearc.sim.data.dataset import Dataset, hash_dataset, load_dataset
from truearc.sim.gate.gate_text import tell_heldout, tell_residual
from truearc.sim.gate.model import PhysicsGate
from truearc.sim.gate.outcome_classes import OutcomeClasses, marks_of
from truearc.sim.gate.physics import physics_of
from truearc.sim.gate.plots import draw_reliability
from truearc.sim.gate.store import save_physics_gate
from truearc.sim.gate.train import Heldout, train_physics_gate
from truearc.sim.infer.belief import Belief, load_belief
from truearc.sim.paper.training import domain_of
from truearc.sim.report import make_png


def run_training(args: argparse.Namespace) -> int:
    """Train, write the weights and report; args: those of `truearc train`."""
    if args.seed < 0:
        raise InputError(f"--seed is {args.seed}; it cannot be negative")
    if args.reliability is not None and not Path(args.reliability).parent.is_dir():
        raise InputError(f"{args.reliability}: there is no directory to write it to")
    belief, dataset = load_belief(args.coefficients), load_dataset(args.real)
    marks, _, left_out = marks_of(dataset.shots, dataset.shots.source)
    for sentence in left_out:
        print(sentence, file=sys.stderr)
    gate, heldout = train_physics_gate(dataset.facts, belief, dataset.shots, args.seed, args.real,
                                       make_progress("train", args.quiet))
    save_physics_gate(args.out, gate, _record(args, belief, dataset, marks, gate, heldout))
    _tell(args, gate, marks, heldout)
    return 0


def _tell(args: argparse.Namespace, gate: PhysicsGate, marks: OutcomeClasses, heldout: Heldout | None) -> None:
    print(f"learned from {len(marks.level)} shots")
    print("\n".join(tell_residual(gate, marks.features, physics_of(gate.facts, gate.belief, marks.features))))
    if len(set(marks.level[marks.level >= 0])) < 2:
        print("careful: every shot has the same outcome; what is not the physics here is the prior")
    if heldout is None:
        print("careful: too few configurations to say what this is worth on others: fifteen at least")
    else:
        print("\n".join(tell_heldout(heldout, gate.temperature)))
        if args.reliability is not None:
            Path(args.reliability).write_bytes(make_png(draw_reliability(heldout.p, heldout.level)))
            print(f"{args.reliability}: stated against true shares")
    print(f"{args.out}: the gate; next: truearc export {args.out} -o gate.onnx")


def _record(args: argparse.Namespace, belief: Belief, dataset: Dataset, marks: OutcomeClasses, gate: PhysicsGate,
            heldout: Heldout | None) -> dict[str, Any]:
    figures = None if heldout is None else {
        name: {key: value if value == value else None for key, value in figures._asdict().items()}
        for name, figures in (("physics", heldout.physics), ("gate", heldout.calibrated))}
    return {"version": version("truearc"), "seed": args.seed, "shots": len(marks.level),
            "real_sha256": hash_dataset(dataset), "coefficients": belief.coefficients, "scatter": belief.scatter,
            "temperature": gate.temperature, "heldout": figures, "domain": domain_of(marks.features)}
