"""The likelihood linearised about a point: slopes and curvatures in all columns, each shot's unknowns integrated out.

A shot deviates from its configuration by d ~ N(0, S). Near the point, measurements by the tracker and by instruments at
the exit are linear in d and in the columns, so d is integrated out exactly, and given them the height at the plane is
normal. Only the likelihood of the outcome is not Gaussian, and it depends on a single number.

Tracks and exit measurements are whitened and multiplied out once per flight: near the point the model is linear, so
their likelihood elsewhere follows from these products without the samples.
"""

from dataclasses import dataclass, replace

import jax
import numpy as np
from jaxtyping import Float, Int

from truearc.sim.infer.likelihood.data import Intake
from truearc.sim.infer.likelihood.forward_model import DEVIATES, Prediction, see_in_blocks
from truearc.sim.infer.likelihood.layout import Layout, Point
from truearc.sim.infer.likelihood.noise import FLOOR_M, UNMEASURED_M
from truearc.sim.infer.likelihood.observations import log_volume, timed_noise, whiten
from truearc.sim.infer.likelihood.score_table import Array, GroupedColumns, PlaneScores, ScoreTable, make_evidence
from truearc.sim.physics.catalogue import CURVE

LEAD = DEVIATES.index("lead_s")


@dataclass(frozen=True)
class Normal:
    """Normal equations of n shots in k numbers, the chain's inputs and then the D deviates.

    With white slopes W [G, k] and white residuals r [G] of a shot as seen from no deviation: inner [n, k, k] = W'W,
    onto [n, k] = W'r, square [n] = r'r. log_noise [n]: log density of noise that is nothing, constants included.
    """

    inner: Float[Array, "n k k"]
    onto: Float[Array, "n k"]
    square: Float[Array, " n"]
    log_noise: Float[Array, " n"]

    def beside(self, other: "Normal | None", share: float) -> "Normal":
        """Return the sum with a share of the other's equations."""
        if other is None:
            return self
        return Normal(self.inner + share * other.inner, self.onto + share * other.onto,
                      self.square + share * other.square, self.log_noise + other.log_noise)

    def at(self, change: Float[Array, "*n k"]) -> "Normal":
        """Return the equations after the k numbers change by `change` [k], or by each shot's own [n, k]."""
        if not change.any():
            return self
        change = np.broadcast_to(change, self.onto.shape)
        taken = np.einsum("nij,nj->ni", self.inner, change)
        return replace(self, onto=self.onto - taken,
                       square=self.square - ((2.0 * self.onto - taken) * change).sum(1))


def multiply_out(intake: Intake, seen: Prediction, slopes: Prediction,
                 deviates: Float[Array, "n D"]) -> tuple[Normal, Normal | None]:
    """Return the normal equations of the exits seen [n] with their slopes (last axis k), about deviates [n, D], and
    those of the tracks."""
    exits = _product(_exit_part(intake, seen, slopes), deviates)
    tracks = _track_part(intake, seen, slopes, deviates.shape[1])
    return exits, None if tracks is None else _product(tracks, deviates)


def _product(part: tuple[Float[Array, "n G inputs"], Float[Array, " n"]], deviates: Float[Array, "n D"]) -> Normal:
    raw, log_noise = part
    # as seen from no deviation: the prior's mean
    raw[..., 0] += np.einsum("ngd,nd->ng", raw[..., raw.shape[2] - deviates.shape[1]:], deviates)
    with np.errstate(over="ignore", invalid="ignore"):     # far from all that flies there is no likelihood: not finite
        product = np.swapaxes(raw, 1, 2) @ raw
    return Normal(product[:, 1:, 1:], product[:, 1:, 0], product[:, 0, 0], log_noise)


def _exit_part(intake: Intake, seen: Prediction,
               slopes: Prediction) -> tuple[Float[Array, "n 3 inputs"], Float[Array, " n"]]:
    """(white [n, 3, 1 + k] of the measured exits, log density); unmeasured ones are 0."""
    known = np.isfinite(intake.exits)
    off = np.where(known, intake.exits - seen.exit, 0.0) / intake.exit_sd
    white = np.where(known[..., None], slopes.exit / intake.exit_sd[..., None], 0.0)
    log_noise = -(known * (np.log(intake.exit_sd) + 0.5 * np.log(2.0 * np.pi))).sum(1)
    return np.concatenate([off[..., None], white], axis=2), log_noise


