"""The paper's simulator: recorded configuration -> height at the target plane -> outcome."""

import math
from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np

from truearc.errors import InputError
from truearc.robot.config.rig_spec import Rig
from truearc.sim.data.dataset import ORDINARY, Circumstances, Shots
from truearc.sim.physics import catalogue as known
from truearc.sim.physics.facing_up import Landing, land, outcome_of
from truearc.sim.physics.flight import STEP_S, Balls, Crossing, fly, path, with_balls
from truearc.sim.physics.term import Exit, Opening, complete
from truearc.sim.printed import Progress

MISS, TWO, THREE = "miss", "two", "three"
BLOCK = 4096                          # rows flown at once
LAUNCH_STATE = ("exit_speed_m_s", "exit_spin_rev_s")
DIGITS = 9                            # of derived columns: rounding errors must not become a covariate
POINT_S, POINTS = 0.01, 400           # of a trajectory; straight lines between its points are within 0.2 mm of it
LANES = 256                           # flown at once for trajectories
NAMED = 5                             # shots that a message names before it only counts

Values = Mapping[str, Mapping[str, Any]]


def predict(rig: Rig, coefficients: Mapping[str, Mapping[str, float]], shots: Shots,
            progress: Progress = lambda done, note: None,
            circumstances: Circumstances = ORDINARY, among: known.Catalogue | None = None,
            step_s: float = STEP_S) -> Crossing:
    """Fly each recorded configuration to its plane with gravity and the terms that `coefficients` names.

    Sensing terms correct what the robot's sensors say and launch terms what the wheels do, never what was measured on
    the ball. Returns numpy arrays, one row a shot. circumstances: of these shots (truearc.sim.data.dataset);
    terms that follow one are absent from ordinary shots. among: the catalogue of the terms,
    truearc.sim.physics.catalogue.catalogue() when not given, here and below. step_s: the longest step of the
    flight. InputError names shots without a distance or a launch. Each shot's own mass_kg and radius_m fly, where they
    are given.
    """
    values = known.effective(coefficients, circumstances, among)
    whose, balls = by_robot(shots), own_balls(rig, shots)
    own = with_balls(rig, balls)
    exit, distance_m = sense(own, values, launch_of(rig, shots), require(shots, "distance_m"), whose, among)
    return fly_rows(rig, values, leave(own, values, exit, whose, among), distance_m, progress, among, balls, step_s)


def forecast(rig: Rig, coefficients: Mapping[str, Mapping[str, float]], shots: Shots,
             progress: Progress = lambda done, note: None,
             circumstances: Circumstances = ORDINARY, among: known.Catalogue | None = None) -> dict[str, np.ndarray]:
    """Return columns of where each configuration comes to at the rig's target, and its outcome, as `predict` flies it.

    Of an upright opening: height_m above the floor and deviation_m from the centre. Of one that faces up: along_m and
    across_m from the centre, in the plane of the rim, angle_deg of arrival, and side of a miss. Numbers are nan where
    the ball does not come there.
    """
    target, opening = rig.target, opening_of(rig, coefficients, among, circumstances)
    if target is None or not target.faces_up:
        height_m = np.asarray(predict(rig, coefficients, shots, progress, circumstances, among).height_m)
        return {"height_m": height_m, "deviation_m": np.asarray(height_m - opening.centre_m),
                "outcome": classify(rig, height_m, opening)}
    landing, radius_m = _land(rig, coefficients, shots, opening, circumstances, among)
    level, side = outcome_of(target, radius_m, landing, opening)
    words = np.array([target.word(word) for word in (MISS, TWO, THREE)])
    return {"along_m": np.asarray(landing.along_m), "across_m": np.asarray(landing.across_m),
            "angle_deg": np.degrees(landing.angle_rad), "outcome": words[level], "side": side}


