"""The paper's tables with ours beside them, as text cells for the terminal, the page and the CSV alike."""

from collections.abc import Sequence

import numpy as np

from truearc.sim.paper.sweep import SweepSetting
from truearc.sim.statistics import BINS
from truearc_proof.reproduce import paper
from truearc_proof.reproduce.analysis import (
    BY_TEST,
    COMPARED,
    EVERYTHING,
    LOW_IS_GOOD,
    REAL,
    SIMULATED,
    WHERE,
    Analysis,
    network_name,
)
from truearc_proof.reproduce.intervals import Interval, interval
from truearc_proof.reproduce.metrics import Metrics
from truearc_proof.reproduce.repetition import OURS, Repetition
from truearc_proof.reproduce.settings import Settings
from truearc_proof.table import Table

DIFFERENCES = "Our gate against the others, paired"
NAMES = {"accuracy": "accuracy", "class_three": "3-pt class accuracy", "class_two": "2-pt class accuracy",
         "f1_three": "3-pt F1", "f1_two": "2-pt F1", "brier": "Brier", "ece": "calibration error"}


def make_tables(repetitions: Sequence[Repetition], analysis: Analysis, settings: Settings) -> list[Table]:
    """Table I, Table II, Figure 9 and 10 as numbers, every model's metrics, and ours against the others."""
    tables = [table_one(repetitions), coefficients_table(repetitions), table_two(analysis, settings),
              figure_nine(analysis, settings), figure_ten(analysis, settings), models_table(analysis)]
    if OURS in analysis.models():
        tables.append(differences_table(analysis))
    return tables


def table_one(repetitions: Sequence[Repetition]) -> Table:
    rows = []
    for part, printed in paper.TABLE_I.items():
        for name, words, percent in (("two", "2-pt accuracy", True), ("three", "3-pt accuracy", True),
                                     ("mean_m", "mean deviation", False), ("median_m", "median deviation", False)):
            values = np.array([getattr(one.scores[part], name) for one in repetitions])
            reached = np.where(np.isfinite(values), values, np.nan)
            show = _percent if percent else _metres
            rows.append((part, words, show(printed[name]), show(interval(reached)), str(int(np.isinf(values).sum()))))
    return Table("Table I: the simulator with the chosen coefficients", ("split", "measure", "paper", "here (95 %)",
                 "repetitions with a shot that never reaches the plane"), tuple(rows),
                 "Accuracies as the paper's arithmetic has them: of the configurations that scored three, those flown "
                 "into the three; of those that scored, those flown into the two. Deviations: of the configurations "
                 "that scored three, from the target's centre; the paper gives no unit, here metres.")


def coefficients_table(repetitions: Sequence[Repetition]) -> Table:
    values = {"C_d": [one.coefficients["drag"]["cd"] for one in repetitions],
              "C_l": [one.coefficients["magnus"]["cl"] for one in repetitions],
              "tied pairs": [float(one.tied) for one in repetitions]}
    printed = {"C_d": f"{paper.COEFFICIENTS['cd']:.2f}", "C_l": f"{paper.COEFFICIENTS['cl']:.2f}", "tied pairs": "28"}
    rows = tuple((name, printed[name], f"{np.median(column):.3g}", f"{min(column):.3g} to {max(column):.3g}")
                 for name, column in values.items())
    return Table("Coefficients chosen by the grid", ("", "paper", "here, median", "range"), rows,
                 "The model loses no speed between wheels and ball; what the launcher loses there, C_d takes.")


def table_two(analysis: Analysis, settings: Settings) -> Table:
    rows = []
    for size in settings.sizes:
        name = network_name(SweepSetting(size, settings.best_weight))
        printed = paper.TABLE_II.get(size)
        cells = [str(size)]
        for place, metric in enumerate(("accuracy", "class_three", "class_two")):
            cells += [_percent(printed[place]) if printed else "-", _over(analysis, name, EVERYTHING, metric)]
        cells += [_over(analysis, name, EVERYTHING, metric) for metric in ("f1_three", "f1_two")]
        rows.append(tuple(cells))
    return Table("Table II: the network by the amount of simulated data", (
        "D_s", "paper: overall", "here", "paper: \"F1-3pt\"", "here, same measure", "paper: \"F1-2pt\"",
        "here, same measure", "here, F1 of three", "here, F1 of two"), tuple(rows),
        "On D_r's test set and D_s^T together. The paper's \"F1\" are shares of 24 configurations: class accuracies, "
        "which stand beside them; F1 proper follows.")


