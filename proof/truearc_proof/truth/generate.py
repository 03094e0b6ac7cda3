"""Dataset of a concealed world, as read by its sensors and released to a solver, and further requested shots.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from truearc.sim.data.dataset import Dataset, Shots, Traces, Tracks
from truearc.sim.data.files import save_dataset
from truearc_proof.truth.flight import Flown, aim, at, draw_luck, fly_shots, wheel_dip, wheel_speeds
from truearc_proof.truth.world import SUPPLIERS, Floats, Plan, World, draw_errors, make_world, plan_shots

# --- sensors

WRONG_OUTCOMES = 0.02
FRAMES_HZ, TRACKED_S = 60.0, 0.75
MEMORY = 0.8                          # correlation of neighbouring frames, with that dirt
LOST_FRAMES = 0.25
HEAVY_TAILS = 3                       # degrees of freedom of Student's t
TRACE_HZ, TRACE_BEGINS_S, TRACE_S = 100.0, -0.05, 0.4
FED_S, GRIP_S, RECOVERY_S = 0.12, 0.02, 0.3       # the ball meets the wheels, is held so long; the wheels recover
BATTERY_NOISE_V, TEMPERATURE_NOISE_C, PRESSURE_NOISE_PA, CLOSING_NOISE_M_S = 0.02, 0.2, 20.0, 0.03


def see_places(world: World, plan: Plan) -> tuple[Floats, Floats]:
    """Return (distance, elevation) as the robot measures them before it shoots.

    True = measured (1 + scale) + bias - latency x closing speed, and measured + offset - backlash x direction of
    approach.
    """
    rng, noise = world.rng(4), world.noise
    old = plan.distance_m + world.amount("vision_latency") * plan.closing_m_s
    distance = (old - world.amount("distance_bias")) / (1.0 + world.amount("distance_scale"))
    hood = plan.hood_deg - world.amount("hood_offset") + world.amount("hood_backlash") * plan.hood_came
    return (distance + noise.distance_m * rng.normal(size=world.shots),
            hood + noise.hood_deg * rng.normal(size=world.shots))


def see_outcomes(world: World, flown: Flown) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return (outcome, side) of every shot; a ball that does not reach the plane is a miss, low."""
    target = world.facts.target
    if target is None:
        raise ValueError("a world has a target")
    catch = world.amount("rim_catch")
    above = flown.arrival.height_m - target.centre_height_m - world.amount("target_height")
    above = np.where(flown.arrival.clear, above, -np.inf)
    outcome = np.where(np.abs(above) <= target.three_half_height_m + catch, "three",
                       np.where(np.abs(above) <= target.two_half_height_m + catch, "two", "miss"))
    side = np.where(above < 0.0, "low", "high")
    if "outliers" in world.dirt:
        outcome = _mistaken(world, outcome)
    return tuple(outcome.tolist()), tuple(np.where(outcome == "three", "", side).tolist())


def _mistaken(world: World, outcome: np.ndarray) -> np.ndarray:
    """Some outcomes noted as one of the other two."""
    rng = world.rng(5)
    words = np.array(["miss", "two", "three"])
    other = words[(np.argmax(words == outcome[:, None], axis=1) + rng.integers(1, 3, len(outcome))) % 3]
    return np.where(rng.random(len(outcome)) < WRONG_OUTCOMES, other, outcome)


def see_telemetry(world: World, plan: Plan,
                  wheels_rad_s: tuple[Floats, Floats]) -> tuple[dict[str, Floats], dict[str, tuple[str, ...]]]:
    """Return columns of shots from telemetry and the log book: numbers and texts."""
    rng, n, noise = world.rng(6), world.shots, world.noise
    names = [wheel.name for wheel in world.facts.launcher.wheel]
    numbers = {f"wheel_{name}_rad_s": speed + noise.wheel_rad_s * rng.normal(size=n)
               for name, speed in zip(names, wheels_rad_s, strict=True)}
    numbers |= {"since_last_shot_s": plan.since_last_s,
                "battery_v": plan.battery_v + BATTERY_NOISE_V * rng.normal(size=n),
                "temperature_c": plan.temperature_c + TEMPERATURE_NOISE_C * rng.normal(size=n),
                "pressure_pa": plan.pressure_pa + PRESSURE_NOISE_PA * rng.normal(size=n),
                "robot_speed_m_s": plan.closing_m_s + CLOSING_NOISE_M_S * rng.normal(size=n)}
    texts = {"ball_id": tuple(f"ball{k + 1}" for k in plan.ball),
             "supplier": tuple(SUPPLIERS[k] for k in plan.supplier)}
    return numbers, texts


def see_traces(world: World, plan: Plan, wheels_rad_s: tuple[Floats, Floats]) -> Traces:
    """Return wheel speeds through every shot: steady, falling while they hold the ball, recovering."""
    rng, n = world.rng(7), world.shots
    t = np.arange(round(TRACE_BEGINS_S * TRACE_HZ), round(TRACE_S * TRACE_HZ) + 1) / TRACE_HZ
    after = np.maximum(t - FED_S - GRIP_S, 0.0)
    shape = np.clip((t - FED_S) / GRIP_S, 0.0, 1.0) * np.exp(-after / RECOVERY_S)
    dip = wheel_dip(world, plan, wheels_rad_s)
    signals = [f"wheel_{wheel.name}_rad_s" for wheel in world.facts.launcher.wheel]
    values = np.stack([speed[:, None] * (1.0 - dip[:, None] * shape) for speed in wheels_rad_s], axis=1)
    values = values + world.noise.wheel_rad_s * rng.normal(size=values.shape)
    signal = np.tile(np.repeat(signals, len(t)), n)
    return Traces(np.repeat(np.arange(n), 2 * len(t)), np.tile(t, 2 * n), tuple(signal.tolist()), values.ravel())


