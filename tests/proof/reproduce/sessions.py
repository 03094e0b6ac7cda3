"""Sessions of a point-mass launcher, written as a robot would leave them, in milliseconds."""

from pathlib import Path

import msgspec
import numpy as np

from tests.proof.reproduce.pools import EFFICIENCY, FACTS, SCATTER, TRUTH, configurations
from truearc.robot.config.schema import Prescribed
from truearc.robot.recording.session import CONFIG, HEADER, TRIALS, Trial, make_header
from truearc.robot.types import Outcome, Shot
from truearc.sim.data.dataset import Shots
from truearc.sim.physics.simulate import classify, fly_rows, launch_of
from truearc.sim.physics.term import Exit


class Launcher:
    """A `record` for the collection: remembers what it was asked for, and writes it where it is not there yet."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.asked: list[str] = []
        self.made: list[str] = []
        self.seeds: list[int] = []

    def __call__(self, recordings, what):
        for recording in recordings:
            self.asked.append(recording.name)
            self.seeds.append(recording.seed)
            if not (self.folder / recording.name).exists():
                self.made.append(recording.name)
                write_session(self.folder / recording.name, recording)
        return [self.folder / recording.name for recording in recordings]


def write_session(folder, recording):
    folder.mkdir(parents=True)
    config = recording.config
    (folder / HEADER).write_bytes(msgspec.json.encode(make_header(config, None, None)))
    (folder / CONFIG).write_bytes(msgspec.json.encode(config))
    rng = np.random.default_rng(recording.seed)
    rows = np.repeat(np.array(config.collect.prescribed or _loose(recording.trials, rng), dtype=object),
                     config.collect.repeats)[:recording.trials]
    outcomes = _shoot(rows, rng)
    lines = []
    for trial, (row, outcome) in enumerate(zip(rows, outcomes, strict=True)):
        shot = Shot(trial, 10**9 * trial, f"c{trial // config.collect.repeats:04d}", row.distance_m, 0.03, row.hood_deg,
                    row.motor_ratio, 300.0, 12.2, None, None, None)
        lines.append(msgspec.json.encode(Trial(Outcome(trial, 10**9 * trial, outcome), shot)))
    (folder / TRIALS).write_bytes(b"\n".join(lines) + b"\n")


def _loose(count, rng):
    """As a robot that walks: anywhere about the target."""
    shots = configurations(count, rng)
    ratio = shots.number("motor_ratio") * (1.0 + rng.uniform(-0.1, 0.1, count))
    return [Prescribed(*map(float, row)) for row in
            zip(shots.number("distance_m"), np.minimum(ratio, 1.0), shots.number("hood_deg"), strict=True)]


def _shoot(rows, rng):
    columns = {name: np.array([getattr(row, name) for row in rows]) for name in
               ("distance_m", "motor_ratio", "hood_deg")}
    start = launch_of(FACTS, Shots(tuple(map(str, range(len(rows)))), columns, {}))
    speed = start.speed_m_s * EFFICIENCY * np.exp(rng.normal(0.0, SCATTER, len(rows)))
    start = Exit(speed, start.elevation_rad, start.spin_rev_s)
    height_m = fly_rows(FACTS, TRUTH, start, columns["distance_m"]).height_m
    sides = np.where(np.nan_to_num(height_m, nan=-1.0) > FACTS.target.centre_height_m, "miss-high", "miss-low")
    said = classify(FACTS, height_m)
    return np.where(said == "miss", sides, said).tolist()
