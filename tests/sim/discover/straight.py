"""A world in which everything is linear, in the place of the flights: names, refits and steps have closed forms there.

One measured number a shot (as an exit speed is): y [n] = slopes [n, slots] times the parameters + unit normal noise.
Only truearc.sim.infer.likelihood.forward_model.see_slopes is replaced; everything after it is the real thing.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from tests.sim.discover.made import column
from truearc.robot.config.rig_spec import Ball, Rig, Target
from truearc.sim.data.dataset import Circumstances, Shots
from truearc.sim.infer.fit import Fit, climb
from truearc.sim.infer.launcher import Launcher, LauncherFit
from truearc.sim.infer.likelihood.data import Intake, see_outcomes
from truearc.sim.infer.likelihood.forward_model import DEVIATES, Chain, Prediction, ShotBatch
from truearc.sim.infer.likelihood.layout import Layout, Point
from truearc.sim.infer.likelihood.linearization import SCATTERED
from truearc.sim.infer.likelihood.noise import SCATTERS
from truearc.sim.infer.likelihood.score_table import Column
from truearc.sim.physics.term import Exit

ASKED = ("wind_x.speed_m_s", "wind_y.speed_m_s", "wind_z.speed_m_s", "spin_decay.rate_per_s", "spin_drag.share",
         "drag_reynolds.slope", "lift_saturation.rate", "drag_wear.share", "buoyancy.share", "added_mass.share",
         "release_height.above_m", "battery_sag.sensitivity")
SHARED = ("drag.cd", "magnus.cl")
NAMES = (*ASKED, *SHARED)
FACTS = Rig(Ball(0.1, 0.1), target=Target(2.44))


def see_straight(slopes: np.ndarray) -> Callable[..., tuple[Prediction, Prediction]]:
    """In the place of see_slopes; lanes carry the number of their shot as their distance."""
    def see_slopes(chain: Chain, lanes: ShotBatch, point: Any, deviates: Any, edges_s: Any,
                   basis: Any) -> tuple[Prediction, Prediction]:
        mine = slopes[np.asarray(lanes.distance_m).astype(int)]
        n, k = len(mine), basis.shape[1]
        exit, by = np.zeros((n, 3)), np.zeros((n, 3, k))
        exit[:, 0], by[:, 0] = mine @ np.asarray(point), mine @ np.asarray(basis)[:len(NAMES)]
        none, none_by = np.zeros((n, 0, 3)), np.zeros((n, 0, 3, k))
        return (Prediction(exit, np.zeros((n, 4)), np.zeros(n, bool), none),
                Prediction(by, np.zeros((n, 4, k)), np.zeros(n), none_by))

    return see_slopes


def take_straight(y: np.ndarray) -> Intake:
    """Shots of which nothing was seen but y."""
    n, unknown = len(y), np.full(len(y), np.nan)
    zero = np.zeros(n)
    lanes = ShotBatch(Exit(zero, zero, zero, zero), 0.0, zero, zero, zero, zero, zero, np.arange(n), Circumstances(),
                      0.0, 0.0, 0.0, zero, 0.0)
    marked, seen = see_outcomes(Shots(tuple(map(str, range(n))), {}, {}), FACTS)
    return Intake(FACTS, FACTS, np.arange(n), lanes, np.zeros((n, len(DEVIATES))), np.zeros((n, len(SCATTERED))),
                  np.stack([y, unknown, unknown], axis=1), np.ones((n, 3)), marked, seen, np.zeros(0, int), None, None,
                  "L1", ())


def lay_straight(usual: np.ndarray) -> Layout:
    """All of ASKED, `usual` [K] large, and SHARED about zero with a standard deviation of 2."""
    slots = tuple((name.partition(".")[0], name.partition(".")[2]) for name in NAMES)
    chain = Chain(FACTS, tuple(term for term, _ in slots), slots, plane=False, track=False)
    columns: tuple[Column, ...] = (
        *(column(name, "term", usual=size) for name, size in zip(ASKED, usual, strict=True)),
        *(column(name, "shared") for name in SHARED))
    return Layout(chain, columns, np.arange(len(NAMES)), (-1,) * len(SCATTERS), np.diag(np.full(2, 0.25)), np.zeros(2),
                  np.zeros(0), np.zeros(len(slots)))


def slopes_and_y(planted: dict[str, float], seed: int, shots: int, copies: dict[str, str],
                 between: dict[str, tuple[str, ...]] | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Slopes all different, except `copies` {name: of which} and those `between` {name: which two}, nearly as alike to
    either; SHARED are at work too."""
    rng = np.random.default_rng(seed)
    slopes = rng.normal(size=(shots, len(NAMES)))
    for name, original in copies.items():
        slopes[:, NAMES.index(name)] = slopes[:, NAMES.index(original)]
    for name, (first, second) in (between or {}).items():
        mean = (slopes[:, NAMES.index(first)] + slopes[:, NAMES.index(second)]) / np.sqrt(2.0)
        slopes[:, NAMES.index(name)] = mean + 0.2 * slopes[:, NAMES.index(name)]
    truth = {SHARED[0]: 0.5, SHARED[1]: -0.3, **planted}
    return slopes, slopes @ [truth.get(name, 0.0) for name in NAMES] + rng.normal(size=shots)


def fit_straight(planted: dict[str, float], seed: int, shots: int = 200, copies: dict[str, str] | None = None,
                 usual: dict[str, float] | None = None, between: dict[str, tuple[str, ...]] | None = None,
                 varying: dict[str, np.ndarray] | None = None) -> LauncherFit:
    """The believed fit at its optimum. varying: sizes [shots] of what differs from shot to shot."""
    slopes, y = slopes_and_y(planted, seed, shots, copies or {}, between)
    for name, size in (varying or {}).items():
        y = y + slopes[:, NAMES.index(name)] * size
    layout = replace(lay_straight(np.array([(usual or {}).get(name, 0.3) for name in ASKED])), see=see_straight(slopes))
    model = Launcher(take_straight(y), layout)
    start = Point.still(layout, shots, np.zeros(len(NAMES)), np.zeros(len(SCATTERS)))
    point = climb(model.shared_only(), start).point
    return Fit(model, point, model.linearise(point)[0])
