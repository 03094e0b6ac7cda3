"""The work of `truearc paper fit`: the grid search, its report and its files."""

import argparse
from pathlib import Path

import numpy as np

from truearc.cli.progress import make_progress
from truearc.robot.config.schema import InputError
from truearc.sim.data.dataset import Dataset, load_dataset
from truearc.sim.infer.coefficients import save_coefficients
from truearc.sim.infer.score import Score, score
from truearc.sim.paper.grid_bootstrap import Bootstrap, bootstrap_grid
from truearc.sim.paper.grid_fit import GridFit, fit_grid, map_deviation
from truearc.sim.paper.grid_report import TIE_HEADER, draw_map, explain, provenance_of
from truearc.sim.report import make_png
from truearc.sim.tables import save_csv


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
        save_coefficients(args.out, fit.coefficients, provenance_of(args.step, dataset, fit, scored, again))
    if args.tied is not None:
        save_csv(Path(args.tied), TIE_HEADER, [[f"{cd:.6g}", f"{cl:.6g}", _metres(mean_m), _metres(median_m)]
                                               for cd, cl, mean_m, median_m in fit.ties])
    if args.picture is not None:
        Path(args.picture).write_bytes(make_png(draw_map(dataset, fit)))
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


def _metres(value: float) -> str:
    return f"{value:.6f}" if np.isfinite(value) else ""
