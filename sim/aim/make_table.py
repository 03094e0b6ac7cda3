"""The table of set points for a belief, its aim file, and the check of that file against the simulator.

Each row states the cost of errors, the band of speeds that score, and corrections for a moving robot. A ball thrown
from a moving robot has the robot's velocity in addition to the launcher's. In a vacuum, the ball would keep the robot's
velocity for the whole flight; drag removes part of it, by different amounts along and across the shot. The set point
for a target at distance D is therefore that of the distance d for which the carried ball reaches D (d + carry_s *
velocity = D), with a speed corrected for the resulting change of height (trim).
"""

import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import msgspec
import numpy as np
from jax import lax
from jaxtyping import Float
from matplotlib.figure import Figure
from scipy.interpolate import PchipInterpolator

from truearc.errors import InputError
from truearc.robot.aim_file import SCHEMA, AimContent, AimFile, Curve, Motion, Segment, contract_hash, rig_of
from truearc.robot.config.rig_spec import Rig
from truearc.robot.gate import UNSEALED, seal
from truearc.sim.aim.solve import LEAST_POINTS, SAFE_SHARE, Chances, Solved, chances_of, solve
from truearc.sim.data.dataset import Shots
from truearc.sim.infer.belief import Belief, before_the_shot
from truearc.sim.infer.forecast import Values, configured
from truearc.sim.infer.likelihood.data import Given, given_of
from truearc.sim.physics.catalogue import Catalogue, flight_terms
from truearc.sim.physics.facing_up import Plane, land
from truearc.sim.physics.flight import make_law, reach_plane, rk4, start_of
from truearc.sim.physics.simulate import opening_of
from truearc.sim.physics.term import BallState, Exit, Vec, plus
from truearc.sim.printed import Printed, Progress
from truearc.sim.report import new_panels

RPM = 60.0 / (2.0 * math.pi)          # of one rad/s
DISTANCE_M, HOOD_DEG, SPEED_RPM = 0.10, 1.0, 50.0       # errors whose cost is reported
BAND = np.linspace(-0.25, 0.25, 101)  # of the log of the motor's speed, in which the band is sought
ROWS_AT_ONCE = 64

Rows = Float[np.ndarray, " n"]


class AimRow(NamedTuple):
    """A set point.

    Fields:
        distance_m: For which it is.
        hood_deg: Launch elevation.
        motor_ratio: Motor speed over free speed.
        motor_rad_s: Motor speed.
        lead_deg: By how much to aim to the left of the target, against wind across.
        flight_s: From the exit to the target.
        p_two, p_three: Probability that the ball goes in, and that it goes through the inner part; of an upright
            target, of at least two points, and of three.
        points: Expected.
        arrival_deg: Angle below the horizontal at which the ball comes to the target; of one that faces up, below the
            plane of its rim.
        lost_10cm, lost_1deg, lost_50rpm: Points that such an error of distance, hood or motor speed costs, the mean of
            both directions.
        slowest_rad_s, fastest_rad_s: Motor speeds between which at least half of the points are left.
        note: What of it is outside the range of the shots that the belief was fitted to.
    """

    distance_m: float
    hood_deg: float
    motor_ratio: float
    motor_rad_s: float
    lead_deg: float
    flight_s: float
    arrival_deg: float
    p_two: float
    p_three: float
    points: float
    lost_10cm: float
    lost_1deg: float
    lost_50rpm: float
    slowest_rad_s: float
    fastest_rad_s: float
    note: str


def make_rows(rig: Rig, belief: Belief, distance_m: Rows, hood_deg: tuple[float, float],
              progress: Progress) -> tuple[tuple[AimRow, ...], tuple[tuple[float, str], ...]]:
    """Return set points for ascending distances [n] in m, and the distances without one with the reason; hood_deg:
    limits.

    InputError where no distance has a set point that scores.
    """
    solved = solve(rig, belief, distance_m, hood_deg, progress)
    scores = np.array([not reason for reason in solved.reason]) & (solved.chances.points >= LEAST_POINTS)
    refused = tuple((float(distance_m[row]), solved.reason[row] or "no set point near its neighbours' scores")
                    for row in np.flatnonzero(~scores))
    if not scores.any():
        raise InputError(f"distances_m: no distance has a set point that scores: {refused[0][1]}")
    return tuple(_rows(rig, belief, distance_m, solved, np.flatnonzero(scores))), refused


