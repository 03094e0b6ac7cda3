"""The page of a reproduction: the paper's tables and figures beside the reproduced ones, also saved as JSON and CSV."""

import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from truearc.sim.data.files import hash_dataset
from truearc.sim.data.table import OUTCOMES
from truearc.sim.paper.sweep import SweepSetting
from truearc.sim.printed import save_csv
from truearc.sim.report import COLOURS, NO_ORIGIN, Origin, make_page, new_figure, paragraph, picture, table
from truearc.sim.statistics import BINS
from truearc_proof.reproduce import EVERYTHING, REAL, SIMULATED, WHERE, Settings
from truearc_proof.reproduce import models as figures
from truearc_proof.reproduce.collect import Pool
from truearc_proof.reproduce.models import OURS, Analysis, Interval, Repetition, interval, network_name
from truearc_proof.table import Table

# the paper's printed Tables I and II; Figures 8 to 10 are pictures without numbers
TABLE_I = {"Training": {"two": 1.0, "three": 0.9231, "mean_m": 0.051, "median_m": 0.058},
           "Testing": {"two": 0.9286, "three": 0.8571, "mean_m": 0.283, "median_m": 0.124}}
# size of D_s -> overall accuracy, "F1-3pt", "F1-2pt": a class's accuracy by its own arithmetic (docs/how-to/paper.md)
TABLE_II = {0: (0.4429, 0.0417, 0.6666), 500: (0.7857, 0.5000, 0.8750), 600: (0.8714, 0.7083, 0.9167),
            750: (0.9143, 0.7916, 0.9583), 900: (0.9856, 0.9583, 1.0000), 1000: (0.9571, 0.9167, 0.9583),
            1250: (0.9285, 0.8750, 0.9167)}
COEFFICIENTS = {"cd": 0.91, "cl": 0.06}
BEST_WEIGHT = 0.01                    # Figure 10's star
NOT_PRINTED = "not printed in the paper"
DIFFERENCES = "Our gate against the others, paired"
NAMES = {"accuracy": "accuracy", "class_three": "3-pt class accuracy", "class_two": "2-pt class accuracy",
         "f1_three": "3-pt F1", "f1_two": "2-pt F1", "brier": "Brier", "ece": "calibration error"}
BLUE, GREY, RED, GREEN = "#1f5fa8", "#9aa3af", "#b3261e", "#1b7f3b"
FARTHEST_M = 2.0
OURS_NOT_THEIRS = ("The data are ours, recorded by an emulated robot in a MuJoCo world, not the paper's: what agrees "
                   "with the paper does so on another launcher, and what differs may differ for that reason.")
SCHEMA = "truearc.reproduction/1"


def make_tables(repetitions: Sequence[Repetition], analysis: Analysis, settings: Settings) -> list[Table]:
    """Return Tables I and II, Figures 9 and 10 as numbers, every model's metrics, and ours against the others."""
    return [table_one(repetitions), coefficients_table(repetitions), table_two(analysis, settings),
            figure_nine(analysis, settings), figure_ten(analysis, settings), models_table(analysis),
            differences_table(analysis)]


def table_one(repetitions: Sequence[Repetition]) -> Table:
    rows = []
    for part, printed in TABLE_I.items():
        for name, words, percent in (("two", "2-pt accuracy", True), ("three", "3-pt accuracy", True),
                                     ("mean_m", "mean deviation", False), ("median_m", "median deviation", False)):
            values = np.array([getattr(one.scores[part], name) for one in repetitions])
            reached = np.where(np.isfinite(values), values, np.nan)
            found = interval(reached)
            rows.append((part, words, format(printed[name], ".2%" if percent else ".3f"),
                         _share(found) if percent else _told(found, ".3f", " m"), str(int(np.isinf(values).sum()))))
    return Table("Table I: the simulator with the chosen coefficients", ("split", "measure", "paper", "here (95 %)",
                 "repetitions with a shot that never reaches the plane"), tuple(rows),
                 "Accuracies as the paper's arithmetic has them: of the configurations that scored three, those flown "
                 "into the three; of those that scored, those flown into the two. Deviations: of the configurations "
                 "that scored three, from the target's centre; the paper gives no unit, here metres.")


