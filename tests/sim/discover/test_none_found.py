"""A verdict 'none' says first what could not have been seen, and `design` plans the measurements that would show it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import truearc as ta

EXAMPLE = Path(__file__).parents[3] / "examples" / "spreadsheet"
TERMS = ["gravity", "drag", "magnus", "exit_efficiency"]


@pytest.fixture(scope="module")
def quiet() -> tuple[ta.Dataset, ta.Finding]:
    """The example's shots, with heights that the simulation itself forecasts, and scatter."""
    dataset = imagine(ta.load_dataset(EXAMPLE))
    return dataset, ta.discover(dataset, believe=TERMS)


def imagine(week: ta.Dataset, drag: float | None = None) -> ta.Dataset:
    """The settings of `week`, with heights that the fitted simulation forecasts (or with this drag), and scatter."""
    belief = ta.fit(week, TERMS).belief
    if drag is not None:
        belief = replace(belief, coefficients={**belief.coefficients, "drag": {"cd": drag}})
    height = np.array(ta.predict(week, belief).column("deviation_m"), float)
    shots = {"shot_id": week.shots.shot_id, **week.shots.numbers,
             "miss_height_m": height + np.random.default_rng(1).normal(0.0, 0.1, len(height))}
    return ta.dataset(shots, rig=week.rig)


def test_none_says_what_could_not_have_been_seen_before_what_could(quiet: tuple[ta.Dataset, ta.Finding]) -> None:
    found = quiet[1]
    assert found.verdict == "none"
    assert 0 < found.sentence.index("could not have shown") < found.sentence.index("Smallest effects")
    could = {one.term: one for one in ta.identifiability(quiet[0]).sight.terms}
    assert found.record.next
    for step in found.record.next:
        assert step["do"] == "measure" and f"measure {step['what']}" in found.sentence
        for term in step["shows"]:                        # with one test alone, too, at most a little would be seen
            assert could[term].smallest is None or could[term].smallest > 0.3 * could[term].usual, term


def test_design_after_none_plans_those_measurements(quiet: tuple[ta.Dataset, ta.Finding]) -> None:
    plan, found = ta.design_shots(*quiet), quiet[1]
    assert plan.verdict == "none"
    for step in found.record.next:
        assert any(f"Measure {step['what']}" in line for line in plan.lines())
        assert f'"instrument": "{step["instrument"]}"' in plan.to_json()


def test_a_fitted_number_that_was_believed_all_but_impossible_is_doubted(quiet: tuple[ta.Dataset, ta.Finding]) -> None:
    assert not quiet[1].record.data.improbable and "impossible" not in quiet[1].sentence
    heavy = imagine(ta.load_dataset(EXAMPLE), 1.5)
    found = ta.discover(heavy, believe=TERMS)
    assert found.verdict == "none"
    (name, value), = found.record.data.improbable.items()
    assert name == "drag.cd" and value > 1.0
    assert f"drag.cd {value:.3g}, believed all but impossible" in found.sentence
