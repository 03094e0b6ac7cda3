"""Pictures of the loop: a shot's telemetry, trajectories, shares with intervals, the reliability of a gate."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from truearc.robot.config.rig_spec import Rig
from truearc.robot.config.schema import Config
from truearc.robot.gate.contract import OUTPUTS
from truearc.robot.types import Tick
from truearc.sim.data.dataset import Shots
from truearc.sim.intervals import wilson
from truearc.sim.metrics import reliability
from truearc.sim.physics.catalogue import effective, flight_terms
from truearc.sim.physics.flight import path
from truearc.sim.physics.simulate import ORDINARY, by_robot, launch_of, leave, sense
from truearc.sim.report import new_figure, new_panels

NS = 1e-9
COLOURS = {"three": "#1b7f3b", "two": "#d99000", "miss": "#b3261e"}
PATH_POINTS, PATH_STEP_S = 300, 0.01


class Share(NamedTuple):
    """A share to draw: `hits` of `tries`."""

    name: str
    hits: int
    tries: int


def draw_shot(ticks: Sequence[Tick], config: Config, fed_t_ns: int) -> Figure:
    """Wheel speed, hood and battery around one shot; time 0 is when the ball was fed."""
    figure, (wheel, hood, supply) = new_panels(8.0, 5.6, 3, sharex=True)
    t_s = np.array([(tick.inputs.t_ns - fed_t_ns) * NS for tick in ticks])
    free = config.rig.launcher.free_speed_rad_s or 0.0
    speeds = [tick.estimate.motor_rad_s for tick in ticks], [tick.aim.motor_ratio * free for tick in ticks]
    angles = [tick.estimate.hood_deg for tick in ticks], [tick.aim.hood_deg or np.nan for tick in ticks]
    for axes, unit, (measured, wanted) in ((wheel, "motors, rad/s", speeds), (hood, "hood, deg", angles)):
        axes.plot(t_s, np.array(wanted, float), color="#9aa3af", linestyle="--", label="wanted")
        axes.plot(t_s, np.array(measured, float), color="#1f5fa8", label="measured")
        axes.set_ylabel(unit)
        axes.legend(frameon=False, loc="lower right")
    supply.plot(t_s, [tick.estimate.battery_v for tick in ticks], color="#1f5fa8")
    supply.set_ylabel("battery, V")
    supply.set_xlabel("seconds from feeding the ball")
    for axes in (wheel, hood, supply):
        axes.axvline(0.0, color="#b3261e", linewidth=1.0)
    return figure


def draw_trajectories(rig: Rig, coefficients: Mapping[str, Mapping[str, float]], shots: Shots, most: int) -> Figure:
    """Draw the fitted simulator's trajectories of recorded configurations, coloured by their recorded outcome."""
    assert rig.target is not None
    figure, (axes,) = new_panels(8.0, 4.0)
    outcomes, distance_m = shots.text("outcome"), shots.number("distance_m")
    for outcome, colour in COLOURS.items():
        rows = np.array([row for row, said in enumerate(outcomes) if said == outcome][:most], dtype=int)
        if len(rows):
            _draw_flights(axes, rig, coefficients, shots.take(rows), distance_m[rows], colour, outcome)
    centre_m = rig.target.centre_height_m
    for half_m, colour in ((rig.target.two_half_height_m, COLOURS["two"]),
                           (rig.target.three_half_height_m, COLOURS["three"])):
        axes.plot([0.0, 0.0], [centre_m - half_m, centre_m + half_m], color=colour, linewidth=5,
                  solid_capstyle="butt")
    axes.set(xlabel="metres before the target", ylabel="height, m", ylim=(0.0, None))
    axes.legend(frameon=False, title="what happened")
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


def draw_shares(shares: Sequence[Share]) -> Figure:
    """Shares with 95 % Wilson intervals, one bar each, top to bottom."""
    figure, (axes,) = new_panels(8.0, 0.8 + 0.5 * len(shares))
    for row, share in enumerate(reversed(shares)):
        low, high = wilson(share.hits, share.tries)
        middle = share.hits / share.tries if share.tries else 0.0
        axes.barh(row, middle, color="#1f5fa8" if "gate" in share.name else "#9aa3af", height=0.6)
        axes.plot([low, high], [row, row], color="#1a1c20", linewidth=2)
        axes.text(max(high, middle) + 0.015, row, f"{middle:.0%}  ({share.hits} of {share.tries})", va="center")
    axes.set_yticks(range(len(shares)), [share.name for share in reversed(shares)])
    axes.set(xlim=(0.0, 1.25), xlabel="share of fired shots, 95 % interval")
    axes.set_xticks(np.linspace(0, 1, 6), [f"{part:.0%}" for part in np.linspace(0, 1, 6)])
    return figure


def draw_reliability(p: np.ndarray, level: np.ndarray) -> Figure:
    """Reliability of both outputs: p [n, 2] (two, three) against level [n] (0 miss, 1 two, 2 three), 95 % intervals."""
    figure = new_figure(7.5, 3.8)
    for k, axes in enumerate(figure.subplots(1, 2, sharey=True)):
        table = reliability(p[:, k], level >= k + 1)
        hits = np.rint(table.came_true * table.count).astype(int)
        low, high = np.array([wilson(int(one), int(tries)) for one, tries in zip(hits, table.count, strict=True)]).T
        axes.plot([0, 1], [0, 1], color="#999999", linewidth=1)
        axes.errorbar(table.stated, table.came_true, yerr=np.abs([table.came_true - low, high - table.came_true]),
                      fmt="o", color="#1b5e9b", capsize=2)
        for x, y, count in zip(table.stated, table.came_true, table.count, strict=True):
            axes.annotate(str(int(count)), (x, y), xytext=(5, -10), textcoords="offset points", fontsize=7)
        axes.set(xlabel=f"stated {OUTPUTS[k]}", xlim=(-0.02, 1.02), ylim=(-0.02, 1.02))
    figure.axes[0].set_ylabel("share that came true")
    return figure
