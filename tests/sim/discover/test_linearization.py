"""The likelihood of shots whose own unknowns are integrated out: against the big covariance matrix, shot by shot.

Measurements by tracks and at the exit are y ~ N(g - A d, A S A' + R) about a deviation d: built here entry by entry,
with slopes by differences of what is to be seen, and handed to SciPy's multivariate normal.
"""

from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from tests.sim.discover.mixed import BALLS, BELIEVED, FLOWN, LANDED, MEASURED, SHOTS, THROWN, make_mixed
from truearc.sim.infer.likelihood.data import Intake, take_in
from truearc.sim.infer.likelihood.forward_model import pad_lanes, see_slopes
from truearc.sim.infer.likelihood.layout import Layout, Point, lay_out
from truearc.sim.infer.likelihood.linearization import linearise, variance_of
from truearc.sim.infer.likelihood.noise import FLOOR_M, HEIGHT_M, LAPSE, SLIP_M
from truearc.sim.infer.likelihood.score_table import ScoreTable
from truearc.sim.physics.catalogue import find_parameter

pytestmark = pytest.mark.slow
SHOWN = (int(FLOWN[0]), int(LANDED[1]), int(LANDED[2]), int(MEASURED[1]), int(MEASURED[6]), int(THROWN[0]), 35, 38)
COLUMNS = ("launch speed", "launch elevation", "distance", "spin_decay.rate_per_s", "lift_saturation.rate",
           "target_height.rise_m", "drag.cd", "exit_efficiency.loss", "track_tilt.angle_deg")


