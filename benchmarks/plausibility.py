"""Benchmark of the plausibility check: how much correct data it refuses, and how often it names a slip.

    python -m benchmarks.plausibility --seed 1 --rigs 100 --out FILE
    python -m benchmarks.plausibility --table FILE

Each seed is a separate rig, with a ball, wheels, air, slip and lift drawn from the priors of truearc's terms. This
module computes its flights with NumPy alone. The same shots are checked unchanged and with one slip. FILE has one line
per seed.
"""

import re
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from msgspec.structs import replace as changed

from benchmarks.worlds import Line, fill_and_tell, read_args
from truearc.errors import InputError
from truearc.robot.config.rig_spec import Ball, LauncherFacts, Rig, Target, Wheel
from truearc.sim.check.check import check_plausible
from truearc.sim.data.dataset import Dataset, Shots, Tracks

Spoil = Callable[[Dataset, np.random.Generator], Dataset | None]
FT, IN, CM, MM = 0.3048, 0.0254, 0.01, 0.001
RPM = np.pi / 30.0
G = 9.81
# radius [m] and mass [kg]: foam balls of 7 and 5 inches, 9.5-inch ball, table tennis, tennis, 15 cm foam, baseball
BALLS = ((0.0889, 0.142), (0.0635, 0.075), (0.1206, 0.27), (0.02, 0.0027), (0.033, 0.058), (0.075, 0.215),
         (0.0366, 0.145), (0.1143, 0.6))


def fly(start: np.ndarray, drag_m: np.ndarray, lift_m: np.ndarray, spin: np.ndarray, step_s: float, steps: int
        ) -> np.ndarray:
    """Places and velocities [steps + 1, lanes, 4] (x, z, vx, vz) by Runge-Kutta; lift_m: acceleration by spin x v."""
    def rate(y: np.ndarray) -> np.ndarray:
        v = y[:, 2:]
        size = np.hypot(v[:, 0], v[:, 1])
        pull = -drag_m[:, None] * size[:, None] * v + (lift_m * spin)[:, None] * np.column_stack([-v[:, 1], v[:, 0]])
        return np.hstack([v, pull - [0.0, G]])
    path = [start]
    for _ in range(steps):
        y = path[-1]
        a = rate(y)
        b = rate(y + 0.5 * step_s * a)
        c = rate(y + 0.5 * step_s * b)
        path.append(y + step_s / 6.0 * (a + 2.0 * b + 2.0 * c + rate(y + step_s * c)))
    return np.array(path)


def height_at(path: np.ndarray, distance_m: np.ndarray) -> np.ndarray:
    """Height [m] where each lane passes its distance; -9 where it does not."""
    x, z = path[:, :, 0], path[:, :, 1]
    past = x >= distance_m
    after = np.maximum(past.argmax(axis=0), 1)
    lane = np.arange(x.shape[1])
    share = (distance_m - x[after - 1, lane]) / np.maximum(x[after, lane] - x[after - 1, lane], 1e-9)
    return np.where(past.any(axis=0), z[after - 1, lane] + share * (z[after, lane] - z[after - 1, lane]), -9.0)


def aim(above_m: Callable[[np.ndarray], np.ndarray], n: int) -> np.ndarray:
    """The speeds of n shots [m/s] at which they pass the target's middle."""
    low, high = np.full(n, 2.0), np.full(n, 45.0)
    for _ in range(14):
        middle = 0.5 * (low + high)
        short = above_m(middle) < 0.0
        low, high = np.where(short, middle, low), np.where(short, high, middle)
    return high


def draw(seed: int) -> Dataset:
    """A sound dataset: a table of outcomes, with tracks of some shots in a third of the seeds."""
    again = 0
    while (dataset := _draw(np.random.default_rng([seed, again]), seed)) is None:
        again += 1
    return dataset


