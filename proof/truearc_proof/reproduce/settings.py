"""What a reproduction records and draws, and the paper's launch."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from truearc.errors import InputError
from truearc.robot.config.rig_spec import Rig
from truearc.sim.data.columns import OUTCOMES
from truearc.sim.data.dataset import Shots
from truearc.sim.paper.settings import PATIENCE, STEPS
from truearc.sim.physics.launch import Exit, exit_opposed, is_opposed

QUICK_DRAWS = 3                       # repetitions with --quick
LEAST = 6                             # fewer configurations of an outcome than this cannot be split
EVERYTHING, REAL, SIMULATED = "D_r test + D_s^T", "D_r test", "D_s^T"      # rows that models are judged by
WHERE = (EVERYTHING, REAL, SIMULATED)


@dataclass(frozen=True)
class Settings:
    """Sizes of one reproduction; the defaults are the paper's where it has any (section IV)."""

    base_seed: int = 3001             # every recording and every draw follows from it
    draws: int = 20                   # repetitions that the intervals are over, the paper's 1
    configurations: int = 100         # D_r of each draw, an even share of each outcome
    test_share: float = 0.2
    transfer: int = 50                # D_s^T of each draw
    repeats: int = 10                 # shots at each configuration
    practice_trials: int = 75         # single shots of each practice session, from which the crew learns to aim
    session_rows: int = 12            # configurations of each session
    pool_each: int = 80               # recorded until every outcome has this many legitimate configurations
    most_rounds: int = 14             # ... or this many rounds of sessions are over
    launched: int = 180               # simulated configurations really launched, from which D_s^T is drawn
    sizes: tuple[int, ...] = (0, 500, 600, 750, 900, 1000, 1250)          # Table II
    best_size: int = 900
    weights: tuple[float, ...] = (0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0)     # Fig. 10: lambda
    best_weight: float = 0.01
    grid_step: float = 0.005          # of both coefficients
    steps: int = STEPS                # of each network's training, at most; a validation split says when to stop
    patience: int = PATIENCE

    def __post_init__(self) -> None:
        if self.base_seed < 0:
            raise InputError(f"--seed {self.base_seed}: cannot be negative")
        if self.draws < 2:
            raise InputError(f"--seeds {self.draws}: at least 2, or there is no interval")
        if self.pool_each < self.each or self.each < LEAST:
            raise ValueError(f"pool of {self.pool_each} of each outcome for draws of {self.each}")

    @property
    def each(self) -> int:
        """Configurations of the commonest outcome in a draw."""
        return -(-self.configurations // 3)


def quick(base_seed: int, draws: int) -> Settings:
    """Sizes that take minutes: enough to see every table and picture, not enough to conclude anything."""
    return Settings(base_seed=base_seed, draws=draws, configurations=30, transfer=12, repeats=5, practice_trials=20,
                    session_rows=10, pool_each=12, most_rounds=4, launched=30, sizes=(0, 500, 900),
                    weights=(0.001, 0.01, 0.1, 10.0), grid_step=0.02, steps=200_000, patience=50_000)


class Draw(NamedTuple):
    """Row numbers: `train` and `test` of the real pool, `transfer` of the launched one; each even by outcome.

    `validation` is a part of `train`: it says when to stop training, and is fitted by what needs no stopping.
    """

    train: np.ndarray
    validation: np.ndarray
    test: np.ndarray
    transfer: np.ndarray


def draw(real: Shots, launched: Shots | None, settings: Settings, number: int) -> Draw:
    """The repetition of that number, from 0; the same settings and pools give the same draw.

    D_r is even by outcome, D_s^T by what the simulator said of it. Without `launched`, `transfer` is empty.
    """
    rng = np.random.default_rng([settings.base_seed, number, 33])
    chosen = _even(np.array(real.text("outcome")), settings.configurations, rng)
    test = _even(np.array(real.text("outcome"))[chosen], round(settings.test_share * len(chosen)), rng)
    kept = np.setdiff1d(np.arange(len(chosen)), test)
    train = chosen[kept]
    watched = _even(np.array(real.text("outcome"))[train], round(settings.test_share * len(train)), rng)
    if launched is None:
        transfer = np.zeros(0, np.int64)
    else:
        transfer = _even(np.array(launched.text("simulated")), settings.transfer,
                         np.random.default_rng([settings.base_seed, number, 34]))
    return Draw(train, train[watched], chosen[test], transfer)


def _even(outcomes: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """`count` ascending rows with as even a share of each outcome as there are rows for."""
    rest, chosen = count, []
    pools = sorted((rng.permutation(np.flatnonzero(outcomes == outcome)) for outcome in OUTCOMES), key=len)
    for number, pool in enumerate(pools):
        share = min(len(pool), -(-rest // (len(pools) - number)) if number else rest // len(pools))
        chosen.append(pool[:share])
        rest -= share
    return np.sort(np.concatenate(chosen))


def exit_seed(rig: Rig, motor_ratio: Any, hood_deg: Any) -> Exit:
    """Launch of the two-wheel rig at motor speed / free speed and elevation.

    The paper's Eq. 11 and 12, the latter with its own factor (twice the spin of a ball that does not slip).
    Raises InputError when the rig has no free speed or not one wheel above and one below.
    """
    if not is_opposed(rig):
        raise InputError("rig.toml: launcher.wheel: the paper's Eq. 11 and 12 need two wheels, clock_deg 0 and 180")
    if rig.launcher.free_speed_rad_s is None:
        raise InputError("rig.toml: launcher.free_speed_rad_s is needed to turn motor_ratio into a launch")
    upper, lower = sorted(rig.launcher.wheel, key=lambda wheel: round(wheel.clock_deg % 360.0, 6))
    motor_rad_s = motor_ratio * rig.launcher.free_speed_rad_s
    return exit_opposed(rig, motor_rad_s * (upper.gear * upper.radius_m), motor_rad_s * (lower.gear * lower.radius_m),
                        hood_deg)
