"""The grid fit as text, as a picture, and as the provenance of its coefficients."""

import math
from collections.abc import Iterator
from importlib.metadata import version
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from truearc.sim.data.dataset import Dataset
from truearc.sim.data.files import hash_dataset
from truearc.sim.infer.belief import launcher_of, ranges_of
from truearc.sim.paper.grid_fit import GridFit, map_deviation
from truearc.sim.paper.score import Score
from truearc.sim.paper.settings import HIGH, LOW
from truearc.sim.report import new_figure

LISTED, SHOWN = 30, 10                # up to LISTED ties are listed in full; of more, SHOWN
FEW_THREES = 10
MAX_OUTLINED = 5000                   # tied pairs drawn one by one
ZOOM_POINTS = 90                      # a side at most, of the picture's second panel
POOR_THREE, POOR_TWO = 0.6, 0.8       # the paper reports 0.92 and 0.98 on the shots it was fitted to


def explain(dataset: Dataset, fit: GridFit, scored: Score) -> list[str]:
    """Report the fit line by line: the pair, those tied with it, and warnings."""
    return [*_found(dataset, fit), *_ties(fit), *_chosen(fit, scored), *_warnings(fit)]


def _found(dataset: Dataset, fit: GridFit) -> Iterator[str]:
    scoring = fit.shots_three + fit.shots_two
    aside = len(dataset.shots) - scoring
    yield f"fitted to {fit.shots_three} three and {fit.shots_two} two"
    if aside:
        yield (f"{aside} other shots of {len(dataset.shots)} do not count in the paper's measures (misses, no outcome)")
    three, two = fit.share_three.max(), float(fit.share_two[fit.tied][0])
    yield (f"pairs tried: {fit.axis.size} x {fit.axis.size} of drag (cd) and lift (cl). The best of them fly "
           f"{round(three * fit.shots_three)} of the {fit.shots_three} three-pointers into the three and "
           f"{round(two * scoring)} of all {scoring} scoring shots into the two")


def _ties(fit: GridFit) -> Iterator[str]:
    count = len(fit.ties)
    if count == 1:
        yield "one pair does so"
        return
    (cd_low, cl_low), (cd_high, cl_high) = fit.ties[:, :2].min(axis=0), fit.ties[:, :2].max(axis=0)
    yield (f"{count} pairs do so equally well (tied): cd {cd_low:.3f} to {cd_high:.3f}, cl {cl_low:.3f} to "
           f"{cl_high:.3f}. The outcomes alone cannot tell them apart; ranked by how close to the centre they fly the "
           "three-pointers:")
    yield "     cd     cl  mean off by  median off by"
    for cd, cl, mean_m, median_m in fit.ties[:count if count <= LISTED else SHOWN]:
        yield f"  {cd:5.3f}  {cl:5.3f}  {_metres(mean_m):>11}  {_metres(median_m):>13}"
    if count > LISTED:
        yield f"  and {count - SHOWN} more (--tied FILE.csv writes all)"


def _chosen(fit: GridFit, scored: Score) -> Iterator[str]:
    yield f"chosen: cd {fit.cd:.3f}, cl {fit.cl:.3f}, the least mean deviation among the tied"
    if math.isfinite(fit.mean_m):
        yield (f"  with it the three-pointers pass {fit.mean_m:.3f} m off the centre in the mean, {fit.median_m:.3f} m "
               "in the median")
    else:
        yield ("  with it, as with every tied pair, some of the three-pointers do not reach the target at all, so that "
               "there is no mean deviation; " + (f"the median is {fit.median_m:.3f} m" if math.isfinite(fit.median_m)
                                                  else "nor a median: it is half of them or more"))
    if math.isfinite(fit.median_m) and fit.median_pair != (fit.cd, fit.cl):
        yield f"  the least median deviation is elsewhere: cd {fit.median_pair[0]:.3f}, cl {fit.median_pair[1]:.3f}"
    yield (f"accuracy: three-point {scored.three:.2%}, two-point {scored.two:.2%}, all outcomes, misses included, "
           f"{scored.all:.2%} ({scored.shots} shots)")


def _warnings(fit: GridFit) -> Iterator[str]:
    for name, value in (("cd", fit.cd), ("cl", fit.cl)):
        if np.isclose(value, LOW) or np.isclose(value, HIGH):
            yield (f"warning: {name} = {value:g} is the edge of the search: the shots ask for still "
                   f"{'less' if np.isclose(value, LOW) else 'more'} than that, or do not depend on it. Check the "
                   "launch (speed, angle, release height in rig.toml)")
    if fit.share_three.max() < POOR_THREE or fit.share_two[fit.tied][0] < POOR_TWO:
        yield ("warning: no drag and lift explain these shots well. Something else is off: facts in rig.toml, labels, "
               "or physics that the simulator lacks; `truearc discover` says which")
    if fit.shots_three < FEW_THREES:
        yield (f"warning: only {fit.shots_three} three-pointer{'s' if fit.shots_three > 1 else ''}; every further one "
               "may move the choice (`truearc fit` gives intervals)")