def _draw(rng: np.random.Generator, seed: int) -> Dataset | None:
    """None where such a launcher scores too seldom."""
    radius_m, mass_kg = BALLS[rng.integers(len(BALLS))]
    mass_kg *= float(np.exp(0.15 * rng.standard_normal()))
    cd, cl = 0.5 * np.exp(0.35 * rng.standard_normal()), max(0.1 + 0.15 * rng.standard_normal(), -0.1)
    loss_log, slip = -np.log1p(-0.2) + 0.2 * rng.standard_normal(), 0.015 * rng.standard_normal()
    hood_off, far, bias = rng.standard_normal(3) * [1.0, 0.02, 0.05]
    drag = 0.5 * cd * np.pi * radius_m**2 * 1.2 / mass_kg
    lift = cl * 16.0 / 3.0 * np.pi**2 * radius_m**3 * 1.2 / mass_kg
    n, steep = int(rng.integers(40, 120)), rng.random() < 0.7
    release_m, centre_m = rng.uniform(0.3, 1.1), rng.uniform(1.2, 2.8)
    half_m = rng.uniform(0.15, 0.4)
    near_m = rng.uniform(1.2, 3.0)
    distance = rng.uniform(near_m, near_m * rng.uniform(1.5, 3.0), n)
    line = np.degrees(np.arctan2(centre_m - release_m, distance))
    hood = np.maximum(rng.uniform(40.0, 70.0, n) if steep else rng.uniform(15.0, 45.0, n), line + rng.uniform(6, 15, n))
    if rng.random() < 0.25:
        hood = np.full(n, round(float(hood.max()), 1))                # a fixed hood
    ratio = rng.uniform(0.6, 1.0) if rng.random() < 0.5 else 1.0      # of the upper wheel's speed by the lower's
    turn = (1.0 - ratio) / (1.0 + ratio) / (np.pi * radius_m)         # revolutions per metre: backspin
    true_m, true_deg = distance * (1.0 + far) + bias, hood + hood_off
    lanes = (np.full(n, drag), np.full(n, lift))

    def shoot(speed: np.ndarray, deg: np.ndarray, step_s: float = 0.02, steps: int = 110) -> np.ndarray:
        angle = np.radians(deg)
        start = np.column_stack([np.zeros(n), np.full(n, release_m), speed * np.cos(angle), speed * np.sin(angle)])
        return fly(start, *lanes, turn * speed / np.exp(-loss_log), step_s, steps)

    speed = aim(lambda speed: height_at(shoot(speed, true_deg), true_m) - centre_m, n)
    speed = speed * np.exp(rng.uniform(0.005, 0.03) * rng.standard_normal(n))         # the aim's
    flown = speed * np.exp(rng.uniform(0.003, 0.02) * rng.standard_normal(n))
    path = shoot(flown, true_deg + rng.uniform(0.1, 0.6) * rng.standard_normal(n), 0.01, 220)
    off_m = height_at(path, true_m) - centre_m
    outcome = tuple("three" if abs(one) < 0.07 else "two" if abs(one) < half_m else "miss" for one in off_m)
    if n - outcome.count("miss") < 12 or speed.max() > 40.0:
        return None
    numbers = {"distance_m": np.maximum(distance + 0.02 * rng.standard_normal(n), 0.1), "hood_deg": hood}
    surface = speed * np.exp(loss_log)
    surface = surface / np.maximum(1.0 - slip * surface, 0.5)
    wheel_m, gear = rng.uniform(0.03, 0.08), float(rng.choice([0.5, 1.0, 1.5, 2.0]))
    wheels = (Wheel("upper", wheel_m, gear * ratio, 0.0), Wheel("lower", wheel_m, gear, 180.0))
    lower = 2.0 * surface / (1.0 + ratio) / wheel_m
    kind = rng.choice(["wheels", "motor", "exit"], p=[0.45, 0.35, 0.2])
    free_rad_s = None
    if kind == "wheels":
        numbers |= {"wheel_upper_rad_s": ratio * lower, "wheel_lower_rad_s": lower}
    elif kind == "motor":
        free_rad_s = float(rng.choice([5500.0, 6000.0, 6380.0]) * RPM)
        free_rad_s = max(free_rad_s, 1.05 * float(lower.max()) / gear)
        if free_rad_s > 1500.0:       # 14,000 rpm
            return None
        numbers |= {"motor_ratio": lower / gear / free_rad_s}
    else:
        numbers |= {"exit_speed_m_s": flown * np.exp(0.02 * rng.standard_normal(n)),
                    "exit_spin_rev_s": turn * surface}
    rig = Rig(Ball(mass_kg, radius_m), LauncherFacts(release_m, free_rad_s, wheels),
              Target(centre_m, min(0.07, half_m), half_m))
    shots = Shots(tuple(f"{k:03d}" for k in range(n)), numbers, {"outcome": outcome})
    return Dataset(f"seed {seed}", rig, shots, _track(rng, path, off_m, true_m) if seed % 3 == 0 else None)


