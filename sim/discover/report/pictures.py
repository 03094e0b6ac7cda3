"""The report's plots: residuals with and without an effect, along the flight and over the field, and free curves.

The joint residual of many shots in one free number (launch speed, a push in flight) is the sum of their scores divided
by the sum of their information; in the height at the target, it is the shift that makes their outcomes most likely. All
plots are PHONE_IN wide, with the panels one below the other, so that their text is legible on a phone.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from jaxtyping import Bool, Float, Int
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from truearc.sim.discover.decide import Step
from truearc.sim.discover.detect.battery import Asked
from truearc.sim.discover.detect.covariates import Covariate, CovariatePair, Factor, followed_column
from truearc.sim.discover.detect.localization import Place, curve_of, joint_bands
from truearc.sim.discover.identifiability import Sight
from truearc.sim.discover.report.finding_text import part_unit, plain, scale_of
from truearc.sim.infer.launcher import LauncherFit
from truearc.sim.infer.likelihood.score_table import Array, PlaneScores, ScoreTable
from truearc.sim.physics.catalogue import Catalogue
from truearc.sim.report import AFTER, BEFORE, INK, PHONE_IN, new_figure, new_panels
from truearc.sim.statistics import Z90

MOST_BINS, BIN_SHOTS = 8, 6
MOST_GROUPS = 3
FEWEST = 3                            # shots of a bin
SHIFTS, MOST_SPREADS = 201, 5.0       # of heights that are tried, as far as this number of spreads of one shot
AT_STAGE = 3.0                        # weight of numbers of the stage where it happens
# Chosen: of about fifty that eight bins explain, chance moves a third
PLAIN, AS_MUCH = "distance_m", 0.67   # what is preferred, where it explains this share of what most does
Along = Covariate | Factor


@dataclass(frozen=True)
class LinearResiduals:
    """Score and information [n] of a column."""

    score: Float[Array, " n"]
    information: Float[Array, " n"]

    def estimate(self, chosen: Bool[Array, " n"]) -> tuple[float, float]:
        """(residual, standard error) of the chosen shots [n]: by information, or by how these differ if that is more.

        nan where they have no information.
        """
        score, information = self.score[chosen], self.information[chosen]
        if len(score) < FEWEST or not information.sum() > 0.0:
            return np.nan, np.nan
        value = score.sum() / information.sum()
        spread = max(float(((score - information * value)**2).sum()), float(information.sum()))
        return float(value), float(np.sqrt(spread) / information.sum())


@dataclass(frozen=True)
class Heights:
    """Observed and expected heights at the plane, of the shots `rows` of n."""

    plane: PlaneScores
    shots: int

    def estimate(self, chosen: Bool[Array, " n"]) -> tuple[float, float]:
        """(common shift of heights in m, uphill from none, its standard error by the likelihood); nan: none to be had.

        A miss that may have been high or low has a second summit far off, which is implausible.
        """
        plane = self.plane
        mine = np.flatnonzero(chosen[plane.rows])
        if len(mine) < FEWEST:
            return np.nan, np.nan
        seen, mean_m, spread_m = plane.seen.take(mine), plane.mean_m[mine], plane.spread_m[mine]
        shifts = np.linspace(-1.0, 1.0, SHIFTS) * MOST_SPREADS * float(np.median(spread_m))
        value = np.array([seen.log_likelihood(mean_m + shift, spread_m).sum() for shift in shifts])
        best = _uphill(value, SHIFTS // 2)
        low = best - int(np.argmax(value[best::-1] < value[best] - 0.5))
        high = best + int(np.argmax(value[best:] < value[best] - 0.5))
        if low == best or high == best:
            return np.nan, np.nan
        return float(shifts[best]), float((shifts[high] - shifts[low]) / 2.0)


def _uphill(value: Float[Array, " shifts"], start: int) -> int:
    """Index of the summit that one comes to from `start`."""
    here = start
    while True:
        best = max(range(max(here - 1, 0), min(here + 2, len(value))), key=lambda k: value[k])
        if value[best] <= value[here]:
            return here
        here = best


Part = LinearResiduals | Heights


@dataclass(frozen=True)
class Residual:
    """One number before and after; `factor` turns it into `unit` as people say it.

    column: of the evidence, None for the height at the target. stage: where such a change happens. after None: nothing
    was put in.
    """

    name: str
    column: int | None
    stage: str
    factor: float
    unit: str
    before: Part
    after: Part | None


@dataclass(frozen=True)
class Bins:
    """Where each shot [n] belongs (-1 nowhere), and the bins' middles [B]; labels of groups, else empty."""

    name: str
    index: Int[Array, " n"]
    middle: Float[Array, " B"]
    labels: tuple[str, ...] = ()


