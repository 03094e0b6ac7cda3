"""Outcomes of an opening that faces up: where the ball comes down in the plane of the rim, along and across.

The miss along the shot is the observable. It is normally distributed, and so is the miss across, which is independent
of it. For each position across, the size of the ball and the angle of its arrival determine the interval of positions
along the shot at which the ball goes in. Probabilities are integrals over the miss across, computed by Gauss-Legendre
quadrature between the corners of the opening, where the length of the interval is smooth. The observable of a ball that
bounces off the backboard is where it would have come down behind the board. Near the board only gravity matters, so the
flight after the bounce has a closed form, from which the interval of a hit follows. For a ball that barely reaches the
rim, the place of arrival is not linear in the launch, but the highest point of the flight is; such shots are modelled
as mixtures over that height, from which the ball falls under gravity alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from msgspec import UnsetType
from scipy.special import ndtr, ndtri

from truearc.robot.config.rig_spec import Rig, Target
from truearc.sim.data.dataset import Shots
from truearc.sim.infer.likelihood.noise import LAPSE
from truearc.sim.infer.likelihood.outcomes import CLASSES, SIDED_SHARE
from truearc.sim.physics.facing_up import GRIP, clearance, half_along

Array = np.ndarray
CELLS = ("short", "long", "left", "right", "hit", "ring")
SHORT, LONG, LEFT, RIGHT, HIT, RING = range(len(CELLS))
WORDS = {"miss": (SHORT, LONG, LEFT, RIGHT), "two": (HIT,), "three": (RING,)}
WIDER, ACROSS, ACROSS_SPREAD, BOUNCE, TOP_M, TOP_SPREAD = range(6)    # the further numbers
MOVES = 6
AHEAD, DOWN, PULL = 4, 5, 10                     # of Prediction.plane
LEANING = 4                                      # of `rise`
# Derived: a normal distribution between them is summed to 1e-6
FINE = 16, 5.2                        # nodes of Gauss-Legendre between two corners; standard deviations to the last
# Measured: chances to 1e-3
RISING = 24, 4.5                      # likewise, of the root of the height of the highest point
# Measured: within 0.01 for many beliefs, 0.04 for shots that hardly reach the rim
COARSE = (5, 0.0), (8, 3.0)           # by Gauss-Hermite, and so few heights, for each of very many beliefs
STEP = 1e-5                           # of differences, in m, and of the board's bounce
LEAST_WEIGHT = 1e-10                  # of a node; measured: chances change by at most 2e-9
LEAST_PULL = 0.1                      # m/s2, downward at the highest point: stronger lift holds the ball up there
BISECTIONS = 40
# Of a shot whose flight is not yet known: as steep, and as far to the side
USUAL_PLANE = (0.0, 0.0, 0.0, 0.0, 2.5, 3.5, 0.6, 0.6, 0.0, -0.9, 9.8)
USUAL_ACROSS_M = 0.1
ALONG_NODES = ndtri((np.arange(33) + 0.5) / 33.0)          # of a forecast, alike likely


@dataclass(frozen=True)
class GroundOutcomes:
    """Observations of n landings relative to the opening's centre; an implementation of Outcomes.

    allowed [n, 6]: whether what was recorded leaves each of CELLS possible. sided: most misses have a side. plane
    [n, 11]: the arrivals (Prediction.plane); across_m [n, 2]: mean and spread of the miss across; rise [n, 6]: as in
    Outcomes.at. change [n, 6]: of the further numbers since: all edges farther out, the mean and the log of the spread
    across, the board's bounce, the mean and the log of the spread of the height of the highest point.
    """

    target: Target
    gravity_m_s2: float
    radius_m: Float[Array, " n"]
    allowed: Bool[Array, "n 6"]
    classes: Float[Array, " n"]
    sided: bool
    plane: Float[Array, "n 11"]
    across_m: Float[Array, "n 2"]
    rise: Float[Array, "n 6"]
    change: Float[Array, "n 6"]
    moves, axes, quantity = MOVES, 2, "where the ball comes down, along"

    @property
    def height_m(self) -> Float[Array, " n"]:
        return np.full(len(self.classes), np.nan)

    @property
    def measured(self) -> Bool[Array, " n"]:
        return np.zeros(len(self.classes), dtype=bool)

    @property
    def worth(self) -> Float[Array, " 6"]:
        """Points of each of CELLS."""
        return np.array([0.0, 0.0, 0.0, 0.0, *self.target.worth])

    def take(self, index: Int[Array, " k"] | Bool[Array, " n"]) -> "GroundOutcomes":
        return replace(self, **{name: getattr(self, name)[index] for name in (
            "radius_m", "allowed", "classes", "plane", "across_m", "rise", "change")})

    def without_slips(self) -> "GroundOutcomes":
        return self

    def at(self, plane: Float[Array, "n 11"], across_m: Float[Array, "n 2"] | None = None,
           rise: Float[Array, "n 6"] | None = None) -> "GroundOutcomes":
        return replace(self, plane=plane, across_m=self.across_m if across_m is None else across_m,
                       rise=np.full((len(plane), 6), np.nan) if rise is None else rise)

    def moves_by(self, slope: Float[Array, "n 11 k"]) -> Float[Array, "n 6 k"]:
        none = np.zeros_like(slope[:, 0])
        return np.stack([slope[:, 3], slope[:, 1], none, slope[:, 7], slope[:, 6], none], axis=1)

    def moved(self, change: Float[Array, "n 6"]) -> "GroundOutcomes":
        return replace(self, change=self.change + change) if change.any() else self

    def cells(self, mean_m: Float[Array, " n"], spread_m: Float[Array, " n"]) -> Float[Array, "n 6"]:
        """Return the chance of each of CELLS, without lapses."""
        return np.asarray(self._cells_by(mean_m, spread_m, False)[0])

    def _cells_by(self, mean_m: Float[Array, " n"], spread_m: Float[Array, " n"], by: bool,
                  sums: tuple[int, float] = FINE, rising: tuple[int, float] = RISING) -> Float[Array, "k n 6"]:
        """The chances of CELLS; where `by`, then their derivatives, as _cells has them, and by the mean and the log
        spread of the height of the highest point. Shots that hardly reach the rim are sums over that height."""
        grazing = np.isfinite(self.rise[:, 0])
        if not grazing.any() and not by:
            return _cells(self, mean_m, spread_m, by, *sums)
        clear, low = np.flatnonzero(~grazing), np.flatnonzero(grazing)
        (top_m, top_sd, along, faster, leaning, fall_s) = self.rise[low].T[:, :, None]
        pull = np.maximum(self.plane[low][:, [PULL]], LEAST_PULL)
        top_m = top_m + self.change[low][:, [TOP_M]]
        top_sd = top_sd * np.exp(np.clip(self.change[low][:, [TOP_SPREAD]], -2.0, 2.0))
        x, w = _legendre(rising[0])
        first, last = (np.sqrt(np.maximum(top_m + sign * rising[1] * top_sd, 0.0)) for sign in (-1.0, 1.0))
        root = 0.5 * (first + last) + 0.5 * (last - first) * x
        higher_m, down = root**2 - top_m, np.sqrt(2.0 * pull) * root
        z = higher_m / top_sd
        weight = (last - first) * w * root * np.exp(-0.5 * z**2) / (np.sqrt(2.0 * np.pi) * top_sd)
        row, column = np.nonzero(weight > LEAST_WEIGHT)
        ahead, longer_s = self.plane[low][:, [AHEAD]] + faster * higher_m, down / pull - fall_s
        wider = np.maximum(1.0 + leaning * longer_s, 0.1)
        places_m = mean_m[low][:, None] + along * higher_m + ahead * longer_s
        every, nodes = self.take(np.concatenate([clear, low[row]])), slice(len(clear), None)
        every.plane[nodes, AHEAD], every.plane[nodes, DOWN] = ahead[row, column], down[row, column]
        every.rise[nodes, LEANING] = (leaning / wider)[row, column]
        each = _cells(every, np.concatenate([mean_m[clear], places_m[row, column]]),
                      np.concatenate([spread_m[clear], (spread_m[low][:, None] * wider)[row, column]]), by, *sums)
        found = np.zeros((len(each) + 2 * by, len(mean_m), len(CELLS)))
        found[:len(each), clear], each = each[:, :len(clear)], each[:, nodes]
        if by:                        # the density's derivatives, at the same height
            off = z[row, column][:, None]
            each = np.concatenate([each, [off * each[0] / top_sd[row] - along[row] * each[1],
                                          (off**2 - 1.0) * each[0]]])
        total = np.zeros((len(low), len(each), len(CELLS)))
        np.add.at(total, row, weight[row, column][:, None, None] * np.swapaxes(each, 0, 1))
        total[:, :, SHORT] -= total.sum(2)          # of balls that never reach it
        total[:, 0, SHORT] += 1.0
        found[:, low] = np.swapaxes(total, 0, 1)
        return found

    def share(self, mean_m: Float[Array, " n"], spread_m: Float[Array, " n"]) -> Float[Array, " n"]:
        return np.asarray((self.cells(mean_m, spread_m) * self.allowed).sum(1))

    def log_likelihood(self, mean_m: Float[Array, " n"], spread_m: Float[Array, " n"]) -> Float[Array, " n"]:
        return np.asarray(np.log(_with_lapses(self.share(mean_m, spread_m))))

    def slopes_and_information(self, mean_m: Float[Array, " n"], spread_m: Float[Array, " n"],
                               asked: Bool[Array, " 6"] | None = None
                               ) -> tuple[tuple[Float[Array, " n"], ...], Float[Array, "n 8 8"]]:
        cells, by_mean, by_log, by_across, by_log_across, by_top, by_log_top = self._cells_by(mean_m, spread_m, True)
        board = not isinstance(self.target.backboard, UnsetType)
        wider, by_bounce = (self._difference(number, mean_m, spread_m) if there and (asked is None or asked[number])
                            else np.zeros_like(cells) for number, there in ((WIDER, True), (BOUNCE, board)))
        each = [by_mean, by_log, wider, by_across, by_log_across, by_bounce, by_top, by_log_top]
        seen = _with_lapses((cells * self.allowed).sum(1))
        slopes = tuple((1.0 - LAPSE) * (by * self.allowed).sum(1) / seen for by in each)
        groups = self._told_apart()
        by = (1.0 - LAPSE) * np.stack(each, axis=1) @ groups.T
        return slopes, np.asarray((by / _with_lapses(cells @ groups.T)[:, None]) @ np.swapaxes(by, 1, 2))

    def _difference(self, number: int, mean_m: Float[Array, " n"], spread_m: Float[Array, " n"]) -> Float[Array, "n 6"]:
        """Derivative of the chances of CELLS by one of the further numbers, by central differences."""
        step = np.zeros((len(mean_m), MOVES))
        step[:, number] = STEP
        more, less = (self.moved(sign * step).cells(mean_m, spread_m) for sign in (1.0, -1.0))
        return np.asarray((more - less) / (2.0 * STEP))

    def _told_apart(self) -> Float[Array, "k 6"]:
        """1 where a cell is part of an outcome that the operator tells apart."""
        each = np.eye(len(CELLS))
        misses = list(each[:HIT]) if self.sided else [each[:HIT].sum(0)]
        return np.stack([*misses, *([each[HIT], each[RING]] if self.target.three_half_height_m > 0.0
                                    else [each[HIT] + each[RING]])])

    def class_chances(self, mean_m: Float[Array, " n"], spread_m: Float[Array, " n"],
                      lapses: bool = True) -> Float[Array, "n 3"]:
        cells = self.cells(mean_m, spread_m)
        clean = np.stack([cells[:, :HIT].sum(1), cells[:, HIT], cells[:, RING]], axis=1)
        return _with_lapses(clean) if lapses else clean

    def chance(self, shot: int, mean_m: Any, spread_m: Any, change: Sequence[Any]) -> Any:
        mean, spread, *moved = np.broadcast_arrays(mean_m, spread_m, *change)
        some = self.take(np.full(mean.size, shot)).moved(np.stack([part.ravel() for part in moved], axis=1))
        cells = some._cells_by(mean.ravel(), spread.ravel(), False, *COARSE)[0]
        return np.reshape(_with_lapses((cells * some.allowed).sum(1) / cells.sum(1)), mean.shape)

    def hit_chance(self, mean_m: Float[Array, " n"], spread_m: Float[Array, " n"]) -> Float[Array, " n"]:
        cells = self.cells(mean_m, spread_m)
        return np.asarray(cells[:, RING] if self.target.three_half_height_m > 0.0 else cells[:, HIT])

    def centred(self, mean_m: Float[Array, " n"]) -> Float[Array, " n"]:
        """Return the middle between the nearest and the farthest place where a ball goes in."""
        return np.asarray(0.5 * clearance(self.target, self.radius_m, _angle(self.plane)))

    def beside(self, spread_m: Float[Array, " n"], aside: Float[Array, " n"]) -> Float[Array, " n"]:
        middle, sign = self.centred(spread_m), np.sign(aside)
        return np.asarray(middle + sign * (self.target.half_sizes_m[0] - middle) + (aside - 2.0 * sign) * spread_m)

    def points_if_aimed(self, mean_m: Float[Array, " n"],
                        both: Sequence[tuple[Float[Array, " n"], Float[Array, " n"]]]) -> Float[Array, " n"]:
        offset_m, points, total = self.centred(mean_m) - mean_m, np.zeros(len(mean_m)), np.full(len(mean_m), 1e-12)
        exact = np.full(len(mean_m), 1e-4)
        for mean, spread in both:
            for node in ALONG_NODES:
                along_m = mean + spread * node
                seen = (self.cells(along_m, exact) * self.allowed).sum(1)
                points += seen * (self.cells(along_m + offset_m, exact) @ self.worth)
                total += seen
        return np.asarray(points / total)

    def points(self) -> Float[Array, " n"]:
        return np.asarray(self.worth[np.array([SHORT, HIT, RING])[np.nan_to_num(self.classes).astype(int)]])


def see_landings(shots: Shots, rig: Rig, target: Target) -> tuple[Int[Array, " n"], GroundOutcomes]:
    """Return (rows [n] with an outcome or a side, the observations)."""
    outcome, side = np.array(shots.text("outcome")), np.array(shots.text("side"))
    rows = np.flatnonzero((outcome != "") | (side != ""))
    allowed = np.zeros((len(rows), len(CELLS)), dtype=bool)
    for place, row in enumerate(rows):
        cells = WORDS.get(outcome[row], WORDS["miss"])
        allowed[place, [cell for cell in cells if cell >= HIT or side[row] in ("", CELLS[cell])]] = True
    misses = outcome[rows] == "miss"
    sided = bool(misses.any() and (side[rows][misses] != "").mean() >= SIDED_SHARE)
    radius_m = np.where(np.isfinite(own := shots.number("radius_m")[rows]), own, rig.ball.radius_m)
    classes = np.array([CLASSES.get(outcome[row], 0.0) for row in rows])
    usual = np.tile(USUAL_PLANE, (len(rows), 1))
    usual[:, 2:4] = target.three_half_height_m, target.two_half_height_m
    return rows, GroundOutcomes(target, rig.world.gravity_m_s2, radius_m, allowed, classes, sided, usual,
                                np.tile([0.0, USUAL_ACROSS_M], (len(rows), 1)), np.full((len(rows), 6), np.nan),
                                np.zeros((len(rows), MOVES)))


def _with_lapses(chance: Float[Array, "*n"]) -> Float[Array, "*n"]:
    return np.asarray((1.0 - LAPSE) * np.clip(chance, 0.0, 1.0) + LAPSE / 3.0)


def _angle(plane: Float[Array, "n 11"]) -> Float[Array, " n"]:
    return np.asarray(np.arctan2(plane[:, DOWN], plane[:, AHEAD]))


def _cells(seen: GroundOutcomes, mean_m: Float[Array, " n"], spread_m: Float[Array, " n"], by: bool,
           nodes: int, tails: float) -> Float[Array, "k n 6"]:
    """The chances of CELLS for normal misses along and across; where `by`, then their derivatives by the mean and the
    log spread along, and by those across."""
    middle = seen.across_m[:, 0] + seen.change[:, ACROSS]
    spread = seen.across_m[:, 1] * np.exp(np.clip(seen.change[:, ACROSS_SPREAD], -2.0, 2.0))
    wider = np.maximum(seen.plane[:, 3] - seen.target.two_half_height_m + seen.change[:, 0],
                       -min(seen.target.half_sizes_m))               # no opening is smaller than nothing
    every, weights, end = _across(seen, wider, middle, spread, nodes, tails)
    row, column = np.nonzero(weights > LEAST_WEIGHT)                 # of most shots few nodes count
    y, weight = every[row, column], weights[row, column]
    one = seen.take(row)
    short, long, hit, ring = (part[..., 0] for part in _by_place(
        one, wider[row], y[:, None], mean_m[row][:, None], spread_m[row][:, None], by))
    cells = np.zeros((5 if by else 1, len(mean_m), len(CELLS)))
    places = (SHORT, short), (LONG, long), (HIT, hit - ring), (RING, ring)

    def total(each: Float[Array, " k"]) -> Float[Array, " n"]:
        return np.bincount(row, each, len(mean_m)).astype(float)     # of no shots at all it counts in whole numbers

    for cell, chance in places:
        for number, part in enumerate(chance):
            cells[number, :, cell] = total(weight * part)
    z = np.stack([middle - end, -middle - end]) / spread             # beyond the left and the right end
    cells[0, :, LEFT], cells[0, :, RIGHT] = ndtr(z)
    if by:
        off = (y - middle[row]) / spread[row]
        for cell, chance in places:
            cells[3, :, cell] = total(weight * off * chance[0]) / spread
            cells[4, :, cell] = total(weight * (off**2 - 1.0) * chance[0])
        density = np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi)
        cells[3, :, LEFT], cells[3, :, RIGHT] = density * np.array([[1.0], [-1.0]]) / spread
        cells[4, :, LEFT], cells[4, :, RIGHT] = -z * density
    return cells


def _across(seen: GroundOutcomes, wider_m: Float[Array, " n"], middle_m: Float[Array, " n"],
            spread_m: Float[Array, " n"], nodes: int, tails: float
            ) -> tuple[Float[Array, "n q"], Float[Array, "n q"], Float[Array, " n"]]:
    """(places across, their weights, half the opening's width): nodes between its corners, where balls come down; about
    the mean, where there are no tails."""
    target = seen.target
    end = target.half_sizes_m[1] + wider_m * _reach_across(target)
    if not tails:
        x, w = _hermite(nodes)
        y = middle_m[:, None] + spread_m[:, None] * x
        return y, np.where(np.abs(y) <= end[:, None], w / w.sum(), 0.0), end
    x, w = _legendre(nodes)
    low, high = middle_m - tails * spread_m, middle_m + tails * spread_m
    corners = np.array(_corners(target)) * end[:, None]
    if target.three_half_height_m > 0.0:
        ring = np.clip(seen.plane[:, 2] + seen.change[:, 0], 0.0, end)[:, None]
        corners = np.sort(np.concatenate([corners, ring, -ring], axis=1), axis=1)
    places, weights = [middle_m[:, None]], [np.zeros_like(middle_m)[:, None]]        # one at least
    for first, last in pairwise(corners.T):
        a, b = (np.clip(edge, first, last) for edge in (low, high))
        if not (a < b).any():                       # no ball comes down there
            continue
        if target.shape == "circle":                # by the angle: its length has no slope at its ends
            a, b = (np.arcsin(np.clip(edge / end, -1.0, 1.0)) for edge in (a, b))
        at = 0.5 * (a + b)[:, None] + 0.5 * (b - a)[:, None] * x
        scale = 0.5 * (b - a)[:, None] * w
        if target.shape == "circle":
            at, scale = end[:, None] * np.sin(at), scale * end[:, None] * np.cos(at)
        places.append(at)
        weights.append(scale)
    y = np.concatenate(places, axis=1)
    z = (y - middle_m[:, None]) / spread_m[:, None]
    weight = np.concatenate(weights, axis=1) * np.exp(-0.5 * z**2) / (np.sqrt(2.0 * np.pi) * spread_m[:, None])
    return y, weight, end


_legendre, _hermite = cache(np.polynomial.legendre.leggauss), cache(np.polynomial.hermite_e.hermegauss)


def _reach_across(target: Target) -> float:
    """How far the sides move out where all edges move out by 1."""
    along, across = target.half_sizes_m
    return across / along if target.shape == "polygon" else 1.0


def _corners(target: Target) -> list[float]:
    """Places across, in half widths, at which the opening's length has corners, and its ends."""
    if target.shape != "polygon" or isinstance(target.sides, UnsetType):
        return [-1.0, 1.0]
    along, across = target.half_sizes_m
    turns = np.pi * (2.0 * np.arange(target.sides) + 1.0) / target.sides
    inside = np.sin(turns) * along / np.cos(np.pi / target.sides) / across
    return [-1.0, *np.unique(inside[np.abs(inside) < 1.0 - 1e-9].round(9)).tolist(), 1.0]


def _by_place(seen: GroundOutcomes, wider: Float[Array, " n"], y: Float[Array, "n q"], mean: Float[Array, "n 1"],
              spread: Float[Array, "n 1"], by: bool) -> tuple[Float[Array, "k n q"], ...]:
    """Chances of short, long, hit and ring at places across; where `by`, then their derivatives by mean and log spread.
    """
    half = np.maximum(half_along(seen.target, y, wider[:, None]), 0.0)
    ring = np.sqrt(np.maximum((seen.plane[:, [2]] + seen.change[:, [0]])**2 - y**2, 0.0)) * (
        seen.target.three_half_height_m > 0.0)
    clear = clearance(seen.target, seen.radius_m, _angle(seen.plane))[:, None]
    # it rose through the plane so long before it came down: as gravity alone has it
    aloft_s = 2.0 * seen.plane[:, [DOWN]] / seen.gravity_m_s2
    # by how much farther it rose, where it comes down a metre farther
    stays = np.maximum(1.0 - aloft_s * np.nan_to_num(seen.rise[:, [LEANING]]), 0.1)

    def below(edge: Any) -> Any:
        z = (edge - mean) / spread
        if not by:
            return ndtr(z)[None]
        density = np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi)
        return np.stack([ndtr(z), -density / spread / np.where(edge == rises, stays, 1.0), -z * density])

    def within(low: Any, high: Any) -> Any:
        return below(np.maximum(high, low)) - below(low)

    whole = np.array([1.0, 0.0, 0.0])[:3 if by else 1, None, None]
    low = clear - half
    # beyond this it rose in front of the near edge
    rises = mean + (aloft_s * seen.plane[:, [AHEAD]] - half - clear - mean) / stays
    high = np.minimum(half, rises)
    short = below(low) + whole - below(np.maximum(rises, low))
    if isinstance(seen.target.backboard, UnsetType):
        hit, inner = within(low, high), within(np.maximum(low, -ring), np.minimum(high, ring))
        return short, whole - short - hit, hit, inner
    board = _Board(seen)
    wall, top = board.wall_m, np.minimum(board.top_m, rises)
    high = np.minimum(high, wall)
    back = clearance(seen.target, seen.radius_m[:, None], board.angle)
    near, far = board.origin(-half), board.origin(half - back)        # of the opening, as it is seen from the board
    hit = within(low, high) + within(np.maximum(far, wall), np.minimum(near, top))
    inner = within(np.maximum(low, -ring), np.minimum(high, ring)) + (ring > 0.0) * within(
        np.maximum(board.origin(np.minimum(ring, half - back)), wall), np.minimum(board.origin(-ring), top))
    short = short + within(np.maximum(near, wall), top)             # back over the near edge
    return short, whole - short - hit, hit, inner


