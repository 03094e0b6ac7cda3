"""The picture of a gate's reliability, and colours of outcomes."""

import numpy as np
from matplotlib.figure import Figure

from truearc.robot.gate.contract import OUTPUTS
from truearc.sim.intervals import wilson
from truearc.sim.metrics import reliability
from truearc.sim.report import new_figure

COLOURS = {"three": "#1b7f3b", "two": "#d99000", "miss": "#b3261e"}


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