def _metres(value: float) -> str:
    return f"{value:.4f} m" if math.isfinite(value) else "not reached"


def draw_map(dataset: Dataset, fit: GridFit) -> Figure:
    """Draw three-point accuracy over (C_d, C_l), and the mean deviation from the centre around the tied pairs.

    The first panel ends where no three-pointer is reproduced any more.
    """
    figure = new_figure(12.0, 4.8)
    whole, close = figure.subplots(1, 2)
    parts = (fit.share_three.any(axis=other) for other in (1, 0))
    cd, cl = (fit.axis[:int(np.flatnonzero(part)[-1] * 1.25) + 2] if part.any() else fit.axis for part in parts)
    image = whole.pcolormesh(cd, cl, fit.share_three.T[:len(cl), :len(cd)], cmap="viridis", shading="nearest",
                             rasterized=True)
    figure.colorbar(image, ax=whole, label="share of recorded three-pointers reproduced")
    whole.set_title("three-point accuracy")
    _mark(whole, fit, cd, cl)
    cd, cl = (_around(np.flatnonzero(fit.tied.any(axis=other)), fit.axis) for other in (1, 0))
    _draw_deviation(close, dataset, fit, cd, cl)
    _mark(close, fit, cd, cl)
    whole.add_patch(Rectangle((cd[0], cl[0]), np.ptp(cd), np.ptp(cl), fill=False, edgecolor="white", linewidth=0.8,
                              linestyle=":"))
    return figure


def _draw_deviation(axes: Axes, dataset: Dataset, fit: GridFit, cd: np.ndarray, cl: np.ndarray) -> None:
    every_cd, every_cl = np.meshgrid(cd, cl)
    reached = np.ma.masked_invalid(map_deviation(dataset.rig, dataset.shots, every_cd, every_cl))
    axes.set_facecolor("#c9ced6")     # where not every three-pointer reaches the target
    if reached.count():
        image = axes.pcolormesh(cd, cl, reached, cmap="magma_r", shading="nearest", rasterized=True,
                                vmax=float(np.quantile(reached.compressed(), 0.9)))
        axes.figure.colorbar(image, ax=axes, label="mean distance from the centre, m", extend="max")
    axes.set_title("around the tied pairs (grey: a three-pointer does not reach)")


def _mark(axes: Axes, fit: GridFit, cd: np.ndarray, cl: np.ndarray) -> None:
    """Outline the tied pairs, mark the chosen one, and set the limits to those of cd and cl."""
    half = 0.5 * (fit.axis[1] - fit.axis[0])
    for row, column in np.argwhere(fit.tied.T)[:MAX_OUTLINED]:
        corner = fit.axis[column] - half, fit.axis[row] - half
        axes.add_patch(Rectangle(corner, 2.0 * half, 2.0 * half, fill=False, edgecolor="#19c3d6", linewidth=1.0))
    axes.plot([], [], color="#19c3d6", label=f"tied pairs: {int(fit.tied.sum())}")
    axes.plot(fit.cd, fit.cl, marker="*", markersize=14, color="#ff5a4f", markeredgecolor="white", linestyle="none",
              label=f"chosen: C_d {fit.cd:.3f}, C_l {fit.cl:.3f}")
    axes.set(xlabel="C_d (drag)", ylabel="C_l (lift)", xlim=(cd[0] - half, cd[-1] + half),
             ylim=(cl[0] - half, cl[-1] + half))
    axes.legend(loc="upper right")


def _around(at: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """The part of the axis about its points `at`, with a margin, and not too many points of it."""
    margin = max(8, (at[-1] - at[0]) // 2)
    part = axis[max(0, at[0] - margin):at[-1] + margin + 1]
    return part[::-(-len(part) // ZOOM_POINTS)]


def provenance_of(step: float, dataset: Dataset, fit: GridFit, scored: Score) -> dict[str, Any]:
    """Return how the chosen pair came about, in plain values for the coefficients file."""
    said = {"method": "grid", "step": step, "dataset": dataset.name, "dataset_sha256": hash_dataset(dataset),
            "truearc": version("truearc"), "tied_pairs": len(fit.ties), "shots_three": fit.shots_three,
            "shots_two": fit.shots_two, "accuracy_three": scored.three, "accuracy_two": scored.two,
            "range": ranges_of(dataset.shots), "rig": launcher_of(dataset.rig)}
    return said | {name: value for name, value in (("mean_deviation_m", fit.mean_m),
                                                   ("median_deviation_m", fit.median_m)) if np.isfinite(value)}
