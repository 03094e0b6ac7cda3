"""Recorded outcomes as what they say about the height at the plane."""

from typing import NamedTuple

import numpy as np

from truearc.robot.config.rig_spec import Target
from truearc.sim.data.dataset import Shots
from truearc.sim.paper.training import usable_rows
from truearc.sim.physics.simulate import MISS, THREE, TWO

# The plane from below to above: miss low, two low, three, two high, miss high.
CELLS = 5
UNKNOWN = (1,) * CELLS
CELLS_OF = {(MISS, ""): (1, 0, 0, 0, 1), (TWO, ""): (0, 1, 0, 1, 0), (THREE, ""): (0, 0, 1, 0, 0),
            (MISS, "low"): (1, 0, 0, 0, 0), (MISS, "high"): (0, 0, 0, 0, 1),
            (TWO, "low"): (0, 1, 0, 0, 0), (TWO, "high"): (0, 0, 0, 1, 0),
            # beside the centre: of the height it says no more than that it was within the two
            (TWO, "left"): (0, 1, 1, 1, 0), (TWO, "right"): (0, 1, 1, 1, 0),
            (MISS, "left"): UNKNOWN, (MISS, "right"): UNKNOWN}
ASIDE = ("left", "right")
LEVEL = {MISS: 0, TWO: 1, THREE: 2}


class OutcomeClasses(NamedTuple):
    """Shots that say something, one a row.

    features [n, 3] in the contract's order; cells [n, 5]: 1 where the height may have been, by the outcome and side;
    miss_m [n]: measured height minus the target's centre, nan where not measured (it then overrides the cells);
    level [n]: 0 miss, 1 two, 2 three, -1 not judged; aside [n]: a miss to the left or right, whose cells are all 1;
    group [n]: rows of one configuration share a number; shot_id [n].
    """

    features: np.ndarray
    cells: np.ndarray
    miss_m: np.ndarray
    level: np.ndarray
    aside: np.ndarray
    group: np.ndarray
    shot_id: np.ndarray

    def take(self, rows: np.ndarray) -> "OutcomeClasses":
        return OutcomeClasses(*(column[rows] for column in self))


def outcome_classes_of(shots: Shots, name: str,
                       target: Target | None = None) -> tuple[OutcomeClasses, list[str]]:
    """Return the outcome classes of shots, and a sentence for each kind of shot of `name` left out.

    target: of the rig; where every hit counts alike, a hit is a three. InputError when no shot is left.
    """
    outcome, side, miss_m = shots.text("outcome"), shots.text("side"), shots.number("miss_height_m")
    if target is not None and target.hit_or_miss:
        outcome = tuple(THREE if one == TWO else one for one in outcome)
    silent = np.array([one not in LEVEL for one in outcome], bool) & np.isnan(miss_m)
    features, kept, left_out = usable_rows(shots, name, silent, "no outcome or miss_height_m")
    cells = np.array([CELLS_OF.get((outcome[row], side[row]), CELLS_OF.get((outcome[row], ""), UNKNOWN))
                      for row in kept], float)
    level = np.array([LEVEL.get(outcome[row], -1) for row in kept])
    aside = np.array([outcome[row] == MISS and side[row] in ASIDE for row in kept])
    return OutcomeClasses(features, cells, miss_m[kept], level, aside, _groups(shots, kept),
                          np.array(shots.shot_id)[kept]), left_out


def _groups(shots: Shots, kept: np.ndarray) -> np.ndarray:
    """Shots of one session with one config_id are a group; a shot without a config_id is one by itself. Their numbers
    do not depend on the order of rows."""
    session, config = shots.text("session"), shots.text("config_id")
    keys = [(session[row], config[row]) if config[row] else ("", shots.shot_id[row]) for row in kept]
    numbers = {key: number for number, key in enumerate(sorted(set(keys)))}
    return np.array([numbers[key] for key in keys])
