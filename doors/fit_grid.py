"""truearc fit --method grid: the seed's search."""

import argparse
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from doors.progress import make_progress
from robot.config import BadInput
from sim.coefficients import save_coefficients
from sim.fit.grid import STEP, GridFit, fit_grid
from sim.fit.score import Score, score
from sim.shots import Dataset, hash_dataset, load_dataset


def add_arguments(parser: argparse.ArgumentParser) -> None:
    grid = parser.add_argument_group("--method grid")
    grid.add_argument("--step", type=float, default=STEP, help="of the grid; divides 5 (%(default)s)")
    grid.add_argument("--map", metavar="FILE", help="npz to write the whole map to: axis, share_three, share_two, "
                                                    "mean_deviation_m, tied; rows cd, columns cl")


def main(args: argparse.Namespace) -> int:
    for path in (args.out, args.map):
        if path is not None and not Path(path).parent.is_dir():
            raise BadInput(f"{path}: there is no directory to write it to")
    dataset = load_dataset(args.dataset)
    fit = fit_grid(dataset.facts, dataset.shots, args.step, make_progress("fit", args.quiet))
    scored = score(dataset.facts, fit.coefficients, dataset.shots)
    _print(dataset, fit, scored)
    try:
        if args.out is not None:
            save_coefficients(args.out, fit.coefficients, _provenance(args.step, dataset, fit, scored))
        if args.map is not None:
            with Path(args.map).open("wb") as file:
                np.savez_compressed(file, axis=fit.axis, share_three=fit.share_three, share_two=fit.share_two,
                                    mean_deviation_m=fit.mean_deviation_m, tied=fit.tied)
    except OSError as error:
        raise BadInput(f"{error.filename}: {error.strerror}") from error
    return 0


def _print(dataset: Dataset, fit: GridFit, scored: Score) -> None:
    aside = len(dataset.shots) - fit.shots_three - fit.shots_two
    print(f"fitted to {fit.shots_three} three and {fit.shots_two} two; {aside} other shots of {len(dataset.shots)} "
          "have no say in the seed's measures (miss, or no outcome)")
    print(f"pairs: {fit.axis.size} x {fit.axis.size}, tied for the best accuracies: {int(fit.tied.sum())}")
    print(f"chosen: cd {fit.cd:.3f}, cl {fit.cl:.3f}; mean deviation {fit.mean_m:.3f} m, median {fit.median_m:.3f} m")
    if fit.median_pair != (fit.cd, fit.cl):
        print(f"the least median deviation among the tied is elsewhere: cd {fit.median_pair[0]:.3f}, "
              f"cl {fit.median_pair[1]:.3f}")
    print(f"accuracy: three-point {scored.three:.2%}, two-point {scored.two:.2%}, all outcomes {scored.all:.2%} "
          f"({scored.shots} shots)")


def _provenance(step: float, dataset: Dataset, fit: GridFit, scored: Score) -> dict[str, Any]:
    return {"method": "grid", "step": step, "dataset": dataset.name, "dataset_sha256": hash_dataset(dataset),
            "truearc": version("truearc"), "tied_pairs": int(fit.tied.sum()), "shots_three": fit.shots_three,
            "shots_two": fit.shots_two, "accuracy_three": scored.three, "accuracy_two": scored.two,
            "mean_deviation_m": fit.mean_m, "median_deviation_m": fit.median_m}
