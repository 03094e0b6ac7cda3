"""Decoys, where everything is linear and their law is known."""

import numpy as np

from tests.sim.discover.straight import fit_straight
from truearc.sim.discover.select.selection_step import share_above
from truearc.sim.discover.select.term_ranking import name_terms, visible_terms

PLANTED = "spin_drag.share"


def share(planted: dict[str, float], seed: int) -> float:
    fitted = fit_straight(planted, seed)
    naming = name_terms(fitted, lambda done, note: None)
    return share_above(fitted.evidence, len(fitted.evidence.rows), naming.nats[naming.leader], seed)


def test_no_decoy_equals_a_clear_name() -> None:
    assert max(share({PLANTED: 0.6}, seed) for seed in range(6)) == 0.0


def test_where_there_is_nothing_the_share_is_uniform() -> None:
    """The best name is one more decoy: at most a tenth falls into the lowest tenth, within chance."""
    shares = np.array([share({}, seed) for seed in range(40)])
    assert 0.3 < shares.mean() < 0.7
    assert (shares <= 0.1).sum() <= 10


def test_shares_are_those_of_signs_drawn_by_hand() -> None:
    fitted = fit_straight({}, 3)
    found = [share_above(fitted.evidence, len(fitted.evidence.rows), nats, 0) for nats in (-1e9, 0.0, 2.0, 1e9)]
    assert found[0] == 1.0 and found[-1] == 0.0 and found == sorted(found, reverse=True)
    # with K nearly independent decoys the best of a deal is the largest of K
    count = len(visible_terms(fitted.evidence))
    assert count >= 10 and found[1] > 0.5
