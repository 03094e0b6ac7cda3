"""A verdict 'none' says first what could not have been seen, and `design` plans the measurements that would show it."""

from pathlib import Path

import numpy as np
import pytest

import truearc as ta
from tests.sim.discover.odd_rigs import make_drops

EXAMPLE = Path(__file__).parents[3] / "examples" / "spreadsheet"


@pytest.fixture(scope="module")
def quiet() -> tuple[ta.Dataset, ta.Finding]:
    """The example's shots, with heights that the simulation itself forecasts, and scatter."""
    week = ta.load_dataset(EXAMPLE)
    belief = ta.fit(week, ["gravity", "drag", "magnus", "exit_efficiency"]).belief
    height = np.array(ta.predict(week, belief).column("deviation_m"), float)
    shots = {"shot_id": week.shots.shot_id, **week.shots.numbers,
             "miss_height_m": height + np.random.default_rng(1).normal(0.0, 0.1, len(height))}
    dataset = ta.dataset(shots, rig=week.rig)
    return dataset, ta.discover(dataset, believe=["gravity", "drag", "magnus", "exit_efficiency"])


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


def test_with_tracks_no_filming_is_suggested() -> None:
    for cd, believe in ((0.0, ["gravity", "drag"]), (0.5, ["gravity"])):
        found = ta.discover(make_drops(14, 1, cd=cd), believe=believe)
        assert not any("camera" in str(step.get("what")) and "flight" in str(step.get("what"))
                       for step in found.record.next)
