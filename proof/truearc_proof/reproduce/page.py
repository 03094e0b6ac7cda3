"""The one page of a reproduction, and its figures as JSON and CSV."""

import json
import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from truearc.sim.data.columns import OUTCOMES
from truearc.sim.data.files import hash_dataset
from truearc.sim.paper.sweep import SweepSetting
from truearc.sim.printed import save_csv
from truearc.sim.report import NO_ORIGIN, Origin, make_page, make_png, paragraph, picture, table
from truearc_proof.reproduce.analysis import BY_TEST, BY_VALIDATION, EVERYTHING, PAPERS, Analysis
from truearc_proof.reproduce.collect import LAUNCHABLE, Pool
from truearc_proof.reproduce.intervals import Interval
from truearc_proof.reproduce.metrics import Metrics
from truearc_proof.reproduce.networks import Answer
from truearc_proof.reproduce.pictures import draw_deviations, draw_reliability, draw_sets, draw_sizes, draw_weights
from truearc_proof.reproduce.repetition import OURS, SIMULATOR, Repetition
from truearc_proof.reproduce.settings import Settings
from truearc_proof.reproduce.tables import NAMES
from truearc_proof.table import Table

OURS_NOT_THEIRS = ("The data are ours, recorded by an emulated robot in a MuJoCo world, not the paper's: what agrees "
                   "with the paper does so on another launcher, and what differs may differ for that reason.")
SCHEMA = "truearc.reproduction/1"


def what_varies(pool: Pool, settings: Settings) -> list[str]:
    """Return sentences that say what an interval over repetitions covers here."""
    real, launched = (_counts(part.shots.text("outcome")) for part in (pool.real, pool.launched))
    return [
        f"Recorded once, shared by all {settings.draws} repetitions: {len(pool.real.shots)} legitimate configurations "
        f"chosen by the crew ({real}), each shot {settings.repeats} times and labelled by the rule of section IV-A, "
        f"and {len(pool.launched.shots)} legitimate ones of {settings.launched} simulated configurations that were "
        f"really launched ({launched}).",
        f"Drawn by each repetition: {settings.configurations} of the former with an even share of each outcome, "
        f"their split into {1 - settings.test_share:.0%} and {settings.test_share:.0%}, the coefficients fitted to "
        f"the training split, the simulated data, the split's validation part, first weights and minibatches, and "
        f"{settings.transfer} of the latter (D_s^T), even by what the simulator said of them.",
        "Repetitions draw from one pool and so overlap: an interval says how far another draw from these recordings "
        "may differ, not another robot or another week.",
        "The simulated configurations to be launched were drawn with the coefficients of the first repetition's "
        "training split: "
        + ", ".join(f"{key} = {value:.3f}" for part in pool.coefficients.values() for key, value in part.items())
        + ". They were drawn from what the robot can see and do: "
        + ", ".join(f"{name} {low:g} to {high:g}" for name, (low, high) in LAUNCHABLE.items()) + ".",
        "Every model has the same training configurations and labels. Networks, as in the paper, are stopped by a "
        "fifth of them that is kept from training; the others have no need of it and are fitted to all.",
    ]


def headline(analysis: Analysis) -> list[str]:
    """Return the findings, one sentence each."""
    lines = []
    for other in (BY_VALIDATION, BY_TEST):
        won = [found for found in analysis.differences if found.where == EVERYTHING and found.other == other]
        if won:
            said = ", ".join(f"{NAMES[found.metric]} {found.ours:.3f} against {found.theirs:.3f}"
                             f"{'' if found.better else ' (not settled)'}" for found in won)
            lines.append(f"Our gate against the {other}: {said}.")
    return lines


