"""How well believable physics explains a dataset: drag, lift, slip, hood, distances and trackers as priors have them.

What the data say of a flight are rows: a residual by the physics' parameters, with its standard deviation. Rows are
Student-t, so that a lucky shot does not decide. The search starts at several beliefs of drag and lift and improves the
two best by Gauss-Newton steps, so that data as recorded are judged at the best believable physics. Callers ignore
NumPy's warnings of numbers that overflow or are not known.
"""

import math
import tomllib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int
from numpy.polynomial import polynomial

from truearc.sim.data.dataset import Dataset, Floats, Tracks
from truearc.sim.data.table import SPIN_VECTOR
from truearc.sim.physics import catalogue
from truearc.sim.physics.simulate import by_wheels, launch_state
from truearc.sim.physics.term import to_scale

TERMS = ("drag", "magnus", "exit_efficiency", "wheel_slip", "hood_offset", "distance_scale", "distance_bias",
         "release_height", "track_scale", "track_tilt")
CD, CL, LOSS, SLIP, HOOD, FAR, BIAS, RISE, SCALE, TILT = range(len(TERMS))
# the priors of these terms, on their scales
PRIORS = [term.amplitude.prior for name in TERMS for term in catalogue.TERMS if term.name == name]
CENTRE = np.array([to_scale(prior.scale, prior.centre) for prior in PRIORS if prior])
SD = np.array([prior.sd for prior in PRIORS if prior])
FREEDOM = 4.0                         # of Student's t; chosen: one row far off costs as much as a few near ones
# Chosen: 1 to 3 % of speeds is usual; worse launchers cost as the prior below says
SCATTERS = np.array([0.012, 0.02, 0.035, 0.06, 0.1])
USUAL, SPREAD = math.log(0.03), 0.5   # of the logarithm of a launcher's scatter; chosen: 8 % at two deviations
LOST = 3.0                            # residual of a log speed of a shot that never arrives; chosen: a unit's is 1 to 6
UNSTATED_M = 0.6                      # of a release height; chosen: as robots have
LIFTING = 0.3                         # rim speed by speed of a ball whose spin is not known; chosen: as of two wheels
SLIPS = 0.6                           # most that wheels slip by their speed, of the log; chosen: a half is left
FINE, ROUGH = (8, 3), (4, 2)          # steps of a flight, and of the search for its speed; chosen: 1 and 3 % in speed
SHOTS = 50                            # most that are judged; chosen: enough for units, and quick
FULL = 25.0                           # shots that count fully: more err alike; chosen: drag laws differ by per cents
ORDINARY = 1.5                        # nats that a row may cost: more is a surprise; derived: 1.6 standard deviations
BALLS = 0.3                           # by which drags of other balls differ; source: Achenbach 1972, smooth to rough
UNLINKED = 3.0                        # times as far do tracks of other shots agree with a shot; chosen: as hoods differ
MIXED = 3.0                           # nats that another unit in one row costs; derived: one row in twenty, ln 20
SCORES = 6                            # fewest shots that are judged; chosen: twice the numbers that they may fix
# Chosen: quartiles of the priors and beyond, by which each start is near enough for Gauss-Newton
STARTS = np.array([[cd, cl] + [0.0] * (len(TERMS) - 2) for cd in (-0.8, 1.2) for cl in (-0.7, 0.5, 1.5)])
STEP, BOUND = 0.2, 4.0                # of derivatives, and bound of parameters, in standard deviations
SAMPLES = 8                           # fewest of a track that is judged; chosen: twice the numbers of a cubic
TRACKS = 3                            # fewest tracks that are judged; chosen: one slip does not decide a median
MOST = 30                             # tracks that are measured; chosen: enough for units and axes, and quick
# Chosen: drag on a light ball doubles a change of speed; a hand, a floor or a wall makes it many times as large
KICK = 3.2                            # times its usual change of velocity in the same time
JOLT = 0.2                            # and this share of its usual speed; chosen: a soft touch is left to the fit
# Measured on 16 foreign seasons (benchmarks.seasons, 20000 to 20015): noise makes 8 of 4800 tracks look so, at most
# two of 300 one way; so many are warned of, more are refused
JOLTED = 0.01                         # share of the tracks
WINDOW = 1.0 / 12.0                   # share of a track on either side, for velocities; chosen: five samples
NOISES = 8.0                          # and so many standard deviations of noise; derived: chance once in 10^15
DIFFERENCES = 20.0                    # variance of a third difference, by that of a sample; derived: 1 + 9 + 9 + 1
MEDIAN = 0.6745                       # of the size of a normal deviate; derived: normal quantile 0.75
BY_TIME = np.array([[1.0], [1.0], [1.0], [2.0], [0.0], [0.0], [1.0]])     # powers of time of a motion's vectors
TABLE = tomllib.loads(Path(__file__).with_name("slips.toml").read_text(encoding="utf-8"))
UNITS: dict[str, dict[str, tuple[str, float]]] = TABLE["units"]
QUANTITIES: dict[str, dict[str, Any]] = TABLE["quantities"]


