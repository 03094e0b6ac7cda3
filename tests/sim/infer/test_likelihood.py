"""Likelihood and forecasts against other code: flights by Monte Carlo, the normal law, slopes against sums."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from scipy import stats
from scipy.stats import norm

from tests.sim.infer import independent
from tests.sim.infer.independent import Truth
from tests.sim.physics import reference
from tests.sim.physics.rigs import GUPPY
from truearc.errors import InputError
from truearc.robot.config.rig_spec import Target
from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.infer.belief import Belief, draw, point_belief
from truearc.sim.infer.forecast import forecast
from truearc.sim.infer.launcher import USUAL_SCATTER
from truearc.sim.infer.likelihood.data import take_in
from truearc.sim.infer.likelihood.heights import HeightOutcomes, see_heights
from truearc.sim.infer.likelihood.layout import Point, lay_out, only_shared
from truearc.sim.infer.likelihood.linearization import linearise
from truearc.sim.infer.likelihood.noise import EXIT_SPEED_M_S, LAPSE
from truearc.sim.infer.likelihood.score_table import ScoreTable

TRUTH = Truth(speed_sd=0.02, elevation_sd_deg=0.5)


def _at_truth(shots: Shots) -> tuple[ScoreTable, np.ndarray]:
    """(evidence, most likely deviates) where the coefficients and scatters are the truth's."""
    intake = take_in(Dataset("d", GUPPY, shots), fewest=1)
    layout = only_shared(lay_out(intake, ("gravity", "drag", "magnus", "exit_efficiency")))
    values, log_scatter = layout.usual.copy(), USUAL_SCATTER.copy()
    log_scatter[:2] = np.log([TRUTH.speed_sd, np.radians(TRUTH.elevation_sd_deg)])
    for slot, value in {("drag", "cd"): TRUTH.cd, ("magnus", "cl"): TRUTH.cl,
                        ("exit_efficiency", "loss"): TRUTH.loss}.items():
        values[layout.chain.slots.index(slot)] = value
    return linearise(intake, layout, Point.still(layout, len(intake.rows), values, log_scatter))


def test_outcomes_are_those_of_many_real_shots():
    """20 000 shots at each of six configurations by other code; the model's normal heights are not theirs exactly."""
    rng = np.random.default_rng(5)
    configuration = independent.configurations(rng, TRUTH, 6)
    shots = Shots(tuple("abcdef"), dict(zip(("distance_m", "hood_deg", "motor_ratio"), configuration, strict=True)),
                  {"outcome": ("miss",) * 6})
    plane = _at_truth(shots)[0].plane
    said = plane.seen.class_chances(plane.mean_m, plane.spread_m)
    many = 20_000
    for row in range(6):
        columns = [np.full(many, column[row]) for column in configuration]
        words = np.array(independent.outcomes(independent.fired(rng, TRUTH, *columns)))
        share = np.array([(words == word).mean() for word in ("miss", "two", "three")])
        clean = (said[row] - LAPSE / 3) / (1 - LAPSE)
        np.testing.assert_allclose(clean, share, atol=0.015 + 4 * 0.5 / np.sqrt(many))
    assert said.max() - said.min() > 0.5             # the six are different enough to mean something


def test_a_measured_exit_speed_is_a_normal_reading_of_the_launch():
    ratio, seen = np.array([0.6, 0.6]), np.array([9.0, 9.1])      # two: what is constant says nothing
    shots = Shots(("a", "b"), {"motor_ratio": ratio, "hood_deg": np.full(2, 45.0), "exit_speed_m_s": seen}, {})
    evidence, deviates = _at_truth(shots)
    speed = reference.exit_of(ratio[0])[0] * (1 - TRUTH.loss)
    wheels = 0.5 * np.hypot(reference.LOWER_RADIUS_M, reference.UPPER_RADIUS_M) / 2 / reference.exit_of(ratio[0])[0]
    scatter, noise = TRUTH.speed_sd**2 + wheels**2, (EXIT_SPEED_M_S / seen)**2
    off = np.log(seen / speed)
    np.testing.assert_allclose(evidence.log_score, stats.norm.logpdf(off, 0.0, np.sqrt(scatter + noise)), rtol=1e-9)
    np.testing.assert_allclose(deviates[:, 0], off * scatter / (scatter + noise), rtol=1e-9)


