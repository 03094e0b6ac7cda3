"""How fast the grid fit is, against plainer ways to fly 1001 x 1001 pairs, and whether it says the same as they do.

    python -m benchmarks.grid_fit [--quick] [--runs 7] [--launches 80]

Two sets of 80 launches, a third of them three-pointers: `random` (distance 1-16 m, ratio 0-1, 15-75 degrees; most can
score with hardly any pair) and `scoring` (those that score with cd 0.9, cl 0.06, as recorded shots do). The plain ways
fly subsets, stated, and are scaled up to all flights; all of them take the law of motion from the terms of sim/physics.
"""

import os
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import jax
import numba
import numpy as np
from jax import lax

from benchmarks.options import read_options
from truearc.robot.config.rig_spec import Air, Ball, LauncherFacts, Rig, Target, Wheel, WorldFacts
from truearc.sim.data.dataset import Shots
from truearc.sim.paper.grid_fit import fit_grid, make_axis, make_scoring
from truearc.sim.paper.grid_kernel import advance, facts_of
from truearc.sim.paper.grid_labels import find_hits, fly_pairs
from truearc.sim.physics.catalogue import flight_terms
from truearc.sim.physics.flight import fly
from truearc.sim.physics.simulate import classify, fly_rows
from truearc.sim.physics.term import Exit
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
    print(f"\nthe same by plainer ways, scaled to all {axis.size**2 * count} flights of `random`: wall s, CPU s, and "
          "times ours\n(on a busy machine the ratio of CPU is the fair one)")
    for what, run, points, runs in plain_ways(sets["random"], min(3, args.runs)):
        wall_s, cpu_s = (spent_s * 1001**2 / points**2 for spent_s in fastest(run, runs))
        print(f"  {what:88s} {wall_s:7.1f} s {wall_s / ours_s['random'][0]:6.0f} x {cpu_s:9.1f} s CPU "
              f"{cpu_s / ours_s['random'][1]:6.0f} x")
    print("\nagainst flying every point (short steps; checked against the JAX law below)")
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


def plain_ways(shots: Shots, runs: int) -> Iterator[tuple[str, Callable[[], object], float, int]]:
    """(what, a run of it, how many points a side of the grid it takes, how often it is run)."""
    flyer, numbers = make_scoring(FACTS, shots).flyer, facts_of(FACTS)
    axis, cl = make_axis(STEP)[::40], make_axis(STEP)[::100]
    yield ("plain numba loop, up to 3 s whatever happens; RK4 5 ms, parallel; every 40th row and column",
           partial(make_plain_loop(), flyer.launch, axis, numbers, 0.75), axis.size, runs)
    yield ("numpy chunks of 16384, to the first crossing, floor or turn; every 40th row and column",
           partial(fly_numpy, flyer.launch, axis, numbers), axis.size, 1)
    yield ("JAX while loop, 50 ms, as fit_grid had it; every 100th row, all columns", partial(fly_jax, shots, cl),
           (1001 * cl.size)**0.5, 1)


def make_plain_loop() -> Callable[..., np.ndarray]:
    """One flight after the other, as one would write it; the step is the kernel's."""

    @numba.njit(parallel=True, fastmath={"nsz", "arcp", "contract", "afn", "reassoc"}, error_model="numpy")
    def loop(launch, axis, facts, release_m):
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

    return loop


def fly_numpy(launch: np.ndarray, axis: np.ndarray, numbers: tuple[float, ...]) -> np.ndarray:
    """All flights of a chunk step by step in numpy, those that have ended left out every 20 steps."""
    which, cl, cd = (part.ravel() for part in np.meshgrid(np.arange(len(launch)), axis, axis, indexing="ij"))
    height_m = np.full(which.size, np.nan)
    for first in range(0, which.size, 16384):
        at = np.arange(first, min(first + 16384, which.size))
        _fly_chunk(at, launch[which[at]].T, cd[at], cl[at], numbers, height_m)
    return height_m


def _fly_chunk(at, launch, cd, cl, facts, height_m) -> None:
    state = np.stack([np.zeros(at.size), np.full(at.size, 0.75), launch[0], launch[1]])
    spin, distance = launch[2], launch[3]
    for step in range(round(LIMIT_S / STEP_S)):
        def rate(s, spin=spin, cd=cd, cl=cl):
            drag, lift = -cd * facts[1] * np.hypot(s[2], s[3]), cl * facts[2] * spin
            return np.stack([s[2], s[3], drag * s[2] - lift * s[3], drag * s[3] + lift * s[2] - facts[0]])

        k1 = rate(state)
        k2 = rate(state + STEP_S / 2 * k1)
        k3 = rate(state + STEP_S / 2 * k2)
        new = state + STEP_S / 6 * (k1 + 2 * (k2 + k3) + rate(state + STEP_S * k3))
        crossed = (state[0] < distance) & (new[0] >= distance)
        part = (distance - state[0])[crossed] / (new[0] - state[0])[crossed]
        height_m[at[crossed]] = state[1][crossed] + part * (new[1] - state[1])[crossed]
        over = crossed | (new[1] < 0.0) | (new[2] <= 0.0)
        distance = np.where(over, -np.inf, distance)
        state = new
        if step % 20 == 19:
            keep = distance > 0.0
            state, spin, distance, cd, cl, at = state[:, keep], spin[keep], distance[keep], cd[keep], cl[keep], at[keep]
            if not at.size:
                return


def fly_jax(shots: Shots, cl: np.ndarray) -> None:
    """The JAX law's own flights, a row of the grid at a time, one launch after the other (XLA takes the cores)."""
    exit = exit_seed(FACTS, shots.number("motor_ratio"), shots.number("hood_deg"))
    cd = make_axis(STEP)
    for row in range(len(shots)):
        _row_of_jax(exit.take(row), shots.number("distance_m")[row], cd, cl).block_until_ready()


@jax.jit
def _row_of_jax(exit: Exit, distance_m: float, cd: np.ndarray, cl: np.ndarray) -> jax.Array:
    def block(lift: jax.Array) -> jax.Array:
        params = {"drag": {"cd": cd}, "magnus": {"cl": lift}}
        terms = flight_terms(("gravity", "drag", "magnus"))
        return fly(FACTS, terms, params, exit, distance_m, step_s=0.05, turn_rad=0.2).height_m

    return lax.map(block, cl)


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
