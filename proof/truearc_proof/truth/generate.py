"""Dataset of a concealed world, as a solver gets it: in memory, or as a folder with rig.toml and shots.csv."""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.data.files import save_dataset
from truearc_proof.truth.aiming import Flown, aim, fly_shots, shoot_all
from truearc_proof.truth.launch import draw_luck, wheel_speeds
from truearc_proof.truth.plan import Floats, Plan, plan_shots
from truearc_proof.truth.sensors import see_outcomes, see_places, see_telemetry, see_traces, see_tracks
from truearc_proof.truth.world import World


class TruthSeason(NamedTuple):
    """All that happened; the solver gets `dataset` and nothing else."""

    dataset: Dataset
    plan: Plan
    motor_ratio: Floats
    wheels_rad_s: tuple[Floats, Floats]
    flown: Flown


def shoot(world: World) -> Dataset:
    """The dataset of a world; the same world gives the same bits."""
    return play(world).dataset


def write(world: World, directory: str | Path) -> Dataset:
    """Shoot, and save the dataset as a folder; InputError when the directory is not new or empty."""
    dataset = replace(shoot(world), name=Path(directory).resolve().name)
    save_dataset(directory, dataset)
    return dataset


def play(world: World) -> TruthSeason:
    """As shoot, with the truth beside it."""
    plan = plan_shots(world)
    distance, hood = see_places(world, plan)
    ratio, flight_s = aim(world, plan, distance, hood)
    return record(world, plan, (distance, hood), ratio, flight_s)


def shift_m(world: World) -> Floats:
    """Return the shift of each shot's height at the plane by effects of launch and flight [n]; nan: falls short."""
    season = play(world)
    none = np.full(world.shots, np.inf)              # a gust that never sets in
    plain = fly_shots(replace(world, effects={}), season.plan, season.wheels_rad_s, draw_luck(world), none)
    return season.flown.arrival.height_m - plain.arrival.height_m


def record(world: World, plan: Plan, seen: tuple[Floats, Floats], ratio: Floats, flight_s: Floats) -> TruthSeason:
    """The shots of a plan and what the sensors say of them.

    seen: (distance, elevation) as measured. ratio: of the motors. flight_s: of the aimed shots.
    """
    distance, hood = seen
    off = world.scatter.wheel * world.rng(9).normal(size=world.shots)
    wheels = wheel_speeds(world, ratio * (1.0 + off))
    flown = shoot_all(world, plan, wheels, flight_s)
    numbers = {"distance_m": distance, "hood_deg": hood, "motor_ratio": ratio, "t_s": plan.t_s}
    outcome, side = see_outcomes(world, flown)
    texts = {"outcome": outcome, "session": tuple(f"day{k + 1}" for k in plan.session)}
    texts |= {"side": side} if world.side else {}
    tracks = traces = None
    if world.level != "L0":
        more_numbers, more_texts = see_telemetry(world, plan, wheels)
        numbers, texts = numbers | more_numbers, texts | more_texts
        traces = see_traces(world, plan, wheels)
    if world.level == "L2":
        tracks = see_tracks(world, flown)
    ids = tuple(f"s{number:04d}" for number in range(1, world.shots + 1))
    dataset = Dataset(f"world{world.seed}", world.facts, Shots(ids, numbers, texts), tracks, traces)
    return TruthSeason(dataset, plan, ratio, wheels, flown)
