"""Benchmark of the grid fit: its speed relative to a plain loop over 1001 x 1001 pairs, and its agreement with flights.

    python -m benchmarks.grid_fit [--quick] [--runs 7] [--launches 80]

There are two sets of 80 launches, a third of them threes: `random` (distance 1-16 m, ratio 0-1, 15-75 degrees; most
score with almost no pair) and `scoring` (those that score with cd 0.9 and cl 0.06, as recorded shots do). The plain
loop simulates a subset, whose size is printed, and its time is extrapolated to all flights. It uses the same equation
of motion as the kernel.
"""

import os
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numba
import numpy as np

from benchmarks.options import read_options
from truearc.robot.config.rig_spec import Air, Ball, LauncherFacts, Rig, Target, Wheel, WorldFacts
from truearc.sim.data.dataset import Shots
from truearc.sim.paper.grid_fit import fit_grid, make_axis, make_scoring
from truearc.sim.paper.grid_kernel import advance, facts_of
from truearc.sim.paper.grid_labels import find_hits, fly_pairs
from truearc.sim.physics.simulate import classify, fly_rows
from truearc_proof.reproduce.collect import exit_seed

FACTS = Rig(ball=Ball(0.14, 0.0889), launcher=LauncherFacts(0.75, 594.0, (
    Wheel("lower", 0.0508, 1.0, 180.0), Wheel("upper", 0.0349, 0.5625, 0.0))), target=Target(2.44), air=Air(1.2),
    world=WorldFacts(9.81))
TRUTH = {"drag": {"cd": 0.9}, "magnus": {"cl": 0.06}}
MANY = 40                             # launches drawn for one that scores
STEP = 0.005                          # of both coefficients
STEP_S, LIMIT_S = 0.005, 3.0          # of the plain loops, as the paper's kind of integration has it


def main() -> None:
    args = read_options(__doc__, quick=(False, "dense check on every 8th row and column only"),
                        runs=(7, "of which the fastest counts (7)"),
                        launches=(80, "of each set; the published figures are of 80"))
    axis, count = make_axis(STEP), args.launches
    sets = {"random": draw_shots(count, 20261121, False), "scoring": draw_shots(count, 7, True)}
    print(f"{os.cpu_count()} cores, load average {os.getloadavg()[0]:.1f} at the start")
    ours_s: dict[str, tuple[float, float]] = {}
    for name, shots in sets.items():
        wall_s, cpu_s = ours_s[name] = fastest(partial(fit_grid, FACTS, shots), args.runs)
        flights = count_flights(shots)
        print(f"1001 x 1001 x {count}, {name:8s} {wall_s:8.3f} s  wall, {cpu_s:.3f} s of CPU, fastest of {args.runs}; "
              f"load {os.getloadavg()[0]:.1f}; {flights} flights, {flights / axis.size**2 / count:.2%}")
    print(f"\na plain loop, extrapolated to all {axis.size**2 * count} flights of `random`: wall s, CPU s, and "
          "their ratios to ours\n(on a busy machine, compare CPU times)")
    some = axis[::40]
    run = partial(fly_plainly, make_scoring(FACTS, sets["random"]).flyer.launch, some, facts_of(FACTS), 0.75)
    wall_s, cpu_s = (spent_s * axis.size**2 / some.size**2 for spent_s in fastest(run, min(3, args.runs)))
    print(f"  plain numba loop, always up to 3 s; RK4 5 ms, parallel; every 40th row and column "
          f"{wall_s:7.1f} s {wall_s / ours_s['random'][0]:6.0f} x {cpu_s:9.1f} s CPU "
          f"{cpu_s / ours_s['random'][1]:6.0f} x")
    print("\ncompared with a simulation of every point (short steps)")
    for name, shots in sets.items():
        check_labels(name, shots, 8 if args.quick else 1)