def coefficients_table(repetitions: Sequence[Repetition]) -> Table:
    values = {"C_d": [one.coefficients["drag"]["cd"] for one in repetitions],
              "C_l": [one.coefficients["magnus"]["cl"] for one in repetitions],
              "tied pairs": [float(one.tied) for one in repetitions]}
    printed = {"C_d": f"{COEFFICIENTS['cd']:.2f}", "C_l": f"{COEFFICIENTS['cl']:.2f}", "tied pairs": "28"}
    rows = tuple((name, printed[name], f"{np.median(column):.3g}", f"{min(column):.3g} to {max(column):.3g}")
                 for name, column in values.items())
    return Table("Coefficients chosen by the grid", ("", "paper", "here, median", "range"), rows,
                 "The model loses no speed between wheels and ball; what the launcher loses there, C_d takes.")


def table_two(analysis: Analysis, settings: Settings) -> Table:
    rows = []
    for size in settings.sizes:
        name = network_name(SweepSetting(size, settings.best_weight))
        printed = TABLE_II.get(size)
        cells = [str(size)]
        for place, metric in enumerate(("accuracy", "class_three", "class_two")):
            cells += [f"{printed[place]:.2%}" if printed else "-", _over(analysis, name, EVERYTHING, metric)]
        cells += [_over(analysis, name, EVERYTHING, metric) for metric in ("f1_three", "f1_two")]
        rows.append(tuple(cells))
    return Table("Table II: the network by the amount of simulated data", (
        "D_s", "paper: overall", "here", "paper: \"F1-3pt\"", "here, same measure", "paper: \"F1-2pt\"",
        "here, same measure", "here, F1 of three", "here, F1 of two"), tuple(rows),
        "On D_r's test set and D_s^T together. The paper's \"F1\" are shares of 24 configurations: class accuracies, "
        "which stand beside them; F1 proper follows.")


def figure_nine(analysis: Analysis, settings: Settings) -> Table:
    models = [(network_name(SweepSetting(size, settings.best_weight)), NOT_PRINTED) for size in settings.sizes]
    models += [(model, "-") for model in analysis.models()]
    rows = [(model, printed, _over(analysis, model, REAL, "accuracy"), printed,
             _over(analysis, model, SIMULATED, "accuracy")) for model, printed in models]
    return Table("Figure 9: accuracy on recorded and on simulated, then launched, configurations",
                 ("model", "paper: D_r", "here: D_r test", "paper: D_s^T", "here: D_s^T"), tuple(rows), "")


def figure_ten(analysis: Analysis, settings: Settings) -> Table:
    rows = []
    for weight in sorted({*settings.weights, settings.best_weight}):
        name = network_name(SweepSetting(settings.best_size, weight))
        star = "best (starred)" if weight == BEST_WEIGHT else NOT_PRINTED
        rows.append((f"{weight:g}", star, *(_over(analysis, name, where, "accuracy") for where in WHERE)))
    return Table(f"Figure 10: the network by lambda, {settings.best_size} simulated configurations",
                 ("lambda", "paper", *(f"here: accuracy, {where}" for where in WHERE)), tuple(rows), "")


def models_table(analysis: Analysis) -> Table:
    """Return every model's metrics, with the best in each column marked."""
    metrics = figures.Metrics._fields
    rows = tuple((model, *(_over(analysis, model, EVERYTHING, metric) for metric in metrics))
                 for model in analysis.models())
    return Table("All models, D_r test and D_s^T together", ("model", *(NAMES[name] for name in metrics)),
                 rows, "Means over repetitions with 95 % intervals. Brier: mean squared error of both outputs' "
                 f"probabilities; calibration error: expected, over {BINS} equal bins of both outputs' probabilities; "
                 "for these two less is better. The simulator alone says 0 or 1.")


def in_short(tables: Sequence[Table]) -> list[Table]:
    """Return a summary for the terminal: only our gate's differences on all rows."""
    return [one._replace(rows=tuple(row for row in one.rows if row[0] == EVERYTHING))
            if one.title == DIFFERENCES else one for one in tables]


def differences_table(analysis: Analysis) -> Table:
    rows = []
    for found in analysis.differences:
        told = (_told(found.difference, "+.4f") if found.metric in figures.LOW_IS_GOOD
                else _told(Interval(*(100.0 * one for one in found.difference)), "+.1f", " points"))
        setting = f" ({found.setting})" if found.setting else ""
        rows.append((found.where, NAMES[found.metric], found.other + setting, f"{found.ours:.3f}",
                     f"{found.theirs:.3f}", told, "yes" if found.better else "no"))
    return Table(DIFFERENCES, ("rows", "measure", "against", "ours", "theirs",
                 "ours - theirs (95 %)", "better"), tuple(rows),
                 f"Paired by repetition. \"{figures.BY_TEST}\" is the one setting that does best on the very rows it "
                 "is judged by. Better: the interval is wholly on the good side of 0. Compared: "
                 + ", ".join(NAMES[name] for name in figures.COMPARED) + ".")