def see_tracks(world: World, flown: Flown) -> Tracks:
    """Return positions in the tracker's own clock, frame and lens, from soon after release, to the plane at most."""
    rng, n = world.rng(8), world.shots
    stamp = np.arange(round(TRACKED_S * FRAMES_HZ) + 1) / FRAMES_HZ
    first = rng.uniform(0.0, 1.0 / FRAMES_HZ, n)
    true_s = first[:, None] + stamp / (1.0 + world.amount("track_clock"))
    lane = np.repeat(np.arange(n), len(stamp))
    end_s = np.nan_to_num(flown.arrival.time_s, nan=np.inf)
    true_m = _positions(flown, true_s)
    position = _tilted(true_m * (1.0 + world.amount("track_scale")), np.radians(world.amount("track_tilt")))
    position = position + _track_noise(world, rng, n, len(stamp))
    seen = (true_s <= end_s[:, None]) & (true_m[:, 2] > 0.0) & _kept_frames(world, rng, true_s, end_s)
    index = np.flatnonzero(seen.ravel())
    shots = lane[index]
    began = stamp[np.argmax(seen, axis=1)]
    x, y, z = position.transpose(1, 0, 2).reshape(3, -1)[:, index]
    return Tracks(shots, np.tile(stamp, n)[index] - began[shots], x, y, z)


def _positions(flown: Flown, time_s: Floats) -> Floats:
    """[n, 3, frames] at times [n, frames]."""
    return np.stack([at(flown.path, column)[0].T for column in time_s.T], axis=2)


def _tilted(position: Floats, angle_rad: float) -> Floats:
    """As seen by a tracker that takes points ahead for higher by angle_rad."""
    x, y, z = position.transpose(1, 0, 2)
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.stack([c * x - s * z, y, s * x + c * z], axis=1)


def _track_noise(world: World, rng: np.random.Generator, n: int, frames: int) -> Floats:
    """[n, 3, frames] of the tracker's standard deviation, whatever its memory and tails."""
    if "outliers" in world.dirt:
        noise = rng.standard_t(HEAVY_TAILS, size=(n, 3, frames))
    else:
        noise = rng.normal(size=(n, 3, frames))
    if "track_memory" in world.dirt:
        for k in range(1, frames):
            noise[..., k] = MEMORY * noise[..., k - 1] + np.sqrt(1.0 - MEMORY**2) * noise[..., k]
    return world.noise.track_m * noise


def _kept_frames(world: World, rng: np.random.Generator, time_s: Floats, end_s: Floats) -> np.ndarray:
    """Frames that are there: some lost at random, or those before and after the camera's view."""
    lost = rng.random(time_s.shape) < (LOST_FRAMES if "missing_frames" in world.dirt else 0.0)
    enter, leave = rng.uniform(0.0, 0.15, len(end_s)), rng.uniform(0.6, 1.0, len(end_s))
    inside = (time_s >= enter[:, None]) & (time_s <= (leave * np.minimum(end_s, TRACKED_S))[:, None])
    return ~lost & (inside if "clipped" in world.dirt else True)


# --- datasets

LATER = 1 << 42                       # seeds of a foreign world's practice from those of its event


class TruthSeason(NamedTuple):
    """Everything that happened; the solver gets only `dataset`."""

    dataset: Dataset
    plan: Plan
    motor_ratio: Floats
    wheels_rad_s: tuple[Floats, Floats]
    flown: Flown


def shoot(world: World) -> Dataset:
    """Return the dataset of a world; the same world gives the same bits."""
    return play(world).dataset


def write(world: World, directory: str | Path) -> Dataset:
    """Shoot, and save the dataset as a folder; InputError if the directory is not new or empty."""
    dataset = replace(shoot(world), name=Path(directory).resolve().name)
    save_dataset(directory, dataset)
    return dataset


def play(world: World) -> TruthSeason:
    """Shoot as shoot does, and return the truth with it."""
    plan = plan_shots(world)
    distance, hood = see_places(world, plan)
    ratio, flight_s = aim(world, plan, distance, hood)
    return record(world, plan, (distance, hood), ratio, flight_s)


def foreign_robot(seed: int, level: str, practice: int, event: int, change: Mapping[str, float]
                  ) -> tuple[World, World]:
    """Return a foreign world's practice, and its event after a change; the robot's small errors are those of its
    seed in both, and the sides of misses are known."""
    home = make_world(draw_errors(seed), level, practice, seed, side=True)
    effects = {name: home.amount(name) + change.get(name, 0.0) for name in {**home.effects, **change}}
    return home, replace(home, seed=seed + LATER, shots=event, effects=effects)


def record(world: World, plan: Plan, seen: tuple[Floats, Floats], ratio: Floats, flight_s: Floats) -> TruthSeason:
    """Return the shots of a plan and the sensor readings of them.

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
