"""truearc train: a gate with the fitted physics in it."""

import argparse

DESCRIPTION = """Train a gate on recorded shots: the forecast of each shot by fitted coefficients, plus a small learned
correction and a calibrated spread. All recorded shots are learned from; each fifth of the configurations is left out in
turn to measure the gate on shots that it has not seen. The paper's network is `truearc paper train`."""
EXAMPLE = "truearc train --real shots/ --coefficients coefficients.toml -o weights/"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--real", required=True, metavar="DIR", help="dataset of recorded shots")
    parser.add_argument("--coefficients", required=True, metavar="FILE",
                        help="coefficients.toml, as `truearc fit` (with the scatter), `truearc discover --adopt` or "
                             "`truearc paper fit` write it")
    parser.add_argument("--reliability", metavar="FILE", help="picture of predicted against observed shares to write")
    parser.add_argument("--seed", type=int, default=0, help="seed of split and first weights (default %(default)s)")
    parser.add_argument("-o", "--out", required=True, metavar="DIR", help="weights directory to write")


def main(args: argparse.Namespace) -> int:
    """Return 0 when the weights are written."""
    from truearc.cli.gate.train_physics import run_training
    return run_training(args)
