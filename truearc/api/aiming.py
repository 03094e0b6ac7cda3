"""Set points by distance, from a belief."""

from collections.abc import Iterable, Mapping

import numpy as np

from truearc.api.terms import check_kind
from truearc.robot.config.rig_spec import Rig
from truearc.robot.config.schema import InputError
from truearc.sim.aim.aim_table import AimTable
from truearc.sim.aim.make_table import make_table
from truearc.sim.infer.belief import Belief
from truearc.sim.progress import Progress

STEP_M = 0.25                         # between distances, where none are given
DISTANCES_M = (2.0, 7.0)              # their range where the belief does not say to what it was fitted
HOOD_DEG = (20.0, 70.0)               # likewise
FARTHEST_M = 100.0


def aim(belief: Belief, rig: Rig, *, distances_m: Iterable[float] | None = None,
        hood_deg: tuple[float, float] | None = None, progress: Progress = lambda done, note: None) -> AimTable:
    """Find the hood angle and motor speed with the most expected points for each distance.

    The height at the target is normally distributed about the belief's forecast: scatter from shot to shot, noise of
    the sensors (rig.toml [noise]) and the belief's covariance. Among set points that are about equally good a smooth
    row with the slower wheels is taken.

    Args:
        belief: Coefficients, scatter and covariance.
        rig: Launcher, target and sensor noise.
        distances_m: From exit to target; None: every 0.25 m of the range that the belief was fitted to, else 2 to 7 m.
        hood_deg: Lowest and highest launch elevation; None: the range that the belief was fitted to, else 20 to 70.
        progress: Called with the share done, 0 to 1, and a note.

    Returns:
        A row per distance; distances at which nothing scores are listed with the reason. Two points count for passing
        the outer opening and three for the inner one; of a hit-or-miss target a hit counts two.

    Raises:
        InputError: a rig without target, wheels or free speed, a distance or angle that cannot be, or no distance with
            a set point that scores.
    """
    check_kind("belief", belief, Belief, "load_belief(...)")
    check_kind("rig", rig, Rig, "load_rig(...)")
    fitted = belief.provenance.get("range", {})
    known: Mapping[str, list[float]] = fitted if isinstance(fitted, Mapping) else {}
    low, high = known.get("hood_deg", HOOD_DEG) if hood_deg is None else hood_deg
    if not -90.0 < low <= high < 90.0:
        raise InputError(f"hood_deg: {low:g} to {high:g}; it must ascend, between -90 and 90")
    return make_table(rig, belief, _distances(distances_m, known), (low, high), progress)


def _distances(given: Iterable[float] | None, known: Mapping[str, list[float]]) -> np.ndarray:
    if given is None:
        low, high = known.get("distance_m", DISTANCES_M)
        first, last = np.ceil(low / STEP_M - 1e-9), np.floor(high / STEP_M + 1e-9)
        return np.arange(first, last + 1) * STEP_M if first <= last else np.array([0.5 * (low + high)])
    distances = np.unique(np.array(list(given), float))
    if not distances.size or not np.isfinite(distances).all() or distances[0] <= 0.0 or distances[-1] > FARTHEST_M:
        raise InputError(f"distances_m: between 0 and {FARTHEST_M:g} m are needed")
    return distances