def _rows(rig: Rig, belief: Belief, distance_m: Rows, solved: Solved, kept: np.ndarray) -> Iterator[AimRow]:
    at = (distance_m[kept], solved.hood_deg[kept], solved.motor_ratio[kept])
    best = chances_of(rig, belief, *at)
    free_rad_s = rig.launcher.free_speed_rad_s or 0.0
    lost = [_lost(rig, belief, at, best, place, error) for place, error in enumerate(
        (DISTANCE_M, HOOD_DEG, SPEED_RPM / RPM / free_rad_s))]
    low, high = _band(rig, belief, at, best)
    come = flown(rig, belief, *at)
    lead = np.degrees(np.arctan2(-come.side_m, at[0])) + 0.0           # against the drift
    fitted = belief.provenance.get("range", {})
    for row in range(len(kept)):
        numbers = (*(float(column[row]) for column in at), float(at[2][row] * free_rad_s), float(lead[row]),
                   float(come.flown_s[row]), float(np.degrees(come.angle_rad[row])),
                   *(float(column[row]) for column in (best.p_two, best.p_three, best.points, *lost)),
                   float(low[row] * free_rad_s), float(high[row] * free_rad_s))
        settings = dict(zip(("distance_m", "hood_deg", "motor_ratio"), numbers, strict=False))
        yield AimRow._make([*numbers, beyond(settings, fitted if isinstance(fitted, Mapping) else {})])


def _lost(rig: Rig, belief: Belief, at: tuple[Rows, Rows, Rows], best: Chances, place: int, error: float) -> Rows:
    """Points that an error of one of the three costs, the mean of both directions; place: which of `at` is wrong."""
    off = []
    for sign in (-1.0, 1.0):
        moved = [column + sign * error if index == place else column for index, column in enumerate(at)]
        off.append(chances_of(rig, belief, *moved).points)
    return np.asarray(best.points - 0.5 * (off[0] + off[1]))


def _band(rig: Rig, belief: Belief, at: tuple[Rows, Rows, Rows], best: Chances) -> tuple[Rows, Rows]:
    """Lowest and highest ratio around each set point with at least SAFE_SHARE of its points."""
    low, high = at[2].copy(), at[2].copy()
    for first in range(0, len(low), ROWS_AT_ONCE):
        rows = slice(first, first + ROWS_AT_ONCE)
        ratio = np.minimum(at[2][rows, None] * np.exp(BAND), 1.0)
        distance_m, hood_deg = (np.repeat(column[rows], len(BAND)) for column in at[:2])
        points = chances_of(rig, belief, distance_m, hood_deg, ratio.ravel()).points.reshape(ratio.shape)
        good = points >= SAFE_SHARE * best.points[rows, None]
        middle = len(BAND) // 2
        below = np.argmin(np.c_[good[:, middle::-1], np.zeros(len(good), bool)], axis=1) - 1
        above = np.argmin(np.c_[good[:, middle:], np.zeros(len(good), bool)], axis=1) - 1
        row = np.arange(len(good))
        low[rows] = ratio[row, middle - np.maximum(below, 0)]
        high[rows] = ratio[row, middle + np.maximum(above, 0)]
    return low, high


def beyond(settings: Mapping[str, float], fitted: Mapping[str, list[float]]) -> str:
    """Return what of a set point is outside the range of the shots that a belief was fitted to; "" if nothing is."""
    return "; ".join(f"{name} beyond the fitted {fitted[name][0]:.3g} to {fitted[name][1]:.3g}"
                     for name, value in settings.items()
                     if name in fitted and not fitted[name][0] - 1e-9 <= value <= fitted[name][1] + 1e-9)


class Arrival(NamedTuple):
    """Where balls come to the target, arrays [n]; NaN: one does not.

    off_m: height or, of an opening that faces up, place along from its centre in the plane of its rim; side_m: to the
    left; flown_s: time of flight; angle_rad: below the horizontal, or that plane.
    """

    off_m: Any
    side_m: Any
    flown_s: Any
    angle_rad: Any


def flown(rig: Rig, belief: Belief, distance_m: Rows, hood_deg: Rows, motor_ratio: Rows) -> Arrival:
    """Return the arrivals of set points."""
    given = _given(rig, belief, distance_m, hood_deg, motor_ratio)
    return Arrival(*map(np.asarray, _flown(rig, belief.coefficients, given, belief.catalogue)))


