"""Simulated shots: the paper's grid of configurations, flown, labelled, sampled evenly by outcome (III-B), and written.

The paper speaks of 375,000 configurations; the ranges and steps that it states, taken inclusively, are
101 x 61 x 76 = 468,236, and those are flown.

It flies one exact pair of coefficients, and all shots of a configuration end alike. With draws, which are our addition,
the label of a configuration is the outcome of *one* shot that the robot would have measured so: coefficients and
scatter drawn from the fitted belief, a launch scattered by it, and a true speed, elevation and distance that differ
from the measured ones by the sensors' noise. So near the edge of the target labels mix as they do on the field. Most
configurations pass metres away from the target, whatever is drawn. Only those are flown whose height by the belief
itself is within MAX_DEVIATIONS standard deviations (truearc.sim.infer.forecast: scatter, sensors and the fit's
uncertainty) of the two-point window; the others stay misses.
"""

import json
import math
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from truearc.errors import InputError
from truearc.robot.config.rig_spec import Rig
from truearc.sim.data.columns import OUTCOMES
from truearc.sim.data.conditions import ORDINARY, Circumstances
from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.data.files import check_free, hash_dataset, save_dataset
from truearc.sim.infer.belief import SCATTERS, Belief, Curves, before_the_shot, draw, load_belief, owners, resized
from truearc.sim.infer.forecast import forecast
from truearc.sim.infer.likelihood.data import given_of
from truearc.sim.paper.network import load_json
from truearc.sim.physics.catalogue import Catalogue, effective
from truearc.sim.physics.launch import Exit
from truearc.sim.physics.simulate import MISS, classify, fly_rows, leave, opening_of, predict, sense
from truearc.sim.printed import Progress

NONE: Curves = {}
STEP_S = 0.01                         # heights then agree with the simulator's own finer step to 1e-6 m
PROVENANCE_FILE = "synth.json"
MAX_DEVIATIONS = 4.0                  # one normal number in 16 000 is further out, on either side together


@dataclass(frozen=True)
class Axis:
    """Evenly spaced values: low, low + 1 / per_unit, ... (`count` of them)."""

    name: str
    low: float
    per_unit: int                     # values per unit; its inverse, the paper's step, is not exact in binary
    count: int

    def values(self) -> np.ndarray:
        """All values, each the float nearest to its decimal."""
        return (round(self.low * self.per_unit) + np.arange(self.count)) / self.per_unit

    def nearest(self, values: np.ndarray) -> np.ndarray:
        """Index of the grid value nearest to each value; -1 where it is further than half a step outside the axis."""
        index = np.rint((values - self.low) * self.per_unit)
        return np.where((index >= 0) & (index < self.count), index, -1).astype(np.int64)


AXES = (Axis("motor_ratio", 0.0, 100, 101), Axis("hood_deg", 15.0, 1, 61), Axis("distance_m", 1.0, 5, 76))
SHAPE = tuple(axis.count for axis in AXES)


def grid_shots(index: np.ndarray) -> Shots:
    """The configurations at flat positions of the grid (motor_ratio slowest, distance_m fastest)."""
    places = np.unravel_index(index, SHAPE)
    numbers = {axis.name: axis.values()[place] for axis, place in zip(AXES, places, strict=True)}
    return Shots(tuple(f"sim-{position:06d}" for position in index), numbers, {})


def grid_heights(rig: Rig, coefficients: Mapping[str, Mapping[str, float]],
                 progress: Progress = lambda done, note: None, curves: Curves = NONE,
                 among: Catalogue | None = None) -> np.ndarray:
    """Height in m at the plane of every configuration of the grid, flat, nan where it is not reached.

    By the simulator with gravity and these terms, of which some may go with curves. among: the catalogue of the terms,
    truearc.sim.physics.catalogue.catalogue() when not given. InputError when the rig cannot turn a
    motor ratio into a launch.
    """
    shots = grid_shots(np.arange(np.prod(SHAPE)))
    before = before_the_shot(curves, rig, shots)
    return np.asarray(predict(rig, coefficients, shots, progress, before, among, STEP_S).height_m)


def label_grid(rig: Rig, coefficients: Mapping[str, Mapping[str, float]],
               progress: Progress = lambda done, note: None, curves: Curves = NONE,
               among: Catalogue | None = None) -> np.ndarray:
    """Outcome of every configuration of the grid, flat; InputError as grid_heights, or when the rig has no target."""
    opening = opening_of(rig, coefficients, among)     # a rig without target: no work
    return classify(rig, grid_heights(rig, coefficients, progress, curves, among), opening)


def taken_configurations(shots: Shots) -> np.ndarray:
    """Flat positions of the grid nearest to recorded shots; a shot that lacks one of the three columns has none."""
    known = np.all([np.isfinite(shots.number(axis.name)) for axis in AXES], axis=0)
    places = np.stack([axis.nearest(shots.number(axis.name)[known]) for axis in AXES])
    return np.unique(np.ravel_multi_index(tuple(places[:, (places >= 0).all(axis=0)]), SHAPE))


