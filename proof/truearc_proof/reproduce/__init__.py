"""The reproduction of the paper's tables and figures on recordings of the emulated robot, and the sizes of its data."""

from dataclasses import dataclass

from truearc.errors import InputError
from truearc.sim.paper import PATIENCE, STEPS

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
        """Number of configurations of the most common outcome in a draw."""
        return -(-self.configurations // 3)


def quick(base_seed: int, draws: int) -> Settings:
    """Return sizes that take minutes: enough to see every table and picture, not enough for conclusions."""
    return Settings(base_seed=base_seed, draws=draws, configurations=30, transfer=12, repeats=5, practice_trials=20,
                    session_rows=10, pool_each=12, most_rounds=4, launched=30, sizes=(0, 500, 900),
                    weights=(0.001, 0.01, 0.1, 10.0), grid_step=0.02, steps=200_000, patience=50_000)
