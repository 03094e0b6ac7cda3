"""The paper's grid search (sections III-A and IV-C) over all pairs of drag and lift coefficients on a square grid.

`fit_grid` simulates all pairs and chooses one; `score` rates coefficients by the paper's measures (Table I); `explain`
and `draw_map` report the fit.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from importlib.metadata import version
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from truearc.errors import InputError
from truearc.robot.config.rig_spec import Rig
from truearc.robot.config.targets import refuse_up
from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.data.files import hash_dataset
from truearc.sim.infer.belief import launcher_of, ranges_of
from truearc.sim.paper import HIGH, LOW, STEP
from truearc.sim.paper.grid_labels import THREE as LABEL_THREE
from truearc.sim.paper.grid_labels import Flyer, Hits, find_hits, fly_pairs, make_flyer
from truearc.sim.physics.simulate import MISS, THREE, TWO, classify, launch_of, opening_of, predict, require
from truearc.sim.printed import Progress
from truearc.sim.report import new_figure

MAX_PARTS = 10000                     # of the range: a hundred times the paper's pairs
LISTED, SHOWN = 30, 10                # up to LISTED ties are listed in full; of more, SHOWN
FEW_THREES = 10
MAX_OUTLINED = 5000                   # tied pairs drawn one by one
ZOOM_POINTS = 90                      # a side at most, of the picture's second panel
POOR_THREE, POOR_TWO = 0.6, 0.8       # the paper reports 0.92 and 0.98 on the shots it was fitted to


@dataclass(frozen=True)
class GridFit:
    """The map over the grid and the pair chosen from it. Maps are [len(axis), len(axis)]: row = cd, column = cl.

    `share_three`: of the shots whose outcome is three, those flown within the three's bounds. `share_two`: of those
    whose outcome is two or three, those flown within the two's. `tied`: best in share_three, and among those in
    share_two. `ties` [k, 4]: cd, cl, mean and median of |height - centre| in m over the shots whose outcome is three,
    for each tied pair, the chosen one first; infinite where a shot (for the median: half of them) is not reached.
    """

    axis: np.ndarray
    share_three: np.ndarray
    share_two: np.ndarray
    tied: np.ndarray
    ties: np.ndarray
    cd: float                         # the chosen pair, and its deviations
    cl: float
    mean_m: float
    median_m: float
    median_pair: tuple[float, float]  # (cd, cl) of the least median deviation among the tied
    shots_three: int
    shots_two: int
    hits: Hits

    @property
    def coefficients(self) -> dict[str, dict[str, float]]:
        return {"drag": {"cd": self.cd}, "magnus": {"cl": self.cl}}


@dataclass(frozen=True)
class Scoring:
    """The shots that the paper's measures count, ready to fly."""

    flyer: Flyer
    is_three: np.ndarray              # [launches]; the others' outcome is two
    target: tuple[float, float, float]  # centre, three's and two's half height in m

    def deviation_m(self, cd: np.ndarray, cl: np.ndarray) -> np.ndarray:
        """|height - centre| [pairs, shots whose outcome is three], infinite where not reached."""
        threes = replace(self.flyer, launch=self.flyer.launch[self.is_three])
        return np.nan_to_num(np.abs(fly_pairs(threes, cd, cl) - self.target[0]), nan=np.inf)


def fit_grid(rig: Rig, shots: Shots, step: float = STEP, progress: Progress = lambda done, note: None) -> GridFit:
    """Fly every scoring shot with every pair of the grid and choose as the paper does.

    First the share of three-point shots flown into the three, then of scoring shots into the two, then the least mean
    deviation (and least median, cd, cl, should that tie too). Shots whose outcome is miss or unknown play no part: the
    paper's measures do not count them. InputError: no shot with outcome three, no target, a step that does not divide
    5, or no pair that puts a single shot where it went.
    """
    axis = make_axis(step)
    progress(0.0, "the law of motion is compiled when it is new")
    scoring = make_scoring(rig, shots)
    hits = find_hits(scoring.flyer, axis, scoring.target, progress)
    three, two = count_hits(hits, scoring.is_three, axis.size)
    if not two.any():
        raise InputError("no pair of coefficients puts any of the scoring shots into the target: distances, launch, "
                       "release height and target of rig.toml cannot all be right")
    tied = (three == three.max()) & (two == two[three == three.max()].max())
    ties = rank_ties(scoring, axis, np.flatnonzero(tied.ravel()))
    median_pair = ties[np.lexsort((ties[:, 1], ties[:, 0], ties[:, 3]))[0], :2]
    cd, cl, mean_m, median_m = ties[0].tolist()
    threes = int(scoring.is_three.sum())
    return GridFit(axis, three.T / threes, two.T / len(scoring.is_three), tied.T, ties, cd, cl, mean_m, median_m,
                   (float(median_pair[0]), float(median_pair[1])), threes, len(scoring.is_three) - threes, hits)


