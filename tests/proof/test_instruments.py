"""What a keeper reads off the tools that a solver may ask for."""

import numpy as np
import pytest

from truearc.sim.physics.catalogue import TERMS
from truearc_proof.rounds import TOOLS
from truearc_proof.rounds.worlds import PARAMETER, read_off


@pytest.mark.parametrize("tool", TOOLS)
def test_a_tool_is_what_discovery_proposes_for_its_terms(tool: str) -> None:
    assert {term.name for term in TERMS if term.instrument and term.instrument.id == tool} == set(TOOLS[tool])


@pytest.mark.parametrize("tool", TOOLS)
def test_readings_scatter_about_the_truth_by_their_stated_error(tool: str) -> None:
    """Of the first of the tool's terms; of the others there is nothing."""
    name, *others = TOOLS[tool]
    amount = 0.02
    readings = [read_off(tool, {name: amount}, seed) for seed in range(400)]
    for term in (name, *others):
        values, sd = np.array([one[term]["value"] for one in readings]), TOOLS[tool][term]
        wanted = PARAMETER[term][1](amount) if term == name else 0.0
        assert values.mean() == pytest.approx(wanted, abs=4.0 * sd / np.sqrt(len(values)))
        assert values.std() == pytest.approx(sd, rel=0.15)
        assert {one[term]["sd"] for one in readings} == {sd}
    assert readings[3] == read_off(tool, {name: amount}, 3)
