"""Labels for launches at every pair of coefficients on the grid, interpolated from a few flights.

A cell is a block of grid points for one launch. Its flights are computed at 8 x 8 Chebyshev-Lobatto nodes. Between the
nodes, the height at the plane is taken to be a polynomial if all nodes reach the plane and the last coefficients are
small. Points whose height is so close to a bound of the target that the polynomial cannot settle their label are marked
to be simulated individually. Maps are indexed [cl, cd]. Functions compiled by numba work on the cells [first, last) of
their arrays.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from types import ModuleType

import numpy as np
import numpy.typing as npt
from numba import njit

from truearc.robot.config.rig_spec import Rig
from truearc.sim.compute import usable_cores
from truearc.sim.paper import grid_kernel
from truearc.sim.physics.flight import LIMIT_S, SHORTEST
from truearc.sim.physics.term import Exit
from truearc.sim.printed import Progress

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int32] | npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]
Labels = npt.NDArray[np.uint8]
Target = tuple[float, float, float]   # centre, three's half height, two's half height in m

NODES = 8                             # a side; 64 flights fill a batch of the kernel
WIDEST = 64                           # points a side of the largest cell
LEAF = 8                              # points a side of a cell that is flown point by point

MISS, TWO, THREE, DOUBTFUL = 0, 1, 2, 3
NOTHING, SPLIT, PAINTED = 0, 1, 2     # what becomes of a cell

ROUGH_M = 0.03                        # an interpolant worse than this is not trusted to know how bad it is
SURE_M = 1e-3                         # nearer to a bound than this, a flight with long steps does not settle a label
GRAZING_M = 5e-3                      # a flight that turns back this near to the plane, before or behind it
CUSP = 1.0                            # times what gaps to the plane differ elsewhere: parted by more, by a cusp
MAX_DOUBTFUL = 96                     # points flown singly before a split is cheaper

compiled = njit(fastmath={"nsz", "arcp", "contract", "afn", "reassoc"}, error_model="numpy", nogil=True, cache=True)
LANES = NODES * NODES
BLOCK = 1 << 14                       # flights that one thread is handed at once
AT_ONCE = 4                           # launches whose cells one thread looks at together
DEEPEST_M = -0.5                      # below the floor, where a flight is given up

# Longest step in s and turn in rad. Long: heights near the target within 4e-4 m; short: within 2e-6 m (measured).
LONG, SHORT = (0.05, 0.2), (0.01, 0.05)


def _basis(part: np.ndarray) -> np.ndarray:
    return np.polynomial.chebyshev.chebvander(2.0 * part - 1.0, NODES - 1)


NODES_AT = (1.0 - np.cos(np.pi * np.arange(NODES) / (NODES - 1))) / 2.0       # Chebyshev-Lobatto points in 0-1 [NODES]
TRANSFORM = np.linalg.inv(_basis(NODES_AT))           # values at the nodes -> Chebyshev coefficients [NODES, NODES]
# The Chebyshev polynomials at m evenly spaced points, for each m from 2: [WIDEST + 1, WIDEST, NODES].
TABLES = np.zeros((WIDEST + 1, WIDEST, NODES))
for _points in range(2, WIDEST + 1):
    TABLES[_points, :_points] = _basis(np.linspace(0.0, 1.0, _points))


def make_roots(points: int, launches: int) -> np.ndarray:
    """Return the first cells [n, 5] = launch, cl from, cl to, cd from, cd to (indices of the axis, both included)."""
    edges = np.linspace(0, points, -(-points // WIDEST) + 1).round().astype(np.int32)
    spans = np.stack([edges[:-1], edges[1:] - 1], axis=1)
    launch, row, column = np.meshgrid(np.arange(launches), np.arange(len(spans)), np.arange(len(spans)), indexing="ij")
    return np.concatenate([launch.reshape(-1, 1), spans[row.ravel()], spans[column.ravel()]], axis=1).astype(np.int32)


def split(cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return quarters of cells: (those to examine again, those small enough to be flown point by point)."""
    launch, top, bottom, left, right = cells.T
    row, column = (top + bottom) // 2, (left + right) // 2
    quarters = [np.stack([launch, *part], axis=1) for part in (
        (top, row, left, column), (top, row, column + 1, right),
        (row + 1, bottom, left, column), (row + 1, bottom, column + 1, right))]
    parts = np.stack(quarters, axis=1).reshape(-1, 5)
    parts = parts[(parts[:, 1] <= parts[:, 2]) & (parts[:, 3] <= parts[:, 4])]
    small = (parts[:, 2] - parts[:, 1] < LEAF) & (parts[:, 4] - parts[:, 3] < LEAF)
    return parts[~small], parts[small]


@compiled
def mark(cells: Ints, labels: Labels, label: int) -> None:
    """Give every point of the cells the same label."""
    for cell in range(len(cells)):
        launch, top, bottom, left, right = cells[cell]
        labels[launch, top:bottom + 1, left:right + 1] = label