class Motion(NamedTuple):
    """Measured tracks [k]: row in Shots; vectors: velocities at three moments, mean acceleration, first and last place,
    velocity at the start; standard error of the acceleration. unlinked: the tracks may be those of other shots."""

    shot: Int[np.ndarray, " k"]
    vectors: Float[np.ndarray, "k 7 3"]
    error_m_s2: Floats
    unlinked: bool = False

    def read(self, matrix: Floats, seconds: float = 1.0, by_m: Floats | float = 0.0) -> "Motion":
        """The same with positions times a matrix [3, 3], plus `by_m`, and times multiplied by `seconds`."""
        vectors = self.vectors @ matrix.T / seconds**BY_TIME
        vectors[:, 4:6] += by_m
        return self._replace(vectors=vectors, error_m_s2=(
            self.error_m_s2 * float(np.linalg.norm(matrix, axis=1).max()) / seconds**2))


class Reading(NamedTuple):
    """A dataset under one interpretation of its numbers."""

    dataset: Dataset
    motion: Motion | None


# residuals with standard deviations by parameters, their scatter, row in Shots, how many count fully
Part = tuple[Callable[[Floats], tuple[Floats, Floats]], Floats, Int[np.ndarray, " n"], float]


class Rows(NamedTuple):
    """Residuals of lanes of parameters [l, p] with standard deviations, both [l, n]; nan: a scatter with `wide` [n].

    whose: row in Shots; weight: how much of a row counts; unusual: nats by which sizes are so.
    """

    residuals: Callable[[Floats], tuple[Floats, Floats]]
    wide: Floats
    whose: Int[np.ndarray, " n"]
    weight: Floats
    unusual: float


class Fit(NamedTuple):
    """Score [nats]; by how much it is lower than usual, and than at best; parameters [p]; residuals [n] in standard
    deviations; shots that are read otherwise."""

    score: float
    surprise: float
    lower: float
    values: Floats
    rest: Floats
    otherwise: Int[np.ndarray, " k"]


