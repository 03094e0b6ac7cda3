"""Collection of a reproduction's recordings (practice, aimed and simulated configurations), and draws from them.

Each repetition has a draw of its own. The settings and the earlier sessions determine every session, so an interrupted
collection resumes where it stopped.

The crew aims for hits, near misses and misses in similar numbers and learns from its own marks. Speeds are those of
vacuum ballistics, corrected by a quadratic in distance and elevation fitted to the marks. No drag, lift or wheel slip
is assumed, so the choice of configurations favours no simulator.
"""

import json
import math
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from msgspec.structs import replace
from scipy.optimize import minimize
from scipy.special import expit
from scipy.stats import norm
from sklearn.linear_model import LogisticRegression

from truearc.errors import InputError
from truearc.robot.aim import FEASIBLE_DEG, vacuum_speed_m_s
from truearc.robot.aim_file import with_plan
from truearc.robot.config.rig_spec import Rig
from truearc.robot.config.schema import Collect, Config, Prescribed, is_hash_of
from truearc.robot.recording.session import CAN, FRAMES, load_header
from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.data.recordings import label_by_repeatability, shots_from_sessions
from truearc.sim.data.table import OUTCOMES
from truearc.sim.paper.grid_fit import fit_grid
from truearc.sim.paper.synthetic import AXES, SHAPE, grid_shots, label_grid, sample_balanced, taken_configurations
from truearc.sim.physics.simulate import exit_opposed, is_opposed
from truearc.sim.physics.term import Exit
from truearc.sim.printed import Progress
from truearc.sim.world.emulated_robot import emulate
from truearc_proof.parallel import fan_out
from truearc_proof.reproduce import Settings

DISTANCES_M = (2.6, 8.0)
RATIOS = (0.15, 0.95)                 # what the wheels do
CENTRE_M, SPAN_M, CENTRE_DEG, SPAN_DEG = 5.0, 2.0, 45.0, 8.0
STRENGTH = 1000.0                     # inverse of the regression's weight decay: hardly any
PERCENT = 0.01                        # log speed is counted in hundredths, about the other columns' size
LEAST_GAIN_M = 0.5                    # nearly along the line of sight the parabola does not determine the speed
LEAST_P = 1e-4                        # a mark in ten thousand may be anything
# Intended height at the plane beside the centre, either way, for each outcome: least, most (m).
INTENDED_M = {"three": (0.0, 0.01), "two": (0.03, 0.30), "miss": (0.40, 1.50)}
# How many of each must be meant for one to be had: much of what is meant for the centre comes out a two.
TRIES = {"three": 2.5, "two": 1.0, "miss": 1.1}
ABREAST = 4                           # sessions of a round, which may be recorded side by side
PRACTICE_SPREAD = 0.12                # speeds off by up to this: misses on both sides teach more than twos
MARKED_SHARE = 0.8                    # of a configuration's shots must be marked: some are rejected or held
# Limits of the camera, the field and the wheels; about the 3 to 30 feet of the paper's zones.
LAUNCHABLE = {"distance_m": (2.0, 9.2), "motor_ratio": RATIOS, "hood_deg": (15.0, 75.0)}


def learn_aiming(rig: Rig, shots: Shots) -> np.ndarray | None:
    """Return log(wheel speed / vacuum speed to the centre) that hits the centre, as terms [6] times levers.

    From marked shots (`side`, `outcome`), by maximum likelihood; None while all misses are on one side.

    A shot passes gain x (log speed - terms . levers) above the centre, with a scatter that is also fitted; a mark gives
    the bounds. Some shots at the right height for the three pass beside it: that share is fitted as well.
    """
    assert rig.target is not None
    columns = [shots.number(name) for name in ("distance_m", "hood_deg", "motor_ratio")]
    log_speed, keep = _log_speed(rig, *columns)
    outcome, side = np.array(shots.text("outcome")), np.array(shots.text("side"))
    cells = np.select([outcome == "three", outcome == "two", side == "high", side == "low"], [0, 1, 2, 3], -1)
    keep &= cells >= 0
    if not {2, 3} <= set(cells[keep].tolist()):
        return None
    levers = _levers(*columns[:2])
    gain_m = np.maximum(_gain_m(rig, *columns[:2]), LEAST_GAIN_M)
    first = _first_guess(log_speed[keep], levers[keep], cells[keep])
    start = np.concatenate([first, [np.log(0.01), np.log(0.05), 1.0]])
    data = (log_speed[keep], levers[keep], gain_m[keep], cells[keep],
            rig.target.three_half_height_m, rig.target.two_half_height_m)
    terms: np.ndarray = minimize(_surprise, start, args=data, method="BFGS").x[:levers.shape[1]]
    return terms


