"""The HTML report of a system identification: efforts, measured and forecast speeds, and the fitted numbers."""

import html
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from truearc.sim.report import (
    BEFORE,
    GREY,
    INK,
    NO_ORIGIN,
    PHONE_IN,
    Origin,
    make_page,
    new_panels,
    paragraph,
    picture,
    table,
)
from truearc.sim.sysid.fit import Floats, SysidFit
from truearc.sim.sysid.sysid_text import UNITS, WORDS

EFFORT = {"nm": "torque, Nm", "v": "voltage, V"}
MISS = "#b3261e"


def draw_fit(fit: SysidFit) -> Figure:
    """Draw effort, speed (measured and forecast) and residual over time; shaded: every other piece."""
    record, rows = fit.record, fit.rows
    figure, (effort, speed, residual, spread) = new_panels(PHONE_IN, 8.0, 4, height_ratios=(0.8, 1.6, 1.1, 1.1))
    speed.sharex(effort)
    residual.sharex(effort)
    spread.sharey(residual)
    for axes in (effort, speed):
        axes.tick_params(labelbottom=False)
    effort.step(record.effort_t_s, record.effort, where="post", color=INK, linewidth=0.9)
    effort.set_ylabel(EFFORT[record.unit])
    speed.plot(record.speed_t_s, record.speed_rad_s, color=GREY, linewidth=2.6, label="measured")
    at_s, forecast = _with_gaps(record.speed_t_s[rows], fit.forecast_rad_s, rows)
    speed.plot(at_s, forecast, color=BEFORE, linewidth=1.0, label="forecast from efforts alone")
    speed.set_ylabel("speed, rad/s")
    speed.legend(frameon=False, loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=2, borderaxespad=0.0, fontsize=8.5)
    missed = record.speed_rad_s[rows] - fit.forecast_rad_s
    for axes, x, name in ((residual, record.speed_t_s, "time, s"), (spread, record.speed_rad_s, "speed, rad/s")):
        axes.axhline(0.0, color=INK, linewidth=0.7)
        axes.plot(x[rows], missed, ".", color=MISS, markersize=2)
        axes.set(xlabel=name, ylabel="measured - forecast,\nrad/s")
    for piece in fit.pieces[1::2]:
        for axes in (effort, speed, residual):
            axes.axvspan(record.speed_t_s[piece.first], record.speed_t_s[piece.last - 1], color=GREY, alpha=0.2, lw=0,
                         zorder=0)
    return figure


def make_fit_page(title: str, fits: Mapping[str, SysidFit], gains: str, notes: Sequence[str],
                  origin: Origin = NO_ORIGIN) -> str:
    """Return HTML: what to do with the gains, the quality of the fit, the gains to paste (TOML), pictures and the
    numbers."""
    worth = "; ".join(f"{joint} within {fit.rms_rad_s:.3g} rad/s (R^2 {fit.r2:.5f})" for joint, fit in fits.items())
    verdict = f"Paste these gains into launcher.toml. The fit forecasts unseen pieces: {worth}."
    sections = [("Gains", f"<pre>{html.escape(gains)}</pre>")]
    for joint, fit in fits.items():
        rows = [(number.name, WORDS[number.name], number.value, number.low90, number.high90,
                 UNITS[fit.record.unit][number.name]) for number in fit.numbers.values()]
        caption = ("Shaded: every other piece. Each third of the pieces is forecast by a fit without it; each run is "
                   "simulated from its start, with nothing but the effort to go by.")
        sections.append((joint, picture(draw_fit(fit), f"{joint}: effort, speed and residual", caption)
                         + table(("", "", "value", "90 % from", "to", "unit"), rows)))
    return make_page(title, verdict, [*sections, *(("", paragraph(note, dim=True)) for note in notes)], origin)


def _with_gaps(t_s: Floats, values: Floats, rows: np.ndarray) -> tuple[Floats, Floats]:
    """A line that is not drawn across rows left out."""
    gaps = np.flatnonzero(np.diff(rows) > 1) + 1
    return np.insert(t_s, gaps, np.nan), np.insert(values, gaps, np.nan)
