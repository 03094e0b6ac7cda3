"""Pictures of the loop: one shot's telemetry, trajectories, the fit's map, shares with intervals."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from truearc.robot.config.rig_spec import Rig
from truearc.robot.config.schema import Config
from truearc.robot.types import Tick
from truearc.sim.data.dataset import Shots
from truearc.sim.intervals import wilson
from truearc.sim.physics.catalogue import effective, flight_terms
from truearc.sim.physics.flight import path
from truearc.sim.physics.simulate import ORDINARY, by_robot, launch_of, leave, sense
from truearc.sim.report import new_figure

NS = 1e-9
COLOURS = {"three": "#1b7f3b", "two": "#d99000", "miss": "#b3261e"}
PATH_POINTS, PATH_STEP_S = 300, 0.01
MOST_OUTLINED = 5000                  # tied pairs drawn one by one


class Share(NamedTuple):
    """A share to draw: `hits` of `tries`."""

    name: str
    hits: int
    tries: int


def draw_shot(ticks: Sequence[Tick], config: Config, fed_t_ns: int) -> Figure:
    """Wheel speed, hood and battery around one shot; time 0 is when the ball was fed."""
    figure = new_figure(8.0, 5.6)
    wheel, hood, supply = figure.subplots(3, 1, sharex=True)
    t_s = np.array([(tick.inputs.t_ns - fed_t_ns) * NS for tick in ticks])
    free = config.rig.launcher.free_speed_rad_s or 0.0
    speeds = [tick.estimate.motor_rad_s for tick in ticks], [tick.aim.motor_ratio * free for tick in ticks]
    angles = [tick.estimate.hood_deg for tick in ticks], [tick.aim.hood_deg or np.nan for tick in ticks]
    for axes, unit, (measured, wanted) in ((wheel, "motors, rad/s", speeds), (hood, "hood, deg", angles)):
        axes.plot(t_s, wanted, color="#9aa3af", linestyle="--", label="wanted")
        axes.plot(t_s, measured, color="#1f5fa8", label="measured")
        axes.set_ylabel(unit)
        axes.legend(frameon=False, loc="lower right")
    supply.plot(t_s, [tick.estimate.battery_v for tick in ticks], color="#1f5fa8")
    supply.set_ylabel("battery, V")
    supply.set_xlabel("seconds from feeding the ball")
    for axes in (wheel, hood, supply):
        axes.axvline(0.0, color="#b3261e", linewidth=1.0)
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def draw_trajectories(rig: Rig, coefficients: Mapping[str, Mapping[str, float]], shots: Shots, most: int) -> Figure:
    """What the fitted simulator makes of recorded configurations, coloured by what really became of them."""
    assert rig.target is not None
    figure = new_figure(8.0, 4.0)
    axes = figure.subplots()
    outcomes, distance_m = shots.text("outcome"), shots.number("distance_m")
    for outcome, colour in COLOURS.items():
        rows = np.array([row for row, said in enumerate(outcomes) if said == outcome][:most], dtype=int)
        if len(rows):
            _draw_flights(axes, rig, coefficients, shots.take(rows), distance_m[rows], colour, outcome)
    low = rig.target.centre_height_m - rig.target.two_half_height_m
    three = rig.target.centre_height_m - rig.target.three_half_height_m
    for bottom, half, colour in ((low, rig.target.two_half_height_m, COLOURS["two"]),
                                 (three, rig.target.three_half_height_m, COLOURS["three"])):
        axes.plot([0.0, 0.0], [bottom, bottom + 2 * half], color=colour, linewidth=5, solid_capstyle="butt")
    axes.set(xlabel="metres before the target", ylabel="height, m", ylim=(0.0, None))
    axes.legend(frameon=False, title="what happened")
    axes.spines[["top", "right"]].set_visible(False)
    return figure


def _draw_flights(axes: Axes, rig: Rig, coefficients: Mapping[str, Mapping[str, float]], shots: Shots,
                  distance_m: np.ndarray, colour: str, outcome: str) -> None:
    values, whose = effective(coefficients, ORDINARY), by_robot(shots)
    exit, distance_m = sense(rig, values, launch_of(rig, shots), distance_m, whose)
    states = path(rig, flight_terms({"gravity", *coefficients}), values, leave(rig, values, exit, whose),
                  PATH_POINTS, PATH_STEP_S)
    x, z = np.asarray(states.position_m.x) - distance_m, np.asarray(states.position_m.z)
    for shot in range(len(shots)):
        shown = (x[:, shot] <= 0.05) & (z[:, shot] >= 0.0)
        until = len(shown) if shown.all() else int(np.argmin(shown))
        axes.plot(x[:until, shot], z[:until, shot], color=colour, linewidth=0.8, alpha=0.7,
                  label=outcome if shot == 0 else None)


class Zoom(NamedTuple):
    """Mean deviation of three-pointers in m around the tied pairs, [len(cl), len(cd)]; infinite where not all reach."""

    cd: np.ndarray
    cl: np.ndarray
    mean_deviation_m: np.ndarray


def draw_fit_map(axis: np.ndarray, accuracy: np.ndarray, chosen: tuple[float, float], tied: np.ndarray | None = None,
                 zoom: Zoom | None = None) -> Figure:
    """The grid fit over (C_d, C_l): 3-point accuracy and tied pairs [cl, cd] along `axis`, the chosen (C_d, C_l).

    Shows only where anything is reproduced at all. With `zoom`, a second panel: mean deviation around the tied pairs.
    """
    figure = new_figure(6.4 if zoom is None else 12.0, 4.8)
    panels = figure.subplots(1, 1 if zoom is None else 2, squeeze=False)[0]
    axes = panels[0]
    cl_end, cd_end = (min(len(axis), int(np.flatnonzero(part)[-1] * 1.25) + 2) if part.any() else len(axis) for part in
                      (accuracy.any(axis=1), accuracy.any(axis=0)))
    axis_cd, axis_cl, shown = axis[:cd_end], axis[:cl_end], accuracy[:cl_end, :cd_end]
    image = axes.pcolormesh(axis_cd, axis_cl, shown, cmap="viridis", shading="nearest", rasterized=True)
    figure.colorbar(image, ax=axes, label="share of recorded three-pointers reproduced")
    axes.set_title("three-point accuracy")
    _mark(axes, axis, chosen, tied, (axis_cd[[0, -1]], axis_cl[[0, -1]]))
    if zoom is not None:
        _draw_zoom(figure, panels[1], axis, chosen, tied, zoom)
        axes.add_patch(Rectangle((zoom.cd[0], zoom.cl[0]), np.ptp(zoom.cd), np.ptp(zoom.cl), fill=False,
                                 edgecolor="white", linewidth=0.8, linestyle=":"))
    return figure


def _draw_zoom(figure: Figure, axes: Axes, axis: np.ndarray, chosen: tuple[float, float], tied: np.ndarray | None,
               zoom: Zoom) -> None:
    reached = np.ma.masked_invalid(zoom.mean_deviation_m)
    axes.set_facecolor("#c9ced6")     # where not every three-pointer reaches the target
    if reached.count():
        image = axes.pcolormesh(zoom.cd, zoom.cl, reached, cmap="magma_r", shading="nearest", rasterized=True,
                                vmax=float(np.quantile(reached.compressed(), 0.9)))
        figure.colorbar(image, ax=axes, label="mean distance from the centre, m", extend="max")
    axes.set_title("around the tied pairs (grey: a three-pointer does not reach)")
    _mark(axes, axis, chosen, tied, (zoom.cd[[0, -1]], zoom.cl[[0, -1]]))


def _mark(axes: Axes, axis: np.ndarray, chosen: tuple[float, float], tied: np.ndarray | None,
          limits: tuple[np.ndarray, np.ndarray]) -> None:
    """Outline the tied pairs, cell by cell of the grid, mark the chosen one, and keep the limits."""
    step = axis[1] - axis[0]
    if tied is not None:
        edges = np.append(axis - step / 2.0, axis[-1] + step / 2.0)
        for row, column in np.argwhere(tied)[:MOST_OUTLINED]:
            axes.add_patch(Rectangle((edges[column], edges[row]), step, step, fill=False, edgecolor="#19c3d6",
                                     linewidth=1.0))
        axes.plot([], [], color="#19c3d6", label=f"tied pairs: {int(tied.sum())}")
    axes.plot(*chosen, marker="*", markersize=14, color="#ff5a4f", markeredgecolor="white", linestyle="none",
              label=f"chosen: C_d {chosen[0]:.3f}, C_l {chosen[1]:.3f}")
    (left, right), (bottom, top) = limits
    axes.set(xlabel="C_d (drag)", ylabel="C_l (lift)", xlim=(left - step / 2, right + step / 2),
             ylim=(bottom - step / 2, top + step / 2))
    axes.legend(loc="upper right")


def draw_shares(shares: Sequence[Share]) -> Figure:
    """Shares with 95 % Wilson intervals, one bar each, top to bottom."""
    figure = new_figure(8.0, 0.8 + 0.5 * len(shares))
    axes = figure.subplots()
    for row, share in enumerate(reversed(shares)):
        low, high = wilson(share.hits, share.tries)
        middle = share.hits / share.tries if share.tries else 0.0
        axes.barh(row, middle, color="#1f5fa8" if "gate" in share.name else "#9aa3af", height=0.6)
        axes.plot([low, high], [row, row], color="#1a1c20", linewidth=2)
        axes.text(max(high, middle) + 0.015, row, f"{middle:.0%}  ({share.hits} of {share.tries})", va="center")
    axes.set_yticks(range(len(shares)), [share.name for share in reversed(shares)])
    axes.set(xlim=(0.0, 1.25), xlabel="share of fired shots, 95 % interval")
    axes.set_xticks(np.linspace(0, 1, 6), [f"{part:.0%}" for part in np.linspace(0, 1, 6)])
    axes.spines[["top", "right"]].set_visible(False)
    return figure
