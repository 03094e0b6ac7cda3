"""What outcomes say of a height: probabilities against the normal law, slopes and information against sums."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from scipy.stats import norm

from truearc.errors import InputError
from truearc.robot.config.rig_spec import Target
from truearc.sim.data.dataset import Shots
from truearc.sim.infer.likelihood import observations as outcomes
from truearc.sim.infer.likelihood.noise import LAPSE
from truearc.sim.infer.likelihood.observations import OutcomeObservations, see_outcomes, widened

TARGET = Target(2.44)
CELLS = (("miss", ""), ("two", ""), ("three", ""), ("miss", "low"), ("miss", "high"), ("two", "low"), ("two", "high"))
Cells = tuple[tuple[str, str], ...]
# All that can be told apart where a side is noted of no class, of misses (as drivers do), of both, of twos.
NOTED: tuple[Cells, ...] = (CELLS[:3], CELLS[1:5], CELLS[2:], (CELLS[0], *CELLS[5:], CELLS[2]))
means = st.floats(-1.0, 1.0)
spreads = st.floats(0.02, 0.6)


def seen_of(
    cells: list[tuple[str, str]], heights: list[float] | None = None, target: Target = TARGET
) -> OutcomeObservations:
    numbers = {} if heights is None else {"miss_height_m": np.array(heights)}
    shots = Shots(tuple(map(str, range(len(cells)))), numbers,
                  {"outcome": tuple(c[0] for c in cells), "side": tuple(c[1] for c in cells)})
    return see_outcomes(shots, target)[1]


def chance(seen: OutcomeObservations, mean: float, spread: float) -> np.ndarray:
    n = len(seen.low)
    return np.exp(outcomes.log_likelihood(seen, np.full(n, mean), np.full(n, spread)))


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
    value = outcomes.log_likelihood
    moved = ((value(seen, m + step, s), value(seen, m - step, s)),
             (value(seen, m, s * np.exp(step)), value(seen, m, s * np.exp(-step))),
             tuple(value(widened(seen, np.full(n, sign * step)), m, s) for sign in (1.0, -1.0)))
    for slope, (more, less) in zip(outcomes.slopes(seen, m, s), moved, strict=True):
        assert np.allclose(slope, (more - less) / (2 * step), atol=1e-4 / spread**2)


@settings(max_examples=30, deadline=None)
@given(wider=st.floats(-0.05, 0.1), mean=means, spread=spreads)
def test_a_more_forgiving_rim_is_a_larger_target(wider: float, mean: float, spread: float) -> None:
    larger = replace(TARGET, three_half_height_m=0.07 + wider, two_half_height_m=0.35 + wider)
    cells, many = list(CELLS), np.full(len(CELLS), wider)
    assert chance(widened(seen_of(cells), many), mean, spread) == pytest.approx(
        chance(seen_of(cells, target=larger), mean, spread), abs=1e-12)


@settings(max_examples=30, deadline=None)
@given(mean=means, spread=spreads, cells=st.sampled_from(NOTED))
def test_information_is_the_mean_square_slope_over_what_can_happen(mean: float, spread: float, cells: Cells) -> None:
    seen = seen_of(list(cells))
    m, s = np.full(len(cells), mean), np.full(len(cells), spread)
    slope = np.stack(outcomes.slopes(seen, m, s), axis=1)
    expected = np.einsum("k,ki,kj->ij", chance(seen, mean, spread), slope, slope)
    assert np.allclose(outcomes.information(seen, m, s)[0], expected, rtol=1e-6, atol=1e-9)


def test_aimed_at_the_centre_a_class_says_nothing_of_the_side_but_a_noted_one_does() -> None:
    """The design notes' figures: 0 without sides, three quarters of a measured height with them; of misses alone, that
    are rare here, hardly any."""
    spread = np.full(4, 0.12)
    measured = 1.0 / 0.12**2
    plain = outcomes.information(seen_of([("miss", ""), *CELLS[:3]]), np.zeros(4), spread)[0, 0, 0] / measured
    sided = outcomes.information(seen_of([*CELLS[3:7]]), np.zeros(4), spread)[0, 0, 0] / measured
    of_misses = outcomes.information(seen_of([*CELLS[3:5], *CELLS[1:3]]), np.zeros(4), spread)[0, 0, 0] / measured
    assert plain == pytest.approx(0.0, abs=1e-9)
    assert 0.6 < sided < 0.9
    assert 0.0 < of_misses < 0.1


def test_sideways_misses_are_not_used_and_a_missing_target_is_named() -> None:
    shots = Shots(("a", "b"), {}, {"outcome": ("miss", "three"), "side": ("left", "")})
    assert see_outcomes(shots, TARGET)[0].tolist() == [1]
    with pytest.raises(InputError, match="target"):
        see_outcomes(shots, None)
