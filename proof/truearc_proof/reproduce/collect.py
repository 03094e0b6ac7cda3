"""The recordings: practice, aimed configurations until each outcome is there often enough, simulated ones launched.

Every session follows from the settings and from the sessions before it, so a collection that was broken off goes on
where it stopped. Nothing here records: that is `record`'s work, which returns the sessions' folders in order.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from truearc.errors import InputError
from truearc.robot.config.overrides import with_plan
from truearc.robot.config.rig_spec import Rig
from truearc.robot.config.schema import Config, Prescribed
from truearc.sim.data.columns import OUTCOMES
from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.data.recordings import label_by_repeatability, shots_from_sessions
from truearc.sim.paper.grid_fit import fit_grid
from truearc.sim.paper.synthetic import AXES, SHAPE, grid_shots, label_grid, sample_balanced, taken_configurations
from truearc.sim.printed import Progress
from truearc_proof.reproduce.aiming import RATIOS, Aiming, intentions, learn_aiming, propose
from truearc_proof.reproduce.draws import draw
from truearc_proof.reproduce.settings import Settings

ABREAST = 4                           # sessions of a round, which may be recorded side by side
PRACTICE_SPREAD = 0.12                # speeds off by up to this: misses on both sides teach more than twos
MARKED_SHARE = 0.8                    # of a configuration's shots must be marked: some are rejected or held
# Limits of the camera, the field and the wheels; about the 3 to 30 feet of the paper's zones.
LAUNCHABLE = {"distance_m": (2.0, 9.2), "motor_ratio": RATIOS, "hood_deg": (15.0, 75.0)}


class Recording(NamedTuple):
    """One session to be recorded."""

    name: str
    config: Config
    trials: int
    seed: int


class Pool(NamedTuple):
    """Legitimate configurations: `real` as the crew chose them, `launched` simulated ones really shot.

    `launched` has a text column `simulated`, what the simulator that they were drawn with says of each;
    `coefficients` are that simulator's.
    """

    real: Dataset
    launched: Dataset
    coefficients: dict[str, dict[str, float]]


Record = Callable[[Sequence[Recording], str], list[Path]]


def collect(config: Config, settings: Settings, record: Record, progress: Progress) -> Pool:
    """Record (or find recorded) all that the analysis draws from."""
    real = collect_real(config, settings, record)
    launched, coefficients = launch_simulated(config, settings, real, record, progress)
    return Pool(real, launched, coefficients)


def collect_real(config: Config, settings: Settings, record: Record) -> Dataset:
    """Practice, then rounds of aimed configurations until every outcome has `pool_each` legitimate ones.

    InputError when `most_rounds` rounds do not give enough for a draw.
    """
    loose = replace(config, collect=replace(config.collect, repeats=1, spread=PRACTICE_SPREAD))
    practice = record([Recording(f"practice-{number}", loose, settings.practice_trials, _seed(settings, 0, number))
                       for number in range(ABREAST)], "practice")
    sessions: list[Path] = []
    counts = dict.fromkeys(OUTCOMES, 0)
    for round_number in range(settings.most_rounds):
        aiming = _aiming(config.rig, [*practice, *sessions])
        shares = intentions({outcome: settings.pool_each - count for outcome, count in counts.items()})
        sessions += record([_aimed(config, settings, aiming, shares, round_number, number)
                            for number in range(ABREAST)], f"round {round_number + 1} ({_said(counts)})")
        labelled = labels(sessions, "real", settings)
        counts = {outcome: labelled.shots.text("outcome").count(outcome) for outcome in OUTCOMES}
        if min(counts.values()) >= settings.pool_each:
            return labelled
    if min(counts.values()) < settings.each:
        raise InputError(f"{len(sessions)} sessions gave {_said(counts)}: too few for draws of "
                         f"{settings.configurations}")
    return labelled


def labels(sessions: Sequence[Path], name: str, settings: Settings) -> Dataset:
    """One row a legitimate configuration of the sessions, labelled by the paper's rule (section IV-A)."""
    shots = shots_from_sessions(sessions, name, telemetry=False)
    return label_by_repeatability(shots, math.ceil(MARKED_SHARE * settings.repeats))