@dataclass(frozen=True)
class Bench:
    """The evidence at a spot off the optimum, deviates and all, and the means to work it out again."""

    intake: Intake
    layout: Layout
    point: Point
    scores: ScoreTable
    mean: np.ndarray

    def see(self, spot: Point) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(exit [n, 3], plane [n, 4], track [n, L, 3])."""
        lanes, n = pad_lanes(self.intake.lanes)
        deviates = np.resize(spot.deviates, (len(lanes.distance_m), spot.deviates.shape[1]))
        seen, _ = see_slopes(self.layout.chain, lanes, jnp.asarray(spot.values), jnp.asarray(deviates),
                             jnp.asarray(self.layout.edges_s), jnp.zeros((self.layout.chain.size, 1)))
        exit, plane, track = (np.asarray(part)[:n] for part in (seen.exit, seen.plane, seen.track_m))
        return exit, plane, track

    def still(self) -> Point:
        """Every shot that deviates does so as all of those do on average."""
        deviates = self.point.deviates
        own = deviates.any(axis=1, keepdims=True)
        return replace(self.point, deviates=own * deviates[own[:, 0]].mean(0))


@pytest.fixture(scope="module")
def bench() -> Bench:
    intake = take_in(make_mixed())
    layout = lay_out(intake, BELIEVED, ("ball_id", BALLS, 5))
    chain = layout.chain
    values = np.array([float(find_parameter(".".join(slot)).default) for slot in chain.slots])
    for slot, value in ((("drag", "cd"), 0.45), (("magnus", "cl"), 0.05), (("exit_efficiency", "loss"), 0.22)):
        values[chain.slots.index(slot)] = value
    # not quite at rest: then both looks are made by the same compiled code
    spot = Point(values, np.log([0.02, 0.008, 0.006, 1.3, 0.03, 0.02, 1.2]),
                              np.full((SHOTS, chain.deviates), 1e-9), np.zeros(layout.grouped))
    _, mean = linearise(intake, layout, spot)
    spot = replace(spot, deviates=mean)
    return Bench(intake, layout, spot, *linearise(intake, layout, spot))


@dataclass(frozen=True)
class Brute:
    """One shot written out: residual r of what was observed, slopes A [m, D] by deviates, covariance R of the noise,
    S [D] of the deviates; height h at no deviation and its slope B [D]."""

    r: np.ndarray
    slope: np.ndarray
    noise: np.ndarray
    own: np.ndarray
    height: float
    height_by: np.ndarray

    @property
    def total(self) -> np.ndarray:
        return self.slope @ np.diag(self.own) @ self.slope.T + self.noise

    def log_density(self) -> float:
        if not len(self.r):
            return 0.0
        return float(multivariate_normal.logpdf(self.r, np.zeros(len(self.r)), self.total))

    def height_given(self) -> tuple[float, float]:
        """(mean, standard deviation) of the height given what was observed: joint normal, conditioned."""
        pull = np.diag(self.own) @ self.slope.T @ np.linalg.inv(self.total)
        left = np.diag(self.own) - pull @ self.slope @ np.diag(self.own)
        variance = self.height_by @ left @ self.height_by
        return self.height + float(self.height_by @ (pull @ self.r)), float(np.sqrt(variance + FLOOR_M**2))


def flat(bench: Bench, row: int, exit: np.ndarray, track: np.ndarray) -> np.ndarray:
    """The observations of a shot in a row: its measured exit, then its track, axis by axis."""
    known = np.isfinite(bench.intake.exits[row])
    samples = bench.intake.samples
    assert samples is not None
    place = np.flatnonzero(bench.intake.tracked == row)
    seen = track[row][samples.real[place[0]]].T.ravel() if len(place) else np.zeros(0)
    return np.concatenate([exit[row][known], seen])


def observed(bench: Bench, row: int) -> np.ndarray:
    samples = bench.intake.samples
    assert samples is not None
    track = np.zeros((SHOTS, *samples.position_m.shape[1:]))
    track[bench.intake.tracked] = samples.position_m
    return flat(bench, row, bench.intake.exits, track)


def noise_of(bench: Bench, row: int, log_noise: float | None = None) -> np.ndarray:
    """Covariance of what is observed; of the tracks as many times as noisy as measured."""
    samples, scatter = bench.intake.samples, bench.intake.scatter
    assert samples is not None and scatter is not None
    known = np.isfinite(bench.intake.exits[row])
    blocks = [np.diag(bench.intake.exit_sd[row][known]**2)]
    noise = np.exp(bench.point.log_scatter[-1]) if log_noise is None else np.exp(log_noise)
    place = np.flatnonzero(bench.intake.tracked == row)
    if len(place):
        time_s = samples.time_s[place[0]][samples.real[place[0]]]
        apart = np.abs(time_s[:, None] - time_s)
        for sigma, memory in zip(scatter.sigma_m, scatter.memory_s, strict=True):
            blocks.append((noise * sigma)**2 * (np.exp(-apart / memory) if memory > 0.0 else np.eye(len(time_s))))
    whole = np.zeros((sum(map(len, blocks)),) * 2)
    first = 0
    for block in blocks:
        whole[first:first + len(block), first:first + len(block)] = block
        first += len(block)
    return whole


def written_out(bench: Bench, row: int) -> Brute:
    spot, step = bench.point, 1e-5
    exit, plane, track = bench.see(spot)
    slope, height_by = [], []
    for number in range(spot.deviates.shape[1]):
        off = np.zeros_like(spot.deviates)
        off[:, number] = step
        (e1, p1, t1), (e0, p0, t0) = (bench.see(replace(spot, deviates=spot.deviates + sign * off)) for sign in (1, -1))
        slope.append((flat(bench, row, e1, t1) - flat(bench, row, e0, t0)) / (2.0 * step))
        height_by.append((p1[row, 0] - p0[row, 0]) / (2.0 * step))
    by = np.stack(slope, axis=1)
    return Brute(observed(bench, row) - flat(bench, row, exit, track) + by @ spot.deviates[row], by,
                 noise_of(bench, row), variance_of(bench.intake, spot.log_scatter)[row][:len(height_by)],
                 float(plane[row, 0] - np.array(height_by) @ spot.deviates[row]), np.array(height_by))


@pytest.fixture(scope="module")
def brute(bench: Bench) -> dict[int, Brute]:
    return {row: written_out(bench, row) for row in SHOWN}


def column_slope(bench: Bench, name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What one column's input does to a shot that deviates as all do on average, by differences of `see`."""
    source, still, step = int(bench.layout.source[bench.scores.index(name)]), bench.still(), 1e-5
    sides = []
    for sign in (1.0, -1.0):
        if source < len(bench.layout.chain.slots):
            values = still.values.copy()
            values[source] += sign * step
            sides.append(bench.see(replace(still, values=values)))
        else:
            off = still.deviates.copy()
            off[:, source - len(bench.layout.chain.slots)] += sign * step
            sides.append(bench.see(replace(still, deviates=off)))
    return tuple((a - b) / (2.0 * step) for a, b in zip(*sides, strict=True))       # type: ignore[return-value]


