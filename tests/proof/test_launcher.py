"""Changes of the MuJoCo world, and the tables of what was made of them."""

import pytest

from benchmarks.launcher_world import make_table
from truearc.sim.physics.catalogue import TERMS
from truearc.sim.physics.term import STAGES
from truearc.sim.world.options import Options
from truearc_proof.rounds.worlds import CHANGES, Change, seen_at


@pytest.mark.parametrize("change", CHANGES, ids=lambda change: change.name)
def test_a_change_is_one_of_the_world_and_its_names_are_of_the_catalogue(change: Change) -> None:
    changed = Options(**change.options)
    assert (changed == Options()) == (change.name == "nothing")
    assert set(change.names) <= {term.name for term in TERMS}
    assert set(change.stages) <= set(STAGES)
    assert bool(change.names) == bool(change.stages) == bool(change.options)


def test_what_only_tracks_show_is_not_asked_of_outcomes() -> None:
    assert {change.name for change in seen_at("L2")} - {change.name for change in seen_at("L1")} == {"cross_wind"}


def test_the_world_as_it_is_is_held_against_its_own_scatter() -> None:
    sizes = [{"before_m": 0.4, "after_m": 0.14, "scatter_m": 0.1}, {"before_m": 0.4, "after_m": 0.2, "scatter_m": 0.1}]
    what = [{"term": "wheel_slip", "parameters": {"size": {"value": 0.5, "unit": "m"}}}]
    table = make_table([{"level": "L1", "seed": 7, "p_value": 0.001, "set": ["wheel_slip"], "verdict": "named",
                         "where": {"stage": "launch"}, "what": what, "also": [], **one} for one in sizes])
    assert "wheel_slip 0.5 m" in table and "| 1.40 |" in table and "| 2.00 |" in table
    assert table.endswith("Adopted within 1.5 x the own scatter: 1 of 2; placed at the launch: 2 of 2.")
