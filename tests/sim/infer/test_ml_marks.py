"""Marks as intervals of a normal height: against SciPy, in the tails too, and against finite differences."""

import jax
import jax.numpy as jnp
import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jaxtyping import TypeCheckError
from scipy import integrate, special, stats

from truearc.robot.config.rig_spec import Target
from truearc.sim.infer.likelihood.outcome_likelihood import (
    FAR_M,
    HEIGHT_SD_M,
    LAPSE,
    interval,
    log_between,
    log_marks,
    make_marks,
    outcome_probabilities,
)
from truearc.sim.physics.term import Opening

TARGET = Target(2.44)
OPENING = Opening(*msgspec.structs.astuple(TARGET))
NAN = np.full(1, np.nan)
WORDS = (("miss", "low"), ("two", "low"), ("three", ""), ("two", "high"), ("miss", "high"))


def _one(outcome, side, mean, sd, height=np.nan) -> float:
    marks = make_marks(TARGET, (outcome,), (side,), np.array([height]))
    return float(log_marks(marks, jnp.array([mean]), jnp.array([sd]))[0])


@settings(deadline=None, max_examples=60)
@given(st.floats(-3, 3), st.floats(0.01, 2.0))
def test_the_five_places_share_one_probability(mean, sd):
    """Lapses apart, a ball is in exactly one of them."""
    clean = [(np.exp(_one(*words, mean, sd)) - LAPSE / 3) / (1 - LAPSE) for words in WORDS]
    assert sum(clean) == pytest.approx(1.0, abs=1e-9)
    edges = (-np.inf, -0.35, -0.07, 0.07, 0.35, np.inf)
    np.testing.assert_allclose(clean, np.diff(stats.norm.cdf(edges, mean, sd)), atol=1e-9)


@settings(deadline=None, max_examples=60)
@given(st.floats(-3, 3), st.floats(0.01, 2.0))
def test_an_outcome_alone_is_its_two_sides(mean, sd):
    table = np.asarray(outcome_probabilities(OPENING, jnp.array([mean]), jnp.array([sd])))[0]
    assert table.sum() == pytest.approx(1.0, abs=1e-9)
    for column, outcome in enumerate(("miss", "two", "three")):
        whole = np.exp(_one(outcome, "", mean, sd))
        assert whole == pytest.approx(table[column], abs=1e-9)
        if outcome != "three":
            parts = [np.exp(_one(outcome, side, mean, sd)) for side in ("low", "high")]
            assert whole == pytest.approx(sum(parts) - LAPSE / 3, abs=1e-9)


@pytest.mark.parametrize(("low", "high", "mean", "sd"), [(0.07, 0.35, 9.0, 0.05), (-0.35, -0.07, 9.0, 0.05),
                                                         (0.35, FAR_M, -4.0, 0.1), (0.07, 0.0700001, 0.3, 0.4)])
def test_tails_are_right_to_the_last_digits(low, high, mean, sd):
    """Against the integral of the density divided by its greatest value in the interval."""
    nearest = np.clip(mean, low, high)
    peak = stats.norm.logpdf(nearest, mean, sd)
    width = min(high - low, 60.0 * sd**2 / max(abs(nearest - mean), sd))
    ends = (low, low + width) if nearest == low else (high - width, high)
    share = integrate.quad(lambda z: np.exp(stats.norm.logpdf(z, mean, sd) - peak), *ends, epsabs=0, epsrel=1e-12)[0]
    got = float(log_between(low, high, jnp.array(mean), jnp.array(sd)))
    assert got == pytest.approx(peak + np.log(share), rel=1e-10)


@pytest.mark.parametrize("mean", [-40.0, -0.4, 0.0, 0.2, 3.0, 80.0])
def test_derivatives_are_those_of_the_normal(mean):
    """d log P/d mean = -(pdf(high) - pdf(low)) / P, by SciPy in logs; third derivatives finite.

    A thousand standard deviations away second derivatives are still good to four digits; at ten thousand to one.
    """
    def value(at):
        return log_between(0.07, 0.35, at[0], jnp.exp(at[1]))

    at = jnp.array([mean, np.log(0.08)])
    slope = jax.jacfwd(value)(at)
    places = (np.array([0.07, 0.35]) - mean) / 0.08
    log_p = special.log_ndtr(-places[0]) if mean < 0.07 else special.log_ndtr(places[1])
    if abs(mean) > 1.0:
        near = 0 if mean < 0.07 else 1
        sign = 1.0 if mean < 0.07 else -1.0
        assert slope[0] == pytest.approx(sign * np.exp(stats.norm.logpdf(places[near]) - log_p) / 0.08, rel=1e-7)
    else:
        share = np.diff(stats.norm.cdf(places))[0]
        assert slope[0] == pytest.approx(-np.diff(stats.norm.pdf(places))[0] / share / 0.08, rel=1e-7)
    step = 1e-5 * max(1.0, abs(mean))
    ends = jax.jacfwd(value)(at + jnp.array([step, 0.0])), jax.jacfwd(value)(at - jnp.array([step, 0.0]))
    np.testing.assert_allclose(jax.jacfwd(jax.jacfwd(value))(at)[:, 0], (ends[0] - ends[1]) / (2 * step), rtol=1e-4)
    assert np.isfinite(jax.jacfwd(jax.jacfwd(jax.jacfwd(value)))(at)).all()


def test_one_wrong_mark_cannot_rule():
    assert _one("three", "", 30.0, 0.05) == pytest.approx(np.log(LAPSE / 3))
    assert _one("miss", "low", 30.0, 0.05) == pytest.approx(np.log(LAPSE / 3))
    assert _one("two", "", 0.0, 0.05, height=30.0) == pytest.approx(np.log(LAPSE / 4))


def test_a_measured_height_counts_alone():
    clean = stats.norm.pdf(0.2, 0.1, np.hypot(0.08, HEIGHT_SD_M))
    for words in (("two", "high"), ("miss", ""), ("", "")):
        got = np.exp(_one(*words, 0.1, 0.08, height=0.2))
        assert got == pytest.approx((1 - LAPSE) * clean + LAPSE / 4, rel=1e-12)


def test_what_words_leave_open():
    nothing = (0.0, 0.0)
    assert interval(TARGET, "three", "") == (-0.07, 0.07, *nothing)
    assert interval(TARGET, "two", "") == (-0.35, -0.07, 0.07, 0.35)
    assert interval(TARGET, "two", "low") == (-0.35, -0.07, *nothing)
    assert interval(TARGET, "two", "left") == (-0.35, 0.35, *nothing)
    assert interval(TARGET, "", "low") == (-FAR_M, 0.0, *nothing)
    for words in (("miss", "left"), ("miss", "right"), ("", "left"), ("", "")):
        assert not make_marks(TARGET, words[:1], words[1:], NAN).marked[0] or interval(TARGET, *words)[:2] != nothing
    assert not make_marks(TARGET, ("miss",), ("left",), NAN).marked[0]
    assert not make_marks(TARGET, ("",), ("",), NAN).marked[0]


def test_marks_of_another_length_than_the_heights_are_refused() -> None:
    marks = make_marks(TARGET, ("two",), ("",), np.array([np.nan]))
    with pytest.raises(TypeCheckError, match="sd_m"):
        log_marks(marks, jnp.zeros(1), jnp.ones(2))