def _over(analysis: Analysis, model: str, where: str, metric: str) -> str:
    found = interval(analysis.values(model, where, metric))
    return _told(found, ".3f") if metric in figures.LOW_IS_GOOD else _share(found)


def _share(found: Interval) -> str:
    return _told(found._replace(low=max(found.low, 0.0), high=min(found.high, 1.0)), ".1%")


def _told(found: Interval, form: str, unit: str = "") -> str:
    return f"{found.mean:{form}}{unit} ({found.low:{form}} to {found.high:{form}})"


def draw_deviations(repetitions: Sequence[Repetition], three_m: float, two_m: float) -> Figure:
    """Draw Figure 8 right: the fitted simulator's deviation of test configurations from the centre, by outcome."""
    figure = new_figure(8.0, 3.4)
    axes = figure.subplots()
    rng = np.random.default_rng(0)
    deviation_m = np.concatenate([one.deviation_m for one in repetitions])
    outcome = np.array([said for one in repetitions for said in one.outcome])
    for place, (name, colour) in enumerate(COLOURS.items()):
        values = np.minimum(deviation_m[outcome == name], FARTHEST_M)
        axes.plot(values, place + rng.uniform(-0.3, 0.3, len(values)), ".", color=colour, alpha=0.5)
        axes.plot([np.median(values)] * 2, [place - 0.38, place + 0.38], color="#1a1c20", linewidth=2)
    for bound, words in ((three_m, "three"), (two_m, "two")):
        axes.axvline(bound, color=GREY, linestyle="--")
        axes.text(bound, 2.62, f" {words}", color="#5c6470", va="top")
    axes.axvline(TABLE_I["Testing"]["mean_m"], color=RED, linewidth=1.0, label="paper: mean on its test set")
    axes.set_yticks(range(len(COLOURS)), [f"was {name}" for name in COLOURS])
    axes.set(xlabel=f"simulated deviation from the centre, m ({FARTHEST_M:g} stands for more and for never there)",
             xlim=(0.0, FARTHEST_M * 1.02), ylim=(-0.6, 2.7))
    axes.legend(frameon=False, loc="lower right")
    return _bare(figure, axes)


def draw_sizes(analysis: Analysis, settings: Settings) -> Figure:
    """Draw Table II and Figure 9 in one: accuracy by the amount of simulated data, together and on either set."""
    figure = new_figure(8.0, 4.0)
    axes = figure.subplots()
    for where, colour in ((EVERYTHING, BLUE), (REAL, GREEN), (SIMULATED, "#d99000")):
        _band(axes, settings.sizes, [analysis.values(network_name(SweepSetting(size, settings.best_weight)), where,
                                                     "accuracy") for size in settings.sizes], colour, f"here: {where}")
    axes.plot(list(TABLE_II), [100 * row[0] for row in TABLE_II.values()], "o--", color=RED,
              label="paper: Table II, overall")
    _level(axes, analysis)
    axes.set(xlabel="simulated configurations (D_s)", ylabel="accuracy, %", ylim=(0.0, 102.0))
    axes.legend(frameon=False, loc="lower right", ncols=2)
    return _bare(figure, axes)


def draw_weights(analysis: Analysis, settings: Settings) -> Figure:
    """Draw Figure 10: accuracy by lambda; the paper's own choice is starred as there."""
    figure = new_figure(8.0, 3.8)
    axes = figure.subplots()
    weights = sorted({*settings.weights, settings.best_weight})
    for where, colour in ((EVERYTHING, BLUE), (REAL, GREEN), (SIMULATED, "#d99000")):
        _band(axes, weights, [analysis.values(network_name(SweepSetting(settings.best_size, weight)), where, "accuracy")
                              for weight in weights], colour, where)
    star = analysis.values(network_name(SweepSetting(settings.best_size, BEST_WEIGHT)), EVERYTHING, "accuracy")
    if len(star):
        axes.plot(BEST_WEIGHT, 100 * star.mean(), "*", markersize=16, color=RED, label="the paper's lambda")
    _level(axes, analysis)
    axes.set(xscale="log", xlabel="lambda", ylabel="accuracy, %")
    axes.legend(frameon=False, ncols=2)
    return _bare(figure, axes)