def draw_shots(count: int, seed: int, score: bool) -> Shots:
    """Launches over the paper's ranges, every third a three; with `score` those that score at TRUTH, of MANY times as
    many."""
    rng = np.random.default_rng(seed)
    many = MANY * count if score else count
    columns = {"distance_m": rng.uniform(1, 16, many), "motor_ratio": rng.uniform(0, 1, many),
               "hood_deg": rng.uniform(15, 75, many)}
    outcome = np.where(np.arange(many) % 3 == 0, "three", "two")
    keep = np.arange(many)
    if score:
        exit = exit_seed(FACTS, columns["motor_ratio"], columns["hood_deg"])
        outcome = classify(FACTS, fly_rows(FACTS, TRUTH, exit, columns["distance_m"]).height_m)
        threes, twos = np.flatnonzero(outcome == "three"), np.flatnonzero(outcome == "two")
        keep = np.sort(np.concatenate([threes[:count // 3], twos[:count - len(threes[:count // 3])]]))
    return Shots(tuple(f"s{row}" for row in range(len(keep))), {name: part[keep] for name, part in columns.items()},
                 {"outcome": tuple(outcome[keep])})


def fastest(run: Callable[[], object], runs: int) -> tuple[float, float]:
    """Least wall and CPU seconds of a whole run, once all is compiled."""
    run()
    spent = []
    for _ in range(runs):
        wall, cpu = time.perf_counter(), time.process_time()
        run()
        spent.append((time.perf_counter() - wall, time.process_time() - cpu))
    return tuple(map(min, zip(*spent, strict=True)))


def count_flights(shots: Shots) -> int:
    scoring = make_scoring(FACTS, shots)
    flown: list[int] = []

    class Counting:
        @staticmethod
        def fly_lanes(batches: tuple[int, int], *rest: object) -> None:
            flown.append((batches[1] - batches[0]) * 64)
            scoring.flyer.kernel.fly_lanes(batches, *rest)

    counted = replace(scoring.flyer, kernel=Counting)
    find_hits(counted, make_axis(STEP), scoring.target, lambda done, note: None)
    return sum(flown)


@numba.njit(parallel=True, fastmath={"nsz", "arcp", "contract", "afn", "reassoc"}, error_model="numpy")
def fly_plainly(launch, axis, facts, release_m):
    """One flight after the other, as one would write it; the step is the kernel's."""
    height_m = np.full((len(launch), len(axis), len(axis)), np.nan)
    for job in numba.prange(len(launch) * len(axis)):
        row, at = job // len(axis), job % len(axis)
        for column in range(len(axis)):
            x, z, vx, vz = 0.0, release_m, launch[row, 0], launch[row, 1]
            for _ in range(round(LIMIT_S / STEP_S)):
                nx, nz, nvx, nvz = advance(x, z, vx, vz, launch[row, 2], (axis[column], axis[at]), facts, STEP_S)
                if x < launch[row, 3] <= nx:
                    height_m[row, at, column] = z + (nz - z) * (launch[row, 3] - x) / (nx - x)
                    break
                x, z, vx, vz = nx, nz, nvx, nvz
    return height_m


def check_labels(name: str, shots: Shots, coarse: int) -> None:
    """Labels of the fit against those of every point, or of every so many, flown by itself."""
    scoring, fit = make_scoring(FACTS, shots), fit_grid(FACTS, shots)
    size = fit.axis.size
    ours = np.zeros((len(shots), size * size), np.uint8)
    ours[fit.hits.launch, fit.hits.pair] = fit.hits.label
    ours = ours.reshape(len(shots), size, size)[:, ::coarse, ::coarse]
    cl, cd = (part.ravel() for part in np.meshgrid(fit.axis[::coarse], fit.axis[::coarse], indexing="ij"))
    began = time.perf_counter()
    dense = np.zeros((len(shots), cl.size), np.uint8)
    for row in range(len(shots)):
        one = replace(scoring.flyer, launch=scoring.flyer.launch[row:row + 1])
        off_m = np.abs(fly_pairs(one, cd, cl)[:, 0] - scoring.target[0])
        dense[row] = (off_m <= scoring.target[2]).astype(np.uint8) + (off_m <= scoring.target[1])
    spent_s = time.perf_counter() - began
    wrong = int((dense != ours.reshape(dense.shape)).sum())
    print(f"  {name:8s} labels equal on {1 - wrong / dense.size:.7%} of {dense.size} ({wrong} differ; "
          f"{(dense > 0).mean():.2%} score; {spent_s:.0f} s)")


if __name__ == "__main__":
    main()