@compiled
def label_points(points: Ints, height_m: Floats, gap_m: Floats, under: Bools, target: Target, final: bool,
                 labels: Labels) -> int:
    """Label points from their own flights; unless `final`, those near a bound stay DOUBTFUL. Returns how many do.

    target: centre, three's half height, two's half height in m.
    """
    centre, three, two = target
    doubtful = 0
    for k in range(len(points)):
        off = abs(height_m[k] - centre)
        label = MISS
        if gap_m[k] <= 0.0 and not under[k]:
            label = THREE if off <= three else TWO if off <= two else MISS
        if not final and off < two + SURE_M:
            near = abs(off - three) < SURE_M or abs(off - two) < SURE_M
            if near or abs(gap_m[k]) < GRAZING_M or under[k]:
                label = DOUBTFUL
                doubtful += 1
        labels[points[k, 0], points[k, 1], points[k, 2]] = label
    return doubtful


@compiled
def largest_step(values: Floats) -> float:
    """Return the largest difference between two of four neighbouring nodes of a [NODES, NODES] array."""
    a, b, c, d = values[:-1, :-1], values[:-1, 1:], values[1:, :-1], values[1:, 1:]
    highest = np.maximum(np.maximum(a, b), np.maximum(c, d))
    return float((highest - np.minimum(np.minimum(a, b), np.minimum(c, d))).max())


@compiled
def has_cusp(gap: Floats) -> bool:
    """Return whether a flight that stops in mid-air separates flights that turn back from those that reach the
    plane.

    Where the plane itself parts them, the gap grows from nothing; where a flight all but turns back and then goes on,
    it begins at a finite size, and heights beside it change faster than nodes can tell.
    """
    leap, edge = 0.0, 0.0
    for row in range(NODES):
        for column in range(NODES):
            here = gap[row, column]
            for other in ((row + 1, column), (row, column + 1)):
                if other[0] == NODES or other[1] == NODES:
                    continue
                there = gap[other[0], other[1]]
                if here > 0.0 and there > 0.0:
                    leap = max(leap, abs(here - there))
                elif here > 0.0 or there > 0.0:
                    edge = max(edge, max(here, there))
    return edge > CUSP * leap


@compiled
def judge(height: Floats, gap: Floats, under: Bools, low: float, high: float) -> int:
    """Judge a cell by its nodes: NOTHING of the target in it, SPLIT it, or PAINTED: an interpolant may settle it.

    Nothing: all pass, or end, above the target or below it, or end before the plane, by more than neighbours differ
    anywhere in the cell. A judgement by each neighbourhood alone saves hardly a flight and misses ten times as much.
    """
    jump = largest_step(height)
    if gap.min() > largest_step(gap) or height.max() < low - jump:
        return NOTHING
    if height.min() > high + jump and not has_cusp(gap):
        return NOTHING
    return SPLIT if np.any((gap > 0.0) | (under & (height > 0.0))) else PAINTED


@compiled
def settle(cells: Ints, height_m: Floats, gap_m: Floats, under: Bools, target: Target, transform: Floats,
           tables: Floats, labels: Labels, verdict: Ints) -> None:
    """Judge cells by their nodes and paint the labels of those that an interpolant settles.

    verdict [n]: see judge.
    """
    centre, three, two = target
    low, high = centre - two, centre + two
    for cell in range(len(cells)):
        first = cell * NODES * NODES
        height = height_m[first:first + NODES * NODES].reshape(NODES, NODES)
        gap = gap_m[first:first + NODES * NODES].reshape(NODES, NODES)
        verdict[cell] = judge(height, gap, under[first:first + NODES * NODES].reshape(NODES, NODES), low, high)
        if verdict[cell] != PAINTED:
            continue
        shape = transform @ height @ transform.T
        size = np.abs(shape)
        tail = (size[NODES - 2:].sum() + size[:NODES - 2, NODES - 2:].sum())
        if tail > ROUGH_M:
            verdict[cell] = SPLIT
            continue
        unsure = SURE_M + tail
        reach = size.sum() - size[0, 0] + unsure
        if shape[0, 0] - reach > high or shape[0, 0] + reach < low:
            verdict[cell] = NOTHING
            continue
        launch, top, bottom, left, right = cells[cell]
        doubtful = paint(shape, tables[bottom - top + 1], tables[right - left + 1], unsure, centre, three, two,
                         labels[launch, top:bottom + 1, left:right + 1])
        if doubtful > MAX_DOUBTFUL:
            verdict[cell] = SPLIT
            labels[launch, top:bottom + 1, left:right + 1] = MISS