def _track_part(intake: Intake, seen: Prediction, slopes: Prediction,
                deviates: int) -> tuple[Float[Array, "n G inputs"], Float[Array, " n"]] | None:
    """(white [n, 3 L, 1 + k] of the tracks, log density); shots without one are 0. deviates: how many of k, the last.

    A later release leaves every sample as much earlier in the flight, so that slopes by it are velocities.
    """
    if intake.samples is None or intake.scatter is None:
        return None
    rows, samples, n = intake.tracked, intake.samples, len(intake.rows)
    raw = np.concatenate([(samples.position_m - seen.track_m[rows])[..., None], slopes.track_m[rows]], axis=3)
    unmeasured = intake.scatter.sigma_m >= UNMEASURED_M
    if unmeasured.any():              # nothing at all: tests have no scale, so a tiny score of one sign is significant
        raw[:, :, unmeasured] = 0.0
    log_noise = np.zeros(n)
    log_noise[rows] = log_volume(samples, intake.scatter)
    if samples.wider is not None:
        raw /= samples.wider[..., None]
        log_noise[rows] -= (np.log(samples.wider).sum(2) * samples.real).sum(1)
    if samples.clock_s is not None:
        by_release = np.asarray(slopes.track_m)[rows, :, 2, slopes.track_m.shape[3] - deviates + LEAD]
        wider = timed_noise(samples, by_release)
        raw /= wider[:, :, None, None]
        log_noise[rows] -= (np.log(wider) * samples.real).sum(1)
    white = np.zeros((n, 3 * raw.shape[1], raw.shape[3]))
    white[rows] = whiten(samples, intake.scatter, raw)
    return white, log_noise


def noise_terms(tracks: Normal, mean: Float[Array, "n D"], covariance: Float[Array, "n D D"],
                counts: Float[Array, " n"], share: float) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """Score and information of the log of how many times as noisy tracks are as measured, 1 / sqrt(share).

    mean, covariance: of the deviates given what was seen; counts [n]: numbers of each track.
    """
    deviates = mean.shape[1]
    inner, onto = tracks.inner[:, -deviates:, -deviates:], tracks.onto[:, -deviates:]
    absorbed = share * np.einsum("nde,ned->n", covariance, inner)
    off = tracks.square - 2.0 * (onto * mean).sum(1) + np.einsum("nd,nde,ne->n", mean, inner, mean)
    return share * off + absorbed - counts, 2.0 * np.maximum(counts - absorbed, 0.0)


ENDLESS = 1e30                        # information, of a flight that goes astray
LOST = 1e-6                           # of a square, that rounding may take below zero
SCATTERED = (0, 1, 2, 4, 6, 7)        # deviates that scatter: log speed, elevation, azimuth, distance, drag, spin
TRACK = len(SCATTERED)                # place of the track's noise among the scatters: the last
FAR_BELOW_M = -10.0                   # stands for a ball that never came near
AHEAD, TOP, APEX, PULL = 4, 6, 9, 10  # of Prediction.plane, of a ball that comes down to a rim
GRAZING = 5.0                         # standard deviations of it; measured there: beyond, 0.01 by the linear model
BESIDE = 0.001                        # standard deviations of the height, between slopes that are compared
TINY = 1e-18                          # of a variance, so that none is nothing
STEEPEST = 1e6                        # m by a deviate: of a flight that goes astray


