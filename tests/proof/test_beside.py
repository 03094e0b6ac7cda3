"""A round played again: near enough, or not."""

from math import comb

import pytest

from truearc_proof.report.compare_rounds import beside
from truearc_proof.scoring.information_bound import Measured
from truearc_proof.scoring.score_world import Mark, mark
from truearc_proof.worlds.sampling_plan import Drawn


def nulls(alarms: int, of: int) -> list[Mark]:
    return [mark(Drawn(f"w{k}", "numpy", "clean", "L0", 300, k, {}),
                 {"mismatch": {"found": k < alarms, "p_value": 0.5}, "verdict": "unknown", "where": None, "what": [],
                  "set": None, "fit": {"gain_per_shot": 0.0}, "also": []}, Measured()) for k in range(of)]


@pytest.mark.parametrize("alarms, inside", [(0, "no"), (1, "yes"), (2, "no"), (8, "no")])
def test_a_share_is_inside_only_between_the_ends_of_the_published_interval(alarms: int, inside: str) -> None:
    row = next(row for row in beside(nulls(2, 40), nulls(alarms, 10)).rows if row[0] == "false alarms, clean")
    assert row[1] == "2/40 = 0.05 (0.01-0.17)" and row[3] == inside


def test_an_interval_that_begins_at_nothing_has_nothing_in_it() -> None:
    rows = {row[0]: row[3] for row in beside(nulls(0, 19), nulls(0, 6)).rows}
    assert rows["false alarms, clean"] == "yes"


def test_chance_is_that_of_the_hypergeometric_distribution() -> None:
    row = next(row for row in beside(nulls(0, 5), nulls(5, 5)).rows if row[0] == "false alarms, clean")
    assert row[4] == f"{2 / comb(10, 5):.2f}"                # all five here or all five there, of all ways to deal them
