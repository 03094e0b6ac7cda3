"""The work of `truearc paper sweep`: train the networks, compare the settings, write tables and picture."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from truearc.cli.common import make_progress, refuse
from truearc.cli.paper.train_network import LAMBDA, load_rows, made_of, recipe_of
from truearc.sim.gate.network_training import make_record
from truearc.sim.paper import sweep_settings as sweeps
from truearc.sim.paper.network import save_weights
from truearc.sim.paper.settings import Recipe
from truearc.sim.paper.sweep import Trained, train_many
from truearc.sim.paper.sweep_settings import Mean, SweepNetwork, SweepScore, SweepSetting, Verdict
from truearc.sim.paper.training import accuracy
from truearc.sim.report import make_png
from truearc.sim.tables import make_text, save_csv

HEADER = ("simulated", "lambda", "cross-entropy: validation", "held out", "right, held out: outcome", "two", "three")
FIGURES = ("validation_loss", "heldout_loss", "outcome", "two", "three")


def run_sweep(args: argparse.Namespace) -> int:
    """Train, compare and write; args: those of `truearc paper sweep`."""
    recipe = recipe_of(args)
    if not any(args.sizes):
        refuse(args, ("--sim", "--lambdas"), "--sizes takes no simulated shots")
    settings = sweeps.settings_of(args.sizes, args.lambdas or (LAMBDA,))
    real = load_rows(args.real)
    networks = sweeps.plan(real, load_rows(args.sim) if args.sim else None, settings,
                            range(args.seed, args.seed + args.seeds), args.holdout, args.validation)
    trained = train_many([network.job for network in networks], recipe, make_progress("sweep", args.quiet))
    scores = [sweeps.judge(network, one) for network, one in zip(networks, trained, strict=True)]
    verdict = sweeps.compare(scores, settings)
    best = verdict.best if verdict else settings[0]
    chosen = next(number for number, network in enumerate(networks) if network.setting == best)
    home = args.out
    home.mkdir(parents=True, exist_ok=True)
    means = _means_of(scores, settings)
    _save_tables(home, scores, means)
    (home / "sweep.png").write_bytes(make_png(sweeps.draw_sweep(scores, settings)))
    _save_best(args, home / "best", recipe, real, networks[chosen], trained[chosen])
    _report(means, verdict)
    print(f"{home}: settings.csv, networks.csv, sweep.png; best/ holds the network of seed {args.seed} "
          f"({best.words()}), for truearc export")
    return 0


def _means_of(scores: Sequence[SweepScore], settings: Sequence[SweepSetting]) -> list[tuple[SweepSetting, list[Mean]]]:
    """Each setting with the means of FIGURES over its networks."""
    means = []
    for setting in settings:
        mine = sweeps.of_setting(scores, setting)
        means.append((setting, [sweeps.mean_of([getattr(score, name) for score in mine]) for name in FIGURES]))
    return means


def _save_tables(home: Path, scores: Sequence[SweepScore], means: Sequence[tuple[SweepSetting, list[Mean]]]) -> None:
    save_csv(home / "networks.csv", SweepScore._fields, scores)
    header = ["size", "weight", "seeds", *(f"{name}{end}" for name in FIGURES for end in ("", "_half95"))]
    save_csv(home / "settings.csv", header, [
        [*setting, len(sweeps.of_setting(scores, setting)),
         *("" if number != number else number for mean in row for number in mean)] for setting, row in means])


def _save_best(args: argparse.Namespace, directory: Path, recipe: Recipe, real: Any, network: SweepNetwork,
               trained: Trained) -> None:
    sets = {"train": network.job.real, "validation": network.job.validation, "heldout": network.heldout}
    score = {name: accuracy(trained.network, rows) for name, rows in sets.items() if rows is not None}
    save_weights(directory, trained.network, make_record(made_of(args), recipe, network.job, real, score, trained))


def _report(means: Sequence[tuple[SweepSetting, list[Mean]]], verdict: Verdict | None) -> None:
    rows = [[f"{setting.size}", f"{setting.weight:g}", _pm(loss), _pm(heldout), *(_pm(share, 100) for share in shares)]
            for setting, (loss, heldout, *shares) in means]
    print("\n".join(make_text(HEADER, rows, right=range(len(HEADER)))))
    if verdict:
        print(_sentence(verdict))


def _pm(mean: Mean, factor: float = 1.0) -> str:
    digits, unit = (1, " %") if factor == 100 else (3, "")
    half = "" if mean.half != mean.half else f"+-{factor * mean.half:.{digits}f}"
    return f"{factor * mean.value:.{digits}f}{half}{unit}"


def _sentence(verdict: Verdict) -> str:
    """Return the verdict as text, with what chance alone could do; the intervals are 95 %."""
    gain = verdict.gain
    if gain.half != gain.half:
        size = f"by {gain.value:+.3f} for the one seed tried, from which chance cannot be judged"
    elif abs(gain.value) <= gain.half:
        size = f"by {gain.value:+.3f} +- {gain.half:.3f}, which is within what the draw of seeds does by chance"
    else:
        size = (f"by {gain.value:+.3f} +- {gain.half:.3f}, which is beyond chance "
                + ("and better" if gain.value > 0 else "and WORSE"))
    return (f"best on the validation shots: {verdict.best.words()}; on shots held out its cross-entropy is lower than "
            f"that of {verdict.rival.words()} {size} (seeds share the recorded shots: another session may differ)")
