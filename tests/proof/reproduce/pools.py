"""Configurations with known outcomes, and sessions as a launcher would record them."""

from pathlib import Path

import msgspec
import numpy as np

from truearc import robot
from truearc.robot.config.schema import Prescribed, load_config
from truearc.robot.recording.session import CONFIG as CONFIG_FILE
from truearc.robot.recording.session import HEADER, TRIALS, Trial, make_header
from truearc.robot.types import Outcome, Shot
from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.data.recordings import rule
from truearc.sim.physics.simulate import classify, fly_rows, launch_of, predict
from truearc.sim.physics.term import Exit
from truearc_proof.reproduce import Settings
from truearc_proof.reproduce.collect import LAUNCHABLE, Pool

CONFIG = load_config(Path(robot.__file__).parent / "launcher.toml")
FACTS = CONFIG.rig
TRUTH = {"drag": {"cd": 0.5}, "magnus": {"cl": 0.05}}
EFFICIENCY, SCATTER, REPEATS = 0.75, 0.004, 10
SMALL = Settings(base_seed=5, draws=2, configurations=30, transfer=12, repeats=REPEATS, pool_each=14, launched=36,
                 sizes=(0, 90), best_size=90, weights=(0.01, 1.0), grid_step=0.1, steps=500, patience=250)


def shoot(shots: Shots, rng: np.random.Generator) -> np.ndarray:
    """Outcomes [n, REPEATS] of each configuration."""
    lucks = SCATTER * rng.normal(size=(REPEATS, len(shots)))
    return np.stack([classify(FACTS, heights(shots, luck)) for luck in lucks], axis=1)


def heights(shots: Shots, luck: np.ndarray) -> np.ndarray:
    """Of the truth at the target; luck [n]: of the logarithm of the speed."""
    start = launch_of(FACTS, shots)
    speed_m_s = start.speed_m_s * EFFICIENCY * np.exp(luck)
    return fly_rows(FACTS, TRUTH, Exit(speed_m_s, start.elevation_rad, start.spin_rev_s),
                    shots.number("distance_m")).height_m


def shots_of(**columns: np.ndarray) -> Shots:
    return Shots(tuple(map(str, range(len(columns["hood_deg"])))), columns, {})


def labelled(shots: Shots, rng: np.random.Generator) -> Shots:
    """The legitimate ones, by the paper's rule."""
    outcomes = shoot(shots, rng)
    r3 = (outcomes == "three").mean(axis=1)
    r2 = r3 + (outcomes == "two").mean(axis=1)
    said = [rule(*pair) for pair in zip(r2, r3, strict=True)]
    kept = np.array([word is not None for word in said])
    found = shots.take(kept)
    return Shots(found.shot_id, found.numbers, {**found.texts, "outcome": tuple(word for word in said if word)})


def configurations(count: int, rng: np.random.Generator) -> Shots:
    """Around where the target is, speeds from bisection on the truth's own flight: no code of the collection's."""
    distance_m, hood_deg = rng.uniform(2.6, 8.0, count), rng.uniform(40.0, 54.0, count)
    low, high = np.full(count, 0.2), np.full(count, 1.0)
    for _ in range(16):
        middle = 0.5 * (low + high)
        height_m = heights(shots_of(distance_m=distance_m, hood_deg=hood_deg, motor_ratio=middle), np.zeros(count))
        above = np.nan_to_num(height_m, nan=0.0) > FACTS.target.centre_height_m
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    ratio = high * (1.0 + rng.choice([0.0, 0.02, 0.12], count) * rng.choice([-1.0, 1.0], count))
    ids = tuple(f"real-c{k:04d}" for k in range(count))
    return Shots(ids, {"distance_m": distance_m, "hood_deg": hood_deg, "motor_ratio": np.minimum(ratio, 1.0)}, {})


def make_pool(seed: int = 1) -> Pool:
    """A pool whose launched configurations are drawn by another simulator, a wrong one, around where it scores."""
    rng = np.random.default_rng(seed)
    real = labelled(configurations(90, rng), rng)
    around = configurations(60, rng)
    columns = {name: np.clip(around.number(name) * rng.uniform(0.97, 1.03, 60), *LAUNCHABLE[name])
               for name in LAUNCHABLE}
    coefficients = {"drag": {"cd": 1.2}, "magnus": {"cl": 0.05}}
    said = classify(FACTS, predict(FACTS, coefficients, Shots(around.shot_id, columns, {})).height_m)
    chosen = Shots(tuple(f"launched-c{k:04d}" for k in range(60)), columns, {"simulated": tuple(map(str, said))})
    return Pool(Dataset("real", FACTS, real), Dataset("launched", FACTS, labelled(chosen, rng)), coefficients)


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
    (folder / CONFIG_FILE).write_bytes(msgspec.json.encode(config))
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
    shots = shots_of(**{name: np.array([getattr(row, name) for row in rows]) for name in LAUNCHABLE})
    height_m = heights(shots, SCATTER * rng.normal(size=len(rows)))
    sides = np.where(np.nan_to_num(height_m, nan=-1.0) > FACTS.target.centre_height_m, "miss-high", "miss-low")
    said = classify(FACTS, height_m)
    return np.where(said == "miss", sides, said).tolist()