@dataclass(frozen=True)
class Linearization:
    """The prediction at a spot, its slopes by the layout's inputs, then deviates (last axis), and the normal equations
    of tracks and exits in both. log_spread_by [n, inputs]: slopes of the log standard deviation of the height at the
    plane; of tracked shots 0. fall_s [n]: of shots that hardly reach the rim of an opening that faces up, the time of
    the fall with which their observable is the place of the highest point and so long a way on; of others nan."""

    point: Point
    seen: Prediction
    slopes: Prediction
    exits: Normal
    tracks: Normal | None
    log_spread_by: Float[Array, "n inputs"]
    fall_s: Float[Array, " n"]

    def change(self, layout: Layout, values: Float[Array, " slots"]) -> Float[Array, " inputs"]:
        """Return the change of the inputs from the spot to other values; group inputs do not change. Everything is
        linear in it."""
        inputs = layout.inputs
        slots = inputs < len(values)
        slots[len(inputs) - _bases(layout):] = False
        change = np.zeros(len(inputs))
        change[slots] = (values - self.point.values)[inputs[slots]]
        return change


def _bases(layout: Layout) -> int:
    return 0 if layout.groups is None else len(layout.groups.inputs)


def linearise(intake: Intake, layout: Layout, spot: Point,
              flown: Linearization | None = None) -> tuple[ScoreTable, Float[Array, "n D"]]:
    """Return (evidence at the spot, most likely deviates there); reuses flights about a nearby spot with the same
    deviates, if given."""
    count = layout.chain.deviates
    flown = flown or fly(intake, layout, spot)
    real = len(layout.columns) - layout.grouped
    bases = _bases(layout)
    columns = np.concatenate([np.flatnonzero(layout.source >= 0), real + np.arange(bases)])
    sd = np.sqrt(variance_of(intake, spot.log_scatter))[:, :count]
    change = flown.change(layout, spot.values)
    moved = np.concatenate([change, np.zeros(count)])
    tracks, noise = None if flown.tracks is None else flown.tracks.at(moved), np.exp(spot.log_scatter[TRACK])
    with np.errstate(over="ignore", invalid="ignore"):     # far from all that flies there is no likelihood: not finite
        normal = flown.exits.at(moved).beside(tracks, float(noise**-2.0))
        left = _integrate(normal, sd, columns, real + bases)
    effects = _group_effects(layout, spot)
    own = left.mean + np.einsum("ndb,nb->nd", left.mean_by[:, :, real:], effects)
    score, info = _scatter_terms(intake, layout, spot, sd, left, own, real + bases)
    log_linear = left.log_likelihood
    if tracks is not None and intake.samples is not None and intake.scatter is not None:
        counts = np.zeros(len(sd))
        counts[intake.tracked] = intake.samples.real.sum(1) * (intake.scatter.sigma_m < UNMEASURED_M).sum()
        log_linear = log_linear - counts * np.log(noise)
        if layout.scatters[TRACK] >= 0:
            place = layout.scatters[TRACK]
            shift = np.pad(effects, ((0, 0), (len(layout.inputs) - bases, count)))
            found = noise_terms(tracks.at(shift), own, left.covariance, counts, float(noise**-2.0))
            score[:, place], info[:, place, place] = found
    plane = _plane(intake, layout, spot, flown, change, sd, left, columns, real + bases)
    parts = _scaled(layout, left.score + score, left.info + info, plane)
    point = _point(layout, spot)
    pull = layout.precision @ (layout.centre - point[layout.first_shared:])
    evidence = make_evidence(intake.rows, layout.columns, point, *parts, layout.precision, pull, log_linear,
                             _deal(layout))
    if spot.effects.any():
        evidence = evidence.moved(np.tile(np.concatenate([np.zeros(real), spot.effects]), (len(intake.rows), 1)))
    return evidence, left.mean


def _scaled(layout: Layout, linear: Float[Array, "n C"], bend: Float[Array, "n C C"],
            plane: PlaneScores | None) -> tuple[Float[Array, "n C"], Float[Array, "n C C"], PlaneScores | None]:
    """The effects of a shot's own group, which come last, in units of their own."""
    groups = layout.groups
    if groups is None:
        return linear, bend, plane
    scale = np.concatenate([np.ones(len(layout.columns) - layout.grouped), groups.scale])
    if plane is not None:
        plane = replace(plane, by_column=plane.by_column * scale, moved_by=plane.moved_by * scale,
                        log_spread_by=plane.log_spread_by * scale)
    return linear * scale, bend * scale[:, None] * scale, plane


