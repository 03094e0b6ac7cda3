"""What other teams' tables say before any simulation: shares of the wheels' speed, and pairs of tables side by side.

    python -m benchmarks.real_tables speeds new old first last [--picture FILE]

The directories are those that docs/real-data.md imports: 971's exit speeds; 254's set points for new and for old balls;
the first and the last version of 3476's. Of a pair: how much steeper the hood of the second table stands than that of
the first, between whose set points a straight line is drawn.
"""

import argparse

import numpy as np
from matplotlib.axes import Axes

from truearc.sim.data.dataset import Dataset, load_dataset
from truearc.sim.report import new_figure

PAIRS = (("254", "new balls", "old balls"), ("3476", "first version", "last, two weeks on"))
COLOURS = ("#1f5fa8", "#c2571a")
Array = np.ndarray


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dirs", nargs=5, metavar="DIR", help="speeds new old first last")
    parser.add_argument("--picture", metavar="FILE")
    args = parser.parse_args()
    speeds, *tables = map(load_dataset, args.dirs)
    surface_m_s, share = shares(speeds)
    print("971: " + ", ".join(f"{a:.1f} m/s {b:.3f}" for a, b in zip(surface_m_s, share, strict=True)))
    pairs = (tables[:2], tables[2:])
    for (team, first, second), pair in zip(PAIRS, pairs, strict=True):
        away_m, steeper_deg = steeper(*pair)
        told = ", ".join(f"{a:.2f} m {b:+.1f}" for a, b in zip(away_m, steeper_deg, strict=True))
        print(f"{team}, {second} against {first}, hood in deg: {told}; mean {steeper_deg.mean():+.1f}")
    if args.picture:
        draw(args.picture, surface_m_s, share, pairs)


def shares(speeds: Dataset) -> tuple[Array, Array]:
    """(surface speed of the wheels, share of it that the ball leaves with)."""
    surface_m_s = speeds.shots.number("wheel_left_rad_s") * speeds.facts.launcher.wheel[0].radius_m
    return surface_m_s, speeds.shots.number("exit_speed_m_s") / surface_m_s


def steeper(first: Dataset, second: Dataset) -> tuple[Array, Array]:
    """(distances of the second table that the first one spans, by how much its hood is steeper there)."""
    known, asked = points(first), points(second)
    inside = (asked[0] >= known[0][0]) & (asked[0] <= known[0][-1])
    return asked[0][inside], (asked[1] - np.interp(asked[0], *known))[inside]


def points(table: Dataset) -> tuple[Array, Array]:
    """(distance, hood), nearest first."""
    order = np.argsort(table.shots.number("distance_m"))
    return table.shots.number("distance_m")[order], table.shots.number("hood_deg")[order]


def draw(path: str, surface_m_s: Array, share: Array, pairs: tuple[list[Dataset], ...]) -> None:
    figure = new_figure(10.0, 3.2)
    left, *others = figure.subplots(1, 3)
    left.plot(surface_m_s, share, "o-", color=COLOURS[0])
    finish(left, "971: share of the wheels' speed", "surface speed of the wheels, m/s")
    for axes, (team, *names), pair in zip(others, PAIRS, pairs, strict=True):
        for name, colour, table in zip(names, COLOURS, pair, strict=True):
            axes.plot(*points(table), "o-", color=colour, label=name)
        axes.legend(frameon=False)
        finish(axes, f"{team}: hood as taken, deg", "distance, m")
    figure.savefig(path, dpi=110)


def finish(axes: Axes, title: str, along: str) -> None:
    axes.set_title(title, loc="left")
    axes.set_xlabel(along)
    axes.spines[["top", "right"]].set_visible(False)


if __name__ == "__main__":
    main()