TARGET = Target(2.44)
CELLS = (("miss", ""), ("two", ""), ("three", ""), ("miss", "low"), ("miss", "high"), ("two", "low"), ("two", "high"))
Cells = tuple[tuple[str, str], ...]
# All that can be told apart where a side is noted of no class, of misses (as drivers do), of both, of twos.
NOTED: tuple[Cells, ...] = (CELLS[:3], CELLS[1:5], CELLS[2:], (CELLS[0], *CELLS[5:], CELLS[2]))
means = st.floats(-1.0, 1.0)
spreads = st.floats(0.02, 0.6)


def seen_of(cells: list[tuple[str, str]], heights: list[float] | None = None, target: Target = TARGET
) -> HeightOutcomes:
    numbers = {} if heights is None else {"miss_height_m": np.array(heights)}
    shots = Shots(tuple(map(str, range(len(cells)))), numbers,
                  {"outcome": tuple(c[0] for c in cells), "side": tuple(c[1] for c in cells)})
    return see_heights(shots, target)[1]


def chance(seen: HeightOutcomes, mean: float, spread: float) -> np.ndarray:
    n = len(seen.low)
    return np.exp(seen.log_likelihood(np.full(n, mean), np.full(n, spread)))


@settings(max_examples=50, deadline=None)
@given(mean=means, spread=spreads)
def test_probabilities_are_those_of_the_normal_law(mean: float, spread: float) -> None:
    p = chance(seen_of(list(CELLS)), mean, spread)
    cdf = lambda z: norm.cdf((z - mean) / spread)                                              # noqa: E731
    three, low_two, high_two = cdf(0.07) - cdf(-0.07), cdf(-0.07) - cdf(-0.35), cdf(0.35) - cdf(0.07)
    exact = np.array([1.0 - cdf(0.35) + cdf(-0.35), low_two + high_two, three, cdf(-0.35), 1.0 - cdf(0.35), low_two,
                      high_two])
    assert np.allclose(p, (1.0 - LAPSE) * exact + LAPSE / 3.0, atol=1e-10)
    assert p[:3].sum() == pytest.approx(1.0)


@settings(max_examples=50, deadline=None)
@given(mean=means, spread=spreads, measured=st.floats(-1.0, 1.0))
def test_slopes_agree_with_differences(mean: float, spread: float, measured: float) -> None:
    seen = seen_of([*CELLS, ("", "")], [np.nan] * len(CELLS) + [measured])
    n, step = len(seen.low), 1e-6
    m, s = np.full(n, mean), np.full(n, spread)
    moved = ((seen.log_likelihood(m + step, s), seen.log_likelihood(m - step, s)),
             (seen.log_likelihood(m, s * np.exp(step)), seen.log_likelihood(m, s * np.exp(-step))),
             tuple(seen.moved(np.full((n, 1), sign * step)).log_likelihood(m, s) for sign in (1.0, -1.0)))
    for slope, (more, less) in zip(seen.slopes(m, s), moved, strict=True):
        assert np.allclose(slope, (more - less) / (2 * step), atol=1e-4 / spread**2)


@settings(max_examples=30, deadline=None)
@given(wider=st.floats(-0.05, 0.1), mean=means, spread=spreads)
def test_a_more_forgiving_rim_is_a_larger_target(wider: float, mean: float, spread: float) -> None:
    larger = replace(TARGET, three_half_height_m=0.07 + wider, two_half_height_m=0.35 + wider)
    cells, many = list(CELLS), np.full((len(CELLS), 1), wider)
    assert chance(seen_of(cells).moved(many), mean, spread) == pytest.approx(
        chance(seen_of(cells, target=larger), mean, spread), abs=1e-12)


@settings(max_examples=30, deadline=None)
@given(mean=means, spread=spreads, cells=st.sampled_from(NOTED))
def test_information_is_the_mean_square_slope_over_what_can_happen(mean: float, spread: float, cells: Cells) -> None:
    seen = seen_of(list(cells))
    m, s = np.full(len(cells), mean), np.full(len(cells), spread)
    slope = np.stack(seen.slopes(m, s), axis=1)
    expected = np.einsum("k,ki,kj->ij", chance(seen, mean, spread), slope, slope)
    assert np.allclose(seen.information(m, s)[0], expected, rtol=1e-6, atol=1e-9)


def test_sideways_misses_are_not_used_and_a_missing_target_is_named() -> None:
    shots = Shots(("a", "b"), {}, {"outcome": ("miss", "three"), "side": ("left", "")})
    assert see_heights(shots, TARGET)[0].tolist() == [1]
    with pytest.raises(InputError, match="target"):
        see_heights(shots, None)


