"""The work of `truearc predict --gate`."""

import argparse
import sys
from pathlib import Path

from truearc.model_export.predict import make_ratings
from truearc.robot.config.schema import InputError
from truearc.robot.gate.model import load_gate
from truearc.sim.data.dataset import load_dataset


def predict_by_gate(args: argparse.Namespace) -> int:
    """Rate each shot and write the rows; args: those of `truearc predict`."""
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