def sample_balanced(outcomes: np.ndarray, count: int, taken: np.ndarray, seed: int) -> np.ndarray:
    """`count` flat positions, ascending, as evenly by outcome as may be, none of them in `taken`; drawn by seed.

    What does not divide by three goes to miss first, then two. InputError when an outcome is too rare for its share.
    """
    check_draw(count, seed)
    rng = np.random.default_rng(seed)
    free = np.ones(len(outcomes), bool)
    free[taken] = False
    chosen = []
    for rank, outcome in enumerate(OUTCOMES):
        share = (count + len(OUTCOMES) - 1 - rank) // len(OUTCOMES)
        pool = np.flatnonzero(free & (outcomes == outcome))
        if len(pool) < share:
            raise InputError(f"only {len(pool)} configurations of the grid are a {outcome!r} with these coefficients, "
                           f"and -n {count} asks for {share}")
        chosen.append(rng.choice(pool, share, replace=False))
    return np.sort(np.concatenate(chosen))


def check_draw(count: int, seed: int) -> None:
    """InputError names the option that no sample can be drawn with."""
    if count < len(OUTCOMES):
        raise InputError(f"-n is {count}; at least {len(OUTCOMES)} shots are needed, one of each outcome")
    if seed < 0:
        raise InputError(f"--seed is {seed}; it cannot be negative")


def sample_shots(outcomes: np.ndarray, count: int, recorded: Shots | None, seed: int) -> Shots:
    """Sample shots with an outcome each from the grid's outcomes, none at a configuration that `recorded` has."""
    taken = np.zeros(0, np.int64) if recorded is None else taken_configurations(recorded)
    shots = grid_shots(index := sample_balanced(outcomes, count, taken, seed))
    return Shots(shots.shot_id, shots.numbers, {"outcome": tuple(map(str, outcomes[index]))})


class Draws(NamedTuple):
    """Numbers of each flight [n]: {term: {parameter: values}}, {"speed", "elevation_deg": standard deviations}, and the
    points [n, k] of all curves, with whose each is."""

    coefficients: dict[str, dict[str, np.ndarray]]
    scatter: dict[str, np.ndarray]
    points: np.ndarray
    whose: tuple[str, ...]


def write_synthetic(directory: str | Path, rig: Rig, coefficients: str | Path, n: int, *,
                    exclude: Dataset | None = None, draws: int | None = None, seed: int = 0,
                    among: Catalogue | None = None, progress: Progress = lambda done, note: None) -> Shots:
    """Simulate shots of the paper's grid of configurations, write them as a dataset, and return them.

    Args:
        directory: To write; new or empty.
        rig: That the shots are made with.
        coefficients: coefficients.toml to fly with; it is copied into the directory.
        n: Shots in all, the same number of each outcome.
        exclude: Recorded shots whose configurations are not drawn.
        draws: Sets of coefficients drawn from the covariance, with launch scatter and sensor noise; None: one exact
            set, as in the paper.
        seed: Of the draw.
        among: The catalogue of the terms.
        progress: Called with the share done, 0 to 1, and a note.

    Raises:
        InputError: the directory is not empty, the file is not coefficients, or there are too few configurations.
    """
    out = check_free(directory)
    belief = load_belief(coefficients, among)
    recorded = None if exclude is None else exclude.shots
    if draws is not None:
        check_belief(belief, str(coefficients))
    shots = synthesise(rig, belief, n, recorded, seed, draws, progress)
    save_dataset(out, Dataset(out.name, rig, shots))
    shutil.copyfile(coefficients, out / "coefficients.toml")
    provenance = {"version": version("truearc"), "seed": seed, "coefficients": belief.coefficients, "draws": draws,
                  "scatter": belief.scatter if draws else None,
                  "excluded_sha256": None if exclude is None else hash_dataset(exclude)}
    (out / PROVENANCE_FILE).write_text(json.dumps(provenance, indent=1) + "\n", encoding="utf-8")
    return shots


def load_provenance(directory: str | Path) -> dict[str, Any]:
    """Read the provenance of a simulated dataset; empty when the directory holds none."""
    path = Path(directory) / PROVENANCE_FILE
    return load_json(path) if path.is_file() else {}


def say_synthetic(directory: str | Path, shots: Shots, draws: int | None = None) -> str:
    """Return how many shots of which outcome were written."""
    counts = ", ".join(f"{shots.text('outcome').count(outcome)} {outcome}" for outcome in OUTCOMES)
    more = f"; each with one of {draws} sets of coefficients, launch scatter and sensor noise" if draws else ""
    return (f"{directory}: {len(shots)} simulated shots of {math.prod(axis.count for axis in AXES)} "
            f"configurations: {counts}{more}")


def check_belief(belief: Belief, name: str) -> None:
    """InputError names the tables that a coefficients file `name` lacks for draws."""
    lacking = [what for what, there in (("[scatter]", set(belief.scatter) == set(SCATTERS)),
                                        ("[covariance]", bool(belief.names))) if not there]
    if lacking:
        raise InputError(f"{name}: has no {' and no '.join(lacking)}, which --draws draws from; "
                       "`truearc fit` writes them, the grid does not")


