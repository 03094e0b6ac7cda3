"""truearc train: one door, a file for each kind of model."""

import argparse

from truearc.cli.gate import train_physics
from truearc.cli.paper import train_network
from truearc.robot.config.schema import InputError

DESCRIPTION = """Train a classifier on recorded shots. network: the seed's (3-8-2, sigmoids), each batch of recorded
shots paired with a batch of simulated ones whose loss is weighed by lambda. physics: the forecast of each shot by
fitted coefficients, plus a small learned correction and a calibrated spread."""
EXAMPLE = "truearc train --real shots/ --sim simulated/ -o weights/"
# Each has NAME, add_arguments(group of its own options) and main(args) -> exit code.
MODELS = (train_network, train_physics)
# What one model learns from and the other would not heed.
FOREIGN = {train_network.NAME: ("sim", "epochs"), train_physics.NAME: ("coefficients", "reliability")}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--model", choices=[model.NAME for model in MODELS], default=MODELS[0].NAME,
                        help=f"what to train ({MODELS[0].NAME})")
    parser.add_argument("--real", required=True, metavar="DIR", help="dataset of recorded shots")
    parser.add_argument("--holdout", type=float, default=0.2, metavar="SHARE",
                        help="share of recorded shots kept out of training, to report on (0.2)")
    parser.add_argument("--seed", type=int, default=0, help="of split, first weights and batches (0)")
    parser.add_argument("-o", "--out", required=True, metavar="DIR", help="weights directory to write")
    for model in MODELS:
        model.add_arguments(parser.add_argument_group(f"--model {model.NAME}"))


def main(args: argparse.Namespace) -> int:
    for model, options in FOREIGN.items():
        for option in options if model != args.model else ():
            if getattr(args, option) is not None:
                raise InputError(f"--{option}: --model {args.model} makes no use of it; --model {model} does")
    chosen = {model.NAME: model for model in MODELS}[args.model]
    return int(chosen.main(args))