EXACT = {"drag": {"cd": TRUTH.cd}, "magnus": {"cl": TRUTH.cl}, "exit_efficiency": {"loss": TRUTH.loss}}
CONFIGURATION = independent.configurations(np.random.default_rng(2), TRUTH, 5)


def _shots(configuration=CONFIGURATION) -> Shots:
    names = ("distance_m", "hood_deg", "motor_ratio")
    return Shots(tuple(map(str, range(len(configuration[0])))), dict(zip(names, configuration, strict=True)), {})


def _clean_height(truth: Truth) -> np.ndarray:
    distance_m, hood_deg, ratio = CONFIGURATION
    speed, spin = reference.exit_of(ratio)
    return independent.heights(distance_m, speed * (1 - truth.loss), np.radians(hood_deg), spin, truth)


def test_heights_and_scatter_are_those_of_many_shots():
    """Launch scatter and sensor noise together; a point belief adds no uncertainty."""
    ahead = forecast(GUPPY, point_belief(EXACT, {"speed": 0.02, "elevation_deg": 0.5}), _shots())
    np.testing.assert_allclose(ahead.height_m, _clean_height(TRUTH), atol=1e-5)
    np.testing.assert_array_equal(ahead.parameter_m, 0.0)
    rng = np.random.default_rng(3)
    for row in range(5):
        columns = [np.full(8000, column[row]) for column in CONFIGURATION]
        fired = independent.fired(rng, TRUTH, *columns)
        assert ahead.sigma_m[row] == pytest.approx(fired.std(), rel=0.05)
    np.testing.assert_allclose(ahead.sigma_m**2, ahead.launch_m**2 + ahead.sensor_m**2, rtol=1e-12)


def test_doubt_about_the_belief_is_that_of_its_draws():
    names = ("drag.cd", "exit_efficiency.loss", "magnus.cl")
    factor = np.array([[0.06, 0, 0], [-0.015, 0.005, 0], [0.0, 0.001, 0.003]])
    belief = Belief(EXACT, {}, names, factor @ factor.T)
    ahead = forecast(GUPPY, belief, _shots())
    heights = [_clean_height(Truth(one.coefficients["drag"]["cd"], one.coefficients["magnus"]["cl"],
                                   one.coefficients["exit_efficiency"]["loss"]))
               for one in draw(belief, 400, np.random.default_rng(5))]
    np.testing.assert_allclose(ahead.parameter_m, np.std(heights, axis=0), rtol=0.15)


def test_the_slopes_are_those_of_dop853():
    ahead = forecast(GUPPY, point_belief(EXACT), _shots())
    distance_m, hood_deg, ratio = CONFIGURATION
    speed, spin = reference.exit_of(ratio)

    def height(log_speed=0.0, elevation=0.0, turns=0.0, further=0.0):
        return independent.heights(distance_m + further, speed * 0.75 * np.exp(log_speed),
                                   np.radians(hood_deg) + elevation, spin + turns, TRUTH)

    for column, name in enumerate(("log_speed", "elevation", "turns", "further")):
        slope = (height(**{name: 1e-3}) - height(**{name: -1e-3})) / 2e-3
        np.testing.assert_allclose(ahead.by_launch[:, column], slope, rtol=2e-3, atol=1e-4)


def test_a_ball_that_turns_back_has_no_height():
    lift = {"drag": {"cd": 0.5}, "magnus": {"cl": 3.0}}
    ahead = forecast(GUPPY, point_belief(lift), _shots((np.array([6.0]), np.array([50.0]), np.array([0.6]))))
    assert np.isnan([ahead.height_m[0], ahead.sigma_m[0]]).all()


def test_a_measured_exit_has_no_scatter_left():
    shots = _shots()
    speed = reference.exit_of(CONFIGURATION[2])[0] * 0.75
    measured = Shots(shots.shot_id, {**shots.numbers, "exit_speed_m_s": speed, "exit_deg": CONFIGURATION[1]}, {})
    ahead = forecast(GUPPY, point_belief(EXACT, {"speed": 0.02, "elevation_deg": 0.5}), measured)
    np.testing.assert_array_equal(ahead.launch_m, 0.0)
    np.testing.assert_allclose(ahead.height_m, _clean_height(TRUTH), atol=1e-5)     # and no loss on top of it