def _aiming(rig: Rig, sessions: Sequence[Path]) -> Aiming:
    aiming = learn_aiming(rig, shots_from_sessions(sessions, "practice", telemetry=False).shots)
    if aiming is None:
        raise InputError("the practice sessions have misses on one side of the target only, which do not determine "
                         "the aim: try another --seed, or without --quick")
    return aiming


def _said(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {outcome}" for outcome, count in counts.items())


def _aimed(config: Config, settings: Settings, aiming: Aiming, shares: Mapping[str, float], round_number: int,
           number: int) -> Recording:
    seed = _seed(settings, 1 + round_number, number)
    rows = propose(config.rig, config.collect, aiming, shares, settings.session_rows,
                   np.random.default_rng([seed, 31]))
    return _prescribed(f"aimed-{round_number:02d}-{number}", config, rows, settings, seed)


def _prescribed(name: str, config: Config, rows: Sequence[Prescribed], settings: Settings, seed: int) -> Recording:
    return Recording(name, with_plan(config, tuple(rows), settings.repeats), len(rows) * settings.repeats, seed)


def _seed(settings: Settings, group: int, number: int) -> int:
    """A seed of its own for every session: the base seed's last digits stay out of each other's way."""
    return 1000 * settings.base_seed + 10 * group + number


def launch_simulated(config: Config, settings: Settings, real: Dataset, record: Record,
                     progress: Progress) -> tuple[Dataset, dict[str, dict[str, float]]]:
    """Launch an even sample of the simulator's configurations, fitted as the first draw does; (labelled, simulator).

    InputError when fewer than `transfer` turn out legitimate.
    """
    train = real.shots.take(draw(real.shots, None, settings, 0).train)
    coefficients = fit_grid(real.facts, train, settings.grid_step, progress).coefficients
    chosen, outcome = choose_launches(real.facts, coefficients, real.shots, settings.launched,
                                      _seed(settings, 90, 0), progress)
    recordings, simulated = _launches(config, settings, chosen, outcome)
    labelled = labels(record(recordings, "simulated configurations"), "launched", settings)
    if len(labelled.shots) < settings.transfer:
        raise InputError(f"only {len(labelled.shots)} of {settings.launched} launched configurations are legitimate; "
                       f"{settings.transfer} are needed")
    said = tuple(simulated[name] for name in labelled.shots.shot_id)
    shots = Shots(labelled.shots.shot_id, labelled.shots.numbers, {**labelled.shots.texts, "simulated": said})
    return Dataset(labelled.name, labelled.facts, shots, left_out=labelled.left_out), coefficients


def choose_launches(rig: Rig, coefficients: dict[str, dict[str, float]], real: Shots, count: int, seed: int,
                    progress: Progress) -> tuple[Shots, np.ndarray]:
    """`count` configurations of the paper's grid that the robot can shoot, even by simulated outcome; and that."""
    outcomes = label_grid(rig, coefficients, progress)
    barred = np.zeros(len(outcomes), bool)
    barred[taken_configurations(real)] = True
    places = np.unravel_index(np.arange(len(outcomes)), SHAPE)
    for axis, place in zip(AXES, places, strict=True):
        low, high = LAUNCHABLE[axis.name]
        barred |= ~((axis.values() >= low - 1e-9) & (axis.values() <= high + 1e-9))[place]
    index = sample_balanced(outcomes, count, np.flatnonzero(barred), seed)
    index = np.random.default_rng([seed, 32]).permutation(index)
    return grid_shots(index), outcomes[index]


def _launches(config: Config, settings: Settings, chosen: Shots,
              outcome: np.ndarray) -> tuple[list[Recording], dict[str, str]]:
    """Sessions that launch them, and what the simulator says of each by the shot_id that its labelled row will have."""
    recordings: list[Recording] = []
    simulated: dict[str, str] = {}
    for number, first in enumerate(range(0, len(chosen), settings.session_rows)):
        rows = np.arange(first, min(first + settings.session_rows, len(chosen)))
        rows = rows[np.argsort(chosen.number("distance_m")[rows], kind="stable")]
        name = f"launched-{number:02d}"
        plan = [Prescribed(*(float(chosen.number(column)[row]) for column in ("distance_m", "motor_ratio", "hood_deg")))
                for row in rows]
        recordings.append(_prescribed(name, config, plan, settings, _seed(settings, 91 + number // 10, number % 10)))
        simulated |= {f"{name}-c{place:04d}": str(outcome[row]) for place, row in enumerate(rows)}
    return recordings, simulated