@partial(jax.jit, static_argnames=("rig", "among"))
def _flown(rig: Rig, values: Values, given: Given, among: Catalogue) -> Arrival:
    at, exit, distance_m = configured(rig, values, given, among)
    return _arrive(rig, at, exit, distance_m, values, among, timed=True)


def _arrive(rig: Rig, at: Values, exit: Exit, distance_m: Any, values: Values, among: Catalogue,
            timed: bool = False) -> Arrival:
    terms = flight_terms({"gravity", *values}, among)
    if rig.target is not None and rig.target.faces_up:
        landing = land(rig, terms, at, exit, distance_m, opening_of(rig, values, among))
        return Arrival(landing.along_m, landing.across_m, landing.time_s, landing.angle_rad)
    plane = reach_plane(rig, make_law(rig, terms, at), exit, distance_m, timed=timed)
    return Arrival(*(jnp.where(plane.near, one, jnp.nan) for one in (
        plane.height_m, plane.side_m, plane.flown_s if timed else 0.0, -jnp.arctan(plane.climb))))


def draw_aim(rows: Sequence[Any], refused: Sequence[tuple[float, str]], up: bool = False) -> Figure:
    """Draw hood angle, motor speed with the band that keeps half of the points, and probabilities, over distance; up:
    at a target that faces up, with the angle of arrival."""
    figure, (hood, speed, chance) = new_panels(7.0, 7.0, 3, sharex=True)
    x = np.array([row.distance_m for row in rows])
    hood.plot(x, [row.hood_deg for row in rows], "o-", color="#1b5e9b", markersize=3)
    hood.set_ylabel("hood, deg")
    if up:
        hood.plot(x, [row.arrival_deg for row in rows], "--", color="#9cc4e4", label="arrives, below the rim's plane")
        hood.legend(frameon=False)
    speed.fill_between(x, [row.slowest_rad_s * RPM for row in rows], [row.fastest_rad_s * RPM for row in rows],
                       color="#9cc4e4", label="at least half of the points")
    speed.plot(x, [row.motor_rad_s * RPM for row in rows], "o-", color="#1b5e9b", markersize=3, label="set point")
    speed.set_ylabel("motor, rpm")
    speed.legend(frameon=False)
    threes = [row.p_three for row in rows]
    chance.plot(x, [row.p_two for row in rows], color="#d9822b",
                label="two or three points" if any(threes) and not up else "hit")
    if any(threes):
        chance.plot(x, threes, color="#2b8a3e", label="through the ring" if up else "three points")
    chance.set(ylim=(0.0, 1.02), ylabel="probability", xlabel="distance, m")
    chance.legend(frameon=False)
    for distance_m, _ in refused:
        for axes in (hood, speed, chance):
            axes.axvline(distance_m, color="#b02a37", linewidth=1, linestyle=":")
    return figure


PROBE_M_S = 1.5                       # velocities of the robot, to and fro, at which the corrections are exact
STEPS = 128                           # of a flight over time
SECANT = 6                            # steps to the speed that meets the height
FIRST_LOG = 0.02                      # of the first one
CLOSE_M = 1e-4                        # of the height, which it must meet


class OnTheMove(NamedTuple):
    """Motion corrections of set points, arrays [n]; NaN if the ball from a robot at PROBE_M_S does not reach the
    target.

    carry_s, sideways_s: how far the robot's velocity along, and across, carries the ball until the flight from rest
    would be over, m per m/s. trim_s_m, bend_s2_m2: log of the motor's speed by that velocity along, and by its square;
    sink_s2_m2: by the square of that across.
    """

    carry_s: Rows
    sideways_s: Rows
    trim_s_m: Rows
    bend_s2_m2: Rows
    sink_s2_m2: Rows


