"""`truearc.discover(system, runs)` on two sets of real recordings: a servo with a pendulum, and cascaded tanks.

    python -m benchmarks.real_systems FOLDER --only tanks|servo|one-mass

FOLDER has the shared recordings (docs/measured/systems.md names their sources). The servo's runs are thinned to 30 ms;
every fourth is left out, and forecast from its first sample by the believed simulator, by the adopted one, and by the
six friction models of the servo's owners, which are fitted to the same runs at 5 ms by least squares.
"""

import csv
import gzip
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numba
import numpy as np
from scipy.optimize import least_squares

import truearc as ta
from benchmarks.options import read_options

THIN = 6                              # of 5 ms
LARGEST_RAD_S = 3400.0 * 2.0 * np.pi / 4096.0     # of the goal, as the servo limits it (the design)
GAIN = 0.166                          # of kp, as its owners have it (the design)
TANKS = {"k1": ta.positive(0.05, factor=3), "k2": ta.positive(0.05, factor=3), "k3": ta.positive(0.05, factor=3),
         "k4": ta.positive(0.05, factor=3)}


def read(path: Path) -> dict[str, np.ndarray]:
    """A table by column; texts stay texts."""
    with gzip.open(path, "rt") if path.suffix == ".gz" else path.open() as file:
        rows = list(csv.reader(file))
    found = {}
    for k, name in enumerate(rows[0]):
        cells = [row[k] for row in rows[1:]]
        try:
            found[name] = np.array(cells, dtype=float)
        except ValueError:
            found[name] = np.array(cells)
    return found


def tank_rate(state: Any, inputs: Any, p: Any) -> Any:
    upper, lower = (np.sqrt(np.maximum(one, 1e-3)) for one in state)
    return -p.k1 * upper + p.k4 * inputs["pump_v"], p.k2 * upper - p.k3 * lower


def tanks(folder: Path) -> list[str]:
    """The estimation record: what is missing, and forecasts of its last quarter from the first three."""
    table = read(folder / "systems" / "cascaded_tanks.csv")
    system = ta.System(rate=tank_rate, state=["upper", "level"], believed=TANKS, observe={"level": None},
                       start={"upper": ta.normal(5.0, sd=3.0)})
    runs = ta.Runs(table, run=None, inputs=["pump_v"])
    found = ta.discover(system, runs, seed=0)
    return ["cascaded tanks", str(found)]


def servo_frame(folder: Path, thin: int = THIN) -> dict[str, np.ndarray]:
    """The runs at `thin` times 5 ms, with the goal limited to its largest velocity."""
    table = read(folder / "systems" / "servo_pendulum.csv.gz")
    kept, limited = [], np.zeros(len(table["run"]))
    for run in np.unique(table["run"]):
        rows = np.flatnonzero(table["run"] == run)
        goal = float(table["position_rad"][rows[0]])
        for row, step_s in zip(rows, np.diff(table["t_s"][rows], append=table["t_s"][rows[-1]]), strict=True):
            most = LARGEST_RAD_S * max(step_s, 0.005)
            goal += float(np.clip(table["goal_rad"][row] - goal, -most, most))
            limited[row] = goal
        kept.append(rows[::thin])
    rows = np.concatenate(kept)
    return {**{name: values[rows] for name, values in table.items()}, "limited_rad": limited[rows],
            "outside_nm": np.zeros(len(rows))}       # where a missing torque would come in


def servo_rate(state: Any, inputs: Any, p: Any) -> Any:
    """Voltage by the owners' law, motor, gravity, Coulomb and viscous friction; kt and R as kt / R and kt^2 / R."""
    angle, speed = state
    duty = jnp.clip(inputs["kp"] * GAIN * p.ratio * (inputs["limited_rad"] - angle), -0.97, 0.97)
    motor = inputs["torque_on"] * (p.push * inputs["supply_v"] * duty - p.emf * speed)
    weight = inputs["mass_kg"] * 9.81 * inputs["length_m"] * jnp.sin(angle + p.offset)
    size = motor + inputs["outside_nm"] - weight - p.dry * jnp.tanh(speed / 0.05) - p.viscous * speed
    return speed, size / (inputs["mass_kg"] * inputs["length_m"]**2 + p.armature)


