"""`truearc.discover(system, runs)` on two sets of real recordings: a servo with a pendulum, and cascaded tanks.

    python -m benchmarks.real_systems FOLDER --only tanks|servo|one-mass

FOLDER has the shared recordings (docs/measured/systems.md names their sources). The servo's runs are thinned to 30 ms;
every fourth is left out, and forecast from its first sample by the believed simulator and by the adopted one.
"""

import csv
import gzip
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

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


def servo_frame(folder: Path) -> dict[str, np.ndarray]:
    """The runs at 30 ms, with the goal limited to its largest velocity."""
    table = read(folder / "systems" / "servo_pendulum.csv.gz")
    kept, limited = [], np.zeros(len(table["run"]))
    for run in np.unique(table["run"]):
        rows = np.flatnonzero(table["run"] == run)
        goal = float(table["position_rad"][rows[0]])
        for row, step_s in zip(rows, np.diff(table["t_s"][rows], append=table["t_s"][rows[-1]]), strict=True):
            most = LARGEST_RAD_S * max(step_s, 0.005)
            goal += float(np.clip(table["goal_rad"][row] - goal, -most, most))
            limited[row] = goal
        kept.append(rows[::THIN])
    rows = np.concatenate(kept)
    return {**{name: values[rows] for name, values in table.items()}, "limited_rad": limited[rows],
            "outside_nm": np.zeros(len(rows))}       # where a missing torque would come in


def servo_rate(state: Any, inputs: Any, p: Any) -> Any:
    """Voltage by the owners' law, motor, gravity, Coulomb and viscous friction; kt and R as kt / R and kt^2 / R."""
    angle, speed = state
    duty = np.clip(inputs["kp"] * GAIN * p.ratio * (inputs["limited_rad"] - angle), -0.97, 0.97)
    motor = inputs["torque_on"] * (p.push * inputs["supply_v"] * duty - p.emf * speed)
    weight = inputs["mass_kg"] * 9.81 * inputs["length_m"] * np.sin(angle + p.offset)
    size = motor + inputs["outside_nm"] - weight - p.dry * np.tanh(speed / 0.05) - p.viscous * speed
    return speed, size / (inputs["mass_kg"] * inputs["length_m"]**2 + p.armature)


def load_friction(state: Any, inputs: Any, a: Any) -> Any:
    """Friction that grows with the weight's torque on the gearbox (the owners' M3 without the motor's torque)."""
    angle, speed = state
    torque = inputs["mass_kg"] * 9.81 * inputs["length_m"] * np.abs(np.sin(angle))
    return 0.0 * speed, -a * torque * np.tanh(speed / 0.05) / (inputs["mass_kg"] * inputs["length_m"]**2 + 0.01)


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


def servo(folder: Path) -> list[str]:
    """All masses: what is missing, and forecasts of every fourth run."""
    table = servo_frame(folder)
    runs = servo_runs(table)
    test = [k for k in range(len(runs)) if k % 4 == 3]
    train = [k for k in range(len(runs)) if k % 4 != 3]
    found = ta.discover(servo_system(), runs.take(train), seed=0)
    believed = ta.fit(servo_system(), runs.take(train)).system
    lines = ["servo pendulum", str(found)]
    left = runs.take(test)
    for name, one in (("Coulomb and viscous", believed), ("adopted", found.adopt())):
        seen = one.simulate(left)["position_rad"]
        off = [np.abs(seen[rows] - left.number("position_rad")[rows]).mean() for rows in left.places]
        lines.append(f"{name}: mean absolute error of {len(off)} runs left out {np.mean(off):.4f} rad")
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
