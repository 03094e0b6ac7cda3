"""The work of `truearc paper sweep`: trains the networks, compares the settings, writes tables and picture."""

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

from truearc.cli.options import refuse
from truearc.cli.paper.train_network import load_rows, made_of
from truearc.cli.progress import make_progress
from truearc.robot.config.schema import InputError
from truearc.sim.data.dataset import check_free
from truearc.sim.gate.network_training import make_record
from truearc.sim.paper.network import save_weights
from truearc.sim.paper.settings import Recipe
from truearc.sim.paper.sweep import Trained, train_many
from truearc.sim.paper.sweep_settings import (
    Mean,
    SweepNetwork,
    SweepScore,
    SweepSetting,
    Verdict,
    compare,
    draw_sweep,
    judge,
    mean_of,
    of_setting,
    plan,
    settings_of,
)
from truearc.sim.paper.training import accuracy
from truearc.sim.report import make_png
from truearc.sim.tables import make_text, save_csv

HEADER = ("simulated", "lambda", "cross-entropy: validation", "held out", "right, held out: outcome", "two", "three")
FIGURES = ("validation_loss", "heldout_loss", "outcome", "two", "three")
LAMBDAS = "0.01"                      # without --lambdas
Kind = TypeVar("Kind", int, float)


def run_sweep(args: argparse.Namespace) -> int:
    """Train, compare and write; args: those of `truearc paper sweep`."""
    recipe = Recipe(args.learning_rate, args.steps, args.patience)
    if args.seeds < 1 or args.seed < 0:
        raise InputError(f"--seeds is {args.seeds} and --seed {args.seed}; at least 1 and 0 are needed")
    sizes = _numbers("--sizes", args.sizes, int)
    if not any(sizes):
        refuse(args, ("--sim", "--lambdas"), f"--sizes {args.sizes} takes no simulated shots")
    settings = settings_of(sizes, _numbers("--lambdas", args.lambdas or LAMBDAS, float))
    home = check_free(args.out)
    real = load_rows(args.real)
    networks = plan(real, load_rows(args.sim) if args.sim else None, settings,
                    range(args.seed, args.seed + args.seeds), args.holdout, args.validation)
    trained = train_many([network.job for network in networks], recipe, make_progress("sweep", args.quiet))
    scores = [judge(network, one) for network, one in zip(networks, trained, strict=True)]
    verdict = compare(scores, settings)
    best = verdict.best if verdict else settings[0]
    chosen = next(number for number, network in enumerate(networks) if network.setting == best)
    home.mkdir(parents=True, exist_ok=True)
    _save_tables(home, scores, settings)
    (home / "sweep.png").write_bytes(make_png(draw_sweep(scores, settings)))
    _save_best(args, home / "best", recipe, real, networks[chosen], trained[chosen])
    _tell(scores, settings, verdict)
    print(f"{home}: settings.csv, networks.csv, sweep.png; best/ holds the network of seed {args.seed} "
          f"({best.words()}), for truearc export")
    return 0


def _numbers(option: str, text: str, kind: Callable[[str], Kind]) -> list[Kind]:
    numbers = []
    for word in text.split(","):
        try:
            numbers.append(kind(word))
        except ValueError as error:
            what = "a whole number" if kind is int else "a number"
            raise InputError(f"{option}: {word.strip()!r} in {text!r} is not {what}") from error
    return numbers


def _save_tables(home: Path, scores: Sequence[SweepScore], settings: Sequence[SweepSetting]) -> None:
    save_csv(home / "networks.csv", SweepScore._fields, scores)
    header = ["size", "weight", "seeds", *(f"{name}{end}" for name in FIGURES for end in ("", "_half95"))]
    rows = []
    for setting in settings:
        mine = of_setting(scores, setting)
        means = [mean_of([getattr(score, name) for score in mine]) for name in FIGURES]
        rows.append([*setting, len(mine), *("" if number != number else number for mean in means for number in mean)])
    save_csv(home / "settings.csv", header, rows)


def _save_best(args: argparse.Namespace, directory: Path, recipe: Recipe, real: Any, network: SweepNetwork,
               trained: Trained) -> None:
    sets = {"train": network.job.real, "validation": network.job.validation, "heldout": network.heldout}
    score = {name: accuracy(trained.network, rows) for name, rows in sets.items() if rows is not None}
    save_weights(directory, trained.network, make_record(made_of(args), recipe, network.job, real, score, trained))


def _tell(scores: Sequence[SweepScore], settings: Sequence[SweepSetting], verdict: Verdict | None) -> None:
    rows = []
    for setting in settings:
        mine = of_setting(scores, setting)
        loss, heldout, *shares = [mean_of([getattr(score, name) for score in mine]) for name in FIGURES]
        rows.append([f"{setting.size}", f"{setting.weight:g}", _pm(loss), _pm(heldout),
                     *(_pm(share, 100) for share in shares)])
    print("\n".join(make_text(HEADER, rows, right=range(len(HEADER)))))
    if verdict:
        print(_sentence(verdict))


def _pm(mean: Mean, factor: float = 1.0) -> str:
    digits, unit = (1, " %") if factor == 100 else (3, "")
    half = "" if mean.half != mean.half else f"+-{factor * mean.half:.{digits}f}"
    return f"{factor * mean.value:.{digits}f}{half}{unit}"


def _sentence(verdict: Verdict) -> str:
    """In words, with what chance alone could do; the intervals are 95 %."""
    gain = verdict.gain
    if gain.half != gain.half:
        size = f"by {gain.value:+.3f} for the one seed tried, which says nothing about chance"
    elif abs(gain.value) <= gain.half:
        size = f"by {gain.value:+.3f} +- {gain.half:.3f}, which is within what the draw of seeds does by chance"
    else:
        size = (f"by {gain.value:+.3f} +- {gain.half:.3f}, which is beyond chance "
                + ("and better" if gain.value > 0 else "and WORSE"))
    return (f"best on the validation shots: {verdict.best.words()}; on shots held out its cross-entropy is lower than "
            f"that of {verdict.rival.words()} {size} (seeds share the recorded shots: another session may differ)")