def _track(rng: np.random.Generator, path: np.ndarray, off_m: np.ndarray, true_m: np.ndarray) -> Tracks:
    """What a camera saw of some flights, until the target or the floor."""
    every, noise_m = int(rng.choice([1, 2, 3])), rng.uniform(0.003, 0.015)
    scale, clock, tilt = 1.0 + 0.02 * rng.standard_normal(), 1.0 + 0.01 * rng.standard_normal(), np.radians(
        rng.standard_normal())
    aside = np.radians(0.7 * rng.standard_normal(path.shape[1]))
    late = int(rng.choice([0, 5, 15]))
    parts = []
    for shot in rng.permutation(path.shape[1])[:int(rng.integers(10, 30))]:
        x, z = path[:, shot, 0], path[:, shot, 1]
        ends = np.flatnonzero((x > true_m[shot]) | (z < 0.1))
        rows = np.arange(late, ends[0] if len(ends) else len(x), every)
        if len(rows) < 10:
            continue
        seen_x, seen_z = x * np.cos(tilt) - z * np.sin(tilt), z * np.cos(tilt) + x * np.sin(tilt)
        points = scale * np.column_stack([seen_x * np.cos(aside[shot]), seen_x * np.sin(aside[shot]), seen_z])[rows]
        points += noise_m * rng.standard_normal(points.shape)
        parts.append(np.column_stack([np.full(len(rows), shot), rows * 0.01 * clock, points]))
    shot_rows, *columns = np.concatenate(parts or [np.zeros((0, 5))]).T
    return Tracks(shot_rows.astype(int), *columns)


# --- slips

def column(name: str, by: Callable[[np.ndarray], np.ndarray]) -> Spoil:
    """One column of shots otherwise; every wheel's for wheel."""
    def spoil(dataset: Dataset, rng: np.random.Generator) -> Dataset | None:
        found = [key for key in dataset.shots.numbers if key.startswith(name)]
        numbers = {key: by(dataset.shots.numbers[key]) for key in found}
        return replace(dataset, shots=replace(dataset.shots, numbers={**dataset.shots.numbers, **numbers})
                       ) if found else None
    return spoil