def needed_speed(distance_m: Any, rise_m: Any, hood_deg: Any, gravity_m_s2: float, drag_m: Any = 0.0,
                 lift_s: Any = 0.0, steps: tuple[int, int] = FINE) -> Floats:
    """Return the speed [m/s] that carries a ball through a point; inf where that angle never does.

    drag_m: deceleration by speed squared [1/m]; lift_s: acceleration across the flight by speed [1/s], of a spin that
    stays. Along x, with slope p = tan of the elevation and speed u: u' = -q (drag u + lift p / q), and
    p' = (lift q^2 - g / u) / u, q^2 = 1 + p^2, in steps of the midpoint; g / u0^2 by fixed point, as the fall of a
    flight is nearly in proportion to it.
    """
    with np.errstate(all="ignore"):
        slope = np.where(np.abs(hood_deg) < 89.5, np.tan(np.radians(hood_deg)), np.nan)
        step = distance_m / steps[0]
        # g / u0^2, first as if the slope stayed: a fall then is (e^a - 1 - a) x^2 / a^2
        a = np.clip(2.0 * drag_m * np.sqrt(1.0 + slope**2) * distance_m, 1e-3, 30.0)
        weight = np.maximum(distance_m * slope - rise_m, 1e-3) / distance_m**2 * a * a / (np.expm1(a) - a)

        def rates(state: Floats, weight: Floats, lift: Any) -> Floats:
            p = slope + state[1] - state[0]
            square, slow = 1.0 + p * p, np.exp(-state[2])
            lifts = lift * slow
            return np.array([weight * slow * slow, lifts * square, -np.sqrt(square) * drag_m - lifts * p])

        for _ in range(steps[1]):
            lift = lift_s * np.sqrt(weight / gravity_m_s2)
            state = heights = np.zeros((3, *weight.shape))        # bent down, bent up, log speed; fallen, lifted
            for _ in range(steps[0]):
                middle = state + 0.5 * step * rates(state, weight, lift)
                state, heights = state + step * rates(middle, weight, lift), heights + step * middle
            change = (distance_m * slope + heights[1] - rise_m) / heights[0]
            weight = weight * np.clip(change, 0.1, 10.0)
        sound = (np.abs(np.log(change)) < 0.1) & (distance_m > 0.0)
        return np.where(sound, np.sqrt(gravity_m_s2 * (1.0 + slope**2) / weight), np.inf)


def flown_shots(dataset: Dataset) -> Int[np.ndarray, " n"]:
    """Return the rows of shots with a distance, an angle and a speed."""
    distance_m, (speed_m_s, _) = dataset.shots.number("distance_m"), launched(dataset)
    return np.flatnonzero(np.isfinite(distance_m + elevation_deg(dataset) + speed_m_s))


def judged_shots(dataset: Dataset) -> Int[np.ndarray, " n"]:
    """Return the rows of those that are known to have reached the target; none of few."""
    shots, target = dataset.shots, dataset.rig.target
    heights = shots.number("miss_height_m")
    scored = np.isin(shots.text("outcome"), ("two", "three"))
    if target is not None and len(set(heights[np.isfinite(heights)].tolist())) > 1:       # no table of aims
        scored |= np.abs(heights) <= target.two_half_height_m
    rows = np.intersect1d(np.flatnonzero(scored), flown_shots(dataset))
    count = min(SHOTS, len(rows)) if target and len(rows) >= SCORES else 0
    return np.asarray(rows[np.linspace(0, len(rows) - 1, count).astype(int)])


def elevation_deg(dataset: Dataset) -> Floats:
    """Return each shot's elevation: the measured one, else the hood's."""
    seen = dataset.shots.number("exit_deg")
    return np.asarray(np.where(np.isfinite(seen), seen, dataset.shots.number("hood_deg")))


def rows_of(reading: Reading, judged: Int[np.ndarray, " n"], rough: bool = False) -> Rows:
    """Rows of a dataset; as many, in the same order, for every reading of it. rough: for a first look."""
    parts: list[Part] = [(lambda theta: (np.zeros((len(theta), 0)),) * 2, np.zeros(0), judged[:0], 1.0)]
    parts += [_of_shots(reading.dataset, judged, ROUGH if rough else FINE)] if len(judged) else []
    parts += [_of_tracks(reading.dataset, reading.motion)] if reading.motion is not None else []
    functions, wides, whose, counts = zip(*parts, strict=True)
    weights = [np.full(len(rows), min(1.0, FULL / count)) for rows, count in zip(whose, counts, strict=True)]

    def residuals(theta: Floats) -> tuple[Floats, Floats]:
        off, sd = (np.concatenate(both, axis=1) for both in zip(*(of(theta) for of in functions), strict=True))
        return np.where(np.isfinite(off), off, LOST), sd
    return Rows(residuals, np.concatenate(wides), np.concatenate(whose), np.concatenate(weights),
                unusual(reading.dataset))


