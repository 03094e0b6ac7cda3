"""The season of truearc.sim.world.season with what a proof adds: ball tracks, and marks and frames that go wrong."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from truearc.robot.config.rig_spec import Rig
from truearc.robot.config.shot_map import OUTCOMES
from truearc.sim.data.dataset import Tracks
from truearc.sim.printed import Progress
from truearc.sim.world import season
from truearc.sim.world.bench import Ball
from truearc.sim.world.field import Pose
from truearc.sim.world.options import Options
from truearc.sim.world.season import Season, ShotSetting, Trial
from truearc.sim.world.world import World

LEVELS = ("L0", "L1", "L2")
NOTED = ("miss-low", "miss-high", "two", "three")      # a crew that notes sides of misses alone


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

    As truearc.sim.world.season.play_season; without tracks and wrong marks the same arguments give the same season.
    """
    if level not in LEVELS:
        raise ValueError(f"no level {level!r}; there are {', '.join(LEVELS)}")
    rng = np.random.default_rng([seed, 7])
    trials = season.shoot(rig, options, seed, settings, season.Sensors(*sensors[:3]), rng, progress,
                          ball_from_muzzle)
    luck = np.random.default_rng([seed, 9])           # apart: good sensors have no part of it
    played = season.season_of(rig, seed, trials, level, _noted(trials, sensors, luck))
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
    """(s since it left, x, y, z in the launcher's axes) of the ball that left last, None if none is in the air."""
    if not world.flying:
        return None
    data = world.flying[-1].flight.data
    x_m, y_m, z_m = map(float, _from_muzzle(data.qpos[:3], world.chassis.pose()))
    return float(data.time), x_m, y_m, z_m


def _from_muzzle(place_m: np.ndarray, pose: Pose) -> np.ndarray:
    """From the field's axes to the launcher's."""
    cos, sin = math.cos(pose.heading_rad), math.sin(pose.heading_rad)
    turn = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    local_m: np.ndarray = turn @ (place_m - np.array([pose.x_m, pose.y_m, 0.0]))
    return local_m