def make_axis(step: float) -> np.ndarray:
    """Return the grid's values of one coefficient; InputError if the step does not divide the range."""
    parts = (HIGH - LOW) / step if step > 0.0 else 0.0
    if not parts <= MAX_PARTS:
        raise InputError(f"--step: {step:g} is too fine; {(HIGH - LOW) / MAX_PARTS:g} is the least")
    if parts < 1.0 or abs(parts - round(parts)) > 1e-6:
        raise InputError(f"--step: {step:g} does not divide the range {LOW:g} to {HIGH:g}")
    return np.linspace(LOW, HIGH, round(parts) + 1)


def make_scoring(rig: Rig, shots: Shots) -> Scoring:
    """Return the shots whose outcome is two or three; InputError if none is a three or the rig has no target."""
    if rig.target is None:
        raise InputError("rig.toml: target.centre_height_m: missing key; state the opening in [target]"
                         ": the fit is by outcomes")
    refuse_up(rig.target, "the paper's method")
    outcome = np.array(shots.text("outcome"))
    if not (outcome == THREE).any():
        raise InputError(f"{shots.source}: outcome: fit by grid needs at least one shot whose outcome is three")
    scoring = shots.take(np.flatnonzero((outcome == THREE) | (outcome == TWO)))
    flyer = make_flyer(rig, launch_of(rig, scoring), require(scoring, "distance_m"))
    target = (rig.target.centre_height_m, rig.target.three_half_height_m, rig.target.two_half_height_m)
    return Scoring(flyer, np.array(scoring.text("outcome")) == THREE, target)


def count_hits(hits: Hits, is_three: np.ndarray, points: int) -> tuple[np.ndarray, np.ndarray]:
    """Return maps [cl, cd]: three-shots flown into the three, and all shots flown into the two."""
    in_three = (hits.label >= LABEL_THREE) & is_three[hits.launch]
    three, two = (np.bincount(pair, minlength=points**2) for pair in (hits.pair[in_three], hits.pair))
    return three.reshape(points, points), two.reshape(points, points)


def rank_ties(scoring: Scoring, axis: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Return GridFit.ties of pairs given as flat indices of [cl, cd]."""
    cl, cd = axis[pairs // axis.size], axis[pairs % axis.size]
    deviation_m = scoring.deviation_m(cd, cl)
    mean_m, median_m = deviation_m.mean(axis=1), np.median(deviation_m, axis=1)
    return np.stack([cd, cl, mean_m, median_m], axis=1)[np.lexsort((cl, cd, median_m, mean_m))]


def map_deviation(rig: Rig, shots: Shots, cd: np.ndarray, cl: np.ndarray) -> np.ndarray:
    """Return the mean deviation in m of three-shots for each pair, infinite if one does not reach the plane.

    cd and cl are arrays of one shape, and so is the result. Flies every pair, at about a microsecond per pair and shot.
    """
    mean_m: np.ndarray = make_scoring(rig, shots).deviation_m(np.ravel(cd), np.ravel(cl)).mean(axis=1)
    return mean_m.reshape(np.shape(cd))


class Score(NamedTuple):
    """Shares in 0-1, nan where no shot counts; deviations in m of the shots whose outcome is three.

    `three`: of shots with outcome three, those flown into the three. `two`: of shots with outcome two or three, those
    flown into the two. `all`: of all shots with an outcome, those whose outcome is predicted exactly.
    """

    three: float
    two: float
    all: float
    mean_m: float
    median_m: float
    shots: int


def score(rig: Rig, coefficients: Mapping[str, Mapping[str, float]], shots: Shots) -> Score:
    """Predict every shot with an outcome and compare; a plane that is not reached is an infinite deviation."""
    known = shots.take(np.flatnonzero(np.isin(shots.text("outcome"), (MISS, TWO, THREE))))
    outcome = np.array(known.text("outcome"), dtype=str)
    height_m = predict(rig, coefficients, known).height_m
    opening = opening_of(rig, coefficients)
    said = classify(rig, height_m, opening)
    is_three = outcome == THREE
    deviation_m = np.nan_to_num(np.abs(height_m - opening.centre_m), nan=np.inf)[is_three]
    return Score(_share((said == THREE)[is_three]), _share((said != MISS)[outcome != MISS]), _share(said == outcome),
                 float(np.mean(deviation_m)) if is_three.any() else np.nan,
                 float(np.median(deviation_m)) if is_three.any() else np.nan, len(known))


def _share(hits: Bool[np.ndarray, " n"]) -> float:
    return float(np.mean(hits)) if hits.size else float("nan")


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
    """Return the origin of the chosen pair, as plain values for the coefficients file."""
    said = {"method": "grid", "step": step, "dataset": dataset.name, "dataset_sha256": hash_dataset(dataset),
            "truearc": version("truearc"), "tied_pairs": len(fit.ties), "shots_three": fit.shots_three,
            "shots_two": fit.shots_two, "accuracy_three": scored.three, "accuracy_two": scored.two,
            "range": ranges_of(dataset.shots), "rig": launcher_of(dataset.rig)}
    return said | {name: value for name, value in (("mean_deviation_m", fit.mean_m),
                                                   ("median_deviation_m", fit.median_m)) if np.isfinite(value)}