def _leaving(dataset: Dataset, rows: Any, seen_m_s: Any = None) -> tuple[Floats, Any, Floats, Floats]:
    """Speed by the launcher, whether it was measured, drag [1/m] and lift [1/s] for coefficients of 1; of a spin that
    is not known, of a usual one. seen_m_s: by tracks."""
    shots, (speed, spin) = dataset.shots, (column[rows] for column in launched(dataset))
    radius_m, mass_kg = (np.where(np.isfinite(own := shots.number(name)), own, getattr(dataset.rig.ball, name))[rows]
                         for name in ("radius_m", "mass_kg"))
    drag = np.pi * radius_m**2 * dataset.rig.air.density_kg_m3 / mass_kg
    usual = LIFTING / 2.0 / np.pi / radius_m * (speed if seen_m_s is None else seen_m_s)
    # wheels give a ball a little more spin than they tell
    measured = np.isfinite(shots.number("exit_spin_rev_s")[rows])
    turned = np.where(measured | (np.abs(spin) > 0.5 * usual), spin, 0.5 * usual)
    return speed, ~by_wheels(shots)[rows], np.minimum(0.5 * drag, 10.0), np.clip(
        16.0 / 3.0 * np.pi * radius_m * drag * turned, -100.0, 100.0)


def launched(dataset: Dataset) -> tuple[Floats, Floats]:
    """Speed and spin by the launcher; nan where they are not known."""
    state, nothing = launch_state(dataset.rig, dataset.shots), np.full(len(dataset.shots), np.nan)
    return state.get("exit_speed_m_s", nothing), state.get("exit_spin_rev_s", dataset.shots.number("exit_spin_rev_s"))


def _left(theta: Floats, speed: Floats, measured: Any) -> Floats:
    """Log of the speed with which balls leave, by lanes."""
    lost = SD[LOSS] * theta[:, [LOSS]] - CENTRE[LOSS] - np.clip(SD[SLIP] * theta[:, [SLIP]] * speed, -SLIPS, SLIPS)
    return np.log(np.maximum(speed, 1e-9)) + np.where(measured, 0.03 * theta[:, [LOSS]], lost)


def _of_shots(dataset: Dataset, judged: Int[np.ndarray, " n"], fine: tuple[int, int]) -> Part:
    """Log of the speed with which balls left by the one that takes them to where they passed the target."""
    rig, shots, target = dataset.rig, dataset.shots, dataset.rig.target
    assert target is not None
    half = np.where(np.array(shots.text("outcome"))[judged] == "three", target.three_half_height_m,
                    target.two_half_height_m)
    stated = rig.launcher.release_height_m
    low, rise = SD[RISE] if stated else 0.3, target.centre_height_m - (stated or UNSTATED_M)
    distance, angle = shots.number("distance_m")[judged], elevation_deg(dataset)[judged]
    speed, measured, drag, lift = _leaving(dataset, judged)

    def need(theta: Floats, higher_m: Any = 0.0, farther_m: Any = 0.0) -> Floats:
        lane = (CENTRE + SD * theta)[:, :, None]
        return np.log(needed_speed(distance * (1.0 + lane[:, FAR]) + lane[:, BIAS] + farther_m,
                                   rise + higher_m + theta[:, [RISE]] * low, angle + lane[:, HOOD],
                                   rig.world.gravity_m_s2, np.exp(lane[:, CD]) * drag, lane[:, CL] * lift, fine))

    def residuals(theta: Floats) -> tuple[Floats, Floats]:
        off = np.clip(_left(theta, speed, measured) - need(theta), -LOST, LOST)
        return off, np.full(off.shape, np.nan)
    off_m = np.array([[0.2], [-0.2]]) * half          # chosen: balls are aimed at the middle of the opening
    up, down = need(np.zeros((2, len(TERMS))), **{"farther_m" if target.faces_up else "higher_m": off_m})
    wide = np.clip(np.nan_to_num(np.abs(up - down), nan=0.02, posinf=0.02), 1e-4, 0.2)
    return residuals, wide, judged, float(len(judged))