def test_log_likelihoods_are_those_of_the_big_matrix_and_the_normal_cdf(bench: Bench, brute: dict[int, Brute]) -> None:
    places = {row: number for number, row in enumerate(bench.intake.marked.tolist())}
    for row, one in brute.items():
        value = one.log_density()
        if row in places:
            mean, spread = one.height_given()
            value += class_log(bench, places[row], mean, spread)
        assert bench.scores.log_score[row] == pytest.approx(value, abs=2e-3), row


def class_log(bench: Bench, place: int, mean: float, spread: float, wider: float = 0.0) -> float:
    """Log of the chance of what was seen of a height: by the normal CDF, intervals from rig.toml's half heights."""
    seen = bench.intake.seen
    if np.isfinite(seen.height_m[place]):
        clean = norm.logpdf(seen.height_m[place], mean, np.hypot(spread, HEIGHT_M))
        return float(np.logaddexp(np.log1p(-LAPSE) + clean, np.log(LAPSE / SLIP_M)))
    inside = {half: norm.cdf(half + wider, mean, spread) - norm.cdf(-half - wider, mean, spread)
              for half in (0.07, 0.35)}
    chance = (1.0 - inside[0.35], inside[0.35] - inside[0.07], inside[0.07])[int(seen.classes[place])]
    return float(np.log((1.0 - LAPSE) * chance + LAPSE / 3.0))


def test_scores_and_information_are_those_of_the_big_matrix(bench: Bench, brute: dict[int, Brute]) -> None:
    index = [bench.scores.index(name) for name in COLUMNS]
    slopes = [column_slope(bench, name) for name in COLUMNS]
    for row, one in brute.items():
        if not len(one.r):
            assert not bench.scores.linear[row].any() and not bench.scores.bend[row].any()
            continue
        by = np.stack([flat(bench, row, exit, track) for exit, _, track in slopes], axis=1)
        precise = np.linalg.inv(one.total)
        score, info = by.T @ precise @ one.r, by.T @ precise @ by
        size = np.sqrt(np.diag(info)) + 1e-9
        assert bench.scores.linear[row, index] / size == pytest.approx(score / size, abs=2e-3), row
        found = bench.scores.bend[row][np.ix_(index, index)] / np.outer(size, size)
        assert found == pytest.approx(info / np.outer(size, size), abs=1e-3), row


def test_scores_of_the_scatters_are_slopes_of_the_big_matrix(bench: Bench, brute: dict[int, Brute]) -> None:
    for number, (column, deviate) in enumerate(zip(bench.layout.scatters[:-1], (0, 1, 2, 4, 6, 7), strict=True)):
        for row, one in brute.items():
            if not len(one.r):
                continue
            own = bench.intake.scattered[row, number] * np.exp(2.0 * bench.point.log_scatter[number])
            sides = []
            for step in (1e-4, -1e-4):
                more = one.own.copy()
                more[deviate] += own * (np.exp(2.0 * step) - 1.0)
                sides.append(replace(one, own=more).log_density())
            assert bench.scores.linear[row, column] == pytest.approx((sides[0] - sides[1]) / 2e-4, abs=2e-3)
            half = own * one.slope[:, deviate] @ np.linalg.solve(one.total, one.slope[:, deviate])
            assert bench.scores.bend[row, column, column] == pytest.approx(2.0 * half**2, rel=1e-3, abs=1e-6)
