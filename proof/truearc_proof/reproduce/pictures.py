"""The paper's Figures 8 (right), 9 and 10 redrawn from ours, and how honest probabilities are."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from truearc.sim.paper.sweep import SweepSetting
from truearc.sim.report import COLOURS, new_figure
from truearc.sim.statistics import reliability
from truearc_proof.reproduce import paper
from truearc_proof.reproduce.analysis import EVERYTHING, REAL, SIMULATED, Analysis, network_name
from truearc_proof.reproduce.intervals import interval
from truearc_proof.reproduce.repetition import OURS, Repetition
from truearc_proof.reproduce.settings import Settings

BLUE, GREY, RED, GREEN = "#1f5fa8", "#9aa3af", "#b3261e", "#1b7f3b"
FARTHEST_M = 2.0


def draw_deviations(repetitions: Sequence[Repetition], three_m: float, two_m: float) -> Figure:
    """Figure 8 right: how far the fitted simulator flies test configurations from the centre, by what happened."""
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
    axes.axvline(paper.TABLE_I["Testing"]["mean_m"], color=RED, linewidth=1.0, label="paper: mean on its test set")
    axes.set_yticks(range(len(COLOURS)), [f"was {name}" for name in COLOURS])
    axes.set(xlabel=f"simulated deviation from the centre, m ({FARTHEST_M:g} stands for more and for never there)",
             xlim=(0.0, FARTHEST_M * 1.02), ylim=(-0.6, 2.7))
    axes.legend(frameon=False, loc="lower right")
    return _bare(figure, axes)


def draw_sizes(analysis: Analysis, settings: Settings) -> Figure:
    """Table II and Figure 9 in one: accuracy by the amount of simulated data, together and on either set."""
    figure = new_figure(8.0, 4.0)
    axes = figure.subplots()
    for where, colour in ((EVERYTHING, BLUE), (REAL, GREEN), (SIMULATED, "#d99000")):
        _band(axes, settings.sizes, [analysis.values(network_name(SweepSetting(size, settings.best_weight)), where,
                                                     "accuracy") for size in settings.sizes], colour, f"here: {where}")
    axes.plot(list(paper.TABLE_II), [100 * row[0] for row in paper.TABLE_II.values()], "o--", color=RED,
              label="paper: Table II, overall")
    _level(axes, analysis, OURS, EVERYTHING, "our gate, both sets")
    axes.set(xlabel="simulated configurations (D_s)", ylabel="accuracy, %", ylim=(0.0, 102.0))
    axes.legend(frameon=False, loc="lower right", ncols=2)
    return _bare(figure, axes)


def draw_sets(analysis: Analysis, settings: Settings) -> Figure:
    """Figure 9: accuracy of every model on D_r's test set and on D_s^T."""
    best = network_name(SweepSetting(settings.best_size, settings.best_weight))
    models = [best, *(model for model in analysis.models() if not model.startswith("seed's network"))]
    figure = new_figure(8.0, 0.9 + 0.55 * len(models))
    axes = figure.subplots()
    for row, model in enumerate(reversed(models)):
        for side, where, colour in ((0.19, REAL, GREEN), (-0.19, SIMULATED, "#d99000")):
            found = interval(100 * analysis.values(model, where, "accuracy"))
            axes.barh(row + side, found.mean, height=0.34, color=colour, label=where if row == 0 else None)
            axes.plot([found.low, found.high], [row + side] * 2, color="#1a1c20", linewidth=1.5)
    axes.set_yticks(range(len(models)), list(reversed(models)))
    axes.set(xlabel="accuracy, %, 95 % interval of the mean over repetitions", xlim=(0.0, 100.0))
    axes.legend(frameon=False, loc="lower center", bbox_to_anchor=(0.4, 1.0), ncols=2)
    return _bare(figure, axes)


def draw_weights(analysis: Analysis, settings: Settings) -> Figure:
    """Figure 10: accuracy by lambda; the paper's own choice is starred as there."""
    figure = new_figure(8.0, 3.8)
    axes = figure.subplots()
    weights = sorted({*settings.weights, settings.best_weight})
    for where, colour in ((EVERYTHING, BLUE), (REAL, GREEN), (SIMULATED, "#d99000")):
        _band(axes, weights, [analysis.values(network_name(SweepSetting(settings.best_size, weight)), where, "accuracy")
                              for weight in weights], colour, where)
    star = analysis.values(network_name(SweepSetting(settings.best_size, paper.BEST_WEIGHT)), EVERYTHING, "accuracy")
    if len(star):
        axes.plot(paper.BEST_WEIGHT, 100 * star.mean(), "*", markersize=16, color=RED, label="the paper's lambda")
    _level(axes, analysis, OURS, EVERYTHING, "our gate, both sets")
    axes.set(xscale="log", xlabel="lambda", ylabel="accuracy, %")
    axes.legend(frameon=False, ncols=2)
    return _bare(figure, axes)


def draw_reliability(repetitions: Sequence[Repetition], answers: dict[str, list[np.ndarray]]) -> Figure:
    """Share of hits against stated probability, both outputs, all repetitions; a diagonal is an honest model."""
    figure = new_figure(8.0, 3.8)
    panels = figure.subplots(1, max(len(answers), 1), sharey=True, squeeze=False)[0]
    hits = np.concatenate([one.asked.labels.ravel() for one in repetitions])
    for axes, (name, predictions) in zip(panels, answers.items(), strict=True):
        bins = reliability(np.concatenate([part.ravel() for part in predictions]), hits)
        axes.plot([0, 1], [0, 1], color=GREY, linewidth=1.0)
        axes.scatter(bins.stated, bins.came_true, s=6 + 300 * bins.count / bins.count.sum(), color=BLUE)
        axes.set(title=name, xlabel="stated probability", xlim=(0, 1), ylim=(0, 1), aspect="equal")
        axes.title.set_fontsize(9)
        axes.spines[["top", "right"]].set_visible(False)
    panels[0].set_ylabel("share of hits")
    return figure


def _band(axes: Axes, x: Sequence[float], columns: list[np.ndarray], colour: str, label: str) -> None:
    found = [interval(100 * column) for column in columns]
    axes.plot(x, [one.mean for one in found], "o-", color=colour, label=label, markersize=4)
    axes.fill_between(x, [one.low for one in found], [one.high for one in found], color=colour, alpha=0.2, linewidth=0)


def _level(axes: Axes, analysis: Analysis, model: str, where: str, label: str) -> None:
    values = analysis.values(model, where, "accuracy")
    if len(values):
        axes.axhline(100 * values.mean(), color="#1a1c20", linestyle=":", label=label)


def _bare(figure: Figure, axes: Axes) -> Figure:
    axes.spines[["top", "right"]].set_visible(False)
    return figure
