"""Draws are even, disjoint, and their own."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from truearc.errors import InputError
from truearc.sim.data.dataset import Shots
from truearc_proof.reproduce import Settings, quick
from truearc_proof.reproduce.collect import _even, draw

SETTINGS = Settings(base_seed=5)


def shots(column, **counts):
    outcomes = tuple(outcome for outcome, count in counts.items() for _ in range(count))
    return Shots(tuple(map(str, range(len(outcomes)))), {}, {column: outcomes})


REAL = shots("outcome", miss=90, two=120, three=80)
LAUNCHED = shots("simulated", miss=60, two=40, three=30)


def test_a_draw_is_the_papers_100_and_50_even_by_outcome():
    drawn = draw(REAL, LAUNCHED, SETTINGS, 3)
    assert (len(drawn.train), len(drawn.test), len(drawn.validation), len(drawn.transfer)) == (80, 20, 16, 50)
    for rows, column, pool in ((drawn.train, "outcome", REAL), (drawn.test, "outcome", REAL),
                               (drawn.validation, "outcome", REAL), (drawn.transfer, "simulated", LAUNCHED)):
        counts = [np.array(pool.text(column))[rows].tolist().count(kind) for kind in ("miss", "two", "three")]
        assert max(counts) - min(counts) <= 1, counts
    assert not set(drawn.train) & set(drawn.test) and set(drawn.validation) <= set(drawn.train)


def test_the_same_number_draws_alike_another_draws_otherwise():
    first, again, other = (draw(REAL, LAUNCHED, SETTINGS, number) for number in (1, 1, 2))
    assert all(np.array_equal(*pair) for pair in zip(first, again, strict=True))
    assert not np.array_equal(first.test, other.test) and not np.array_equal(first.transfer, other.transfer)


def test_what_was_launched_changes_nothing_in_what_was_drawn_of_the_recorded():
    with_it, without = draw(REAL, LAUNCHED, SETTINGS, 1), draw(REAL, None, SETTINGS, 1)
    assert np.array_equal(with_it.train, without.train) and len(without.transfer) == 0


@settings(deadline=None)
@given(st.integers(0, 30), st.integers(0, 30), st.integers(0, 30), st.integers(0, 60))
def test_a_rare_outcome_is_made_up_for_by_the_others(miss, two, three, count):
    outcomes = np.array(["miss"] * miss + ["two"] * two + ["three"] * three, dtype="U5")
    chosen = _even(outcomes, count, np.random.default_rng(0))
    assert len(chosen) == min(count, len(outcomes)) == len(set(chosen.tolist()))
    counts = {kind: int((outcomes[chosen] == kind).sum()) for kind in ("miss", "two", "three")}
    # water filling: nobody who is not exhausted has two fewer than another
    for kind, there in (("miss", miss), ("two", two), ("three", three)):
        assert counts[kind] == there or counts[kind] >= max(counts.values()) - 1


@pytest.mark.parametrize("change", [{"base_seed": -1}, {"draws": 1}])
def test_settings_that_cannot_be_are_told(change):
    with pytest.raises(InputError, match="--seed"):
        Settings(**change)


def test_quick_settings_are_possible():
    assert quick(5, 2).each <= quick(5, 2).pool_each
