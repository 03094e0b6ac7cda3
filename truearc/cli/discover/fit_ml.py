"""The work of `truearc fit`: the fit, its report and its file."""

import argparse
import sys
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from truearc.cli.progress import make_progress
from truearc.cli.terms_from import catalogue_of
from truearc.robot.config.schema import InputError
from truearc.sim.data.dataset import Dataset, hash_dataset, load_dataset
from truearc.sim.infer.advise import advise
from truearc.sim.infer.belief import save_belief
from truearc.sim.infer.crossval import CrossValidation, cross_validate
from truearc.sim.infer.fit_text import (
    say_advice,
    say_estimates,
    say_evidence,
    say_identified,
    say_prediction,
    say_scatter,
)
from truearc.sim.infer.map_fit import MlFit, fit_ml
from truearc.sim.infer.profile import ProfileInterval, profile_interval
from truearc.sim.paper.grid_start import grid_start

if TYPE_CHECKING:
    from truearc.sim.infer.posterior import Posterior


def run_fit(args: argparse.Namespace) -> int:
    """Fit, report and write; args: those of `truearc fit`."""
    _check(args)
    among = catalogue_of(args)
    asked = None if args.terms is None else _names("--terms", args.terms)
    dataset = load_dataset(args.dataset)
    terms = dataset.facts.believe.terms if asked is None else asked
    among.find(terms)
    fit = fit_ml(dataset.facts, dataset, terms, make_progress("fit", args.quiet), grid_start(dataset.facts, dataset),
                 among)
    _say("", say_evidence(fit))
    if not fit.converged:
        print("truearc fit: the search for the most probable parameters did not settle; nothing is written",
              file=sys.stderr)
        return 1
    _say("what these shots can tell", say_identified(fit))
    intervals = _profiles(fit, args.quiet)
    _say("estimates", say_estimates(intervals, fit.model.sought))
    _say("", say_scatter(fit))
    score = cross_validate(fit, make_progress("cross-validation", args.quiet))
    _say("", say_prediction(score))
    _say("what would tell more", say_advice(advise(fit)))
    posterior = _posterior(fit, args)
    if args.out is not None:
        save_belief(args.out, fit.belief, _provenance(dataset, fit, intervals, score, posterior))
    return 0 if posterior is None or posterior.converged else 1


def _check(args: argparse.Namespace) -> None:
    if args.out is not None and not Path(args.out).parent.is_dir():
        raise InputError(f"{args.out}: there is no directory to write it to")
    if args.posterior is not None and args.posterior < 1:
        raise InputError(f"--posterior is {args.posterior}; at least 1 sample is needed")
    if args.seed is not None and args.seed < 0:
        raise InputError(f"--seed is {args.seed}; it cannot be negative")


def _names(option: str, text: str) -> tuple[str, ...]:
    """The names in a comma-separated list; InputError when there is none."""
    names = tuple(name.strip() for name in text.split(",") if name.strip())
    if not names:
        raise InputError(f"{option}: names no term")
    return names


def _say(title: str, lines: Any) -> None:
    lines = list(lines)
    if title and lines:
        print(f"\n{title}:")
    for line in lines:
        print(line)


def _profiles(fit: MlFit, quiet: bool) -> list[ProfileInterval]:
    show = make_progress("intervals", quiet)
    intervals = []
    for number, name in enumerate(fit.model.names, 1):
        intervals.append(profile_interval(fit, name))
        show(number / len(fit.model.names), name)
    return intervals


def _posterior(fit: MlFit, args: argparse.Namespace) -> "Posterior | None":
    if args.posterior is None:
        return None
    # NumPyro takes a second to import, for one option only
    from truearc.sim.infer.posterior import sample, save_draws, say_posterior
    drawn = sample(fit, args.posterior, args.seed or 0, make_progress("posterior", args.quiet))
    _say("posterior", say_posterior(drawn))
    if args.out is not None:
        path = Path(args.out).with_suffix(".posterior.npz")
        save_draws(path, drawn)
        print(f"{path}: {args.posterior} draws")
    return drawn


def _provenance(dataset: Dataset, fit: MlFit, intervals: list[ProfileInterval], score: CrossValidation | None,
                posterior: "Posterior | None") -> dict[str, Any]:
    said: dict[str, Any] = {
        "method": "ml", "dataset": dataset.name, "dataset_sha256": hash_dataset(dataset), "truearc": version("truearc"),
        "shots": len(fit.gathered.rows), "terms": list(fit.model.terms), "log_posterior": -fit.optimum.value,
        "evidence": dict(fit.gathered.used), "left_out": list(fit.gathered.left_out),
        "interval90": {one.name: [one.low90, one.high90] for one in intervals}}
    if score is not None:
        said["heldout"] = {"shots": score.shots, "log_score": score.log_score, "accuracy": score.accuracy}
    if posterior is not None:
        said["posterior"] = {"seed": posterior.seed, "draws": posterior.count}
    return said
