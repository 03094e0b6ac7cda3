"""The shots that a team takes: configurations that reach the goal, from practice with this robot, with some spread."""

from functools import cache

import numpy as np

from truearc.sim.world.bench import Bench
from truearc.sim.world.field import CENTRE_HEIGHT_M
from truearc.sim.world.options import Options
from truearc.sim.world.season import ShotSetting
from truearc.sim.world.world import World
from truearc_proof.world.season import ball_from_muzzle

HOODS_DEG = np.arange(32.0, 65.0, 4.0)
RATIOS = np.arange(0.45, 0.86, 0.05)
FREE_RAD_S = 594.0
FAR_M = 30.0                          # no goal is in the way of practice
NEAREST_M, FARTHEST_M = 2.4, 8.0      # from where shots are taken
ASIDE = 0.05                          # one standard deviation of a shot's distance about the one that practice says
TRIES = 1000


@cache
def reach_table() -> np.ndarray:
    """Distance in m [hood, ratio] at which a ball of the robot as drawn falls through the centre's height; nan where it
    never gets that high."""
    bench = Bench(World(0, Options(scatter_scale=0.0, pose_scale=0.0), FAR_M), ball_from_muzzle)
    table = np.full((len(HOODS_DEG), len(RATIOS)), np.nan)
    for row, hood_deg in enumerate(HOODS_DEG):
        for column, ratio in enumerate(RATIOS):
            bench.samples.clear()
            bench.fire(float(ratio) * FREE_RAD_S, float(hood_deg), 1)
            table[row, column] = _falls_through(np.array([s.ball for s in bench.samples if s.ball is not None]))
    return table


def _falls_through(track: np.ndarray) -> float:
    """x at which z last falls through the centre's height."""
    x_m, above_m = track[:, 1], track[:, 3] - CENTRE_HEIGHT_M
    falling = np.flatnonzero((above_m[:-1] >= 0.0) & (above_m[1:] < 0.0))
    if not len(falling):
        return np.nan
    k = falling[-1]
    return float(x_m[k] + (x_m[k + 1] - x_m[k]) * above_m[k] / (above_m[k] - above_m[k + 1]))


def reach_m(hood_deg: float, ratio: float) -> float:
    """The table between its points, linear in both; nan outside it."""
    table = reach_table()
    row = (hood_deg - HOODS_DEG[0]) / (HOODS_DEG[1] - HOODS_DEG[0])
    column = (ratio - RATIOS[0]) / (RATIOS[1] - RATIOS[0])
    i, j = int(np.floor(row)), int(np.floor(column))
    if not (0 <= i < len(HOODS_DEG) - 1 and 0 <= j < len(RATIOS) - 1):
        return float("nan")
    p, q = row - i, column - j
    return float((1 - p) * ((1 - q) * table[i, j] + q * table[i, j + 1])
                 + p * ((1 - q) * table[i + 1, j] + q * table[i + 1, j + 1]))


def plan_season(seed: int, shots: int, nearest_m: float = NEAREST_M) -> list[ShotSetting]:
    """Configurations about the goal, in the order in which they are shot, from this distance on."""
    rng = np.random.default_rng([seed, 8])
    settings: list[ShotSetting] = []
    for _ in range(TRIES * shots):
        if len(settings) == shots:
            break
        hood_deg, ratio = rng.uniform(HOODS_DEG[0], HOODS_DEG[-1]), rng.uniform(RATIOS[0], RATIOS[-1])
        distance_m = reach_m(hood_deg, ratio) * (1.0 + ASIDE * rng.normal())
        if nearest_m <= distance_m <= FARTHEST_M:
            settings.append(ShotSetting(float(distance_m), float(hood_deg), float(ratio)))
    return settings