def evidence_after(step: Step) -> ScoreTable:
    """With the step's name fitted in, or with the free curve, each shot's from the other folds, where it has none."""
    if not step.unknown:
        return step.fitted.beside(step.refit).scores
    if step.place is None:
        return step.fitted.scores
    return step.place.correction.scores.moved(step.place.correction.after)       # the test's column, then the shared


def residuals_of(before: ScoreTable, after: ScoreTable | None, tracked: bool) -> tuple[Residual, ...]:
    """The height at the target; with tracks also launch, distance and pushes throughout the flight."""
    found = []
    if before.plane is not None:
        later = None if after is None or after.plane is None else Heights(after.plane, len(after.rows))
        found.append(Residual(before.plane.seen.quantity, None, "arrival", 100.0, "cm",
                              Heights(before.plane, len(before.rows)), later))
    for k, column in enumerate(before.columns[:before.first_shared] if tracked else ()):
        # a wrong distance is seen in nothing but the height
        plain = column.kind == "free" and column.stage != "sensing" and not column.follows
        if plain and (before.info[:, k, k] > 0.0).any():
            factor, unit = scale_of(column.unit)
            there = None if after is None else next(
                (_linear(after, number) for number, one in enumerate(after.columns) if one.name == column.name), None)
            found.append(Residual(column.name, k, column.stage, factor, unit.strip(), _linear(before, k), there))
    return tuple(found)


def _linear(evidence: ScoreTable, column: int) -> LinearResiduals:
    return LinearResiduals(evidence.score[:, column], evidence.info[:, column, column])


def find_along(name: str | None, along: Sequence[Along]) -> Along | None:
    """The covariate or factor of that name, under any of its names."""
    for one in along:
        names = one.names if isinstance(one, Covariate) else (one.name,)
        if name in names:
            return one
    return None