def _deal(layout: Layout) -> GroupedColumns | None:
    groups = layout.groups
    if groups is None:
        return None
    return GroupedColumns(len(layout.columns) - layout.grouped, len(groups.inputs), groups.count, groups.label)


def _point(layout: Layout, spot: Point) -> Float[Array, " P"]:
    point = np.zeros(len(layout.columns))
    point[layout.in_slot] = spot.values[layout.source[layout.in_slot]]
    for number, column in enumerate(layout.scatters):
        if column >= 0:
            point[column] = spot.log_scatter[number]
    point[layout.source == -2] = spot.effects
    return point


def fly(intake: Intake, layout: Layout, spot: Point) -> Linearization:
    """Fly all shots at the spot.

    Slopes by inputs are those of a shot that deviates as all do on average: taken at the deviation that a track itself
    tells, they would go with that track's noise, and the score of what bends with a deviation would lean to one side.
    Taken without deviation, they would be those of another launcher where a loss of speed is not believed.
    """
    inputs, first = layout.inputs, len(layout.chain.slots)
    deviates = first + np.arange(layout.chain.deviates)
    both = np.concatenate([inputs, deviates])
    if not spot.deviates.any():
        seen, slopes = _fly(intake, layout, spot, both)
        return _linearization(intake, layout, spot, seen, slopes)
    _, still = _fly(intake, layout, replace(spot, deviates=_common(spot.deviates)), inputs)
    seen, moving = _fly(intake, layout, spot, deviates)
    slopes = jax.tree.map(lambda a, b: np.concatenate([a, b], axis=-1), still, moving)
    return _linearization(intake, layout, spot, seen, slopes)


def _linearization(intake: Intake, layout: Layout, spot: Point, seen: Prediction, slopes: Prediction) -> Linearization:
    exits, tracks = multiply_out(intake, seen, slopes, spot.deviates)
    log_spread_by, fall_s = _log_spread_by(intake, layout, spot, seen, slopes, exits), np.full(len(intake.rows), np.nan)
    if layout.chain.plane and intake.seen.axes > 1:
        rows, fall_s = _grazing(intake, seen, slopes, _given_exits(intake, layout, spot, exits))
        log_spread_by[rows] = 0.0
        for part in (seen.plane, slopes.plane):
            part[rows, 0] = part[rows, APEX] + (fall_s[rows] * part[rows, AHEAD].T).T
    return Linearization(spot, seen, slopes, exits, tracks, log_spread_by, fall_s)


def _given_exits(intake: Intake, layout: Layout, spot: Point, normal: Normal) -> Float[Array, "n D D"]:
    """Covariance of the deviates given the measured exits."""
    inputs = len(layout.inputs)
    sd = np.sqrt(variance_of(intake, spot.log_scatter))[:, :layout.chain.deviates]
    inner = np.eye(sd.shape[1]) + sd[:, :, None] * normal.inner[:, inputs:, inputs:] * sd[:, None, :]
    return np.asarray(sd[:, :, None] * np.linalg.inv(inner) * sd[:, None, :])


def _grazing(intake: Intake, seen: Prediction, slopes: Prediction,
             covariance: Float[Array, "n D D"]) -> tuple[Int[Array, " k"], Float[Array, " n"]]:
    """(shots whose highest point is within GRAZING standard deviations of the rim, or that come up so near to it; how
    long they fall [n])."""
    deviates = covariance.shape[1]
    by = np.clip(slopes.plane[:, :, slopes.plane.shape[2] - deviates:], -STEEPEST, STEEPEST)
    sd = np.sqrt(np.einsum("nad,nde,nae->na", by, covariance, by))
    along, ahead, down, top = (np.asarray(seen.plane)[:, axis] for axis in (0, AHEAD, 5, TOP))
    begin_m = along - 2.0 * ahead * down / intake.rig.world.gravity_m_s2      # where it rose through the plane
    rises_near = begin_m + GRAZING * sd[:, 0] > -seen.plane[:, 3] - 2.0 * np.asarray(intake.lanes.ball_m)
    near = (top > -GRAZING * sd[:, TOP]) & ((top < GRAZING * sd[:, TOP]) | rises_near) & seen.near
    rows, fall_s = np.intersect1d(np.flatnonzero(near), intake.marked), np.full(len(near), np.nan)
    fall_s[rows] = np.sqrt(np.maximum(2.0 * top, sd[:, TOP]) / seen.plane[:, PULL])[rows]
    return rows, fall_s


