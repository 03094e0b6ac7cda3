"""A round played again: near enough, or not."""

from math import comb

import pytest

from sim.prove.marking import Mark, mark
from sim.prove.measure import Measured
from sim.prove.mix import Drawn
from sim.prove.proof_beside import beside


def nulls(alarms: int, of: int) -> list[Mark]:
    return [mark(Drawn(f"w{k}", "numpy", "clean", "L0", 300, k, {}),
                 {"mismatch": {"found": k < alarms, "p_value": 0.5}, "verdict": "unknown", "where": None, "what": [],
                  "set": None, "fit": {"gain_per_shot": 0.0}, "also": []}, Measured()) for k in range(of)]


@pytest.mark.parametrize("alarms, inside", [(0, "yes"), (1, "yes"), (2, "yes"), (8, "no")])
def test_a_share_is_inside_to_a_whole_world(alarms: int, inside: str) -> None:
    row = next(iter(beside(nulls(2, 40), nulls(alarms, 10)).rows))
    assert (row[0], row[3]) == ("false alarms, clean", inside)


def test_chance_is_that_of_the_hypergeometric_distribution() -> None:
    row = next(iter(beside(nulls(0, 5), nulls(5, 5)).rows))
    assert row[4] == f"{2 / comb(10, 5):.2f}"                # all five here or all five there, of all ways to deal them