def _of_tracks(dataset: Dataset, motion: Motion) -> Part:
    """Accelerations, where flights begin and go, and how they agree with angle, speed and distance of their shots."""
    rig, shots, g, own = dataset.rig, dataset.shots, dataset.rig.world.gravity_m_s2, motion.shot
    velocity, (accelerated, place, end, first) = motion.vectors[:, :3], motion.vectors[:, 3:].swapaxes(0, 1)
    total = np.linalg.norm(first, axis=1)
    speed, measured, drag, lift = _leaving(dataset, own, total)
    size = np.linalg.norm(velocity, axis=2, keepdims=True)
    up = np.cross(velocity, np.cross([0.0, 0.0, 1.0], velocity))
    up = up / np.maximum(np.linalg.norm(up, axis=2, keepdims=True), 1e-12) * size
    slow, raised = -drag[:, None] * (size * velocity).mean(axis=1), lift[:, None] * up.mean(axis=1)
    back = np.where(first[:, 0] > 0.1 * total, place[:, 0] / first[:, 0], np.nan)
    far, way = np.abs(place[:, 0]), end - place
    stated = rig.launcher.release_height_m
    fallen = 0.07 * g * np.nan_to_num(back)**2          # chosen: drag takes so much of a fall
    begins = place[:, 2] - first[:, 2] * back - 0.5 * g * back**2 - stated
    along, aside = np.hypot(way[:, 0], way[:, 1]), np.degrees(np.arctan2(way[:, 1], way[:, 0]))
    begun = np.clip(np.nan_to_num(back), 0.0, 2.0)
    rises = np.degrees(np.arctan2(first[:, 2] + g * begun, np.hypot(first[:, 0], first[:, 1])))
    longer = np.log(along / shots.number("distance_m")[own])
    faster = np.log(np.linalg.norm(first + np.outer(begun, [0.0, 0.0, g]), axis=1))
    unsure = np.hypot(motion.error_m_s2, 0.07 * np.linalg.norm(accelerated, axis=1) + 1e-12)
    if np.isfinite(shots.number("mass_kg")).any():           # each ball has drag of its own
        unsure = np.hypot(unsure, BALLS * np.linalg.norm(slow, axis=1))
    upright = np.median(along) < 0.2 * np.median(np.abs(way[:, 2]))      # chosen: dropped, or nearly so
    # where it is not stated, and of balls that are dropped, tracks tell alone where they begin
    low, begins = (SD[RISE], begins) if (stated or rig.target) and not upright else (0.0, 0.0 * far)
    widths = np.array([*[unsure] * 3, 0.06 + 0.06 * far + fallen,
                       0.15 + 0.1 * far + 0.1 * np.abs(place[:, 2]), 0.15 + 0.2 * np.abs(place[:, 2]),
                       (180.0 if upright else 8.0) + np.degrees(0.05 / np.maximum(along, 1e-9)),
                       1.5 + far, 0.05 + 0.05 * far, np.ones(len(own))])
    too_long = np.where(np.isfinite(longer), np.where(longer > 0.0, longer / 0.2, longer / 1.5), 0.0)
    elevation, unlinked = elevation_deg(dataset)[own], [1.0] * 7 + [UNLINKED if motion.unlinked else 1.0] * 3

    def residuals(theta: Floats) -> tuple[Floats, Floats]:
        lane = (CENTRE + SD * theta)[:, :, None, None]
        pull = np.exp(lane[:, CD]) * slow + lane[:, CL] * raised - np.array([0.0, 0.0, g])
        tilt = math.radians(2.5) * theta[:, TILT, None]
        pull = np.stack([pull[..., 0] - tilt * pull[..., 2], pull[..., 1], pull[..., 2] + tilt * pull[..., 0]])
        bend = accelerated.T[:, None, :] - pull * (1.0 + 0.11 * theta[:, SCALE, None])
        angle = elevation + SD[HOOD] * theta[:, [HOOD]] + 2.5 * theta[:, [TILT]] - rises
        quick = _left(theta, speed, measured) + 0.06 * theta[:, [SCALE]] - faster
        off = np.stack(np.broadcast_arrays(
            *bend, begins + 0.044 * theta[:, [TILT]] * far + low * theta[:, [RISE]], place[:, 1] - first[:, 1] * back,
            np.minimum(place[:, 0], 0.0), aside, np.where(np.isfinite(elevation), angle, 0.0),
            np.where(speed > 0.0, quick, 0.0), too_long), axis=1)
        off = np.where(np.isfinite(off), off, 0.0 if upright else LOST * widths) / widths
        return off.reshape(len(theta), -1), np.tile(np.repeat(unlinked, len(own)), (len(theta), 1))
    return residuals, np.zeros(10 * len(own)), np.tile(own, 10), 2.0 * len(own)


