"""The work of `truearc paper fit`: the grid search, its report and its files."""

import argparse
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from truearc.cli.paper.fit_grid_text import TIE_HEADER, explain
from truearc.cli.progress import make_progress
from truearc.robot.config.schema import InputError
from truearc.sim.data.dataset import Dataset, hash_dataset, load_dataset
from truearc.sim.infer.coefficients import save_coefficients
from truearc.sim.infer.score import Score, score
from truearc.sim.paper.grid_bootstrap import Bootstrap, bootstrap_grid
from truearc.sim.paper.grid_fit import GridFit, fit_grid, map_deviation
from truearc.sim.plots import Zoom, draw_fit_map
from truearc.sim.report import make_png
from truearc.sim.tables import save_csv

ZOOM_POINTS = 90                      # a side at most, of the picture's second panel


def run_grid_fit(args: argparse.Namespace) -> int:
    """Fit, report and write what was asked for; args: those of `truearc paper fit`."""
    resamples, seed = args.bootstrap or 0, args.seed or 0
    for path in (args.out, args.map, args.picture, args.tied):
        if path is not None and not Path(path).parent.is_dir():
            raise InputError(f"{path}: there is no directory to write it to")
    if resamples < 0 or seed < 0:
        raise InputError("--bootstrap and --seed cannot be negative")
    dataset = load_dataset(args.dataset)
    fit = fit_grid(dataset.facts, dataset.shots, args.step, make_progress("fit", args.quiet))
    scored = score(dataset.facts, fit.coefficients, dataset.shots)
    again = bootstrap_grid(dataset.facts, dataset.shots, fit, resamples, seed) if resamples else None
    print("\n".join(explain(dataset, fit, scored, again)))
    try:
        _write(args, dataset, fit, scored, again)
    except OSError as error:
        raise InputError(f"{error.filename}: {error.strerror}") from error
    return 0


def _write(args: argparse.Namespace, dataset: Dataset, fit: GridFit, scored: Score, again: Bootstrap | None) -> None:
    if args.out is not None:
        save_coefficients(args.out, fit.coefficients, _provenance(args.step, dataset, fit, scored, again))
    if args.tied is not None:
        save_csv(Path(args.tied), TIE_HEADER, [[f"{cd:.6g}", f"{cl:.6g}", _metres(mean_m), _metres(median_m)]
                                               for cd, cl, mean_m, median_m in fit.ties])
    if args.picture is not None:
        figure = draw_fit_map(fit.axis, fit.share_three.T, (fit.cd, fit.cl), fit.tied.T, _zoom(dataset, fit))
        Path(args.picture).write_bytes(make_png(figure))
    if args.map is not None:
        with Path(args.map).open("wb") as file:
            np.savez_compressed(file, axis=fit.axis, share_three=fit.share_three, share_two=fit.share_two,
                                mean_deviation_m=_deviations(dataset, fit), tied=fit.tied)


def _deviations(dataset: Dataset, fit: GridFit) -> np.ndarray:
    """Mean deviation [cd, cl] wherever a three is reproduced."""
    mean_m = np.full(fit.share_three.shape, np.nan)
    at = np.nonzero((fit.share_three > 0.0) | fit.tied)
    mean_m[at] = map_deviation(dataset.facts, dataset.shots, fit.axis[at[0]], fit.axis[at[1]])
    return mean_m


def _zoom(dataset: Dataset, fit: GridFit) -> Zoom:
    """Mean deviation around the tied pairs."""
    cd, cl = (_around(np.flatnonzero(fit.tied.any(axis=other)), fit.axis) for other in (1, 0))
    every_cd, every_cl = np.meshgrid(cd, cl)
    return Zoom(cd, cl, map_deviation(dataset.facts, dataset.shots, every_cd, every_cl))


def _around(at: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """The part of the axis about its points `at`, with a margin, and not too many points of it."""
    margin = max(8, (at[-1] - at[0]) // 2)
    part = axis[max(0, at[0] - margin):at[-1] + margin + 1]
    return part[::-(-len(part) // ZOOM_POINTS)]


def _metres(value: float) -> str:
    return f"{value:.6f}" if np.isfinite(value) else ""


def _provenance(step: float, dataset: Dataset, fit: GridFit, scored: Score, again: Bootstrap | None) -> dict[str, Any]:
    said = {"method": "grid", "step": step, "dataset": dataset.name, "dataset_sha256": hash_dataset(dataset),
            "truearc": version("truearc"), "tied_pairs": len(fit.ties), "shots_three": fit.shots_three,
            "shots_two": fit.shots_two, "accuracy_three": scored.three, "accuracy_two": scored.two}
    said |= {name: value for name, value in (("mean_deviation_m", fit.mean_m), ("median_deviation_m", fit.median_m))
             if np.isfinite(value)}
    if again is not None and again.cd.size:
        (cd_low, cd_high), (cl_low, cl_high) = again.interval90("cd"), again.interval90("cl")
        said |= {"bootstrap_resamples": len(again.cd), "bootstrap_seed": again.seed, "cd_low90": cd_low,
                 "cd_high90": cd_high, "cl_low90": cl_low, "cl_high90": cl_high}
    return said