def some(name: str, factor: float) -> Spoil:
    """One row in twenty otherwise, of the scoring ones."""
    def spoil(dataset: Dataset, rng: np.random.Generator) -> Dataset | None:
        scoring = np.flatnonzero(np.array(dataset.shots.text("outcome")) != "miss")
        rows = rng.permutation(scoring)[:max(2, len(dataset.shots) // 20)]
        return column(name, lambda old: np.where(np.isin(np.arange(len(old)), rows), factor * old, old))(dataset, rng)
    return spoil


def exchange(first: str, second: str) -> Spoil:
    """Two columns exchanged, of shots or of tracks."""
    def spoil(dataset: Dataset, rng: np.random.Generator) -> Dataset | None:
        if first[0] in "xyz" and first[1:] == "_m":
            return points({first: lambda one: getattr(one, second), second: lambda one: getattr(one, first)})(
                dataset, rng)
        numbers = dataset.shots.numbers
        if not {first, second} <= set(numbers):
            return None
        swapped = {**numbers, first: numbers[second], second: numbers[first]}
        return replace(dataset, shots=replace(dataset.shots, numbers=swapped))
    return spoil


def points(columns: dict[str, Callable[[Tracks], np.ndarray]]) -> Spoil:
    """Columns of tracks otherwise."""
    def spoil(dataset: Dataset, rng: np.random.Generator) -> Dataset | None:
        if dataset.tracks is None or len(set(dataset.tracks.shot)) < 5:
            return None
        return replace(dataset, tracks=replace(dataset.tracks, **{
            name: by(dataset.tracks) for name, by in columns.items()}))
    return spoil


def lengths(factor: float, share: float = 1.0) -> Spoil:
    """Tracks in another unit, all or some."""
    def of(name: str) -> Callable[[Tracks], np.ndarray]:
        return lambda one: np.where(one.shot <= np.quantile(one.shot, share), factor, 1.0) * getattr(one, name)
    return points({name: of(name) for name in ("x_m", "y_m", "z_m")})


def stated(part: str, key: str, factor: float) -> Spoil:
    """A number of the rig otherwise."""
    def spoil(dataset: Dataset, rng: np.random.Generator) -> Dataset | None:
        table = getattr(dataset.rig, part)
        if key == "wheel_radius":
            new = changed(table, wheel=tuple(changed(one, radius_m=one.radius_m * factor) for one in table.wheel))
            moving = "exit_speed_m_s" not in dataset.shots.numbers
        else:
            old = getattr(table, key)
            moving, new = old is not None, changed(table, **{key: (old or 1.0) * factor})
        return replace(dataset, facts=changed(dataset.rig, **{part: new})) if moving else None
    return spoil


def stopped(back: float, floor: bool) -> Spoil:
    """Flights that touch a wall or the floor and go on."""
    def spoil(dataset: Dataset, rng: np.random.Generator) -> Dataset | None:
        tracks = dataset.tracks
        if tracks is None or len(set(tracks.shot)) < 5:
            return None
        x, z = tracks.x_m.copy(), tracks.z_m.copy()
        for _, mine in tracks.by_shot():
            if floor:
                at = z[mine[-1]] + 0.25 * (z[mine].max() - z[mine[-1]])
                z[mine] = np.where((z[mine] < at) & (np.arange(len(mine)) > z[mine].argmax()),
                                   at + back * (at - z[mine]), z[mine])
            else:
                at = x[mine[0]] + 0.7 * (x[mine[-1]] - x[mine[0]])
                x[mine] = np.where(x[mine] > at, at - back * (x[mine] - at), x[mine])
        return replace(dataset, tracks=replace(tracks, x_m=x, z_m=z))
    return spoil


def under_feet(dataset: Dataset, rng: np.random.Generator) -> Dataset | None:
    """Metres in a column of feet."""
    wrong = column("distance_m", lambda old: old * FT)(dataset, rng)
    return wrong and replace(wrong, shots=replace(wrong.shots, written={"distance_m": ("distance_ft", FT, 0.0)}))


# kind -> what is spoiled, and what the first sentence has to say
KINDS: dict[str, tuple[Spoil, str]] = {
    "distance in feet": (column("distance_m", lambda old: old / FT), "feet|distance_ft"),
    "distance in inches": (column("distance_m", lambda old: old / IN), "inches|distance_in"),
    "distance in centimetres": (column("distance_m", lambda old: old / CM), "centimetres|distance_cm"),
    "distance in millimetres": (column("distance_m", lambda old: old / MM), "millimetres|distance_mm"),
    "metres labelled as feet": (under_feet, "distance.*metres"),
    "hood in radians": (column("hood_deg", np.radians), "radians"),
    "hood from the vertical": (column("hood_deg", lambda old: 90.0 - old), "vertical"),
    "wheels in rpm": (column("wheel_", lambda old: old / RPM), "revolutions per minute|rpm"),
    "wheels in rev/s": (column("wheel_", lambda old: old / 2.0 / np.pi), "revolutions per second|rev_s"),
    "free speed in rpm": (stated("launcher", "free_speed_rad_s", 1.0 / RPM), "revolutions per minute"),
    "exit speed in ft/s": (column("exit_speed_m_s", lambda old: old / FT), "ft_s"),
    "exit speed in mph": (column("exit_speed_m_s", lambda old: old / 0.44704), "mph"),
    "exit speed in km/h": (column("exit_speed_m_s", lambda old: old * 3.6), "km_h"),
    "distance and hood exchanged": (exchange("distance_m", "hood_deg"), "exchange"),
    "hood and wheel exchanged": (exchange("hood_deg", "wheel_lower_rad_s"), "exchange"),
    "hood and exit speed exchanged": (exchange("hood_deg", "exit_speed_m_s"), "exchange"),
    "one distance in twenty in feet": (some("distance_m", 1.0 / FT), "feet"),
    "one distance in twenty in inches": (some("distance_m", 1.0 / IN), "inches"),
    "one distance in twenty in cm": (some("distance_m", 1.0 / CM), "centimetres"),
    "one angle in twenty in radians": (some("hood_deg", np.pi / 180.0), "radians"),
    "one speed in twenty in rpm": (some("wheel_", 1.0 / RPM), "revolutions per minute|rpm"),
    "ball radius is in mm": (stated("ball", "radius_m", 1000.0), "millimetres"),
    "ball radius is in inches": (stated("ball", "radius_m", 1.0 / IN), "inches"),
    "ball radius is the diameter": (stated("ball", "radius_m", 2.0), "diameter"),
    "ball mass in grams": (stated("ball", "mass_kg", 1000.0), "grams"),
    "target in feet": (stated("target", "centre_height_m", 1.0 / FT), "centre_height_m.*feet"),
    "target in inches": (stated("target", "centre_height_m", 1.0 / IN), "centre_height_m.*inches"),
    "release in inches": (stated("launcher", "release_height_m", 1.0 / IN), "release_height_m.*inches"),
    "wheel radius in inches": (stated("launcher", "wheel_radius", 1.0 / IN), "inches"),
    "wheel radius in mm": (stated("launcher", "wheel_radius", 1000.0), "millimetres"),
    "wheel radius is the diameter": (stated("launcher", "wheel_radius", 2.0), "diameter"),
    "tracks in feet": (lengths(1.0 / FT), "feet"),
    "tracks in inches": (lengths(1.0 / IN), "inches"),
    "tracks in centimetres": (lengths(1.0 / CM), "centimetres"),
    "tracks in millimetres": (lengths(1.0 / MM), "millimetres"),
    "some tracks in feet": (lengths(1.0 / FT, 0.05), "feet"),
    "times in ms": (points({"t_s": lambda one: one.t_s * 1000.0}), "milliseconds"),
    "times as frame numbers at 60 fps": (points({"t_s": lambda one: one.t_s * 60.0}), "pictures"),
    "times halved": (points({"t_s": lambda one: one.t_s / 2.0}), "half"),
    "x and z exchanged": (exchange("x_m", "z_m"), "exchange"),
    "y and z exchanged": (exchange("y_m", "z_m"), "exchange"),
    "x and y exchanged": (exchange("x_m", "y_m"), "exchange"),
    "z downward": (points({"z_m": lambda one: -one.z_m}), "down"),
    "x backward": (points({"x_m": lambda one: -one.x_m}), "backward"),
    "a bounce off the floor": (stopped(0.6, True), "touch|hit|turn upward"),
    "a wall hit": (stopped(0.3, False), "touch|hit"),
}


def said_of(dataset: Dataset) -> tuple[str, list[str]]:
    """(refused, warned or passed; sentences)."""
    try:
        said = check_plausible(dataset).accepted
        return ("warned" if said else "passed"), list(said)
    except InputError as error:
        return "refused", str(error).splitlines()


def line_of(seed: int) -> Line:
    """One seed: what is said of the sound dataset, and of the same with a slip."""
    sound = draw(seed)
    begin = time.perf_counter()
    word, said = said_of(sound)
    line: Line = {"seed": seed, "sound": word, "said": said, "s": round(time.perf_counter() - begin, 3)}
    rng, names = np.random.default_rng([seed, 1]), list(KINDS)
    for at in rng.permutation(len(names)):
        if (spoiled := KINDS[names[at]][0](sound, rng)) is not None:
            word, said = said_of(spoiled)
            right = bool(said) and re.search(KINDS[names[at]][1], said[0]) is not None
            return {**line, "kind": names[at], "spoiled": word, "right": right, "spoiled_said": said}
    return line


def table(lines: Sequence[Line]) -> str:
    """Shares, by kind."""
    n = len(lines)
    sound = [line["sound"] for line in lines]
    rows = [f"{n} unchanged: {sound.count('refused')} refused ({sound.count('refused') / n:.1%}), "
            f"{sound.count('warned')} with a warning ({sound.count('warned') / n:.1%}); "
            f"{np.median([line['s'] for line in lines]):.2f} s each"]
    spoiled = [line for line in lines if "kind" in line]
    for name in ["all", *KINDS]:
        mine = [line for line in spoiled if name in ("all", line["kind"])]
        if mine:
            words = [line["spoiled"] for line in mine]
            rows.append(f"  {name:36s} {len(mine):5d}: refused {words.count('refused') / len(mine):4.0%}, accepted "
                        f"without a warning {words.count('passed') / len(mine):4.0%}, correct cause first "
                        f"{sum(line['right'] for line in mine) / len(mine):4.0%}")
    return "\n".join(rows)


def main() -> int:
    args = read_args(__doc__, seed=(1, "the first"), rigs=1000)
    return fill_and_tell(args, lambda: {str(seed): seed for seed in range(args.seed, args.seed + args.rigs)}, line_of,
                         table)


if __name__ == "__main__":
    sys.exit(main())