def synthesise(rig: Rig, belief: Belief, count: int, recorded: Shots | None, seed: int, draws: int | None = None,
               progress: Progress = lambda done, note: None) -> Shots:
    """Simulated shots with an outcome each, none at a configuration that `recorded` has; same arguments, same shots.

    draws: sets of coefficients drawn from the belief, with launch scatter and sensor noise on every shot; None: the
    belief's own coefficients, exactly. InputError when count or draws are too few.
    """
    check_draw(count, seed)                      # before the work, not after it
    if draws is None:
        outcomes = label_grid(rig, belief.coefficients, progress, belief.curves, belief.catalogue)
    elif draws < 1:
        raise InputError(f"--draws is {draws}; at least 1 is needed")
    else:
        outcomes = label_grid_draws(rig, belief, draws, seed, progress)
    return sample_shots(outcomes, count, recorded, seed)


def label_grid_draws(rig: Rig, belief: Belief, draws: int, seed: int,
                     progress: Progress = lambda done, note: None) -> np.ndarray:
    """Outcome of one uncertain shot at every configuration of the grid, flat."""
    classify(rig, np.zeros(0))                  # refuses a rig without target before the work
    height_m = grid_heights(rig, belief.coefficients, lambda done, note: progress(0.5 * done, note), belief.curves,
                            belief.catalogue)
    places = near_places(rig, belief, height_m)
    rng = np.random.default_rng([seed, 2])
    shots = grid_shots(places)
    drawn = assign(draw(belief, draws, rng), len(places), rng)
    drawn_m = fly_draws(rig, shots, drawn, rng, lambda done, note: progress(0.5 + 0.5 * done, note),
                        before_the_shot(belief.curves, rig, shots), belief.catalogue)
    outcomes = np.full(len(height_m), MISS, dtype="<U5")
    outcomes[places] = classify(rig, drawn_m, opening_of(rig, drawn.coefficients, belief.catalogue))
    return outcomes


def near_places(rig: Rig, belief: Belief, height_m: np.ndarray) -> np.ndarray:
    """Flat positions of the grid from which a draw may score: heights [grid] by the belief's own coefficients."""
    opening = opening_of(rig, belief.coefficients, belief.catalogue)
    reached = np.flatnonzero(np.isfinite(height_m))
    sigma_m = forecast(rig, belief, grid_shots(reached)).sigma_m
    beyond_m = np.abs(height_m[reached] - opening.centre_m) - opening.two_half_m
    return np.asarray(reached[~(beyond_m > MAX_DEVIATIONS * sigma_m)])          # an unknown sigma is flown too


def assign(beliefs: list[Belief], count: int, rng: np.random.Generator) -> Draws:
    """One of the drawn beliefs for each of `count` flights, all about equally often."""
    which = rng.permutation(np.resize(np.arange(len(beliefs)), count))

    def column(tables: list[Mapping[str, float]], key: str) -> np.ndarray:
        return np.asarray(np.array([table[key] for table in tables])[which])

    first = beliefs[0]
    coefficients = {term: {key: column([one.coefficients[term] for one in beliefs], key) for key in values}
                    for term, values in first.coefficients.items()}
    points = np.array([[value for curve in one.curves.values() for value in curve.points] for one in beliefs])
    return Draws(coefficients, {key: column([one.scatter for one in beliefs], key) for key in first.scatter},
                 points[which], owners(first.curves))


def fly_draws(rig: Rig, shots: Shots, draws: Draws, rng: np.random.Generator,
              progress: Progress = lambda done, note: None, circumstances: Circumstances = ORDINARY,
              among: Catalogue | None = None) -> np.ndarray:
    """Heights [n] in m at the plane, nan where not reached, of one shot at each measured configuration."""
    given = given_of(rig, shots)
    count = len(shots)
    noise = rng.standard_normal((count, given.wheel_log_speed.shape[1]))
    rolling = Exit(given.rolling.speed_m_s * np.exp(np.sum(given.wheel_log_speed * noise, axis=1)),
                   given.rolling.elevation_rad + given.elevation_sd_rad * rng.standard_normal(count),
                   given.rolling.spin_rev_s + np.sum(given.wheel_spin_rev_s * noise, axis=1))
    values = effective(draws.coefficients, resized(circumstances, draws.whose, draws.points), among)
    rolling, true_m = sense(rig, values, rolling, given.distance_m, among=among)
    left = Exit(*map(np.asarray, leave(rig, values, rolling, among=among)))
    scattered = Exit(left.speed_m_s * np.exp(draws.scatter["speed"] * rng.standard_normal(count)),
                     left.elevation_rad + np.radians(draws.scatter["elevation_deg"]) * rng.standard_normal(count),
                     left.spin_rev_s, left.above_m)
    distance_m = np.asarray(true_m) + given.distance_sd_m * rng.standard_normal(count)
    return np.asarray(fly_rows(rig, values, scattered, distance_m, progress, among, step_s=STEP_S).height_m)