def _band(axes: Axes, x: Sequence[float], columns: list[np.ndarray], colour: str, label: str) -> None:
    found = [interval(100 * column) for column in columns]
    axes.plot(x, [one.mean for one in found], "o-", color=colour, label=label, markersize=4)
    axes.fill_between(x, [one.low for one in found], [one.high for one in found], color=colour, alpha=0.2, linewidth=0)


def _level(axes: Axes, analysis: Analysis) -> None:
    axes.axhline(100 * analysis.values(OURS, EVERYTHING, "accuracy").mean(), color="#1a1c20", linestyle=":",
                 label="our gate, both sets")


def _bare(figure: Figure, axes: Axes) -> Figure:
    axes.spines[["top", "right"]].set_visible(False)
    return figure


def what_varies(pool: Pool, settings: Settings) -> list[str]:
    """Return sentences on what an interval over repetitions covers here."""
    real, launched = (", ".join(f"{count} {outcome}" for outcome, count in _counted(part.shots.text("outcome")).items())
                      for part in (pool.real, pool.launched))
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
        "training split, from what the robot can see and do.",
        "Every model has the same training configurations and labels. Networks, as in the paper, are stopped by a "
        "fifth of them that is kept from training; our gate is fitted to all.",
    ]


def headline(analysis: Analysis) -> list[str]:
    """Return the findings, one sentence each."""
    lines = []
    for other in (figures.BY_VALIDATION, figures.BY_TEST):
        won = [found for found in analysis.differences if found.where == EVERYTHING and found.other == other]
        if won:
            said = ", ".join(f"{NAMES[found.metric]} {found.ours:.3f} against {found.theirs:.3f}"
                             f"{'' if found.better else ' (not settled)'}" for found in won)
            lines.append(f"Our gate against the {other}: {said}.")
    return lines


def save_page(path: Path, pool: Pool, repetitions: Sequence[Repetition], analysis: Analysis, tables: Sequence[Table],
              settings: Settings, origin: Origin = NO_ORIGIN) -> None:
    """Write the page; everything is inline."""
    target = pool.real.facts.target
    assert target is not None
    pictures = {
        "Table I:": picture(draw_deviations(repetitions, target.three_half_height_m, target.two_half_height_m),
                           "deviations on the test sets", "Figure 8, right. Black bars: medians. Of the paper's "
                           "points the mean and median are printed, no more."),
        "Table II:": picture(draw_sizes(analysis, settings), "accuracy by the amount of simulated data",
                            "Bands: 95 % intervals of the mean over repetitions."),
        "Figure 10": picture(draw_weights(analysis, settings), "accuracy by lambda", "Figure 10 redrawn; of "
                             "the paper's curve only the star is known."),
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
    """Write figures.csv: every model's metrics in every repetition; summary.json: the rest."""
    rows = [[figure.repetition, figure.model, "" if figure.size is None else figure.size,
             "" if figure.weight is None else figure.weight, figure.where, *map(_cell, figure.metrics)]
            for figure in analysis.figures]
    header = ["repetition", "model", "simulated", "lambda", "rows", *figures.Metrics._fields]
    save_csv(folder / "figures.csv", header, rows)
    text = msgspec.json.encode(_summary(pool, repetitions, analysis, tables, settings), enc_hook=float)
    (folder / "summary.json").write_bytes(msgspec.json.format(text, indent=1) + b"\n")


def _summary(pool: Pool, repetitions: Sequence[Repetition], analysis: Analysis, tables: Sequence[Table],
             settings: Settings) -> dict[str, Any]:
    return {
        "schema": SCHEMA, "data": OURS_NOT_THEIRS, "varies": what_varies(pool, settings), "settings": asdict(settings),
        "pool": {"real": _counted(pool.real.shots.text("outcome")),
                 "launched": _counted(pool.launched.shots.text("outcome")),
                 "left_out": [*pool.real.left_out, *pool.launched.left_out]},
        "repetitions": [{"number": one.number, "coefficients": one.coefficients, "tied": one.tied,
                         "table_1": {part: found._asdict() for part, found in one.scores.items()},
                         "deviation_m": one.deviation_m.tolist(), "outcome": one.outcome}
                        for one in repetitions],
        "differences": [{**one._asdict(), "difference": one.difference._asdict()} for one in analysis.differences],
        "tables": [one._asdict() for one in tables],
    }


def _counted(outcomes: Sequence[str]) -> dict[str, int]:
    return {outcome: list(outcomes).count(outcome) for outcome in OUTCOMES}


def _cell(value: float) -> str:
    return repr(float(value)) if math.isfinite(value) else "" if math.isnan(value) else "inf"