def load_friction(state: Any, inputs: Any, a: Any) -> Any:
    """Friction that grows with the weight's torque on the gearbox (the owners' M3 without the motor's torque)."""
    angle, speed = state
    torque = inputs["mass_kg"] * 9.81 * inputs["length_m"] * jnp.abs(jnp.sin(angle))
    return 0.0 * speed, -a * torque * jnp.tanh(speed / 0.05) / (inputs["mass_kg"] * inputs["length_m"]**2 + 0.01)


def servo_system() -> "ta.System":
    return ta.System(
        rate=servo_rate, state=["position_rad", "speed_rad_s"],
        believed={"push": ta.positive(0.15, factor=3), "emf": ta.positive(0.3, factor=3),
                  "ratio": ta.positive(1.0, factor=1.5), "armature": ta.positive(0.01, factor=3),
                  "dry": ta.positive(0.1, factor=3), "viscous": ta.positive(0.05, factor=3),
                  "offset": ta.normal(0.0, sd=0.05)},
        observe={"position_rad": None, "speed_rad_s": None}, hold="linear",
        effects=[ta.effect("load_friction", load_friction, usual=0.1)])


def servo_runs(table: dict[str, np.ndarray]) -> "ta.Runs":
    return ta.Runs(table, inputs=["limited_rad", "torque_on", "outside_nm"],
                   conditions=["mass_kg", "length_m", "kp", "supply_v"])


def law_of_swing(p: Any, friction: Any, run: Any) -> Any:
    """Angles of one run at 5 ms by the owners' law: friction takes speed away within its limit, and stops the arm.

    p: push, emf, ratio, armature, offset, viscous. friction: f, l for te and tm, s, speed, alpha, ls for te and tm,
    q, q'. run [T, 6]: goal, torque on, mass, length, kp, supply, and the first angle in column 6.
    """
    angle, speed, found = run[0, 6], 0.0, np.zeros(len(run))
    for k in range(len(run)):
        found[k] = angle
        goal, on, mass, length, kp, supply = run[k, :6]
        inertia = mass * length**2 + p[3]
        for _ in range(2):
            duty = min(max(kp * GAIN * p[2] * (goal - angle), -0.97), 0.97)
            tm = on * (p[0] * supply * duty - p[1] * speed)
            te = -mass * 9.81 * length * np.sin(angle + p[4])
            e = np.exp(-(abs(speed) / friction[4])**friction[5])
            limit = friction[0] + p[5] * abs(speed) + abs(friction[1] * te + friction[2] * tm)
            limit += e * (friction[3] + abs(friction[6] * te + friction[7] * tm))
            if te * tm < 0.0:
                limit += e * (friction[8] * te**2 if abs(te) < abs(tm) else friction[9] * tm**2)
            speed += 0.0025 * (tm + te) / inertia
            speed = np.sign(speed) * max(abs(speed) - 0.0025 * limit / inertia, 0.0)
            angle += 0.0025 * speed
    return found


swing: Any = numba.njit(cache=True)(law_of_swing)

# {model: of its friction numbers, which are free; numbers in braces are equal}. The outside torque on the gearbox and
# the motor's are both taken along the motion, so that |te - tm| of the owners, who count them against each other, is
# |te + tm| here
MODELS: dict[str, list[list[int]]] = {"M1": [[0]], "M2": [[0], [3], [4], [5]], "M3": [[0], [1, 2]],
                                      "M4": [[0], [1, 2], [3], [4], [5], [6, 7]],
                                      "M5": [[0], [1], [2], [3], [4], [5], [6], [7]],
                                      "M6": [[0], [1], [2], [3], [4], [5], [6], [7], [8], [9]]}
FIRST = np.array([0.05, 0.02, 0.02, 0.03, 0.5, 1.0, 0.02, 0.02, 0.02, 0.02])
STARTS = (1.0, 0.1)                   # of these, from which each fit begins
USED = np.array([True, False, False, False, True, True, False, False, False, False])