def on_the_move(rig: Rig, belief: Belief, distance_m: Rows, hood_deg: Rows, motor_ratio: Rows,
                flight_s: Rows) -> OnTheMove:
    """Fly each set point from a robot that moves at PROBE_M_S toward the target, away from it and across."""
    given = _given(rig, belief, distance_m, hood_deg, motor_ratio)
    among, values = belief.catalogue, belief.coefficients
    ahead, behind, left, rest = (np.asarray(_place(rig, values, given, flight_s, along, across, among))
                                 for along, across in ((PROBE_M_S, 0.0), (-PROBE_M_S, 0.0), (0.0, PROBE_M_S),
                                                       (0.0, 0.0)))
    carry_s = (ahead[0] - behind[0]) / (2.0 * PROBE_M_S)
    at_rest_m = np.asarray(_off(rig, values, given, distance_m, 0.0, among))

    def faster(log: Rows) -> Given:
        return _given(rig, belief, distance_m, hood_deg, motor_ratio * np.exp(np.clip(np.nan_to_num(log), -1.0, 1.0)))

    def along_m(log: Rows, along: float) -> Rows:
        return np.asarray(_off(rig, values, faster(log), distance_m + carry_s * along, along, among) - at_rest_m)

    def across_m(log: Rows) -> Rows:
        flown = np.asarray(_place(rig, values, faster(log), flight_s, 0.0, PROBE_M_S, among))
        return np.asarray(_at_target(flown, rig, distance_m)[1] - at_rest_m)

    to, fro, sink = (_root(off_m, np.zeros(len(distance_m))) for off_m in (
        partial(along_m, along=PROBE_M_S), partial(along_m, along=-PROBE_M_S), across_m))
    sideways_m = _at_target(left, rig, distance_m)[0] - _at_target(rest, rig, distance_m)[0]
    return OnTheMove(carry_s, sideways_m / PROBE_M_S, (to - fro) / (2.0 * PROBE_M_S), (to + fro) / (2.0 * PROBE_M_S**2),
                     sink / PROBE_M_S**2)


def _at_target(flown: Float[np.ndarray, "6 n"], rig: Rig, distance_m: Rows) -> tuple[Rows, Rows]:
    """(place to the left, Arrival.off_m) where a ball that is near the target's plane meets it."""
    x, y, z, vx, vy, vz = flown
    if rig.target is None or not rig.target.faces_up:
        left_s = (distance_m - x) / vx
        return y + vy * left_s, z + vz * left_s
    plane = Plane.of(rig.target, distance_m, rig.target.centre_height_m)
    off_x, off_z = x - plane.distance_m, z - plane.height_m
    left_s = np.asarray(-plane.above(off_x, off_z) / plane.above(vx, vz))
    return y + vy * left_s, np.asarray(plane.along(off_x + vx * left_s, off_z + vz * left_s))


def _given(rig: Rig, belief: Belief, distance_m: Rows, hood_deg: Rows, motor_ratio: Rows) -> Given:
    shots = Shots.of_settings(distance_m, hood_deg, motor_ratio)
    return given_of(rig, shots, before_the_shot(belief.curves, rig, shots))


def _root(off_m: Any, log: Rows) -> Rows:
    """Where heights meet, by the secant method."""
    before, new = log, log + FIRST_LOG
    off_before = off_m(before)
    for _ in range(SECANT):
        off = off_m(new)
        with np.errstate(divide="ignore", invalid="ignore"):
            step = np.where(off == off_before, 0.0, off * (new - before) / (off - off_before))
        before, off_before, new = new, off, new - step
    return np.asarray(np.where(np.abs(off_m(new)) < CLOSE_M, new, np.nan))


@partial(jax.jit, static_argnames=("rig", "among"))
def _off(rig: Rig, values: Values, given: Given, distance_m: Any, along: Any, among: Catalogue) -> Any:
    """Arrival.off_m [n] at a target, NaN: does not come there; the velocity along only changes the launch."""
    at, exit, _ = configured(rig, values, given, among)
    forward, upward = exit.speed_m_s * jnp.cos(exit.elevation_rad) + along, exit.speed_m_s * jnp.sin(exit.elevation_rad)
    moved = Exit(jnp.hypot(forward, upward), jnp.arctan2(upward, forward), exit.spin_rev_s, exit.above_m)
    return _arrive(rig, at, moved, distance_m, values, among).off_m


@partial(jax.jit, static_argnames=("rig", "among"))
def _place(rig: Rig, values: Values, given: Given, flight_s: Any, along: Any, across: Any, among: Catalogue) -> Any:
    """Place and velocity [6, n] after so long."""
    at, exit, _ = configured(rig, values, given, among)
    law = make_law(rig, flight_terms({"gravity", *values}, among), at)
    ball = start_of(rig, exit, jnp.shape(flight_s))
    zero = jnp.zeros_like(ball.position_m.x)
    place, speed, spin = (Vec(*(plus(part, zero) for part in vec)) for vec in ball[:3])
    start = BallState(place, Vec(speed.x + along, speed.y + across, speed.z), spin, zero)
    end = lax.scan(lambda ball, _: (rk4(law, ball, flight_s / STEPS), None), start, None, length=STEPS)[0]
    return jnp.stack([*end.position_m, *end.velocity_m_s])


