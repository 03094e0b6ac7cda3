"""The seed's simulator: a recorded configuration -> height at the target plane -> outcome."""

from collections.abc import Callable, Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np

from robot.config import BadInput
from robot.facts import Facts
from sim.physics.catalogue import flight_terms, launch_terms
from sim.physics.flight import Crossing, fly
from sim.physics.launch import Exit, exit_no_slip, exit_opposed, is_opposed
from sim.physics.term import complete
from sim.shots import Shots

MISS, TWO, THREE = "miss", "two", "three"
BLOCK = 4096                          # rows flown at once
NAMED = 5                             # shots that a message names before it only counts


def predict(facts: Facts, coefficients: Mapping[str, Mapping[str, float]], shots: Shots,
            progress: Callable[[float, str], None] = lambda done, note: None) -> Crossing:
    """Fly each recorded configuration to its plane with gravity and the terms that `coefficients` names.

    Launch terms change what the wheels say, never an exit speed that was measured. Returns numpy arrays, one row a
    shot. BadInput names shots without a distance or a launch.
    """
    leaving = leave(facts, coefficients, launch_of(facts, shots), by_wheels(shots))
    return _fly_rows(facts, coefficients, leaving, require(shots, "distance_m"), progress)


def fly_rows(facts: Facts, coefficients: Mapping[str, Mapping[str, float]], exit: Exit, distance_m: np.ndarray,
             progress: Callable[[float, str], None] = lambda done, note: None) -> Crossing:
    """As predict, of launches by the wheels (before launch terms) given as numpy arrays [n]."""
    return _fly_rows(facts, coefficients, leave(facts, coefficients, exit), distance_m, progress)


def leave(facts: Facts, coefficients: Mapping[str, Mapping[str, Any]], exit: Exit, where: Any = True) -> Exit:
    """The launch after the launch terms that `coefficients` names; numpy or JAX arrays [n].

    exit: the launch by the wheels. Terms act on the rows that `where` names; without such terms `exit` itself returns.
    """
    changed = exit
    for term in launch_terms(coefficients):
        changed = term.leave(facts, complete(term, coefficients[term.name]), changed)
    if changed is exit:
        return exit
    pick = np.where if all(isinstance(part, np.ndarray | float) for part in changed) else jnp.where
    return Exit(*(pick(where, new, old) for new, old in zip(changed, exit, strict=True)))


def _fly_rows(facts: Facts, coefficients: Mapping[str, Mapping[str, float]], exit: Exit, distance_m: np.ndarray,
              progress: Callable[[float, str], None]) -> Crossing:
    """Heights and times of launches as they leave.

    Rows fly in blocks of those that stay aloft about equally long, and in few different sizes, since each is compiled.
    """
    terms = flight_terms({"gravity", *coefficients})
    upward_m_s = exit.speed_m_s * np.sin(exit.elevation_rad)
    order = np.argsort(upward_m_s, kind="stable")
    height_m, time_s = np.full(len(order), np.nan), np.full(len(order), np.nan)
    lanes = min(BLOCK, 1 << max(len(order) - 1, 15).bit_length())
    for first in range(0, len(order), lanes):
        rows = order[first:first + lanes]
        padded = np.resize(rows, lanes)
        part = fly(facts, terms, coefficients, Exit(*(column[padded] for column in exit)), distance_m[padded])
        height_m[rows] = np.asarray(part.height_m)[:rows.size]
        time_s[rows] = np.asarray(part.time_s)[:rows.size]
        progress(min(first + lanes, len(order)) / len(order), f"{min(first + lanes, len(order))} shots")
    return Crossing(height_m, time_s, ~np.isnan(height_m))


def classify(facts: Facts, height_m: np.ndarray) -> np.ndarray:
    """Outcome of a height at the plane (nan = not reached): the seed's Eq. 13 and 14, bounds included."""
    if facts.target is None:
        raise BadInput("rig.toml: [target] is needed to tell an outcome")
    deviation_m = np.abs(np.asarray(height_m, dtype=float) - facts.target.centre_height_m)
    return np.where(deviation_m <= facts.target.three_half_height_m, THREE,
                    np.where(deviation_m <= facts.target.two_half_height_m, TWO, MISS))