class _Board:
    """The backboard of n shots: where balls would have come down behind it that bounce to a place in front of it."""

    def __init__(self, seen: GroundOutcomes) -> None:
        board = seen.target.backboard
        assert not isinstance(board, UnsetType)
        self.ahead, self.down = (np.maximum(seen.plane[:, [k]], 0.05) for k in (AHEAD, DOWN))     # m/s
        self.share = np.clip(seen.plane[:, [7]] + seen.change[:, [BOUNCE]], 0.05, 1.0)
        self.gravity, self.backspin = seen.gravity_m_s2, seen.plane[:, [8]]
        self.wall_m = board.behind_m - seen.radius_m[:, None]
        self.longest_s = self.down / self.gravity                   # before it comes down; then it is at its highest
        high_m = 0.5 * self.down * self.longest_s
        rest = np.sqrt(np.maximum(self.down**2 - 2.0 * self.gravity * np.minimum(board.height_m, high_m), 0.0))
        self.top_m = self.wall_m + self.ahead * (self.down - rest) / self.gravity
        self.angle = np.arctan2(self.down, -self.share * self.ahead)

    def _lands(self, early_s: Any) -> Any:
        """Where a ball comes down that meets the board so long before it would have come down behind it."""
        above_m = self.down * early_s - 0.5 * self.gravity * early_s**2
        sinks = (self.down - self.gravity * early_s) * (1.0 - GRIP) + GRIP * self.backspin
        falls_s = (np.sqrt(sinks**2 + 2.0 * self.gravity * np.maximum(above_m, 0.0)) - sinks) / self.gravity
        return self.wall_m - self.share * self.ahead * falls_s

    def origin(self, along_m: Any) -> Any:
        """Return where a ball would have come down that comes down at along_m after the bounce: by bisection."""
        low, high = np.zeros_like(along_m + self.wall_m), np.broadcast_to(self.longest_s, np.shape(along_m)).copy()
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            nearer = self._lands(middle) > along_m
            low, high = np.where(nearer, middle, low), np.where(nearer, high, middle)
        return self.wall_m + self.ahead * 0.5 * (low + high)