FLOWN, SET = ("distance_m", "hood_deg", "motor_ratio", "flight_s"), ("hood_deg", "motor_ratio", "lead_deg")
CHECKED = 40                          # distances at which a file is checked
MOST_LOST = 0.05                      # points that a set point of the file may fall short of the best by
LEAST_LEAD_DEG = 0.05                 # what is less is left out
INCH_M = 0.0254


@dataclass(frozen=True, eq=False)
class AimCheck(Printed):
    """An aim file checked against the simulator, at distances [n] between its ends.

    points, best: expected points of the file's set points, and of those solved anew.
    """

    distance_m: Rows
    points: Rows
    best: Rows

    @property
    def lost(self) -> float:
        """Points by which the worst of the file's set points falls short."""
        return max(float(np.max(self.best - self.points)), 0.0)

    @property
    def passed(self) -> bool:
        return self.lost <= MOST_LOST

    def lines(self) -> list[str]:
        """Return how far the file's set points fall short of the best."""
        return [f"at {len(self.distance_m)} random distances at most {self.lost:.2f} points short of the best"]


def aim_bytes(rows: Sequence[AimRow], refused: Iterable[tuple[float, str]], rig: Rig, note: str,
              provenance: dict[str, Any], belief: Belief) -> bytes:
    """Return the sealed file; a distance without a set point splits it. InputError if no two neighbours remain."""
    gaps = [distance_m for distance_m, _ in refused]
    columns = [np.array([getattr(row, name) for row in rows]) for name in FLOWN]
    moving = np.column_stack(on_the_move(rig, belief, *columns))
    runs: list[list[int]] = [[0]]
    for number, (before, row) in enumerate(pairwise(rows), 1):
        if any(before.distance_m < gap < row.distance_m for gap in gaps):
            runs.append([])
        runs[-1].append(number)
    segments = tuple(_segment([rows[number] for number in run], moving[run]) for run in runs if len(run) > 1)
    if not segments:
        raise InputError("distances_m: no two neighbouring distances have a set point; an aim file needs them")
    content = AimContent(SCHEMA, UNSEALED, contract_hash(), note, rig_of(rig), segments, provenance)
    return seal(msgspec.json.format(msgspec.json.encode(content), indent=1) + b"\n")


def check_aim_file(aim: AimFile, belief: Belief, rig: Rig, seed: int = 0) -> AimCheck:
    """Solve for the best set points at random distances, within the file's hood angles, and compare."""
    segments = aim.content.segments
    spans = np.array([segment.distance_m[-1] - segment.distance_m[0] for segment in segments])
    rng = np.random.default_rng([seed, 41])
    chosen = rng.choice(len(segments), CHECKED, p=spans / spans.sum())
    distance_m = np.sort([segments[k].distance_m[0] + rng.uniform() * spans[k] for k in chosen])
    points = [point for point in map(aim.at, map(float, distance_m)) if point is not None]
    hood_deg, ratio = np.array([point.hood_deg for point in points]), np.array([point.motor_ratio for point in points])
    angles = [angle for segment in segments for angle in segment.hood_deg.value]
    best = solve(rig, belief, distance_m, (min(angles), max(angles))).chances
    return AimCheck(distance_m, chances_of(rig, belief, distance_m, hood_deg, ratio).points, best.points)


def _segment(rows: Sequence[AimRow], moving: Float[np.ndarray, "n 5"]) -> Segment:
    x = np.array([row.distance_m for row in rows])

    def curve(y: Rows) -> Curve:
        slope = PchipInterpolator(x, y).derivative()(x) if len(x) > 2 else np.full(2, (y[1] - y[0]) / (x[1] - x[0]))
        return Curve(tuple(map(float, y)), tuple(map(float, slope)))

    hood, ratio, lead = (curve(np.array([getattr(row, name) for row in rows])) for name in SET)
    known = np.flatnonzero(np.isfinite(moving).all(axis=1))
    if len(known) < 2 or np.ptp(known) != len(known) - 1:
        return Segment(tuple(map(float, x)), hood, ratio, lead)
    carry, sideways, trim, bend, sink = map(curve, moving[np.clip(np.arange(len(x)), known[0], known[-1])].T)
    return Segment(tuple(map(float, x)), hood, ratio, lead,
                   Motion(carry, sideways, trim, bend, sink, float(x[known[0]]), float(x[known[-1]])))