class Judged(NamedTuple):
    """Score of each lane [l]; residuals, curvatures, which reading, residuals in standard deviations, all [l, n]; nats
    by which the scatter is unusual [l]."""

    score: Floats
    off: Floats
    curve: Floats
    which: Int[np.ndarray, "l n"]
    rest: Floats
    spread: Floats


def _judge(readings: Sequence[Rows], theta: Floats) -> Judged:
    whose = readings[0].whose
    shots, place = np.unique(whose, return_inverse=True)
    onto = (place[:, None] == np.arange(len(shots))).astype(float)
    offs, sd = (np.stack(columns) for columns in zip(*(rows.residuals(theta) for rows in readings), strict=True))
    wide, unknown = np.stack([rows.wide for rows in readings]), np.isnan(sd)[:, None]
    width = np.where(unknown, np.hypot(SCATTERS[:, None, None], wide[:, None, None]), sd[:, None])
    cost = nats_of(offs[:, None] / width) + np.log(width / np.where(unknown, SCATTERS[0], 1.0))
    each = (readings[0].weight * cost) @ onto            # [readings, scatters, lanes, shots]
    each[1:] += MIXED * np.minimum(1.0, FULL / max(len(shots), 1))
    which = each.argmin(axis=0)
    spread = unknown.any() * 0.5 * (np.maximum(np.log(SCATTERS) - USUAL, 0.0) / SPREAD)**2
    cost = each.min(axis=0).sum(axis=-1) + spread[:, None]
    best, lane = cost.argmin(axis=0), np.arange(len(theta))
    picked = which[best, lane][:, place]
    off, width = (np.take_along_axis(one, picked[None], 0)[0] for one in (offs, width[:, best, lane]))
    curve = readings[0].weight * (FREEDOM + 1.0) / (FREEDOM + (off / width)**2) / width**2
    score = -cost[best, lane] - 0.5 * (theta**2).sum(axis=1) - readings[0].unusual
    return Judged(score, off, curve, picked, off / width, spread[best])


def nats_of(off: Floats) -> Floats:
    """Return what residuals cost, in standard deviations."""
    return np.asarray(0.5 * (FREEDOM + 1.0) * np.log1p(off**2 / FREEDOM))


def explain(readings: Sequence[Rows], near: Sequence[Floats] = (), turns: int = 4, lanes: int = 2) -> Fit:
    """The best believable physics; each shot is read as the likelier of `readings`. near: more starts."""
    scattered = readings[0].wide > 0.0          # speeds of shots
    starts = np.vstack([*near, STARTS])
    if scattered.any():               # whatever the wheels lose: the middle shot goes as it should
        off = np.median(_judge(readings, starts).off[:, scattered], axis=1)
        starts[:, LOSS] -= np.clip(off / SD[LOSS], -3.0, 3.0)
    best = starts[np.argsort(-_judge(readings, starts).score)[:lanes]]
    moves, shares = STEP * np.eye(len(TERMS) + 1, len(TERMS), -1), np.array([0.0, 1.0, 0.4, 0.1])
    for _ in range(turns if len(readings[0].whose) else 0):
        moved = best[:, None] - np.where(best > 0.0, 1.0, -1.0)[:, None, :] * moves
        judged = _judge(readings, moved.reshape(-1, len(TERMS)))
        off = judged.off.reshape(*moved.shape[:2], -1)
        change = off[:, 1:] - off[:, :1]
        slope = np.where(np.abs(change) < 1.0 + np.abs(off[:, :1]), change, 0.0) / (
            (moved[:, 1:] - moved[:, :1]).sum(axis=2)[:, :, None])
        weighted = slope * judged.curve.reshape(off.shape)[:, :1]
        step = -np.linalg.solve(weighted @ slope.transpose(0, 2, 1) + np.eye(len(TERMS)),
                                (weighted @ off[:, 0, :, None]) + best[:, :, None])[:, :, 0]
        tried = np.clip(best[:, None] + shares[:, None] * np.clip(step, -2.0, 2.0)[:, None], -BOUND, BOUND)
        score = _judge(readings, tried.reshape(-1, len(TERMS))).score.reshape(len(best), -1)
        best = tried[np.arange(len(best)), score.argmax(axis=1)]
    last = _judge(readings, best)
    at = int(last.score.argmax())
    each = nats_of(last.rest[at])
    common = last.spread[at] + 0.5 * best[at] @ best[at] + readings[0].unusual
    return Fit(float(last.score[at]), float(np.maximum(each - ORDINARY, 0.0) @ readings[0].weight + common),
               float(each @ readings[0].weight + common), best[at], last.rest[at],
               np.unique(readings[0].whose[last.which[at] > 0]))


