"""Changes of the MuJoCo world, and the tables of what was made of them."""

from typing import Any

import pytest

from benchmarks.launcher_world import make_tables
from truearc.sim.physics.catalogue import TERMS
from truearc.sim.physics.term import STAGES
from truearc.sim.world.options import Options
from truearc_proof.worlds.perturbations import CHANGES, Change, seen_at


@pytest.mark.parametrize("change", CHANGES, ids=lambda change: change.name)
def test_a_change_is_one_of_the_world_and_its_names_are_of_the_catalogue(change: Change) -> None:
    changed = Options(**change.options)
    assert (changed == Options()) == (change.name == "nothing")
    assert set(change.names) <= {term.name for term in TERMS}
    assert set(change.stages) <= set(STAGES)
    assert bool(change.names) == bool(change.stages) == bool(change.options)


def test_what_only_tracks_show_is_not_asked_of_outcomes() -> None:
    assert {change.name for change in seen_at("L2")} - {change.name for change in seen_at("L1")} == {"cross_wind"}


def line(name: str, found: bool, names: tuple[str, ...] = (), stage: str | None = None, **more: Any) -> dict[str, Any]:
    what = [{"term": one, "parameters": {"size": {"value": 0.5, "unit": "m"}}} for one in names]
    return {"name": name, "level": "L1", "seed": 7, "found": found, "p_value": 0.001, "set": list(names) or None,
            "verdict": "named" if names else "unknown" if found else "none", "where": {"stage": stage},
            "what": what, "also": [], **more}


def test_a_row_counts_what_was_right_of_what_was_found() -> None:
    lines = [line("tail_wind", True, ("wind_x",), "flight"), line("tail_wind", True, ("drag", "wind_x"), "flight"),
             line("tail_wind", True, (), "launch"), line("tail_wind", False), line("nothing", False)]
    table = make_tables(lines).splitlines()
    wind = next(row for row in table if row.startswith("| tail_wind"))
    assert "| 3/4 = 0.75 (0.30-0.95) | 2/3 | 1/3 | 2/3 |" in wind
    nothing = next(row for row in table if row.startswith("| nothing"))
    assert nothing.startswith("| nothing | 0/1 = 0.00 (0.00-0.79) | - | - | -")


def test_the_world_as_it_is_is_held_against_its_own_scatter() -> None:
    sizes = [{"before_m": 0.4, "after_m": 0.14, "scatter_m": 0.1}, {"before_m": 0.4, "after_m": 0.2, "scatter_m": 0.1}]
    table = make_tables([line("as-is", True, ("wheel_slip",), "launch", **one) for one in sizes])
    assert "wheel_slip 0.5 m" in table and "| 1.40 |" in table and "| 2.00 |" in table
    assert table.endswith("Adopted within 1.5 x the own scatter: 1 of 2; placed at the launch: 2 of 2.")