def bins_of(along: Along, rows: Int[Array, " n"]) -> Bins:
    """Even shares of the shots, the distinct values of a covariate with few, the levels of a factor."""
    if isinstance(along, Factor):
        return Bins(along.name, along.codes[rows], np.arange(len(along.levels), dtype=float), along.levels)
    values = along.values[rows]
    known = np.isfinite(values)
    distinct = np.unique(values[known])
    if len(distinct) <= MOST_BINS:
        index = np.searchsorted(distinct, np.where(known, values, distinct[0]))
        return Bins(along.name, np.where(known, index, -1), distinct)
    count = int(np.clip(known.sum() // BIN_SHOTS, 2, MOST_BINS))
    edges = np.unique(np.quantile(values[known], np.linspace(0.0, 1.0, count + 1)))
    index = np.where(known, np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2), -1)
    middle = np.array([values[index == k].mean() if (index == k).any() else np.nan for k in range(len(edges) - 1)])
    return Bins(along.name, index, middle)


def binned(part: Part, bins: Bins) -> tuple[Float[Array, " B"], Float[Array, " B"]]:
    """(residual, standard error) [B]; nan where the shots of a bin have no information on it."""
    found = np.array([part.estimate(bins.index == k) for k in range(len(bins.middle))]).reshape(-1, 2)
    return found[:, 0], found[:, 1]


def choose(residuals: Sequence[Residual], along: Sequence[Along], rows: Int[Array, " n"],
           stage: str | None = None) -> tuple[Residual, Along] | None:
    """The number and what to draw it against in which what was put in explains most.

    Numbers of the stage where it happens count for more. The distance is preferred where what explains more does so by
    chance, and where nothing was put in. Groups are drawn against only where nothing else is asked for.
    """
    found: list[tuple[float, Residual, Along]] = []
    for one in [each for each in along if isinstance(each, Covariate)] or along:
        bins = bins_of(one, rows)
        for residual in residuals:
            gained = _roughness(residual.before, bins)
            gained -= 0.0 if residual.after is None else _roughness(residual.after, bins)
            gained *= AT_STAGE if residual.stage == stage and gained > 0.0 else 1.0
            found.append((gained, residual, one))
    most = max((gained for gained, *_ in found), default=0.0)
    plain = [one for one in found if one[2].name == PLAIN and (one[0] >= AS_MUCH * most or one[1].after is None)]
    return max(plain or found, key=lambda one: one[0])[1:] if found else None


def _roughness(part: Part, bins: Bins) -> float:
    """Log-likelihood that the bins' values explain, times two, less its expectation by chance."""
    value, error = binned(part, bins)
    known = np.isfinite(value) & (error > 0.0)
    return float((((value[known] / error[known])**2) - 1.0).sum())


def stated_covariate(step: Step, along: Sequence[Along], first: str | None) -> str | None:
    """The covariate that the named term follows, or else the one that the finding states."""
    if not step.unknown:
        followed = followed_column(step.column.follows, (one for one in along if isinstance(one, Covariate)))
        if followed is not None:
            return followed
    return first if step.base == () else None


@dataclass(frozen=True)
class View:
    """The residual and the covariate in which an effect shows best; step None: nothing was found. stated: the covariate
    that it follows."""

    step: Step | None
    before: ScoreTable
    after: ScoreTable | None
    stated: Along | None
    residual: Residual
    against: Along


def views_of(fitted: LauncherFit, asked: Asked, steps: Sequence[Step], first: str | None) -> Iterator[View]:
    """One view per step, or one of the fit alone; none where nothing that was recorded varies."""
    single = (test.what for test in asked.tests if isinstance(test.what, Covariate | Factor))
    along = tuple({what.name: what for what in single}.values())
    for step in steps or (None,):
        before, after, stated, stage = fitted.scores, None, None, None
        if step is not None:
            before, after = step.fitted.scores, evidence_after(step)
            where = step.column if not step.unknown else None if step.place is None else step.place.column
            stage = None if where is None else where.stage
            stated = find_along(stated_covariate(step, along, first), along)
        chosen = choose(residuals_of(before, after, fitted.model.data.samples is not None),
                        along if stated is None else (stated,), before.rows, stage)
        if chosen is not None:
            yield View(step, before, after, stated, *chosen)


def halves(along: Along | None, rows: Int[Array, " n"]) -> list[tuple[str, Bool[Array, " n"]]]:
    """All shots (no label), or those low and high in a covariate, or by the levels of a factor of two or three."""
    if isinstance(along, Factor) and len(along.levels) <= MOST_GROUPS:
        return [(f"{along.name} {level}", along.codes[rows] == k) for k, level in enumerate(along.levels)]
    if isinstance(along, Covariate):
        values = along.values[rows]
        middle = float(np.nanmedian(values))
        low, high = values <= middle, values > middle
        if low.any() and high.any():
            return [(f"{along.name} to {middle:.3g}", low), (f"{along.name} above", high)]
    return [("", np.ones(len(rows), dtype=bool))]


STAGE_COLOURS = {"sensing": "#7a56a8", "launch": "#c2571a", "flight": "#1f5fa8", "arrival": "#2f7d4f"}
DIRECTIONS = ("along", "vertical", "lateral")
DIRECTION_LABELS = {"along": "along the flight", "vertical": "up across the flight", "lateral": "to the left"}
CELL_SHOTS, MOST_CELLS, FEWEST_CELLS = 9, 5, 2
FEWEST_SHOTS = 4                      # of a cell that is drawn
SURE_SD = 5.0                         # standard errors at which a cell has its full colour
LEAST_INFORMATION = 1e-3              # of the fullest band's; less is not drawn
Series = Sequence[tuple[str, ScoreTable, str]]
Each = Float[Array, " n"]             # a number of each shot
Edges = Sequence[Float[Array, " _"]]
Cells = Float[Array, "across up"]
Shown = TypeVar("Shown")


def residual_figure(residual: Residual, along: Along, rows: Int[Array, " n"], what: str) -> Figure:
    """Residual by bins of `along`, as simulated, and below with `what` put in (when something was)."""
    bins, parts = bins_of(along, rows), _both(residual.before, residual.after, what)
    figure, panels = new_panels(PHONE_IN, 1.3 + 1.4 * len(parts), len(parts), sharex=True, sharey=True)
    for axes, (title, part, colour) in zip(panels, parts, strict=True):
        _points(axes, bins, part, residual.factor, colour)
        axes.set_title(title, loc="left", fontsize=11, color=colour, fontweight="bold")
    panels[-1].set_xlabel(_worded(bins.name))
    figure.supylabel(f"{residual.name},\nreal − simulated [{residual.unit}]", fontsize=10)
    if residual.after is not None:
        gone = (binned(residual.before, bins)[0] - binned(residual.after, bins)[0]) * residual.factor
        panels[0].plot(bins.middle, gone, color=AFTER, lw=2.0, alpha=0.8, zorder=1, label=f"{what}, as fitted")
        panels[0].legend(frameon=False, fontsize=9)
    return figure


def _both(before: Shown, after: Shown | None, what: str) -> list[tuple[str, Shown, str]]:
    """(title, what is shown, colour) as simulated, and with `what` put in where something was."""
    return [("as simulated", before, BEFORE), *([] if after is None else [(f"with {what}", after, AFTER)])]


def _points(axes: Axes, bins: Bins, part: Part, factor: float, colour: str) -> None:
    value, error = binned(part, bins)
    axes.axhline(0.0, color=INK, lw=0.9)
    axes.errorbar(bins.middle, value * factor, error * factor, fmt="o", ms=6, color=colour, elinewidth=1.4, capsize=2.5)
    if bins.labels:
        axes.set_xticks(bins.middle, bins.labels)
    elif len(bins.middle) <= 3:
        axes.set_xticks(bins.middle, [f"{middle:.3g}" for middle in bins.middle])
    axes.margins(x=0.08)
    axes.tick_params(labelsize=9)


def draw_curve(place: Place) -> Figure | None:
    """The free curve of an unexplained effect, fitted to all shots, less its mean; None where it is the same in all."""
    what, column = place.test.what, place.column
    if what is None:
        return None
    value, sd = curve_of(place.correction)
    rows, (factor, unit) = place.correction.scores.rows, scale_of(column.unit)
    value, reach = value * factor, Z90 * sd * factor
    figure, (axes,) = new_panels(PHONE_IN, 3.0)
    if isinstance(what, CovariatePair):
        seen = axes.scatter(what.first.values[rows], what.second.values[rows], c=value, cmap="RdBu_r", s=18,
                            vmin=-np.abs(value).max(), vmax=np.abs(value).max(), edgecolor=INK, lw=0.3)
        figure.colorbar(seen, ax=axes, label=f"{column.name} [{unit.strip()}]")
        axes.set(xlabel=_worded(what.first.name), ylabel=_worded(what.second.name))
    else:
        _curve(axes, what, rows, value, reach)
        axes.axhline(0.0, color=INK, lw=0.9)
        axes.set(xlabel=_worded(what.name), ylabel=f"change of {column.name}\n[{unit.strip()}]")
    axes.tick_params(labelsize=9)
    return figure


def _curve(axes: Axes, what: Covariate | Factor, rows: Int[Array, " n"], value: Each, reach: Each) -> None:
    """A line with its 90 % band over a number, which ticks at the bottom mark; a point for each group."""
    if isinstance(what, Factor):
        codes, first = np.unique(what.codes[rows], return_index=True)
        axes.errorbar(codes, value[first], reach[first], fmt="o", ms=6, color=AFTER, elinewidth=1.4, capsize=2.5)
        axes.set_xticks(codes, [what.levels[code] if code >= 0 else "unknown" for code in codes])
        return
    at, first = np.unique(what.values[rows], return_index=True)
    first, at = first[np.isfinite(at)], at[np.isfinite(at)]
    axes.fill_between(at, value[first] - reach[first], value[first] + reach[first], color=AFTER, alpha=0.2, lw=0)
    axes.plot(at, value[first], color=AFTER, lw=2.0)
    axes.plot(at, np.zeros(len(at)), "|", color=INK, ms=5, alpha=0.5, transform=axes.get_xaxis_transform())


def draw_flight(before: ScoreTable, after: ScoreTable | None, what: str,
               groups: Sequence[tuple[str, Bool[Array, " n"]]]) -> Figure | None:
    """Missing acceleration by flight time, a row a group of shots (label, [n] booleans); None without bands."""
    if not any(column.times_s for column in before.columns):
        return None
    directions = [way for way in DIRECTIONS if _bands(before, way)]
    figure = new_figure(PHONE_IN, 1.0 + 1.7 * len(directions))
    grid = figure.subplots(len(directions), len(groups), sharex=True, sharey=True, squeeze=False)
    for row, way in zip(grid, directions, strict=True):
        for axes, (label, chosen) in zip(row, groups, strict=True):
            _band_panel(axes, way, _both(before, after, what), chosen)
            axes.set_title(f"{DIRECTION_LABELS[way]}\n{label}" if label else DIRECTION_LABELS[way], loc="left",
                           fontsize=9)
    figure.supxlabel("time in flight [s]", fontsize=10)
    figure.supylabel("real − simulated [m/s²]", fontsize=10)
    figure.legend(*grid[0, -1].get_legend_handles_labels(), loc="outside upper left", ncols=1, frameon=False,
                  fontsize=9)
    return figure


def _bands(evidence: ScoreTable, direction: str) -> list[int]:
    """Columns of a direction's bands that the data say something of."""
    bands = [k for k, column in enumerate(evidence.columns) if column.times_s and column.direction == direction]
    size = [float(evidence.info[:, k, k].sum()) for k in bands]
    return [k for k, each in zip(bands, size, strict=True) if each > LEAST_INFORMATION * max(size)]


def _band_panel(axes: Axes, direction: str, series: Series, chosen: Bool[Array, " n"]) -> None:
    axes.axhline(0.0, color=INK, lw=0.9)
    for number, (label, evidence, colour) in enumerate(series):
        bands = _bands(evidence, direction)
        if not bands:                 # of a correction that shares the columns of this direction
            continue
        amplitude = joint_bands(evidence, bands, chosen.astype(float))
        error = _band_errors(evidence, bands, chosen, amplitude)
        spans = np.array([evidence.columns[k].times_s for k in bands])
        spans[~np.isfinite(spans)] = 2.0 * spans[-1, 0] - spans[-2, 0] if len(spans) > 1 else 1.0
        shift = (number - 0.5 * (len(series) - 1)) * 0.25 * np.diff(spans, axis=1)[:, 0]
        axes.errorbar(spans.mean(1) + shift, amplitude, error, fmt="o", ms=5, color=colour, elinewidth=1.4, capsize=2,
                      label=label)
    axes.tick_params(labelsize=9)


def _band_errors(evidence: ScoreTable, bands: Sequence[int], chosen: Bool[Array, " n"],
                 amplitude: Float[Array, " bands"]) -> Float[Array, " bands"]:
    """Standard errors from how the shots differ among themselves (sandwich)."""
    info = evidence.info[chosen][:, bands][:, :, bands]
    left = evidence.score[chosen][:, bands] - info @ amplitude
    bread = np.linalg.inv(info.sum(0) + 1e-9 * np.trace(info.sum(0)) * np.eye(len(bands)))
    return np.sqrt(np.maximum(np.diag(bread @ (left.T @ left) @ bread), 0.0))


def draw_field(residual: Residual, across: tuple[str, Each], up: tuple[str, Each], what: str) -> Figure | None:
    """Mean residual in cells of two settings (name, [n]), before and after; None where a setting hardly varies."""
    count = int(np.clip(np.sqrt(len(across[1]) / CELL_SHOTS), FEWEST_CELLS, MOST_CELLS))
    edges = [_edges(values, count) for _, values in (across, up)]
    if any(len(edge) < 3 for edge in edges):
        return None
    parts = _both(residual.before, residual.after, what)
    figure, panels = new_panels(PHONE_IN, 1.2 + 2.7 * len(parts), len(parts), sharex=True, sharey=True)
    for axes, (title, part, colour) in zip(panels, parts, strict=True):
        values, error = _cells(part, (across[1], up[1]), edges)
        image = axes.pcolormesh(*edges, (values / error).T, cmap="RdBu_r", vmin=-SURE_SD, vmax=SURE_SD,
                                edgecolor="white", lw=1.5)
        _write_cells(axes, edges, values * residual.factor, values / error)
        axes.set_title(title, loc="left", fontsize=11, color=colour, fontweight="bold")
        axes.set_ylabel(up[0])
    panels[-1].set_xlabel(across[0])
    figure.colorbar(image, ax=list(panels), location="bottom", aspect=30,
                    label=f"colour: standard errors from 0\nnumbers: {residual.name} [{residual.unit}]")
    return figure


def _edges(values: Each, count: int) -> Float[Array, " edges"]:
    known = values[np.isfinite(values)]
    return np.unique(np.quantile(known, np.linspace(0.0, 1.0, count + 1))) if len(known) else np.zeros(0)


def _cells(part: Part, settings: tuple[Each, Each], edges: Edges) -> tuple[Cells, Cells]:
    """(mean residual, its standard error) [across, up]; nan in cells that hardly any shot is in."""
    place = [np.clip(np.searchsorted(edge, values, side="right") - 1, 0, len(edge) - 2)
             for edge, values in zip(edges, settings, strict=True)]
    index = np.ravel_multi_index(place, (len(edges[0]) - 1, len(edges[1]) - 1))
    shape = tuple(len(edge) - 1 for edge in edges)
    value, error = binned(part, Bins("cell", index, np.zeros(int(np.prod(shape)))))
    value[np.bincount(index, minlength=len(value)) < FEWEST_SHOTS] = np.nan
    return value.reshape(shape), np.maximum(error, 1e-12).reshape(shape)


def _write_cells(axes: Axes, edges: Edges, values: Cells, sure: Cells) -> None:
    middles = [(edge[1:] + edge[:-1]) / 2.0 for edge in edges]
    for i, j in np.argwhere(np.isfinite(values)):
        axes.text(middles[0][i], middles[1][j], _signed(values[i, j]), ha="center", va="center", fontsize=8.5,
                  color="white" if abs(sure[i, j]) > 0.6 * SURE_SD else "#1a1c20")


def _signed(value: float) -> str:
    return f"{value:+.0f}" if abs(value) >= 10.0 else f"{value:+.2g}"


def draw_sight(sight: Sight, among: Catalogue | None = None) -> Figure | None:
    """Shots needed for each effect at its usual size, on a log scale; None where no number of shots would do."""
    seen = [one for one in sight.terms if one.shots_needed is not None]
    if not seen:
        return None
    figure, (axes,) = new_panels(PHONE_IN, 1.3 + 0.24 * len(seen))
    for row, one in enumerate(reversed(seen)):
        needed = one.shots_needed or 1
        axes.barh(row, needed, left=0.8, height=0.68, color=STAGE_COLOURS[one.stage],
                  alpha=1.0 if needed <= sight.shots else 0.45)
        axes.text(needed * 1.15 + 0.8, row, f"{needed:,}".replace(",", " "), va="center", fontsize=8, color=INK)
    axes.set_yticks(range(len(seen)), [plain(one.term, among) for one in reversed(seen)])
    axes.set_xscale("log")
    axes.set_xlim(0.8, 12.0 * max(max(one.shots_needed or 1 for one in seen), sight.shots))
    axes.axvline(sight.shots, color=INK, lw=1.2, ls="--", zorder=0)
    axes.text(sight.shots, len(seen) - 0.35, f" {sight.shots} shots", fontsize=9, color=INK, va="bottom")
    axes.set_ylim(-0.6, len(seen) + 0.3)
    axes.set_xlabel("shots needed to see it at its usual size,\nfour times in five")
    stages = [stage for stage in STAGE_COLOURS if any(one.stage == stage for one in seen)]
    figure.legend(handles=[Patch(color=STAGE_COLOURS[stage], label=stage) for stage in stages], frameon=False,
                  loc="outside upper right", ncols=len(stages), fontsize=8.5, handlelength=1.0, columnspacing=1.0)
    axes.tick_params(labelsize=9)
    return figure


def _worded(name: str) -> str:
    """A column's name with its unit in brackets, where it ends in one."""
    rest, unit = part_unit(name)
    return rest.replace("_", " ") + f" [{unit}]" * bool(unit)