def has_lead(rows: Iterable[Any]) -> bool:
    """Return whether a set point is aimed beside the target."""
    return any(abs(row.lead_deg) >= LEAST_LEAD_DEG for row in rows)


def _lines(head: str, templates: Sequence[str], rows: Iterable[Any], notes: bool = True) -> str:
    """The head, and of each row the filled-in templates, below what its belief does not cover."""
    lines = [head]
    for row in rows:
        at = {"m": row.distance_m, "inch": row.distance_m / INCH_M, "hood": row.hood_deg, "zenith": 90.0 - row.hood_deg,
              "rpm": row.motor_rad_s * RPM, "rad_s": row.motor_rad_s, "rev_s": row.motor_rad_s / (2.0 * math.pi),
              "s": row.flight_s, "lead": row.lead_deg}
        lines += [f"// {row.distance_m:.3f} m: {row.note}"] if notes and row.note else []
        lines += [template.format(**at) for template in templates]
    return "\n".join(lines) + "\n"


def java_text(rows: Iterable[Any]) -> str:
    """Return statements for two edu.wpi.first.math.interpolation.InterpolatingDoubleTreeMap, keyed by distance in m."""
    lead = has_lead(rows := tuple(rows))
    return _lines("// by truearc aim: distance (m) -> hood (deg above the horizontal), motor (rpm)"
                  + ", lead (deg to the left)" * lead,
                  ("hoodDeg.put({m:.3f}, {hood:.2f});", "motorRpm.put({m:.3f}, {rpm:.1f});",
                   *["leadDeg.put({m:.3f}, {lead:.2f});"] * lead), rows)


def cpp_text(rows: Iterable[Any]) -> str:
    """Return an array that needs no library."""
    lead = has_lead(rows := tuple(rows))
    head = ("// by truearc aim: distance (m), hood (deg above the horizontal), motor (rpm)"
            + ", lead (deg to the left)" * lead + "\nstruct SetPoint { double distance_m, hood_deg, motor_rpm"
            + ", lead_deg" * lead + "; };\nconstexpr SetPoint kSetPoints[] = {")
    lines = _lines("", ("    {{{m:.3f}, {hood:.2f}, {rpm:.1f}" + ", {lead:.2f}" * lead + "}},",), rows)
    return head + lines.replace("\n//", "\n    //") + "};\n"


def json_3476_text(rows: Iterable[Any]) -> str:
    """Return a file like team 3476's shooterconfig.json of 2020: distance in inches, hood in degrees, motor in rpm."""
    configs = [{"distance": round(row.distance_m / INCH_M, 2), "hoodEjectAngle": round(row.hood_deg, 2),
                "flywheelSpeed": round(row.motor_rad_s * RPM, 1)} for row in rows]
    return json.dumps({"shooterConfigs": configs}, indent=2) + "\n"


# Shapes of teams' public code. 6328's ShotCalculator of 2026: hood from the vertical, in InterpolatingTreeMap and
# InterpolatingDoubleTreeMap of WPILib; 254's Constants of 2020; files as 2928's robot of 2026 and 3476's of 2020 load
# them.
TEAMS: dict[str, Callable[[Iterable[Any]], str]] = {
    "java-6328": partial(_lines, "// by truearc aim: distance (m) -> hood (deg from the vertical), motor (rad/s), time "
                         "of flight (s)", ("shotHoodAngleMap.put({m:.3f}, Rotation2d.fromDegrees({zenith:.2f}));",
                                        "shotFlywheelSpeedMap.put({m:.3f}, {rad_s:.2f});",
                                        "timeOfFlightMap.put({m:.3f}, {s:.3f});")),
    "java-254": partial(_lines, "// by truearc aim: distance (in) -> hood (deg above the horizontal), motor (rpm)", (
        "kLaserNewHoodMap.put(new InterpolatingDouble({inch:.2f}), new InterpolatingDouble({hood:.2f}));",
        "kLaserRPMMap.put(new InterpolatingDouble({inch:.2f}), new InterpolatingDouble({rpm:.1f}));")),
    "csv-2928": partial(_lines, "distance_m,hood_angle_deg,velocity_rps", ("{m:.3f},{hood:.2f},{rev_s:.3f}",),
                        notes=False),
    "json-3476": json_3476_text}