def launch_of(facts: Facts, shots: Shots) -> Exit:
    """How each shot left: measured exit columns first, then wheel speeds, then motor_ratio (numpy, one row a shot).

    A measured speed without a spin, measured or of wheels, means a ball without spin. BadInput names shots that have
    too little of these, or no elevation.
    """
    speed_m_s = _prefer(shots.number("exit_speed_m_s"), _from_wheels(facts, shots)[0])
    elevation_deg = _prefer(shots.number("exit_deg"), shots.number("hood_deg"))
    _need(shots, np.isnan(speed_m_s), "motor_ratio (with launcher.free_speed_rad_s in rig.toml), every "
          "wheel_<name>_rad_s, or exit_speed_m_s")
    _need(shots, np.isnan(elevation_deg), "hood_deg or exit_deg")
    return Exit(speed_m_s, np.radians(elevation_deg), spin_of(facts, shots))


def spin_of(facts: Facts, shots: Shots) -> np.ndarray:
    """Backspin in rev/s as it was measured, else by the wheels, else none; one a shot."""
    spin_rev_s = _prefer(shots.number("exit_spin_rev_s"), _from_wheels(facts, shots)[1])
    return np.where(np.isnan(spin_rev_s), 0.0, spin_rev_s)


def by_wheels(shots: Shots) -> np.ndarray:
    """Which shots' speed launch_of takes from the wheels, since none was measured."""
    return np.isnan(shots.number("exit_speed_m_s"))


def require(shots: Shots, name: str) -> np.ndarray:
    """A numeric column without gaps; BadInput names the shots that lack it."""
    column = shots.number(name)
    _need(shots, np.isnan(column), name)
    return column


def roll(facts: Facts, surface_m_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(speed in m/s, backspin in rev/s) [n] by the surface speeds of the wheels [n, wheels]; linear in them."""
    if is_opposed(facts):
        lower = [round(wheel.clock_deg % 360.0, 6) for wheel in facts.launcher.wheel].index(180.0)
        exit = exit_opposed(facts, surface_m_s[:, 1 - lower], surface_m_s[:, lower], 0.0)
        return exit.speed_m_s, exit.spin_rev_s
    speed_m_s, spin_rad_s = exit_no_slip(facts, surface_m_s)
    return speed_m_s, -spin_rad_s[:, 1] / (2.0 * np.pi)


def _from_wheels(facts: Facts, shots: Shots) -> tuple[np.ndarray, np.ndarray]:
    """Speed and backspin from the wheels; nan where a wheel's speed is not known."""
    wheels = facts.launcher.wheel
    if not wheels:
        return np.full(len(shots), np.nan), np.full(len(shots), np.nan)
    surface_m_s = np.stack([_wheel_rad_s(facts, shots, index) * wheel.radius_m for index, wheel in enumerate(wheels)],
                           axis=1)
    return roll(facts, surface_m_s)


def _wheel_rad_s(facts: Facts, shots: Shots, index: int) -> np.ndarray:
    wheel = facts.launcher.wheel[index]
    measured = shots.number(f"wheel_{wheel.name}_rad_s")
    free_speed_rad_s = facts.launcher.free_speed_rad_s
    if free_speed_rad_s is None:
        return measured
    return _prefer(measured, shots.number("motor_ratio") * wheel.gear * free_speed_rad_s)


def _prefer(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return np.where(np.isnan(first), second, first)


def _need(shots: Shots, lacking: np.ndarray, what: str) -> None:
    if lacking.any():
        names = [shots.shot_id[row] for row in np.flatnonzero(lacking)]
        more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
        raise BadInput(f"shots {', '.join(names[:NAMED])}{more}: {what} is needed and missing")