def save_page(path: Path, pool: Pool, repetitions: Sequence[Repetition], answers: Sequence[dict[SweepSetting, Answer]],
              analysis: Analysis, tables: Sequence[Table], settings: Settings, origin: Origin = NO_ORIGIN) -> None:
    """Write the page; everything is inline."""
    target = pool.real.facts.target
    assert target is not None
    pictures = {
        "Table I:": picture(make_png(draw_deviations(repetitions, target.three_half_height_m,
                                                    target.two_half_height_m)),
                           "deviations on the test sets", "Figure 8, right. Black bars: medians. Of the paper's "
                           "points the mean and median are printed, no more."),
        "Table II:": picture(make_png(draw_sizes(analysis, settings)), "accuracy by the amount of simulated data",
                            "Bands: 95 % intervals of the mean over repetitions."),
        "Figure 9": picture(make_png(draw_sets(analysis, settings)), "accuracy on both sets", "Figure 9 redrawn; the "
                            "paper's bars are not printed as numbers."),
        "Figure 10": picture(make_png(draw_weights(analysis, settings)), "accuracy by lambda", "Figure 10 redrawn; of "
                             "the paper's curve only the star is known."),
        "All models": picture(make_png(draw_reliability(repetitions, _reliabilities(repetitions, answers, settings))),
                              "stated probability against share of hits", "Both outputs, both sets, all repetitions; "
                              "the larger the dot, the more predictions."),
    }
    sections = [("What the data are", "".join(paragraph(line) for line in what_varies(pool, settings)))]
    for one in tables:
        drawn = "".join(body for start, body in pictures.items() if one.title.startswith(start))
        sections.append((one.title, drawn + table(one.header, one.rows) + paragraph(one.note, dim=True)))
    verdict = " ".join([OURS_NOT_THEIRS, *headline(analysis)])
    path.write_text(make_page("truearc reproduce: the paper's tables and figures", verdict, sections,
                              origin._replace(sha256=hash_dataset(pool.real))), encoding="utf-8")


def save_figures(folder: Path, pool: Pool, repetitions: Sequence[Repetition], analysis: Analysis,
                 tables: Sequence[Table], settings: Settings) -> None:
    """figures.csv: every model's metrics in every repetition; table_1.csv: Table I's; summary.json: the rest."""
    rows = [[figure.repetition, figure.model, "" if figure.size is None else figure.size,
             "" if figure.weight is None else figure.weight, figure.where, *map(_cell, figure.metrics)]
            for figure in analysis.figures]
    save_csv(folder / "figures.csv", ["repetition", "model", "simulated", "lambda", "rows", *Metrics._fields], rows)
    splits = [[one.number, part, *map(_cell, found)] for one in repetitions for part, found in one.scores.items()]
    names = repetitions[0].scores["Training"]._fields
    save_csv(folder / "table_1.csv", ["repetition", "split", *names], splits)
    text = json.dumps(_summary(pool, repetitions, analysis, tables, settings), indent=1, allow_nan=False)
    (folder / "summary.json").write_text(text + "\n", encoding="utf-8")


def _summary(pool: Pool, repetitions: Sequence[Repetition], analysis: Analysis, tables: Sequence[Table],
             settings: Settings) -> dict[str, Any]:
    return {
        "schema": SCHEMA, "data": OURS_NOT_THEIRS, "varies": what_varies(pool, settings), "settings": asdict(settings),
        "pool": {"real": _counted(pool.real.shots.text("outcome")),
                 "launched": _counted(pool.launched.shots.text("outcome")),
                 "left_out": [*pool.real.left_out, *pool.launched.left_out]},
        "repetitions": [{"number": one.number, "coefficients": one.coefficients, "tied": one.tied,
                         "deviation_m": [_finite(value) for value in one.deviation_m], "outcome": list(one.outcome)}
                        for one in repetitions],
        "differences": [_plain(found._asdict()) for found in analysis.differences],
        "tables": [one._asdict() for one in tables],
    }


def _reliabilities(repetitions: Sequence[Repetition], answers: Sequence[dict[SweepSetting, Answer]],
                   settings: Settings) -> dict[str, list[np.ndarray]]:
    setting = SweepSetting(settings.best_size, settings.best_weight)
    shown = {PAPERS: [networks[setting].p for networks in answers]}
    for name in (OURS, "Gaussian process", SIMULATOR):
        if all(name in one.predictions for one in repetitions):
            shown[name] = [one.predictions[name] for one in repetitions]
    return shown


def _counts(outcomes: Sequence[str]) -> str:
    return ", ".join(f"{count} {outcome}" for outcome, count in _counted(outcomes).items())


def _counted(outcomes: Sequence[str]) -> dict[str, int]:
    return {outcome: list(outcomes).count(outcome) for outcome in OUTCOMES}


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(part) for key, part in value.items()}
    if isinstance(value, Interval):
        return _plain(value._asdict())
    return _finite(value) if isinstance(value, float) else value


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _cell(value: float) -> str:
    return repr(float(value)) if math.isfinite(value) else "" if math.isnan(value) else "inf"