def _land(rig: Rig, coefficients: Mapping[str, Mapping[str, float]], shots: Shots, opening: Opening,
          circumstances: Circumstances, among: known.Catalogue | None) -> tuple[Landing, np.ndarray]:
    """(landings, radii of the balls) of an opening that faces up."""
    values = known.effective(coefficients, circumstances, among)
    whose, balls = by_robot(shots), own_balls(rig, shots)
    own = with_balls(rig, balls)
    exit, distance_m = sense(own, values, launch_of(rig, shots), require(shots, "distance_m"), whose, among)
    exit = Exit(*map(np.asarray, leave(own, values, exit, whose, among)))
    terms = known.flight_terms({"gravity", *values}, among)
    named = {term.name: values[term.name] for term in terms if term.name in values}
    radius_m = np.full(len(shots), rig.ball.radius_m) if balls is None else np.asarray(balls[1])
    parts = []
    for first in range(0, len(shots), BLOCK):
        rows = np.resize(np.arange(first, min(first + BLOCK, len(shots))), min(BLOCK, -(-len(shots) // LANES) * LANES))
        hole = Opening(*(part if np.ndim(part) == 0 else part[rows] for part in opening))
        mine = None if balls is None else (balls[0][rows], balls[1][rows])
        parts.append(land(rig, terms, take_values(named, rows), exit.take(rows), np.asarray(distance_m)[rows], hole,
                          balls=mine))
    return Landing(*(np.concatenate([np.asarray(part) for part in each])[:len(shots)]
                     for each in zip(*parts, strict=True))), radius_m


def trajectories(rig: Rig, coefficients: Mapping[str, Mapping[str, float]], shots: Shots,
                 circumstances: Circumstances = ORDINARY, among: known.Catalogue | None = None
                 ) -> tuple[tuple[np.ndarray, float], ...]:
    """Return each shot's flight, flown as `predict` does with the rig's ball, and the distance to its plane in m.

    A flight is places [k, 3] in m in the launcher's frame (x toward the target, y left, z up; origin on the floor below
    the exit), POINT_S apart, from the exit to where it first meets the plane or the floor or turns back; it ends after
    POINTS in any case. InputError names shots without a distance or a launch.
    """
    values, whose = known.effective(coefficients, circumstances, among), by_robot(shots)
    exit, distance_m = sense(rig, values, launch_of(rig, shots), require(shots, "distance_m"), whose, among)
    exit = Exit(*map(np.asarray, leave(rig, values, exit, whose, among)))
    terms = known.flight_terms({"gravity", *values}, among)
    named = {term.name: values[term.name] for term in terms if term.name in values}
    flown: list[tuple[np.ndarray, float]] = []
    for first in range(0, len(shots), LANES):
        rows = np.arange(first, min(first + LANES, len(shots)))
        axes = path(rig, terms, take_values(named, rows), exit.take(rows), POINTS, POINT_S).position_m
        places = np.stack(np.broadcast_arrays(*map(np.asarray, axes)), axis=-1)
        flown += [(_until_end(places[:, lane], plane_m), plane_m)
                  for lane, plane_m in enumerate(np.asarray(distance_m)[rows].tolist())]
    return tuple(flown)


def _until_end(places: np.ndarray, distance_m: float) -> np.ndarray:
    """Up to the plane, the floor or the turn, whichever is first; there on the straight line to the point beyond."""
    x, z = places[:, 0], places[:, 2]
    beyond = np.flatnonzero((x[1:] >= distance_m) | (z[1:] < 0.0) | (np.diff(x) <= 0.0))
    if len(beyond) == 0:
        return places
    before, after = places[beyond[0]], places[beyond[0] + 1]
    share = 1.0 if after[0] > before[0] else 0.0
    if after[0] >= distance_m:
        share = (distance_m - before[0]) / (after[0] - before[0])
    if after[2] < 0.0:
        share = min(share, before[2] / (before[2] - after[2]))
    return np.concatenate([places[:beyond[0] + 1], [before + share * (after - before)]])


def own_balls(rig: Rig, shots: Shots) -> Balls | None:
    """Return mass in kg and radius in m [n] of each shot's ball, by default the rig's; None if no shot states one."""
    given = [shots.number(name) for name in ("mass_kg", "radius_m")]
    if not any((column > 0.0).any() for column in given):
        return None
    usual = rig.ball.mass_kg, rig.ball.radius_m
    mass_kg, radius_m = (np.where(column > 0.0, column, own) for column, own in zip(given, usual, strict=True))
    return mass_kg, radius_m


def sense(rig: Rig, values: Values, exit: Exit, distance_m: Any, where: Any = True,
          among: known.Catalogue | None = None) -> tuple[Exit, Any]:
    """Return (launch by the wheels, distance) corrected by the sensing terms among `values`; numpy or JAX arrays
    [n].

    exit, distance_m: as the sensors have them. where: the parts of the launch from the robot's own sensors, an Exit of
    booleans (by_robot) or one for all; a distance is always theirs.
    """
    changed = exit, distance_m
    for term in known.sensing_terms(values, among):
        changed = term.sense(rig, values[term.name], *changed)
    return _where(where, changed[0], exit), changed[1]


def leave(rig: Rig, values: Values, exit: Exit, where: Any = True, among: known.Catalogue | None = None) -> Exit:
    """Return the launch after the launch terms among `values` (effective); numpy or JAX arrays [n].

    exit: the launch by the wheels. Terms act on the parts that `where` names, an Exit of booleans (by_robot) or one for
    all; without such terms `exit` itself returns.
    """
    changed = exit
    for term in known.launch_terms(values, among):
        changed = term.leave(rig, complete(term, values[term.name]), changed)
    return _where(where, changed, exit)


def opening_of(rig: Rig, coefficients: Values, among: known.Catalogue | None = None,
               circumstances: Circumstances = ORDINARY) -> Opening:
    """Return the opening that the ball has to pass, from the rig's target and the arrival terms among
    `coefficients`.

    InputError when the rig has no target.
    """
    if rig.target is None:
        raise InputError("rig.toml: target.centre_height_m: missing key; state the opening in [target]"
                         ": outcomes are about it")
    opening = Opening(rig.target.centre_height_m, rig.target.three_half_height_m, rig.target.two_half_height_m)
    values = known.effective(coefficients, circumstances, among)
    for term in known.arrival_terms(values, among):
        opening = term.arrive(values[term.name], opening)
    return opening


def _where(where: Any, new: Exit, old: Exit) -> Exit:
    """The new parts of a launch where they apply."""
    if new is old:
        return old
    masks = where if isinstance(where, Exit) else Exit(where, where, where, True)
    pick = np.where if all(isinstance(part, np.ndarray | float) for part in new) else jnp.where
    return Exit(*(b if a is b else pick(mask, a, b) for mask, a, b in zip(masks, new, old, strict=True)))


def take_values(values: Values, rows: Any) -> dict[str, dict[str, Any]]:
    """Return those lanes of effective values; numbers shared by all lanes stay unchanged."""
    return {name: {key: value if np.ndim(value) == 0 else value[rows] for key, value in table.items()}
            for name, table in values.items()}


def fly_rows(rig: Rig, values: Values, exit: Exit, distance_m: np.ndarray,
             progress: Progress = lambda done, note: None, among: known.Catalogue | None = None,
             balls: Balls | None = None, step_s: float = STEP_S) -> Crossing:
    """Fly launches [n] as they leave the wheels, after sensing and launch terms, by effective `values`.

    Rows fly in blocks of those that stay aloft about equally long, and in few different sizes, since each is compiled.
    """
    terms = known.flight_terms({"gravity", *values}, among)
    named = {term.name: values[term.name] for term in terms if term.name in values}
    exit, distance_m = Exit(*map(np.asarray, exit)), np.asarray(distance_m)
    order = np.argsort(exit.speed_m_s * np.sin(exit.elevation_rad), kind="stable")
    height_m, time_s = np.full(len(order), np.nan), np.full(len(order), np.nan)
    lanes = min(BLOCK, 1 << max(len(order) - 1, 15).bit_length())
    for first in range(0, len(order), lanes):
        rows = order[first:first + lanes]
        padded = np.resize(rows, lanes)
        mine = None if balls is None else (balls[0][padded], balls[1][padded])
        part = fly(rig, terms, take_values(named, padded), exit.take(padded), distance_m[padded], step_s, balls=mine)
        height_m[rows] = np.asarray(part.height_m)[:rows.size]
        time_s[rows] = np.asarray(part.time_s)[:rows.size]
        progress(min(first + lanes, len(order)) / len(order), f"{min(first + lanes, len(order))} shots")
    return Crossing(height_m, time_s, ~np.isnan(height_m))


def classify(rig: Rig, height_m: np.ndarray, opening: Opening | None = None) -> np.ndarray:
    """Return the outcome of a height at the plane (nan = not reached): the paper's Eq. 13 and 14, bounds included.

    opening: the target's; the rig's own when not given.
    """
    hole = opening_of(rig, {}) if opening is None else opening
    deviation_m = np.abs(np.asarray(height_m, dtype=float) - hole.centre_m)
    return np.where(deviation_m <= hole.three_half_m, THREE, np.where(deviation_m <= hole.two_half_m, TWO, MISS))


def launch_of(rig: Rig, shots: Shots) -> Exit:
    """Return how each shot left: from measured exit columns, else wheel speeds, else motor_ratio (numpy, one row per
    shot).

    A measured speed without a spin, measured or of wheels, means a ball without spin. InputError names shots that have
    too little of these, or no elevation.
    """
    leaving = _as_recorded(rig, shots)
    _need(shots, np.isnan(leaving.speed_m_s), "motor_ratio (with launcher.free_speed_rad_s in rig.toml), every "
          "wheel_<name>_rad_s, or exit_speed_m_s")
    _need(shots, np.isnan(leaving.elevation_rad), "hood_deg or exit_deg")
    return leaving


def _as_recorded(rig: Rig, shots: Shots) -> Exit:
    """The same with nan where it is not known."""
    rolled_m_s, rolled_rev_s = _from_wheels(rig, shots)
    elevation_deg = _prefer(shots.number("exit_deg"), shots.number("hood_deg"))
    return Exit(_prefer(shots.number("exit_speed_m_s"), rolled_m_s), np.radians(elevation_deg),
                _prefer(_prefer(shots.number("exit_spin_rev_s"), rolled_rev_s), np.zeros(len(shots))))


def launch_state(rig: Rig, shots: Shots) -> dict[str, np.ndarray]:
    """Return exit speed and backspin of the believed launch, nan where unknown; nothing if no speed is known."""
    leaving = _as_recorded(rig, shots)
    if np.isnan(leaving.speed_m_s).all():
        return {}
    return {name: np.round(np.asarray(column), DIGITS) + 0.0      # no -0.0
            for name, column in zip(LAUNCH_STATE, (leaving.speed_m_s, leaving.spin_rev_s), strict=True)}


def by_wheels(shots: Shots) -> np.ndarray:
    """Return which shots' speed launch_of takes from the wheels, since none was measured."""
    return np.isnan(shots.number("exit_speed_m_s"))


def has_wheels(rig: Rig, shots: Shots) -> np.ndarray:
    """Return which shots have a speed for every wheel, measured or from motor_ratio; none for a rig without wheels."""
    return np.asarray(np.isfinite(_from_wheels(rig, shots)[0]))


def by_robot(shots: Shots) -> Exit:
    """Return which parts of launch_of come from the robot's own sensors, not from measurements of the ball: booleans
    [n].

    The release height is always the rig's.
    """
    return Exit(by_wheels(shots), np.isnan(shots.number("exit_deg")), np.isnan(shots.number("exit_spin_rev_s")), True)


def require(shots: Shots, name: str) -> np.ndarray:
    """Return a numeric column without gaps; InputError names the shots that lack it."""
    column = shots.number(name)
    _need(shots, np.isnan(column), name)
    return column


def roll(rig: Rig, surface_m_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (speed in m/s, backspin in rev/s) [n] from the surface speeds of the wheels [n, wheels]; linear in
    them."""
    if is_opposed(rig):
        lower = [round(wheel.clock_deg % 360.0, 6) for wheel in rig.launcher.wheel].index(180.0)
        exit = exit_opposed(rig, surface_m_s[:, 1 - lower], surface_m_s[:, lower], 0.0)
        return exit.speed_m_s, exit.spin_rev_s
    speed_m_s, spin_rad_s = exit_no_slip(rig, surface_m_s)
    return speed_m_s, -spin_rad_s[:, 1] / (2.0 * np.pi)


def _from_wheels(rig: Rig, shots: Shots) -> tuple[np.ndarray, np.ndarray]:
    """Speed and backspin from the wheels; nan where a wheel's speed is not known."""
    wheels = rig.launcher.wheel
    if not wheels:
        return np.full(len(shots), np.nan), np.full(len(shots), np.nan)
    ratio, free_rad_s = shots.number("motor_ratio"), rig.launcher.free_speed_rad_s or np.nan
    turning = [_prefer(shots.number(f"wheel_{wheel.name}_rad_s"), ratio * wheel.gear * free_rad_s) for wheel in wheels]
    return roll(rig, np.stack([rad_s * wheel.radius_m for rad_s, wheel in zip(turning, wheels, strict=True)], axis=1))


def _prefer(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return np.where(np.isnan(first), second, first)


def _need(shots: Shots, lacking: np.ndarray, what: str) -> None:
    if len(lacking) and lacking.all():
        raise InputError(f"{shots.source}: {what} is needed, and no shot has it")
    if lacking.any():
        names = [shots.shot_id[row] for row in np.flatnonzero(lacking)]
        more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
        written, *_ = shots.written.get(what, (what,))
        raise InputError(f"{shots.source}: shots {', '.join(names[:NAMED])}{more}: {written} is needed and missing")


def exit_opposed(rig: Rig, upper_m_s: Any, lower_m_s: Any, hood_deg: Any) -> Exit:
    """Evaluate Eq. 11 and 12 for the surface speeds of the two wheels."""
    spin_rev_s = (lower_m_s - upper_m_s) / (2.0 * math.pi * rig.ball.radius_m)
    return Exit((upper_m_s + lower_m_s) / 2.0, hood_deg * (math.pi / 180.0), spin_rev_s)


def exit_no_slip(rig: Rig, wheel_surface_m_s: Any) -> tuple[Any, Any]:
    """Return exit speed and spin of a ball that rolls on all wheels without slip, by least squares.

    wheel_surface_m_s: [n, wheels] in the rig's order, positive drives the ball out. Returns speed [n] in m/s and spin
    [n, 3] in rad/s, right-handed about (exit direction, left, up across the exit direction); backspin is about -left.
    Solves v + R (w x n_i).e = u_i. Among solutions it takes the smallest v^2 + (R w)^2: spin along the exit
    direction is 0, and a lone wheel rolls the ball as if against a wall opposite to it.
    """
    surface_m_s = np.asarray(wheel_surface_m_s, dtype=float)
    clock_rad = np.radians([wheel.clock_deg for wheel in rig.launcher.wheel])
    # n_i = cos(clock) up - sin(clock) left, so (n_i x e) = cos(clock) left + sin(clock) up
    rows = np.stack([np.ones_like(clock_rad), np.cos(clock_rad), np.sin(clock_rad)], axis=1)
    solved = surface_m_s @ np.linalg.pinv(rows, rcond=1e-9).T
    return solved[:, 0], np.concatenate([np.zeros_like(solved[:, :1]), solved[:, 1:] / rig.ball.radius_m], axis=1)


def is_opposed(rig: Rig) -> bool:
    """Return whether the paper's Eq. 11 and 12 apply to this rig."""
    return sorted(round(wheel.clock_deg % 360.0, 6) for wheel in rig.launcher.wheel) == [0.0, 180.0]
