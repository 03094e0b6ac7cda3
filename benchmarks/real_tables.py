"""What changed between the versions of teams' tables of set points, and which single causes would each explain it.

    python -m benchmarks.real_tables frc_shot_tables.csv frc3476_tuning_history.csv frc6328_event_corrections.csv
                                     [--shuffle SEED] [--team TEAM] [--picture FILE]

Versions of a table are compared in the order of their dates (3476: its dated history; 6328: rpm added at an event), at
the distances of the later one that the earlier one spans. Of hood and wheel speed together: how much higher the later
set point sends the ball at the goal, all else unchanged. A cause explains that if one size of it, for all distances,
takes it back to within what a scoring row fixes (TUNED_M). Simulated with drag and lift of a foam ball. Where a hood's
zero is not known, three are tried, and a size is a range. --shuffle: rows in another order, which must change nothing.
"""

import argparse
import csv
import math
import random
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from benchmarks.team_tables import GOAL_M, HOODS, MIDDLES_DEG, NOT_TUNED, rig_of
from truearc.sim.data.dataset import Shots
from truearc.sim.physics.simulate import predict
from truearc.sim.printed import make_text
from truearc.sim.report import new_figure

Array = np.ndarray
TUNED_M = 0.15 * math.sqrt(2.0)       # of two rows, each of which scores: the opening leaves 10 to 15 cm open
TEAMS = {"254": ("laser_new_ball", "laser_old_ball"), "1678": ("v_bcc9b26", "v_eaaabfe", "v_1ebd4cf", "v_83009a4"),
         "5940": ("distance_5v_commented_older", "distance_5v"), "4774": ("v_5269df4", "v_7744b81", "v_484d490"),
         "6328": ("before_16b685a", "v_16b685a"), "8": ("earlier_in_comment", "final")}     # by date; 254: by ball
SPEEDS_M_S, RADIUS_M = np.linspace(4.0, 30.0, 131), 0.0889
CD, CL = 0.5, 0.15                    # assumed, with half of the spin of a rolling ball
CAUSES = {"slower %": 30.0, "drag +": 1.5, "lift -": 0.3, "flatter deg": 15.0, "goal up m": 1.5, "farther m": 1.5}
TRIED = np.linspace(-1.0, 1.0, 61)    # times these, the largest sizes
HEADER = ("team", "from, to", "rows", "hood deg", "speed %", "higher m", *CAUSES)


class Table(NamedTuple):
    """Rows of one version, nearest first."""

    distance_m: Array
    hood: Array
    rpm: Array


class Change(NamedTuple):
    """Of a later version less an earlier one, at `distance_m` [n]; `share` of speed; `elevation_deg`: each assumed."""

    distance_m: Array
    hood_deg: Array
    share: Array
    elevation_deg: list[Array]