def speeds_off(reading: Reading, rows: Int[np.ndarray, " n"], known: Fit) -> Floats:
    """Return by how much shots [n] were too fast for where they were aimed at, in logs, at most 1."""
    flown, *_ = _of_shots(reading.dataset, rows, FINE)
    return np.asarray(np.clip(np.nan_to_num(flown(known.values[None])[0][0], nan=-LOST), -1.0, 1.0))


def lifts_less(rows: Rows, known: Fit) -> float:
    """By how many nats negative lift explains the rows better than none; 0 where lift is not negative."""
    none = np.where(np.arange(len(TERMS)) == CL, -CENTRE / SD, known.values)
    return float(known.score - _judge([rows], none[None]).score[0]) if known.values[CL] < none[CL] else 0.0


# --- what tracks show by themselves


def measure_motion(tracks: Tracks, without: frozenset[int] = frozenset()) -> Motion | None:
    """Fit each track but those of shots `without` by a polynomial; None where there are too few."""
    measured = []
    for shot, t_s, places in (one for one in _sampled(tracks) if one[0] not in without):
        half_s, scaled = np.ptp(t_s) / 2.0, 2.0 * (t_s - t_s[0]) / np.ptp(t_s) - 1.0
        degree = 4 if len(t_s) >= 2 * SAMPLES else 3
        fit, basis = polynomial.polyfit(scaled, places, degree), polynomial.polyvander(scaled, degree)
        noise_m = np.sqrt(((places - basis @ fit)**2).sum() / (3.0 * max(len(scaled) - degree - 1, 1)))
        slope, middle = polynomial.polyder(fit) / half_s, np.array([-0.5, 0.0, 0.5])
        measured.append((shot, np.concatenate([
            polynomial.polyval(middle, slope).T,
            [polynomial.polyval(middle, polynomial.polyder(slope)).mean(axis=1) / half_s],
            polynomial.polyval(np.array([-1.0, 1.0]), fit).T, [polynomial.polyval(-1.0, slope)]]),
            2.0 * noise_m * np.sqrt(np.linalg.pinv(basis.T @ basis)[2, 2]) / half_s**2))
    if len(measured) < TRACKS:
        return None
    kept = np.linspace(0, len(measured) - 1, min(MOST, len(measured))).astype(int)
    return Motion(*(np.array(column)[kept] for column in zip(*measured, strict=True)))


def _sampled(tracks: Tracks) -> Iterator[tuple[int, Floats, Float[np.ndarray, "n 3"]]]:
    """Shot, times and places of each track with enough samples."""
    points = np.column_stack([tracks.x_m, tracks.y_m, tracks.z_m])
    sound = np.asarray(np.isfinite(points).all(axis=1))
    for shot, rows in tracks.by_shot():
        here = rows[sound[rows]]
        if len(here) >= SAMPLES and (np.diff(tracks.t_s[here]) > 0.0).all():
            yield shot, tracks.t_s[here], points[here]


