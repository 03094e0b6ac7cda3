"""Dataset of a concealed world, as a solver gets it, and further shots that it asks for, with its effects at work as
before.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.data.files import save_dataset
from truearc_proof.truth.flight import Flown, aim, draw_luck, fly_shots, intended_s, wheel_speeds
from truearc_proof.truth.sensors import see_outcomes, see_places, see_telemetry, see_traces, see_tracks
from truearc_proof.truth.world import Floats, Plan, World, plan_shots

APART = 1 << 40                       # seeds of a world from those of the shots that follow it
RESTED_S = 8.0
SESSIONS = 100                        # at most, of one follow-up


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
    flown = fly_shots(world, plan, wheels, draw_luck(world), flight_s * 2.0 / 3.0)     # a late gust has the last third
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


class Asked(NamedTuple):
    """A configuration as the robot's sensors have it, and how often it is to be shot."""

    distance_m: float
    hood_deg: float
    motor_ratio: float
    shots: int


def follow(world: World, asked: Sequence[Asked], number: int = 1) -> Dataset:
    """More sessions of the same robot, with the same balls, at leisure: configurations one after another.

    The dataset has the new shots alone; their shot_ids, and the sessions' names, are none of the season's. number: of
    the follow-up; the same number shoots the same shots. ValueError when nothing is asked for.
    """
    extra = sum(one.shots for one in asked)
    if extra < 1:
        raise ValueError("no shots are asked for")
    season = play(world)
    own = replace(world, shots=world.shots + extra, seed=world.seed + number * APART)
    plan = _longer(season.plan, own, extra, number)
    distance, hood, ratio = (np.repeat([one[k] for one in asked], [one.shots for one in asked]).astype(float)
                             for k in range(3))
    plan = _placed(world, plan, distance, hood)
    seen = see_places(own, plan)
    ratio = np.concatenate([season.motor_ratio, ratio])
    told = record(own, plan, seen, ratio, intended_s(own, replace(plan, distance_m=seen[0], hood_deg=seen[1]), ratio))
    dataset = told.dataset.take(range(world.shots, own.shots))
    ids = tuple(f"f{number}-{k:04d}" for k in range(1, extra + 1))
    return replace(dataset, shots=Shots(ids, dataset.shots.numbers, dataset.shots.texts))


def _longer(plan: Plan, own: World, extra: int, number: int) -> Plan:
    """Append sessions with circumstances of their own to the season; balls go on being used."""
    fresh = plan_shots(replace(own, shots=max(extra, 10)))
    more = {name: column[:extra] for name, column in vars(fresh).items()}
    balls = plan.ball.max() + 1
    ball = fresh.ball[:extra] % balls
    first = np.array([np.argmax(plan.ball == one) for one in ball])
    most = max(np.bincount(plan.ball).max() - 1, 1)
    had = np.array([np.count_nonzero(plan.ball == one) + np.count_nonzero(ball[:k] == one)
                    for k, one in enumerate(ball)])
    begins = np.diff(more["session"], prepend=-1) > 0
    place = np.arange(extra) - np.maximum.accumulate(np.where(begins, np.arange(extra), 0))
    more |= {"session": plan.session.max() + 1 + SESSIONS * (number - 1) + more["session"],
             "since_last_s": np.where(begins, np.nan, RESTED_S), "t_s": RESTED_S * place, "ball": ball,
             "used": had / most, "fresh_ball": plan.fresh_ball[first], "drag_of_ball": plan.drag_of_ball[first],
             "supplier": plan.supplier[first], "closing_m_s": np.zeros(extra)}
    return Plan(**{name: np.concatenate([column, more[name]]) for name, column in vars(plan).items()})


def _placed(world: World, plan: Plan, distance_m: Floats, hood_deg: Floats) -> Plan:
    """The robot stands, and its hood, where its sensors say what was asked for; so the truth is off by their errors."""
    extra = len(distance_m)
    hood = np.concatenate([plan.hood_deg[:-extra], hood_deg])
    came = np.concatenate([plan.hood_came[:-extra], np.sign(np.diff(hood))[-extra:]])
    came[-extra:][np.diff(plan.session[-extra - 1:]) > 0] = 0.0
    hood[-extra:] += world.amount("hood_offset") - world.amount("hood_backlash") * came[-extra:]
    distance = distance_m * (1.0 + world.amount("distance_scale")) + world.amount("distance_bias")
    return replace(plan, distance_m=np.concatenate([plan.distance_m[:-extra], distance]), hood_deg=hood, hood_came=came)