@compiled
def paint(shape: Floats, rows: Floats, columns: Floats, unsure: float, centre: float, three: float, two: float,
          labels: Labels) -> int:
    """Label a cell's points from its polynomial; return how many are DOUBTFUL."""
    heights = rows[:labels.shape[0]] @ shape @ columns[:labels.shape[1]].T
    found = 0
    for row in range(labels.shape[0]):
        for column in range(labels.shape[1]):
            off = abs(heights[row, column] - centre)
            label = (1 if off <= two else 0) + (1 if off <= three else 0)
            near = (abs(off - two) < unsure) | (abs(off - three) < unsure)
            labels[row, column] = DOUBTFUL if near else label
            found += 1 if near else 0
    return found


@dataclass(frozen=True)
class Hits:
    """Every (launch, pair) that scores: `pair` = index in the grid [cl, cd] laid flat; `label` 1 two, 2 three."""

    launch: np.ndarray
    pair: np.ndarray
    label: np.ndarray


@dataclass(frozen=True)
class Flyer:
    """Flies launches with pairs of coefficients."""

    kernel: ModuleType
    rig_values: tuple[float, ...]
    release_m: float
    launch: np.ndarray                # [n, 4] forward and upward speed m/s, spin rev/s, distance m

    def fly(self, which: np.ndarray, cd: np.ndarray, cl: np.ndarray, steps: tuple[float, float]) -> tuple[
            np.ndarray, np.ndarray, np.ndarray]:
        """Return (height, gap, under) of every lane as in the kernel; any number of lanes."""
        batches = -(-len(which) // LANES)
        if len(which) != batches * LANES:
            which, cd, cl = (np.resize(part, batches * LANES) for part in (which, cd, cl))
        height_m, gap_m = np.empty(batches * LANES), np.empty(batches * LANES)
        under = np.empty(batches * LANES, np.bool_)
        rules = (self.release_m, *steps, steps[0] * SHORTEST, DEEPEST_M, LIMIT_S)
        self.kernel.fly_lanes((0, batches), self.launch, which, cd, cl, self.rig_values, rules, height_m, gap_m, under)
        return height_m, gap_m, under


def make_flyer(rig: Rig, exit: Exit, distance_m: np.ndarray) -> Flyer:
    """Return a flyer of these launches; the first flight compiles, which takes seconds, and the result stays on
    disk."""
    launch = np.stack([exit.speed_m_s * np.cos(exit.elevation_rad), exit.speed_m_s * np.sin(exit.elevation_rad),
                       exit.spin_rev_s, distance_m], axis=1)
    return Flyer(grid_kernel, grid_kernel.facts_of(rig), float(rig.launcher.release_height_m), launch)


def label_launches(flyer: Flyer, axis: np.ndarray, target: Target, rows: range) -> np.ndarray:
    """Return labels 0 miss, 1 two, 2 three [launches, cl, cd] of launches `rows` at every pair of the axis.

    target: centre, three's and two's half height in m.
    """
    labels = np.zeros((len(rows), len(axis), len(axis)), np.uint8)
    part = replace(flyer, launch=flyer.launch[rows.start:rows.stop])
    cells, leaves = make_roots(len(axis), len(rows)), []
    if len(axis) <= LEAF:
        cells, leaves = cells[:0], [cells]
    while len(cells):
        cells, small = split(cells[_look(part, axis, target, cells, labels) == SPLIT])
        leaves.append(small)
    mark(np.concatenate(leaves), labels, DOUBTFUL)
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
    settle(cells, height_m, gap_m, under, target, TRANSFORM, TABLES, labels, verdict)
    return verdict


def _fly_doubtful(flyer: Flyer, axis: np.ndarray, target: Target, labels: np.ndarray, steps: tuple[float, float],
                  final: bool) -> int:
    """Fly every point labelled DOUBTFUL and label it; returns how many stay so, none if `final`."""
    points = np.stack(np.unravel_index(np.flatnonzero(labels == DOUBTFUL), labels.shape), axis=1)
    height_m, gap_m, under = flyer.fly(points[:, 0], axis[points[:, 2]], axis[points[:, 1]], steps)
    return label_points(points, height_m, gap_m, under, target, final, labels)


def find_hits(flyer: Flyer, axis: np.ndarray, target: Target, progress: Progress) -> Hits:
    """Fly every launch over the whole grid, one thread per core; the result does not depend on their number."""
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
    """Return heights in m [pairs, launches] at the plane by short steps, nan where not reached."""
    launches = len(flyer.launch)
    height_m = np.empty((len(cd), launches))
    block = max(1, BLOCK // launches)

    def one(first: int) -> None:
        pairs = np.arange(first, min(first + block, len(cd)))
        row = np.repeat(pairs, launches)
        height, gap, under = flyer.fly(np.tile(np.arange(launches), len(pairs)), cd[row], cl[row], SHORT)
        height_m[pairs] = np.where((gap > 0.0) | under, np.nan, height)[:len(row)].reshape(-1, launches)

    with ThreadPoolExecutor(usable_cores()) as pool:
        list(pool.map(one, range(0, len(cd), block)))
    return height_m
