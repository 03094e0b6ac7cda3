"""Which launches would score what, at every pair of the grid: few flights, and the rest by interpolation."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType

import numpy as np

from truearc.robot.config.rig_spec import Rig
from truearc.sim.compute import usable_cores
from truearc.sim.paper import grid_cells as cells_of
from truearc.sim.paper.grid_cells import DOUBTFUL, LEAF, MISS, NODES, NODES_AT, SPLIT, TABLES, TRANSFORM, Target
from truearc.sim.physics.catalogue import flight_terms
from truearc.sim.physics.compiled import facts_values, load_kernel, make_source
from truearc.sim.physics.flight import LIMIT_S, SHORTEST
from truearc.sim.physics.launch import Exit
from truearc.sim.printed import Progress

TERMS = flight_terms(("gravity", "drag", "magnus"))
VALUES = (("drag", "cd"), ("magnus", "cl"))
TEMPLATE = Path(__file__).with_name("grid_kernel.py")
LANES = NODES * NODES
BLOCK = 1 << 14                       # flights that one thread is handed at once
AT_ONCE = 4                           # launches whose cells one thread looks at together
DEEPEST_M = -0.5                      # below the floor, where a flight is given up

# Longest step in s and turn in rad. Long: heights near the target within 4e-4 m; short: within 2e-6 m (measured).
LONG, SHORT = (0.05, 0.2), (0.01, 0.05)



@dataclass(frozen=True)
class Hits:
    """Every (launch, pair) that scores: `pair` = index in the grid [cl, cd] laid flat; `label` 1 two, 2 three."""

    launch: np.ndarray
    pair: np.ndarray
    label: np.ndarray


@dataclass(frozen=True)
class Flyer:
    """Flies launches with pairs of coefficients, by machine code made from the law of motion."""

    kernel: ModuleType
    rig_values: tuple[float, ...]
    release_m: float
    launch: np.ndarray                # [n, 4] forward and upward speed m/s, spin rev/s, distance m

    def fly(self, which: np.ndarray, cd: np.ndarray, cl: np.ndarray, steps: tuple[float, float]) -> tuple[
            np.ndarray, np.ndarray, np.ndarray]:
        """(height, gap, under) of every lane as the kernel has them; any number of lanes."""
        batches = -(-len(which) // LANES)
        if len(which) != batches * LANES:
            which, cd, cl = (np.resize(part, batches * LANES) for part in (which, cd, cl))
        height_m, gap_m = np.empty(batches * LANES), np.empty(batches * LANES)
        under = np.empty(batches * LANES, np.bool_)
        rules = (self.release_m, *steps, steps[0] * SHORTEST, DEEPEST_M, LIMIT_S)
        self.kernel.fly_lanes((0, batches), self.launch, which, cd, cl, self.rig_values, rules, height_m, gap_m, under)
        return height_m, gap_m, under


def make_flyer(rig: Rig, exit: Exit, distance_m: np.ndarray) -> Flyer:
    """A flyer of these launches; compiles once for a law, which takes seconds, and keeps the result on disk."""
    kernel = load_kernel(make_source(rig, TERMS, VALUES), TEMPLATE)
    launch = np.stack([exit.speed_m_s * np.cos(exit.elevation_rad), exit.speed_m_s * np.sin(exit.elevation_rad),
                       exit.spin_rev_s, distance_m], axis=1)
    return Flyer(kernel, facts_values(rig), float(rig.launcher.release_height_m), launch)


def label_launches(flyer: Flyer, axis: np.ndarray, target: Target, rows: range) -> np.ndarray:
    """Labels 0 miss, 1 two, 2 three [launches, cl, cd] of launches `rows` at every pair of the axis.

    target: centre, three's and two's half height in m.
    """
    labels = np.zeros((len(rows), len(axis), len(axis)), np.uint8)
    part = replace(flyer, launch=flyer.launch[rows.start:rows.stop])
    cells, leaves = cells_of.make_roots(len(axis), len(rows)), []
    if len(axis) <= LEAF:
        cells, leaves = cells[:0], [cells]
    while len(cells):
        cells, small = cells_of.split(cells[_look(part, axis, target, cells, labels) == SPLIT])
        leaves.append(small)
    cells_of.mark(np.concatenate(leaves), labels, DOUBTFUL)
    if _fly_doubtful(part, axis, target, labels, LONG, False):
        _fly_doubtful(part, axis, target, labels, SHORT, True)
    return labels


def _look(flyer: Flyer, axis: np.ndarray, target: Target, cells: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """Judge cells by flights at their nodes, and label those that an interpolant settles; their verdicts [n]."""
    launch, top, bottom, left, right = cells.T
    cl, cd = (axis[first, None] + (axis[last] - axis[first])[:, None] * NODES_AT
              for first, last in ((top, bottom), (left, right)))
    height_m, gap_m, under = flyer.fly(np.repeat(launch, LANES).astype(np.int64), np.tile(cd, NODES).ravel(),
                                       np.repeat(cl, NODES), LONG)
    verdict = np.zeros(len(cells), np.int64)
    cells_of.settle(cells, height_m, gap_m, under, target, TRANSFORM, TABLES, labels, verdict)
    return verdict


def _fly_doubtful(flyer: Flyer, axis: np.ndarray, target: Target, labels: np.ndarray, steps: tuple[float, float],
                  final: bool) -> int:
    """Fly every point labelled DOUBTFUL and label it; returns how many stay so, none if `final`."""
    points = np.stack(np.unravel_index(np.flatnonzero(labels == DOUBTFUL), labels.shape), axis=1)
    height_m, gap_m, under = flyer.fly(points[:, 0], axis[points[:, 2]], axis[points[:, 1]], steps)
    return cells_of.label_points(points, height_m, gap_m, under, target, final, labels)


def find_hits(flyer: Flyer, axis: np.ndarray, target: Target, progress: Progress) -> Hits:
    """Fly every launch over the whole grid; one thread a core, and the same result however many there are."""
    launches = len(flyer.launch)

    def one(first: int) -> Hits:
        labels = label_launches(flyer, axis, target, range(first, min(first + AT_ONCE, launches)))
        at = np.flatnonzero(labels != MISS)
        launch, pair = np.divmod(at, axis.size**2)
        return Hits((first + launch).astype(np.int32), pair.astype(np.int32), labels.ravel()[at])

    parts = []
    with ThreadPoolExecutor(usable_cores()) as pool:
        for part in pool.map(one, range(0, launches, AT_ONCE)):
            parts.append(part)
            done = min(len(parts) * AT_ONCE, launches)
            progress(done / launches, f"{done}/{launches} shots")
    return Hits(*(np.concatenate([getattr(part, name) for part in parts]) for name in ("launch", "pair", "label")))


def fly_pairs(flyer: Flyer, cd: np.ndarray, cl: np.ndarray) -> np.ndarray:
    """Heights in m [pairs, launches] at the plane by short steps, nan where not reached."""
    launches = len(flyer.launch)
    height_m = np.empty((len(cd), launches))
    block = max(1, BLOCK // launches)

    def one(first: int) -> None:
        pairs = np.arange(first, min(first + block, len(cd)))
        row = np.repeat(pairs, launches)
        height, gap, under = flyer.fly(np.tile(np.arange(launches), len(pairs)), cd[row], cl[row], SHORT)
        missed = (gap > 0.0) | under
        height_m[pairs] = np.where(missed, np.nan, height)[:len(row)].reshape(-1, launches)

    with ThreadPoolExecutor(usable_cores()) as pool:
        list(pool.map(one, range(0, len(cd), block)))
    return height_m