def jolts(tracks: Tracks) -> Iterator[tuple[int, float, bool]]:
    """Shot, time and whether it is at the start, where a velocity changes at once, as no force of the air does it."""
    for shot, t_s, seen in _sampled(tracks):
        places, t_s = np.median([seen[:-2], seen[1:-1], seen[2:]], axis=0), t_s[1:-1]   # one stray sample is no jolt
        span = max(round(WINDOW * len(t_s)), 2)
        slope = (places[span:] - places[:-span]) / (t_s[span:] - t_s[:-span])[:, None]
        change = np.linalg.norm(slope[span:] - slope[:-span], axis=1)
        noise_m = np.median(np.abs(np.diff(places, 3, axis=0))) / MEDIAN / np.sqrt(DIFFERENCES)
        at = int(change.argmax())
        if change[at] > max(KICK * np.median(change), JOLT * np.median(np.linalg.norm(slope, axis=1)),
                            NOISES * noise_m * 2.0 / np.median(t_s[span:] - t_s[:-span])):
            early = at + span < len(t_s) / 3
            yield shot, float(t_s[at + (2 if early else 1) * span]), early


# --- sizes


def unusual(dataset: Dataset) -> float:
    """Return how unusual the sizes of all quantities are, in nats; a column's size is its median."""
    rig, shots, (speed, _) = dataset.rig, dataset.shots, launched(dataset)
    motor = shots.number("motor_ratio") * (rig.launcher.free_speed_rad_s or math.nan)
    around = 2.0 * math.pi * rig.ball.radius_m / np.where(speed > 0.0, speed, np.nan)
    found: dict[str, Any] = {
        "density": rig.ball.density_kg_m3, "speed": speed, "rim": around * shots.number("exit_spin_rev_s"),
        "rim of all": around * np.sqrt(sum(shots.number(name)**2 for name in SPIN_VECTOR)),
        **{f"motor of {wheel.name}": shots.number(f"wheel_{wheel.name}_rad_s") / (motor * wheel.gear)
           for wheel in rig.launcher.wheel}, "allowed": _by_allowed(dataset)}
    # without a target, balls may be dropped from a tower
    found |= {key: value_of(dataset, key) if "." in key else shots.number(key) for key in QUANTITIES
              if key not in found and (rig.target or key != "launcher.release_height_m")}
    nats = 0.0
    for key, value in found.items():
        about = QUANTITIES[key.partition(" of")[0]]
        size = float(np.nanmedian(np.abs(value))) if "usual" in about and np.isfinite(value).any() else 0.0
        if size > 0.0:
            off = math.log(min(max(size, 1e-12), 1e12) / about["usual"])
            nats += min(0.5 * (off / about["below" if off < 0.0 else "above"])**2, 100.0)
    return nats


def _by_allowed(dataset: Dataset) -> float:
    """Return the size of heights by what their outcomes allow, or by how far they are aside of the target's middle."""
    target, height = dataset.rig.target, dataset.shots.number("miss_height_m")
    if target is None or np.isfinite(height).sum() < 3:
        return math.nan
    half = {"two": target.two_half_height_m, "three": target.three_half_height_m}
    allowed = np.array([half.get(word, 0.5) + 0.03 for word in dataset.shots.text("outcome")])
    most = float(np.sqrt(np.nanmean((height / allowed)**2)))
    spread = float(np.nanstd(height) / np.median(allowed))
    aside = abs(float(np.nanmedian(height))) / float(np.nanstd(height)) / 3.0 if spread > 1e-9 * most else 0.0
    return most if aside == 0.0 else max(most, 1.0) * max(aside, 1.0) if max(most, aside) > 1.0 else spread


def value_of(dataset: Dataset, key: str) -> float:
    """Return a number of the rig by its dotted key, for wheels the first one's; nan if it is not stated."""
    value: Any = dataset.rig
    for name in key.split("."):
        value = getattr(value, name, None)
        value = value[0] if isinstance(value, tuple) and value else value or None
    return math.nan if value is None else float(value)
