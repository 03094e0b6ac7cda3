"""What the report shows: the effect against what it follows, and along the flight."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from sim.discover.covariates import Factor
from sim.discover.evidence import Array, Evidence
from sim.discover.family import name_of
from sim.discover.locate import Place, joint_bands
from sim.report import make_png, new_figure

INK, DOTS, LINE = "#30343b", "#1f5fa8", "#c2571a"
POOLED_BINS = 10                      # where one shot says too little to be drawn by itself
READABLE = 4.0                        # times the middle error: shots that say less than that are not drawn alone


def covariate_png(evidence: Evidence, place: Place) -> bytes:
    """Amplitude that each shot (or bin of shots) asks for, against the covariate, with the free correction."""
    figure = new_figure()
    axes = figure.add_subplot()
    what, name = place.test.what, name_of(place.test, place.channel)
    values = _positions(evidence, place)
    x, y, error = _points(evidence, place, values)
    axes.axhline(0.0, color=INK, lw=0.8)
    axes.errorbar(x, y, error, fmt="o", ms=4.5, color=DOTS, ecolor=DOTS, elinewidth=0.8, alpha=0.75,
                  label="one shot" if len(x) == len(values) else "shots pooled")
    if not isinstance(what, Factor):
        order = np.argsort(values, kind="stable")
        axes.plot(values[order], _levelled(evidence, place)[order], color=LINE, lw=2.0, label="free correction")
    else:
        axes.set_xticks(range(len(what.levels)), what.levels)
    axes.set_xlabel(name if what is not None and name else "shot, in the order of the file")
    _finish(axes, f"{place.channel.name} [{_unit(place.channel.unit)}]\nmissing from the simulation")
    return make_png(figure)


def _levelled(evidence: Evidence, place: Place) -> Array:
    """The correction at the level of what the shots ask for: its own level is shared with the refitted coefficients."""
    line, k = place.correction.amplitude, place.test.channel
    weight = evidence.info[:, k, k]
    return line + (evidence.score[:, k].sum() - (weight * line).sum()) / weight.sum()


def flight_png(evidence: Evidence, place: Place) -> bytes | None:
    """Missing acceleration in bands of flight time, for shots low and high in the covariate; None without bands."""
    bands = [k for k, channel in enumerate(evidence.channels)
             if channel.times_s and channel.direction == place.channel.direction]
    if not bands:
        return None
    figure = new_figure()
    axes = figure.add_subplot()
    axes.axhline(0.0, color=INK, lw=0.8)
    for index, (label, chosen) in enumerate(_groups(evidence, place)):
        weights = chosen.astype(float)
        amplitude = joint_bands(evidence, bands, weights)
        error = _band_errors(evidence, bands, chosen, amplitude)
        middle, half = _band_spans(evidence, bands)
        axes.errorbar(middle, amplitude, error, half, fmt="o", ms=5, color=(DOTS, LINE)[index], elinewidth=1.6,
                      label=label)
    axes.set_xlabel("time since the first sample [s]")
    _finish(axes, f"acceleration {place.channel.direction} [m/s²]\nmissing from the simulation")
    return make_png(figure)


def _unit(unit: str) -> str:
    return "share" if unit == "1" else unit.replace("s2", "s²")


def _finish(axes: Axes, label: str) -> None:
    axes.set_ylabel(label)
    axes.spines[["top", "right"]].set_visible(False)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(frameon=False)


def _positions(evidence: Evidence, place: Place) -> Array:
    what = place.test.what
    if what is None:
        return np.arange(len(evidence.rows), dtype=float)
    return (what.codes if isinstance(what, Factor) else what.values)[evidence.rows].astype(float)


def _points(evidence: Evidence, place: Place, values: Array) -> tuple[Array, Array, Array]:
    """(x, amplitude, standard error) a shot, or pooled over bins where single shots say too little to be drawn."""
    u = evidence.score[:, place.test.channel]
    info = evidence.info[:, place.test.channel, place.test.channel]
    known = np.isfinite(values) & (info > 0.0)
    u, info, values = u[known], info[known], values[known]
    span = max(float(np.ptp(place.correction.amplitude)), float(np.abs(place.correction.amplitude).max()), 1e-12)
    if np.median(1.0 / np.sqrt(info)) < READABLE * span and evidence.kind != "outcomes":
        return values, u / info, 1.0 / np.sqrt(info)
    order = np.array_split(np.argsort(values, kind="stable"), min(POOLED_BINS, max(len(values) // 5, 1)))
    pooled = np.array([info[part].sum() for part in order])
    return (np.array([values[part].mean() for part in order]),
            np.array([u[part].sum() for part in order]) / pooled, 1.0 / np.sqrt(pooled))


def _groups(evidence: Evidence, place: Place) -> list[tuple[str, Array]]:
    """All shots, or the lower and upper part of the covariate (the group named, and the others)."""
    name = name_of(place.test, place.channel)
    if place.test.what is None or place.channel.follows:
        return [("all shots", np.ones(len(evidence.rows), dtype=bool))]
    values = _positions(evidence, place)
    if isinstance(place.test.what, Factor):
        inside = values == place.test.what.levels.index(place.test.shape)
        return [(f"{name} other than {place.test.shape}", ~inside), (f"{name} {place.test.shape}", inside)]
    middle = 0.5 * (np.nanmin(values) + np.nanmax(values))
    return [(f"{name} below {middle:.3g}", values <= middle), (f"{name} above {middle:.3g}", values > middle)]


def _band_spans(evidence: Evidence, bands: Sequence[int]) -> tuple[Array, Array]:
    spans = np.array([evidence.channels[k].times_s for k in bands])
    return spans.mean(1), np.diff(spans, axis=1)[:, 0] / 2.0


def _band_errors(evidence: Evidence, bands: Sequence[int], chosen: Array, amplitude: Array) -> Array:
    """Standard errors from how the shots differ among themselves (sandwich)."""
    info = evidence.info[chosen][:, bands][:, :, bands]
    left = evidence.score[chosen][:, bands] - info @ amplitude
    bread = np.linalg.inv(info.sum(0) + 1e-9 * np.trace(info.sum(0)) * np.eye(len(bands)))
    return np.sqrt(np.maximum(np.diag(bread @ (left.T @ left) @ bread), 0.0))