def rise_of(by: Float[Array, "n axes k"], top_m: Float[Array, " n"], fall_s: Float[Array, " n"]
            ) -> Float[Array, "n 6"]:
    """Return `rise` of Outcomes.at, from slopes of Prediction.plane by independent standard deviations."""
    top, square = by[:, TOP], (by[:, TOP]**2).sum(1) + FLOOR_M**2
    with_top, faster = (by[:, [0, AHEAD]] * top[:, None]).sum(2).T / square
    along = by[:, 0] - with_top[:, None] * top
    leaning = (along * by[:, AHEAD]).sum(1) / ((along**2).sum(1) + FLOOR_M**2)
    rise = np.stack([top_m, np.sqrt(square), with_top, faster, leaning, fall_s], axis=1)
    return np.where(np.isfinite(fall_s)[:, None], rise, np.nan)


def _log_spread_by(intake: Intake, layout: Layout, spot: Point, seen: Prediction,
                   slopes: Prediction, normal: Normal) -> Float[Array, "n inputs"]:
    """Slopes [n, inputs] of the log standard deviation of the height at the plane.

    By how the height's slopes differ between shots that deviate a little and those that do not: compiling a second
    derivative would take longer than all flights.
    """
    inputs = len(layout.inputs)
    result = np.zeros((len(intake.rows), inputs))
    if layout.steady or intake.samples is not None or not len(intake.marked) or not layout.chain.plane:
        return result
    covariance = _given_exits(intake, layout, spot, normal)
    by_deviate = np.clip(slopes.plane[:, 0, inputs:], -STEEPEST, STEEPEST)
    toward = np.einsum("nde,ne->nd", covariance, by_deviate)
    spread = np.sqrt((toward * by_deviate).sum(1) + FLOOR_M**2)
    toward /= spread[:, None]
    here = replace(spot, deviates=spot.deviates + BESIDE * toward)
    beside = _fly(intake, layout, here, layout.inputs)[1].plane[:, 0]
    change = (beside - slopes.plane[:, 0, :inputs]) / (BESIDE * spread[:, None])
    return np.where(seen.near[:, None] & np.isfinite(change), change, result)


def _common(deviates: Float[Array, "n D"]) -> Float[Array, "n D"]:
    """The mean of those that deviate, for each of them; nothing for the others."""
    own = np.any(deviates, axis=1)
    return np.where(own[:, None], deviates[own].mean(axis=0), 0.0)


def _fly(intake: Intake, layout: Layout, spot: Point,
         inputs: Int[Array, " k"]) -> tuple[Prediction, Prediction]:
    """(all lanes at the spot, their slopes by these of the chain's inputs)."""
    like, times = _by_constants(intake, layout, inputs)
    flown, place = np.unique(like, return_inverse=True)
    basis = np.zeros((layout.chain.size, len(flown)))
    basis[flown, np.arange(len(flown))] = 1.0
    seen, slopes = see_in_blocks(layout.chain, intake.lanes, spot.values, spot.deviates, layout.edges_s, basis,
                                 layout.see)
    return seen, jax.tree.map(lambda one: one[..., place] * times.reshape(
        len(times), *[1] * (one.ndim - 2), len(like)), slopes)      # there may be none


def _by_constants(intake: Intake, layout: Layout,
                  inputs: Int[Array, " k"]) -> tuple[Int[Array, " k"], Float[Array, "n k"]]:
    """(the input that is flown for each, times which its slopes are this one's): of a curve whose first point is a
    constant, slopes by all points are those by the constant times their shapes."""
    by, like, times = np.asarray(intake.lanes.circumstances.curve_by), inputs.copy(), np.ones((1, len(inputs)))
    points = [slot for slot, (term, _) in enumerate(layout.chain.slots) if term == CURVE]
    for column, slot in enumerate(points):
        number = int(layout.chain.slots[slot][1].partition(".")[2])
        if (by[:, column - number] == 1.0).all():
            like = np.where(inputs == slot, slot - number, like)
            times = np.where(inputs == slot, by[:, [column]], times)
    return like, times