def fit_rivals(runs: list[tuple[Any, Any]]) -> dict[str, Callable[[Any], Any]]:
    """{model: angles of a run}, each fitted to the positions of these runs [(run, angles)], from M1's numbers on."""
    found: dict[str, Callable[[Any], Any]] = {}
    plain = np.log(np.array([0.15, 0.3, 1.0, 0.01, 1.0, 0.05]))
    plain[4] = 0.0
    for name, groups in MODELS.items():
        def numbers(x: Any, groups: list[list[int]] = groups) -> tuple[Any, Any]:
            p, friction = np.exp(x[:6]), np.where(USED, FIRST, 0.0)
            p[4] = x[4]
            for value, group in zip(x[6:], groups, strict=True):
                friction[group] = np.exp(value)
            return p, friction

        def off(x: Any, numbers: Any = numbers) -> Any:
            return np.concatenate([swing(*numbers(x), run)[::THIN] - angle[::THIN] for run, angle in runs])
        tops = [least_squares(off, np.concatenate([plain, np.log([size * FIRST[group[0]] for group in groups])]),
                              bounds=(-12.0, 4.0), loss="soft_l1", f_scale=0.03, max_nfev=30) for size in STARTS]
        best = min(tops, key=lambda one: one.cost)
        plain = best.x[:6] if name == "M1" else plain
        found[name] = partial(swing, *numbers(best.x))
    return found


def servo(folder: Path) -> list[str]:
    """All masses: what is missing, and forecasts of every fourth run."""
    whole, table = servo_frame(folder, 1), servo_frame(folder)
    runs = servo_runs(table)
    test = [k for k in range(len(runs)) if k % 4 == 3]
    train = [k for k in range(len(runs)) if k % 4 != 3]
    names = ("limited_rad", "torque_on", "mass_kg", "length_m", "kp", "supply_v", "position_rad")
    single = [(np.stack([whole[name][rows] for name in names], axis=1), whole["position_rad"][rows])
              for rows in (np.flatnonzero(whole["run"] == run) for run in np.unique(whole["run"]))]
    off = {name: [np.abs(law(single[k][0]) - single[k][1]).mean() for k in test]
           for name, law in fit_rivals([single[k] for k in train]).items()}
    print("\n".join(f"{name}: {np.mean(each):.4f} rad" for name, each in off.items()), flush=True)
    found = ta.discover(servo_system(), runs.take(train), seed=0)
    left = runs.take(test)
    for name, one in (("Coulomb and viscous", ta.fit(servo_system(), runs.take(train)).system),
                      ("adopted", found.adopt())):
        seen = one.simulate(left)["position_rad"]
        off[name] = [np.abs(seen[rows] - left.number("position_rad")[rows]).mean() for rows in left.places]
    lines = ["servo pendulum", str(found), f"mean absolute error of {len(test)} runs left out, and less that by "
             "Coulomb and viscous friction"]
    for name, each in off.items():
        less = np.array(each) - np.array(off["Coulomb and viscous"])
        lines.append(f"{name}: {np.mean(each):.4f} rad; {less.mean():+.4f} (standard error "
                     f"{less.std(ddof=1) / np.sqrt(len(less)):.4f})")
    return lines


def one_mass(folder: Path) -> list[str]:
    """One mass and arm alone: the answer should be that it cannot be told, with another mass to measure."""
    table = servo_frame(folder)
    masses, count = np.unique(table["mass_kg"], return_counts=True)
    kept = table["mass_kg"] == masses[count.argmax()]
    found = ta.discover(servo_system(), servo_runs({name: values[kept] for name, values in table.items()}), seed=0)
    return [f"one mass, {masses[count.argmax()]} kg", str(found)]


ANSWERS: dict[str, Callable[[Path], list[str]]] = {"tanks": tanks, "servo": servo, "one-mass": one_mass}


def main() -> int:
    args = read_options(__doc__, folder=..., only="")
    for name, answer in ANSWERS.items():
        if name == args.only or not args.only:
            print("\n".join(answer(args.folder)), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
