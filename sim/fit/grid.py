"""The seed's coefficient search (section III-A and IV-C): every pair of drag and lift coefficient on a square grid."""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from robot.config import BadInput
from robot.facts import Facts
from sim.physics.catalogue import flight_terms
from sim.physics.flight import fly
from sim.physics.launch import Exit
from sim.physics.shot import THREE, TWO, launch_of, require
from sim.shots import Shots

LOW, HIGH, STEP = 0.0, 5.0, 0.005     # the seed's grid, bounds included
TERMS = flight_terms(("gravity", "drag", "magnus"))

# Coarser than sim.physics.flight's own: heights near the target then agree with DOP853 to 4e-5 m for 99 launches of
# 100 and to 1e-3 m for all, which no 0.07 m target notices, in half the time that 20 ms steps take.
STEP_S, TURN_RAD = 0.05, 0.2

Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class GridFit:
    """The map over the grid and the pair chosen from it. Maps are [len(axis), len(axis)]: row = cd, column = cl.

    `share_three`: of the shots whose outcome is three, those flown within the three's bounds. `share_two`: of those
    whose outcome is two or three, those flown within the two's. `mean_deviation_m`: mean |height - centre| of the
    shots whose outcome is three, infinite where one of them is not reached. `tied`: best in share_three, and among
    those in share_two.
    """

    axis: np.ndarray
    share_three: np.ndarray
    share_two: np.ndarray
    mean_deviation_m: np.ndarray
    tied: np.ndarray
    median_pair: tuple[float, float]  # (cd, cl) of the least median deviation among the tied
    cd: float
    cl: float
    mean_m: float                     # deviations at the chosen pair
    median_m: float
    shots_three: int
    shots_two: int

    @property
    def coefficients(self) -> dict[str, dict[str, float]]:
        return {"drag": {"cd": self.cd}, "magnus": {"cl": self.cl}}


def fit_grid(facts: Facts, shots: Shots, step: float = STEP, progress: Progress = lambda done, note: None) -> GridFit:
    """Fly every scoring shot with every pair of the grid and choose as the seed does.

    First the share of three-point shots flown into the three, then of scoring shots into the two, then the least mean
    deviation (and least median, cd, cl, should that tie too). Shots whose outcome is miss or unknown play no part: the
    seed's measures do not see them. BadInput: no shot with outcome three, no target, or a step that does not divide 5.
    """
    axis = make_axis(step)
    if facts.target is None:
        raise BadInput("rig.toml: [target] is needed to fit by outcomes")
    outcome = np.array(shots.text("outcome"))
    if not (outcome == THREE).any():
        raise BadInput("fit by grid needs at least one shot whose outcome is three")
    scoring = shots.take(np.flatnonzero((outcome == THREE) | (outcome == TWO)))
    is_three = np.array(scoring.text("outcome")) == THREE
    cd, cl = _pairs(axis)
    three, two, total_m = np.zeros(cd.shape, np.int32), np.zeros(cd.shape, np.int32), np.zeros(cd.shape)
    for row, deviation_m in enumerate(_deviations(facts, scoring, cd, cl)):
        two += deviation_m <= facts.target.two_half_height_m
        if is_three[row]:
            three += deviation_m <= facts.target.three_half_height_m
            total_m += deviation_m
        progress((row + 1) / len(scoring), f"{row + 1}/{len(scoring)} shots")
    tied = (three == three.max()) & (two == two[three == three.max()].max())
    median_m = _medians(facts, scoring.take(is_three), cd, cl, tied)
    return _choose(axis, three, two, total_m, tied, median_m, int(is_three.sum()), len(scoring))


def make_axis(step: float) -> np.ndarray:
    """The grid's values of one coefficient; BadInput when the step does not divide the range."""
    parts = (HIGH - LOW) / step if step > 0.0 else 0.0
    if parts < 1.0 or abs(parts - round(parts)) > 1e-6:
        raise BadInput(f"--step: {step:g} does not divide the range {LOW:g} to {HIGH:g}")
    return np.linspace(LOW, HIGH, round(parts) + 1)


def _choose(axis: np.ndarray, three: np.ndarray, two: np.ndarray, total_m: np.ndarray, tied: np.ndarray,
            median_m: np.ndarray, shots_three: int, shots_scoring: int) -> GridFit:
    """Maps arrive as [cl, cd]; median_m has the tied pairs only."""
    cd, cl = (part[tied] for part in _pairs(axis))
    mean_m = total_m / shots_three
    best = np.lexsort((cl, cd, median_m, mean_m[tied]))[0]
    least = np.lexsort((cl, cd, median_m))[0]
    return GridFit(axis, three.T / shots_three, two.T / shots_scoring, mean_m.T, tied.T,
                   (float(cd[least]), float(cl[least])), float(cd[best]), float(cl[best]),
                   float(mean_m[tied][best]), float(median_m[best]), shots_three, shots_scoring - shots_three)


def _pairs(axis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(cd, cl) of every pair, [cl, cd]: the flights of one row, of one lift, last about equally long."""
    cl, cd = np.meshgrid(axis, axis, indexing="ij")
    return cd, cl


def _medians(facts: Facts, shots: Shots, cd: np.ndarray, cl: np.ndarray, tied: np.ndarray) -> np.ndarray:
    """Median deviation of the three-point shots at each tied pair, in the order of np.flatnonzero."""
    lanes = cd.shape[1]
    pairs = int(tied.sum())
    at = np.resize(np.flatnonzero(tied), (-(-pairs // lanes), lanes))   # repeats pairs to fill the last block
    rows = [deviation_m.ravel()[:pairs] for deviation_m in _deviations(facts, shots, cd.ravel()[at], cl.ravel()[at])]
    return np.median(np.stack(rows), axis=0)


def _deviations(facts: Facts, shots: Shots, cd: np.ndarray, cl: np.ndarray) -> Iterator[np.ndarray]:
    """|height - centre| in m of one shot after the other at every pair; infinite where not reached.

    cd and cl are [blocks, lanes], and so is each result. A launch does not depend on the pair, so it is worked out
    once; one thread a core, results in the order of shots.
    """
    exit, distance_m = launch_of(facts, shots), require(shots, "distance_m")
    workers = os.cpu_count() or 1

    def one(row: int) -> np.ndarray:
        height_m = _heights(facts, Exit(*(part[row] for part in exit)), distance_m[row], cd, cl)
        return np.nan_to_num(np.abs(np.asarray(height_m) - facts.target.centre_height_m), nan=np.inf)

    with ThreadPoolExecutor(workers) as pool:
        for first in range(0, len(shots), 2 * workers):
            yield from pool.map(one, range(first, min(first + 2 * workers, len(shots))))


@partial(jax.jit, static_argnames=("facts",))
def _heights(facts: Facts, exit: Exit, distance_m: float, cd: jnp.ndarray, cl: jnp.ndarray) -> jnp.ndarray:
    """Height of one launch at each pair [blocks, lanes], flown a block at a time."""
    def block(pair: tuple[jnp.ndarray, jnp.ndarray]) -> jnp.ndarray:
        params = {"drag": {"cd": pair[0]}, "magnus": {"cl": pair[1]}}
        return fly(facts, TERMS, params, exit, distance_m, step_s=STEP_S, turn_rad=TURN_RAD).height_m

    return lax.map(block, (cd, cl))