def variance_of(intake: Intake, log_scatter: Float[Array, " S"]) -> Float[Array, "n D"]:
    """Return variances of the deviates."""
    variance = intake.noise_var.copy()
    variance[:, SCATTERED] += intake.scattered * np.exp(2.0 * log_scatter[:TRACK])
    return variance


@dataclass(frozen=True)
class _Left:
    """After the deviates are integrated out: score, info and log-likelihood; and the deviates' posterior mean, its
    covariance and the mean's slope by the columns."""

    score: Float[Array, "n C"]
    info: Float[Array, "n C C"]
    log_likelihood: Float[Array, " n"]
    mean: Float[Array, "n D"]
    covariance: Float[Array, "n D D"]
    mean_by: Float[Array, "n D C"]


def _integrate(normal: Normal, sd: Float[Array, "n D"], columns: Int[Array, " inputs"], count: int) -> _Left:
    """`columns`: which of the C = count the inputs are; in the others nothing is said."""
    inputs = len(columns)
    astray = ~(np.abs(normal.inner).max(axis=(1, 2)) < ENDLESS)
    if astray.any():
        normal = Normal(*(np.where(astray.reshape(-1, *[1] * (part.ndim - 1)), 0.0, part)
                          for part in (normal.inner, normal.onto, normal.square, normal.log_noise)))
    inner, cross = normal.inner[:, inputs:, inputs:], normal.inner[:, inputs:, :inputs]
    inner = np.eye(sd.shape[1]) + sd[:, :, None] * inner * sd[:, None, :]
    inverse = np.linalg.inv(inner)
    onto_r, onto_c = sd * normal.onto[:, inputs:], sd[:, :, None] * cross
    shift, by = np.einsum("nde,ne->nd", inverse, onto_r), inverse @ onto_c
    score, info, mean_by = np.zeros((len(sd), count)), np.zeros((len(sd), count, count)), np.zeros((*sd.shape, count))
    score[:, columns] = normal.onto[:, :inputs] - np.einsum("ndp,nd->np", onto_c, shift)
    info[:, columns[:, None], columns] = normal.inner[:, :inputs, :inputs] - np.swapaxes(onto_c, 1, 2) @ by
    mean_by[:, :, columns] = -sd[:, :, None] * by
    quadratic = normal.square - (onto_r * shift).sum(1)
    value = -0.5 * (quadratic + np.linalg.slogdet(inner)[1]) + normal.log_noise
    # slopes may be so large that no digit is right
    value = np.where(astray | (quadratic < -LOST * normal.square), -np.inf, value)
    return _Left(score, info, value, sd * shift, sd[:, :, None] * inverse * sd[:, None, :], mean_by)


def _group_effects(layout: Layout, spot: Point) -> Float[Array, "n B"]:
    """Effects of each shot's own group, in the units of what they act on."""
    groups = layout.groups
    if groups is None:
        return np.zeros((len(spot.deviates), 0))
    return np.asarray(spot.effects.reshape(-1, groups.count)[:, groups.label].T * groups.scale)


def _scatter_terms(intake: Intake, layout: Layout, spot: Point, sd: Float[Array, "n D"],
                   left: _Left, own: Float[Array, "n D"],
                   count: int) -> tuple[Float[Array, "n C"], Float[Array, "n C C"]]:
    """Score and information of the log scatters from tracks and exits (the plane adds its own). own [n, D]: deviates of
    each shot without its group's effect, which is not scatter."""
    n = len(sd)
    score, info = np.zeros((n, count)), np.zeros((n, count, count))
    variance = np.maximum(sd**2, 1e-300)
    scattered = intake.scattered * np.exp(2.0 * spot.log_scatter[:TRACK])
    for number, (column, deviate) in enumerate(zip(layout.scatters[:TRACK], SCATTERED, strict=True)):
        if column < 0 or deviate >= sd.shape[1]:          # without tracks flights do not differ in drag and spin
            continue
        total, kept = variance[:, deviate], left.covariance[:, deviate, deviate]
        share = scattered[:, number] / total
        known = np.clip(1.0 - kept / total, 0.0, 1.0)
        score[:, column] = share * ((own[:, deviate]**2 + kept) / total - 1.0)
        info[:, column, column] = 2.0 * (share * known)**2
    return score, info