def _surprise(theta: np.ndarray, log_speed: np.ndarray, levers: np.ndarray, gain_m: np.ndarray, cells: np.ndarray,
              three_m: float, two_m: float) -> float:
    """Mean negative log likelihood; theta: terms, logs of the scatter in log speed and in height, log odds beside."""
    terms, (speed, floor_m, beside) = theta[:-3], theta[-3:]
    mean_m = gain_m * (log_speed - levers @ terms)
    sd_m = np.hypot(gain_m * np.exp(speed), np.exp(floor_m))
    below = [norm.cdf((bound - mean_m) / sd_m) for bound in (-two_m, -three_m, three_m, two_m)]
    inside = (below[2] - below[1]) * expit(beside)
    p = np.stack([inside, below[3] - below[0] - inside, 1.0 - below[3], below[0]])
    return -float(np.mean(np.log(np.maximum(p[cells, np.arange(len(cells))], LEAST_P))))


def _first_guess(log_speed: np.ndarray, levers: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Where a logistic regression of high against low is undecided, a hit counting half on either side."""
    columns = np.column_stack([log_speed / PERCENT, levers])
    high, low = cells != 3, cells != 2
    rows, labels = np.concatenate([columns[high], columns[low]]), np.repeat([1, 0], [high.sum(), low.sum()])
    weight = np.concatenate([np.where(cells[part] < 2, 0.5, 1.0) for part in (high, low)])
    fitted = LogisticRegression(C=STRENGTH, fit_intercept=False, max_iter=10000, tol=1e-8).fit(rows, labels, weight)
    slope, *terms = fitted.coef_[0]
    return -np.array(terms) * PERCENT / max(float(slope), 1e-3)


def intentions(lacking: Mapping[str, int]) -> dict[str, float]:
    """Return the share of the next configurations meant for each outcome, by the number still lacking (sums to 1)."""
    tries = {outcome: TRIES[outcome] * max(lacking[outcome], 0) for outcome in TRIES}
    total = sum(tries.values())
    return {outcome: count / total if total else 1.0 / len(tries) for outcome, count in tries.items()}


def propose(rig: Rig, collect: Collect, aiming: np.ndarray, shares: Mapping[str, float], count: int,
            rng: np.random.Generator) -> list[Prescribed]:
    """Return `count` configurations that this launcher can be set to, `shares` of them meant for each outcome.

    Sorted by distance, so that little time is spent on driving.
    """
    rows: list[Prescribed] = []
    while len(rows) < count:
        row = _propose_one(rig, collect, aiming, shares, rng)
        if row is not None:
            rows.append(row)
    return sorted(rows, key=lambda row: row.distance_m)


def _propose_one(rig: Rig, collect: Collect, aiming: np.ndarray, shares: Mapping[str, float],
                 rng: np.random.Generator) -> Prescribed | None:
    assert rig.target is not None
    rise_m = rig.target.centre_height_m - rig.launcher.release_height_m
    distance_m = float(rng.uniform(*DISTANCES_M))
    low_deg = max(collect.hood_low_deg, math.degrees(math.atan2(rise_m, distance_m)) + FEASIBLE_DEG)
    hood_deg = float(rng.uniform(low_deg, max(low_deg, collect.hood_high_deg)))
    outcome = rng.choice(list(INTENDED_M), p=[shares[name] for name in INTENDED_M])
    beside_m = float(rng.choice([-1.0, 1.0]) * rng.uniform(*INTENDED_M[str(outcome)]))
    place = np.array([distance_m]), np.array([hood_deg])
    log_speed = float(aiming @ _levers(*place)[0] + beside_m / _gain_m(rig, *place)[0])
    speed_m_s = vacuum_speed_m_s(distance_m, rise_m, hood_deg, rig.world.gravity_m_s2)
    assert speed_m_s is not None      # FEASIBLE_DEG above the line of sight
    ratio = speed_m_s * math.exp(log_speed) / float(exit_seed(rig, 1.0, 0.0).speed_m_s)
    return Prescribed(distance_m, ratio, hood_deg) if RATIOS[0] <= ratio <= RATIOS[1] else None


def _gain_m(rig: Rig, distance_m: np.ndarray, hood_deg: np.ndarray) -> np.ndarray:
    """By how much a parabola's height at the plane grows per unit of log speed."""
    assert rig.target is not None
    rise_m = rig.target.centre_height_m - rig.launcher.release_height_m
    gain_m: np.ndarray = 2.0 * (distance_m * np.tan(np.radians(hood_deg)) - rise_m)
    return gain_m


def _log_speed(rig: Rig, distance_m: np.ndarray, hood_deg: np.ndarray,
               motor_ratio: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """log(wheels' speed / vacuum's speed to the centre), and whether there is such a speed."""
    assert rig.target is not None
    rise_m = rig.target.centre_height_m - rig.launcher.release_height_m
    speeds = [vacuum_speed_m_s(*pair, rig.world.gravity_m_s2)
              for pair in zip(distance_m.tolist(), [rise_m] * len(distance_m), hood_deg.tolist(), strict=True)]
    vacuum_m_s = np.array([np.nan if speed is None else speed for speed in speeds])
    log_speed = np.log(exit_seed(rig, motor_ratio, 0.0).speed_m_s) - np.log(vacuum_m_s)
    keep = np.isfinite(log_speed)
    return np.where(keep, log_speed, 0.0), keep


def _levers(distance_m: np.ndarray, hood_deg: np.ndarray) -> np.ndarray:
    """1, and distance and elevation up to squares, each about one in size: [n, 6]."""
    d, h = (distance_m - CENTRE_M) / SPAN_M, (hood_deg - CENTRE_DEG) / SPAN_DEG
    return np.column_stack([np.ones_like(d), d, h, d * d, d * h, h * h])


class Recording(NamedTuple):
    """One session to record."""

    name: str
    config: Config
    trials: int
    seed: int


class Pool(NamedTuple):
    """Legitimate configurations: `real` as the crew chose them, `launched` simulated ones that were really shot.

    `launched` has a text column `simulated`, the outcome from the simulator that drew them; `coefficients` are that
    simulator's.
    """

    real: Dataset
    launched: Dataset
    coefficients: dict[str, dict[str, float]]


Record = Callable[[Sequence[Recording], str], list[Path]]


def collect(config: Config, settings: Settings, record: Record, progress: Progress) -> Pool:
    """Record (or find recorded) everything that the analysis draws from."""
    real = collect_real(config, settings, record)
    launched, coefficients = launch_simulated(config, settings, real, record, progress)
    return Pool(real, launched, coefficients)


def collect_real(config: Config, settings: Settings, record: Record) -> Dataset:
    """Record practice, then rounds of aimed configurations until every outcome has `pool_each` legitimate ones.

    InputError if `most_rounds` rounds do not give enough for a draw.
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
    """Return one row per legitimate configuration of the sessions, labelled by the paper's rule (section IV-A)."""
    shots = shots_from_sessions(sessions, name, telemetry=False)
    return label_by_repeatability(shots, math.ceil(MARKED_SHARE * settings.repeats))


def _aiming(rig: Rig, sessions: Sequence[Path]) -> np.ndarray:
    aiming = learn_aiming(rig, shots_from_sessions(sessions, "practice", telemetry=False).shots)
    if aiming is None:
        raise InputError("the practice sessions have misses on one side of the target only, which do not determine "
                         "the aim: try another --seed, or without --quick")
    return aiming


def _said(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {outcome}" for outcome, count in counts.items())


def _aimed(config: Config, settings: Settings, aiming: np.ndarray, shares: Mapping[str, float], round_number: int,
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
    """Launch an even sample of the configurations of the first draw's simulator; return (labelled, simulator).

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
    """Return `count` configurations of the paper's grid that the robot can shoot, even by simulated outcome; and that
    outcome."""
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


class Draw(NamedTuple):
    """Row numbers: `train` and `test` of the real pool, `transfer` of the launched one; each even by outcome.

    `validation` is a part of `train` that decides when to stop training; models without such stopping are also fitted
    to it.
    """

    train: np.ndarray
    validation: np.ndarray
    test: np.ndarray
    transfer: np.ndarray


def draw(real: Shots, launched: Shots | None, settings: Settings, number: int) -> Draw:
    """Return the repetition of that number, from 0; the same settings and pools give the same draw.

    D_r is even by outcome, D_s^T by the simulator's outcome. Without `launched`, `transfer` is empty.
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
    """Return the launch of the two-wheel rig at motor speed / free speed and elevation.

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


# --- recording, or finding what is recorded

DONE = "recording.json"               # written last: a folder without it is incomplete and is recorded again


def make_record(folder: Path, workers: int | None,
                make_progress: Callable[[str], Progress]) -> Record:
    """Return a function that records sessions in `folder`, unless they are there already, and returns their folders.

    The folders are in the order of the sessions. The function raises InputError when a session was recorded with other
    settings.
    """
    def record(recordings: Sequence[Recording], what: str) -> list[Path]:
        jobs = [(folder.resolve() / recording.name, recording) for recording in recordings]
        missing = [job for job in jobs if not _is_there(*job)]
        if missing:
            folder.mkdir(parents=True, exist_ok=True)
            fan_out(_record, missing, make_progress(f"record {what}"), workers)
        return [place for place, _ in jobs]

    return record


def _is_there(folder: Path, recording: Recording) -> bool:
    path = folder / DONE
    if not path.is_file():
        return False
    said = json.loads(path.read_text(encoding="utf-8"))
    if said != _stated(recording) or not is_hash_of(load_header(folder).config_sha256, recording.config):
        raise InputError(f"{folder}: recorded with other settings; name another folder or take this one away")
    return True


def _stated(recording: Recording) -> dict[str, int]:
    return {"seed": recording.seed, "trials": recording.trials}


def _record(job: tuple[Path, Recording]) -> str:
    """Images and raw frames, nine tenths of a session, are not kept: every tick and mark is."""
    folder, recording = job
    shutil.rmtree(folder, ignore_errors=True)
    emulate(recording.config, folder, recording.trials, recording.seed)
    shutil.rmtree(folder / FRAMES)
    (folder / CAN).unlink()
    (folder / DONE).write_text(json.dumps(_stated(recording)) + "\n", encoding="utf-8")
    return str(folder)