def read(path: str, shuffle: int | None) -> list[dict[str, str]]:
    with open(path, encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    if shuffle is not None:
        random.Random(shuffle).shuffle(rows)
    return rows


def tables_of(rows: Sequence[dict[str, str]], moves: bool, names: tuple[str, str, str]) -> dict[str, Table]:
    """{position of the hood, or "": rows} by the columns of distance, hood and rpm."""
    places = sorted({"" if moves else row[names[1]] for row in rows})
    found = {}
    for place in places:
        mine = sorted((float(row[names[0]]), float(row[names[1]]) if moves else 0.0, float(row[names[2]]))
                      for row in rows if moves or row[names[1]] == place)
        found[place] = Table(*np.array(mine).T)
    return found


def change_of(team: str, before: dict[str, Table], after: dict[str, Table]) -> Change:
    hood = HOODS.get(team)
    sign, zero_deg = (0.0, None) if hood is None else (hood.sign * hood.deg, hood.zero_deg)
    parts = []
    for place in sorted(set(before) & set(after)):
        old, new = before[place], after[place]
        inside = (new.distance_m >= old.distance_m[0] - 0.01) & (new.distance_m <= old.distance_m[-1] + 0.01)
        was = [np.interp(new.distance_m, old.distance_m, column)[inside] for column in (old.hood, old.rpm)]
        parts.append(np.stack([new.distance_m[inside], sign * (new.hood[inside] - was[0]),
                               new.rpm[inside] / was[1] - 1.0, sign * was[0]]))
    away_m, hood_deg, share, stood = np.concatenate(parts, axis=1)
    middles = [zero_deg] if zero_deg is not None else [one - float(np.median(stood)) for one in MIDDLES_DEG]
    return Change(away_m, hood_deg, share, [np.clip(stood + one, 10.0, 80.0) for one in middles])


def heights(away_m: Array, hood_deg: Array, speed_m_s: Array, cause: str = "", size: Array | float = 0.0) -> Array:
    """Above the goal's centre [n], with a cause of some size [n]."""
    by = {name: size if name == cause else 0.0 for name in CAUSES}
    speed_m_s = speed_m_s * (1.0 - by["slower %"] / 100.0)
    shots = Shots(tuple(map(str, range(len(away_m)))), {
        "distance_m": np.maximum(away_m + by["farther m"], 0.3), "exit_speed_m_s": speed_m_s,
        "hood_deg": np.clip(hood_deg - by["flatter deg"], 1.0, 89.0),
        "exit_spin_rev_s": 0.25 * speed_m_s / (math.pi * RADIUS_M)}, {})
    ball = {"drag": {"cd": CD + by["drag +"]}, "magnus": {"cl": CL - by["lift -"]}}
    return np.asarray(predict(rig_of(), ball, shots).height_m) - GOAL_M - by["goal up m"]


def aimed(away_m: Array, hood_deg: Array) -> Array:
    """The least speed that meets the centre [n]; NaN where none does."""
    many = [np.repeat(one, len(SPEEDS_M_S)) for one in (away_m, hood_deg)]
    above = heights(*many, np.tile(SPEEDS_M_S, len(away_m))).reshape(len(away_m), -1)
    above = np.where(np.isfinite(above), above, -GOAL_M)
    found = np.full(len(away_m), np.nan)
    for k, row in enumerate(above):
        crossing = np.flatnonzero((row[:-1] < 0.0) & (row[1:] >= 0.0))
        if len(crossing):
            at = crossing[0]
            found[k] = np.interp(0.0, row[at:at + 2], SPEEDS_M_S[at:at + 2])
    return found


def explain(change: Change, elevation_deg: Array) -> tuple[Array, dict[str, tuple[float, float]]]:
    """(how much higher [n], {cause: (size that takes it back, RMS that it leaves)}) with these elevations before."""
    speed = aimed(change.distance_m, elevation_deg)
    can = np.isfinite(speed)
    away_m, hood_deg, speed = change.distance_m[can], elevation_deg[can], speed[can]
    if not can.any():
        return np.zeros(0), {}
    hood_deg, speed = hood_deg + change.hood_deg[can], speed * (1.0 + change.share[can])
    higher = heights(away_m, hood_deg, speed)
    seen = np.isfinite(higher)        # else it does not get there
    now = [one[seen] for one in (away_m, hood_deg, speed)]
    return higher[seen], {cause: best_size(cause, most, now) for cause, most in CAUSES.items()}


def best_size(cause: str, most: float, now: Sequence[Array]) -> tuple[float, float]:
    """(size, RMS that it leaves) of the one that brings these set points nearest to the centre."""
    sizes = most * TRIED
    for _ in range(2):
        one_each = [np.tile(one, len(sizes)) for one in now]
        left = heights(*one_each, cause, np.repeat(sizes, len(now[0]))).reshape(len(sizes), -1)
        off_m = np.sqrt(np.mean(np.where(np.isfinite(left), left, -GOAL_M)**2, axis=1))
        best = int(off_m.argmin())
        found = float(sizes[best]), float(off_m[best])
        sizes = found[0] + most * TRIED / len(TRIED) * 2.0
    return found


def row_of(team: str, said: str, change: Change) -> tuple[str, ...]:
    """A line of the table; "no": a cause that leaves more than TUNED_M; "-": nothing need be explained."""
    told = [explain(change, one) for one in change.elevation_deg]
    told = [one for one in told if len(one[0]) >= 0.5 * len(change.distance_m)]
    off = [causes for higher, causes in told if np.sqrt(np.mean(higher**2)) > TUNED_M]
    sizes = {name: [one[name][0] for one in off if one[name][1] <= TUNED_M] for name in CAUSES}
    cells = [(span(one) or "no") if off else "-" for one in sizes.values()]
    moved = (np.abs(change.hood_deg) > 0.005) | (np.abs(change.share) > 0.0005)
    return (team, said, f"{moved.sum()} of {len(moved)}", span(change.hood_deg, 1), span(100.0 * change.share, 1),
            span([one for higher, _ in told for one in higher]), *cells)


def span(numbers: Sequence[float] | Array, places: int = 2) -> str:
    if not len(numbers):
        return ""
    low, high = (f"{one + 0.0:+.{places}f}" for one in (min(numbers), max(numbers)))
    return low if low == high else f"{low} to {high}"


def changes(paths: Sequence[str], shuffle: int | None = None) -> list[tuple[str, str, Change]]:
    """(team, versions, change) of every pair of versions."""
    shots, history, event = (read(path, shuffle) for path in paths)
    found, columns = [], ("distance_m", "hood_raw", "wheel_rpm")
    for team, versions in TEAMS.items():
        tables = [tables_of([row for row in shots if (row["team"], row["table"]) == (team, name)
                             and not any(word in row["note"] for word in NOT_TUNED)], team in HOODS, columns)
                  for name in versions]
        found += [(team, f"{old}, {new}", change_of(team, *pair)) for (old, new), pair in
                  zip(pairwise(versions), pairwise(tables), strict=True)]
    dated = {key: tables_of([row for row in history if (row["committed_at"], row["commit"]) == key], True,
                            ("distance_m", "hood_eject_angle_deg", "flywheel_rpm"))
             for key in sorted({(row["committed_at"], row["commit"]) for row in history})}
    keys = list(dated)
    days = [next(key for key in keys[::-1] if key[0][:10] == day) for day in dict.fromkeys(key[0][:10] for key in keys)]
    for old, new in (*pairwise(days), (keys[0], keys[-1])):
        found.append(("3476", f"{old[0][:10]}, {new[0][:10]}", change_of("3476", dated[old], dated[new])))
    home = tables_of([row for row in shots if (row["team"], row["table"]) == ("6328", "v_16b685a")], False, columns)
    for when in sorted({row["committed_at"] for row in event}):
        added = {row["hood_position"]: float(row["added_rpm_to_v_16b685a_curve"]) for row in event
                 if row["committed_at"] == when}
        if any(added.values()):
            there = {place: home[place]._replace(rpm=home[place].rpm + rpm) for place, rpm in added.items()}
            found.append(("6328", f"home, event {when[:10]} {when[11:16]}", change_of("6328", home, there)))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs=3, metavar="FILE", help="shot tables, 3476's history, 6328's corrections")
    parser.add_argument("--shuffle", type=int, metavar="SEED")
    parser.add_argument("--team", help="of the table, this team's rows only")
    parser.add_argument("--picture", metavar="FILE")
    args = parser.parse_args()
    found = [one for one in changes(args.files, args.shuffle) if args.team in (None, one[0])]
    print("\n".join(make_text(HEADER, [row_of(*one) for one in found], right=())))
    if args.picture:
        draw(args.picture, found)


def draw(path: str, found: Sequence[tuple[str, str, Change]]) -> None:
    figure = new_figure(10.0, 5.0)
    teams = list(dict.fromkeys(team for team, *_ in found))
    for place, team in enumerate(teams):
        axes = figure.add_subplot(2, -(-len(teams) // 2), place + 1)
        mine = [(said, one) for name, said, one in found if name == team]
        turned = any(np.ptp(one.hood_deg) > 0.0 for _, one in mine)
        for said, one in mine:
            line = "o-" if (np.diff(one.distance_m) > 0.0).all() else "o"       # else of several hood positions
            axes.plot(one.distance_m, one.hood_deg if turned else 100.0 * one.share, line, markersize=3, label=said)
        axes.axhline(0.0, color="0.6", linewidth=0.8)
        axes.legend(frameon=False, fontsize=5)
        axes.set_title(f"{team}: {'hood, deg' if turned else 'wheel speed, %'}", loc="left", fontsize=9)
        axes.spines[["top", "right"]].set_visible(False)
        if place >= len(teams) - -(-len(teams) // 2):
            axes.set_xlabel("distance, m")
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main()