def figure_nine(analysis: Analysis, settings: Settings) -> Table:
    rows = [
        (
            network_name(SweepSetting(size, settings.best_weight)),
            paper.NOT_PRINTED,
            _over(analysis, network_name(SweepSetting(size, settings.best_weight)), REAL, "accuracy"),
            paper.NOT_PRINTED,
            _over(analysis, network_name(SweepSetting(size, settings.best_weight)), SIMULATED, "accuracy"),
        )
        for size in settings.sizes
    ]
    rows += [(model, "-", _over(analysis, model, REAL, "accuracy"), "-", _over(analysis, model, SIMULATED, "accuracy"))
             for model in analysis.models()]
    return Table("Figure 9: accuracy on recorded and on simulated, then launched, configurations",
                 ("model", "paper: D_r", "here: D_r test", "paper: D_s^T", "here: D_s^T"), tuple(rows), "")


def figure_ten(analysis: Analysis, settings: Settings) -> Table:
    rows = []
    for weight in sorted({*settings.weights, settings.best_weight}):
        name = network_name(SweepSetting(settings.best_size, weight))
        star = "best (starred)" if weight == paper.BEST_WEIGHT else paper.NOT_PRINTED
        rows.append((f"{weight:g}", star, *(_over(analysis, name, where, "accuracy") for where in WHERE)))
    return Table(f"Figure 10: the network by lambda, {settings.best_size} simulated configurations",
                 ("lambda", "paper", *(f"here: accuracy, {where}" for where in WHERE)), tuple(rows), "")


def models_table(analysis: Analysis) -> Table:
    """Every model on everything, the best in each column marked."""
    rows = []
    for model in analysis.models():
        rows.append((model, *(_over(analysis, model, EVERYTHING, metric) for metric in Metrics._fields)))
    return Table("All models, D_r test and D_s^T together", ("model", *(NAMES[name] for name in Metrics._fields)),
                 tuple(rows), "Means over repetitions with 95 % intervals. Brier: mean squared error of both outputs' "
                 f"probabilities; calibration error: expected, over {BINS} equal bins of both outputs' probabilities; "
                 "for these two less is better. The simulator alone says 0 or 1.")


def in_short(tables: Sequence[Table]) -> list[Table]:
    """For the terminal: of our gate's differences those on all rows only."""
    return [one._replace(rows=tuple(row for row in one.rows if row[0] == EVERYTHING))
            if one.title == DIFFERENCES else one for one in tables]


def differences_table(analysis: Analysis) -> Table:
    rows = []
    for found in analysis.differences:
        show = _points if found.metric not in LOW_IS_GOOD else _plain
        setting = f" ({found.setting})" if found.setting else ""
        rows.append((found.where, NAMES[found.metric], found.other + setting, f"{found.ours:.3f}",
                     f"{found.theirs:.3f}", show(found.difference), "yes" if found.better else "no"))
    return Table(DIFFERENCES, ("rows", "measure", "against", "ours", "theirs",
                 "ours - theirs (95 %, t; bootstrap)", "better"), tuple(rows),
                 f"Paired by repetition. \"{BY_TEST}\" is the one setting that does best on the very rows it is "
                 "judged by. Better: both intervals are wholly on the good side of 0. Compared: "
                 + ", ".join(NAMES[name] for name in COMPARED) + ".")


def _over(analysis: Analysis, model: str, where: str, metric: str) -> str:
    found = interval(analysis.values(model, where, metric))
    return _plain(found, short=True) if metric in LOW_IS_GOOD else _percent(found)


def _percent(value: float | Interval) -> str:
    if isinstance(value, Interval):
        return f"{value.mean:.1%} ({max(value.low, 0.0):.1%} to {min(value.high, 1.0):.1%})"
    return f"{value:.2%}"


def _metres(value: float | Interval) -> str:
    if isinstance(value, Interval):
        return f"{value.mean:.3f} m ({value.low:.3f} to {value.high:.3f})"
    return f"{value:.3f}"


def _points(value: Interval) -> str:
    return (f"{100 * value.mean:+.1f} points ({100 * value.low:+.1f} to {100 * value.high:+.1f}; "
            f"{100 * value.boot_low:+.1f} to {100 * value.boot_high:+.1f})")


def _plain(value: Interval, short: bool = False) -> str:
    if short:
        return f"{value.mean:.3f} ({value.low:.3f} to {value.high:.3f})"
    return (f"{value.mean:+.4f} ({value.low:+.4f} to {value.high:+.4f}; "
            f"{value.boot_low:+.4f} to {value.boot_high:+.4f})")
