"""Flights are matched to shots by the pattern of their times, or a sentence says why not."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from truearc.errors import InputError
from truearc.sim.video.match import match_by_order, match_times


def season(seed: int, shots: int, *, even: bool = False) -> np.ndarray:
    """Times of shots, some seconds apart as people and robots take them."""
    rng = np.random.default_rng(seed)
    gaps = np.full(shots, 4.0) if even else rng.uniform(2.0, 9.0, shots)
    return 100.0 + np.cumsum(gaps)


def filmed(rng: np.random.Generator, shot_s: np.ndarray, first: int, count: int, *, offset_s: float, drift: float,
           jitter_s: float, seen: float, strays: int) -> tuple[np.ndarray, np.ndarray, tuple[float, float]]:
    """(times of flights in a clip of some of the shots, their rows or -1, begin and end of the clip)."""
    rows = np.arange(first, first + count)
    begin, end = shot_s[rows[0]] - 1.0, shot_s[rows[-1]] + 2.0
    kept = rows[rng.random(count) < seen]
    times = np.concatenate([shot_s[kept] + rng.normal(0.15, jitter_s, len(kept)), rng.uniform(begin, end, strays)])
    truth = np.concatenate([kept, np.full(strays, -1)])
    order = np.argsort(times)
    def on_clip(t_s):
        return (t_s - begin) * (1.0 + drift) + offset_s
    return on_clip(times[order]), truth[order], (on_clip(begin), on_clip(end))


@settings(max_examples=60)
@given(seed=st.integers(0, 999), shots=st.integers(20, 120), count=st.integers(8, 20),
       offset_s=st.floats(-500.0, 500.0), drift=st.floats(-2e-4, 2e-4), jitter_s=st.sampled_from([0.005, 0.02, 0.04]),
       seen=st.sampled_from([1.0, 0.85]), strays=st.integers(0, 2))
def test_no_flight_gets_another_shot(seed, shots, count, offset_s, drift, jitter_s, seen, strays):
    rng = np.random.default_rng(seed)
    shot_s = season(seed, shots)
    first = int(rng.integers(0, shots - count + 1))
    flight_s, truth, view = filmed(rng, shot_s, first, count, offset_s=offset_s, drift=drift, jitter_s=jitter_s,
                                   seen=seen, strays=strays)
    matching = match_times(flight_s, shot_s, *view)
    claimed = matching.shots >= 0 if len(matching.shots) else np.zeros(len(truth), dtype=bool)
    real = claimed & (truth >= 0)
    assert (matching.shots[real] == truth[real]).all() if claimed.any() else True
    if (truth >= 0).sum() >= 10 and jitter_s <= 0.02:
        assert not matching.refusal, matching
        assert real.sum() >= 0.9 * (truth >= 0).sum()


@settings(max_examples=30)
@given(seed=st.integers(0, 999), offset_s=st.floats(-100.0, 100.0))
def test_even_intervals_are_refused_with_two_shifts(seed, offset_s):
    rng = np.random.default_rng(seed)
    shot_s = season(seed, 40, even=True)
    flight_s, _, view = filmed(rng, shot_s, 10, 12, offset_s=offset_s, drift=0.0, jitter_s=0.01, seen=1.0, strays=0)
    matching = match_times(flight_s, shot_s, *view)
    assert "fit alike" in matching.refusal
    assert (matching.shots == -1).all()
    assert matching.rival is not None
    gap = abs(matching.best.offset_s - matching.rival.offset_s)
    assert gap > 3.9
    assert f"{matching.rival.offset_s:.2f}" in str(matching)


@settings(max_examples=60)
@given(seed=st.integers(0, 999), shots=st.integers(10, 200), flights=st.integers(3, 25))
def test_clip_of_another_day_is_not_matched(seed, shots, flights):
    shot_s, flight_s = season(seed, shots), season(seed + 5000, flights)
    assert match_times(flight_s, shot_s, flight_s[0] - 1.0, flight_s[-1] + 2.0).refusal


def test_shots_before_the_recording_leave_others_matched():
    rng = np.random.default_rng(4)
    shot_s = season(4, 40)
    flight_s, truth, view = filmed(rng, shot_s, 0, 25, offset_s=30.0, drift=1e-4, jitter_s=0.01, seen=1.0, strays=0)
    matching = match_times(flight_s, shot_s[8:], *view)
    assert (matching.shots[8:] == truth[8:] - 8).all() and (matching.shots[:8] == -1).all()
    assert "as likely as the next" in str(matching)


def test_few_flights_have_no_pattern():
    assert "2 flights" in match_times(np.array([1.0, 2.0]), np.arange(9.0), 0.0, 3.0).refusal


def test_order_needs_equal_numbers():
    assert match_by_order(3, 3).tolist() == [0, 1, 2]
    with pytest.raises(InputError, match="4 flights and 3 shots"):
        match_by_order(4, 3)
