"""Seasons of the MuJoCo world with what a proof adds: practice, ball tracks, wrong marks and lost frames.

`python -m truearc_proof.world.season` prints the ratio of exit speed to wheel speed.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np

from truearc.robot.config.rig_spec import Rig
from truearc.robot.config.shot_map import OUTCOMES
from truearc.sim.data.dataset import Tracks
from truearc.sim.printed import Progress
from truearc.sim.world import world
from truearc.sim.world.drive import UPPER_GEAR
from truearc.sim.world.field import CENTRE_HEIGHT_M, Pose
from truearc.sim.world.options import Options
from truearc.sim.world.scene import LOWER_RADIUS_M, UPPER_RADIUS_M
from truearc.sim.world.world import Ball, Bench, Season, ShotSetting, Trial, World

LEVELS = ("L0", "L1", "L2")
NOTED = ("miss-low", "miss-high", "two", "three")      # a crew that notes sides of misses alone
HOODS_DEG = np.arange(32.0, 65.0, 4.0)
RATIOS = np.arange(0.45, 0.86, 0.05)
FREE_RAD_S, BALL_RADIUS_M = 594.0, 0.0889
FAR_M = 30.0                          # no goal is in the way of practice
NEAREST_M, FARTHEST_M = 2.4, 8.0      # from where shots are taken
ASIDE = 0.05                          # one standard deviation of a shot's distance about the one that practice says
TRIES = 1000


class Sensors(NamedTuple):
    """Standard deviations of what is read from shot to shot; a tracker beside the field sees balls at `track_hz`,
    for the first `track_s` of each flight.

    wrong_marks: share of shots that are noted as one of the other outcomes. track_tails: degrees of freedom of
    Student's t, which track_m is then times (0: normal). lost_frames: share of a track's frames.
    """

    distance_m: float = 0.03
    hood_deg: float = 0.05
    wheel_rad_s: float = 0.3
    track_m: float = 0.015
    track_hz: float = 60.0
    track_s: float = 0.75
    wrong_marks: float = 0.0
    track_tails: int = 0
    lost_frames: float = 0.0


ORDINARY = Sensors()


def play_season(rig: Rig, options: Options, seed: int, settings: Sequence[ShotSetting], level: str,
                sensors: Sensors = ORDINARY, progress: Progress = lambda done, note: None) -> Season:
    """Shoot the settings in this order with one robot on one battery. level: "L0", "L1" (telemetry), "L2" (tracks too).

    As truearc.sim.world.world.play_season; without tracks and wrong marks the same arguments give the same season.
    """
    if level not in LEVELS:
        raise ValueError(f"no level {level!r}; there are {', '.join(LEVELS)}")
    rng = np.random.default_rng([seed, 7])
    trials = world.shoot(rig, options, seed, settings, world.Sensors(*sensors[:3]), rng, progress,
                          ball_from_muzzle)
    luck = np.random.default_rng([seed, 9])           # apart: good sensors have no part of it
    played = world.season_of(rig, seed, trials, level, _noted(trials, sensors, luck))
    if level != "L2":
        return played
    return played._replace(dataset=replace(played.dataset, tracks=_tracks(trials, sensors, rng, luck)))


def _noted(trials: Sequence[Trial], sensors: Sensors, luck: np.random.Generator) -> list[tuple[str, str]]:
    """Return (outcome, side) of each shot as the crew noted them, some with the wrong button; of twos no side."""
    wrong = luck.random(len(trials)) < sensors.wrong_marks
    aside = luck.integers(1, len(NOTED), len(trials))
    seen = [trial.result.outcome for trial in trials]
    places = [NOTED.index("two" if one.startswith("two") else one) for one in seen]
    return [OUTCOMES[NOTED[(place + int(slip) * int(step)) % len(NOTED)]]
            for place, slip, step in zip(places, wrong, aside, strict=True)]


def _tracks(trials: Sequence[Trial], sensors: Sensors, rng: np.random.Generator, luck: np.random.Generator) -> Tracks:
    """Return the samples at the tracker's rate, counted from the first of each ball, without the lost ones."""
    parts = []
    for shot, trial in enumerate(trials):
        begin_s, end_s = trial.track[0, 0], min(trial.track[-1, 0], trial.track[0, 0] + sensors.track_s)
        due = np.unique(np.searchsorted(trial.track[:, 0], np.arange(begin_s, end_s, 1.0 / sensors.track_hz)))
        kept = trial.track[due]
        size, tails = (len(kept), 3), sensors.track_tails
        seen = kept[:, 1:] + sensors.track_m * (luck.standard_t(tails, size) if tails else rng.normal(size=size))
        there = np.flatnonzero(luck.random(len(kept)) >= sensors.lost_frames)
        clock_s = kept[there, 0] - kept[there[:1], 0]
        parts.append(np.column_stack([np.full(len(there), shot), clock_s, seen[there]]))
    shot, t_s, x_m, y_m, z_m = np.concatenate(parts).T
    return Tracks(shot.astype(np.int64), t_s, x_m, y_m, z_m)


def ball_from_muzzle(world: World) -> Ball | None:
    """Return (s since it left, x, y, z in the launcher's axes) of the ball that left last, None if none is in the
    air."""
    if not world.flying:
        return None
    data = world.flying[-1].data
    x_m, y_m, z_m = map(float, _from_muzzle(data.qpos[:3], world.chassis.pose()))
    return float(data.time), x_m, y_m, z_m


def _from_muzzle(place_m: np.ndarray, pose: Pose) -> np.ndarray:
    """From the field's axes to the launcher's."""
    cos, sin = math.cos(pose.heading_rad), math.sin(pose.heading_rad)
    turn = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    local_m: np.ndarray = turn @ (place_m - np.array([pose.x_m, pose.y_m, 0.0]))
    return local_m


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
    """Interpolate the table, linearly in both; nan outside it."""
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
    """Return configurations about the goal, in shooting order, from this distance on."""
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


def survey() -> None:
    """Shoot balls without scatter, at motor speeds up to the free speed."""
    print("ratio  exit speed / wheels' mean surface speed  spin / spin without slip")
    for ratio in (0.4, 0.5, 0.6, 0.7, 0.8, 0.9):
        shot = Bench(World(0, Options(scatter_scale=0.0))).fire(ratio * FREE_RAD_S, 45.0, 1)[0]
        lower, upper = (shot.wheel_before_rad_s * each for each in (LOWER_RADIUS_M, UPPER_GEAR * UPPER_RADIUS_M))
        rolling_rev_s = (lower - upper) / (4.0 * math.pi * BALL_RADIUS_M)
        print(f"{ratio:5.2f}  {2.0 * shot.exit_speed_m_s / (lower + upper):38.3f}  "
              f"{shot.exit_spin_rev_s / rolling_rev_s:24.3f}")


if __name__ == "__main__":
    survey()