def _plane(intake: Intake, layout: Layout, spot: Point, flown: Linearization, change: Float[Array, " inputs"],
           sd: Float[Array, "n D"], left: _Left, columns: Int[Array, " inputs"], count: int) -> PlaneScores | None:
    """Heights after a change of the inputs, given what tracks and exits said of the launch."""
    rows = intake.marked
    if not len(rows) or not layout.chain.plane:
        return None
    slopes, inputs = flown.slopes, len(layout.inputs)
    seen = flown.seen._replace(plane=flown.seen.plane + slopes.plane[..., :inputs] @ change)
    near = seen.near[rows]
    slope = np.where(near[:, None, None], slopes.plane[rows], 0.0)
    moved = np.zeros((len(rows), intake.seen.moves, count))
    moved[:, :, columns] = intake.seen.moves_by(slope[:, :, :inputs])
    scattered = intake.scattered[rows] * np.exp(2.0 * spot.log_scatter[:TRACK])
    kept = np.diagonal(left.covariance[rows], axis1=1, axis2=2) / np.maximum(sd[rows]**2, 1e-300)
    with_top = np.zeros(len(rows))

    def scatter(axis: int) -> tuple[Array, Array, Array, Array]:
        """(mean, variance [m], slopes of the mean and of the log spread [m, count]) of a coordinate at the target; the
        first besides what goes `with_top`."""
        by_deviate, by_column, log_spread = slope[:, axis, inputs:], *np.zeros((2, len(rows), count))
        by_column[:, columns] = slope[:, axis, :inputs]
        by_column += np.einsum("md,mdp->mp", by_deviate, left.mean_by[rows])
        mean = seen.plane[rows, axis] + np.einsum("md,md->m", by_deviate, left.mean[rows] - spot.deviates[rows])
        if axis == 0 and with_top.any():
            by_deviate = by_deviate - with_top[:, None] * slope[:, TOP, inputs:]
        variance = np.einsum("md,mde,me->m", by_deviate, left.covariance[rows], by_deviate) + FLOOR_M**2
        log_spread[:, columns] = flown.log_spread_by[rows] * (axis == 0)
        for number, (column, deviate) in enumerate(zip(layout.scatters[:TRACK], SCATTERED, strict=True)):
            if column >= 0 and deviate < sd.shape[1]:
                log_spread[:, column] = (by_deviate[:, deviate]**2 * scattered[:, number] * kept[:, deviate]**2
                                         ) / variance
        return mean, variance, by_column, log_spread

    across_m = rise = None
    if intake.seen.axes > 1:
        mean_across, square, moved[:, 1], moved[:, 2] = scatter(1)
        across_m = np.stack([mean_across, np.sqrt(square)], axis=1)
        top_m, _, moved[:, 4], moved[:, 5] = scatter(TOP)
        root = np.linalg.cholesky(left.covariance[rows] + TINY * np.eye(sd.shape[1]))
        rise = rise_of(slope[:, :, inputs:] @ root, top_m, flown.fall_s[rows])
        with_top = np.nan_to_num(rise[:, 2])
    mean, variance, by_column, log_spread = scatter(0)
    wider_by = np.exp(np.clip(flown.log_spread_by @ change, -2.0, 2.0))
    spread = np.where(near, np.sqrt(variance) * wider_by[rows], 1.0)
    marks = intake.seen.at(np.asarray(seen.plane)[rows], across_m, rise)
    return PlaneScores(rows, marks, np.where(near, mean, FAR_BELOW_M), spread, by_column, moved, log_spread)
