"""What was not measured says nothing; a verdict 'none' says what could not have been seen, and plans it."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

import truearc as ta
from tests.sim.discover.odd_rigs import make_drops
from truearc.sim.discover import finding as rec
from truearc.sim.discover.identifiability import TAKEN, UNTOUCHED, Sight, TermIdentifiability
from truearc.sim.discover.next_steps import blind_terms
from truearc.sim.discover.report.story import tell_none
from truearc.sim.infer.belief import point_belief
from truearc.sim.physics.simulate import launch_state

LATERAL = "wind_y"
EXAMPLE = Path(__file__).parents[3] / "examples" / "spreadsheet"


def seen_at_its_usual_size(dataset: ta.Dataset, term: str, believe: list[str]) -> bool:
    """Whether `truearc identifiability` says that the shots show this term."""
    one, = (row for row in ta.identifiability(dataset, believe=believe).sight.terms if row.term == term)
    return one.smallest is not None and one.smallest < one.usual


def test_a_coordinate_that_is_zero_everywhere_shows_no_crosswind() -> None:
    filmed = make_drops(14, 2, cd=0.0)
    assert filmed.tracks is not None
    noise_m = 1e-9 * np.random.default_rng(0).normal(size=len(filmed.tracks.y_m))      # a float's rounding
    flat = replace(filmed, tracks=replace(filmed.tracks, y_m=noise_m))
    believe = ["gravity", "drag"]
    assert not seen_at_its_usual_size(flat, LATERAL, believe)
    said = str(ta.identifiability(flat, believe=believe))
    assert f"never seen: {LATERAL}: nothing in these data depends on it" in said
    assert "crosswind" not in ta.discover(flat, believe=believe).sentence


@pytest.mark.parametrize("name", ["exit_speed_m_s", "exit_spin_rev_s"])
def test_a_measurement_that_never_varies_is_as_if_it_were_not_there(name: str, exits: ta.Dataset) -> None:
    numbers = dict(exits.shots.numbers)
    without = replace(exits, shots=replace(exits.shots, numbers={key: column for key, column in numbers.items()
                                                                 if key != name}))
    constant = replace(exits, shots=replace(exits.shots, numbers={
        **numbers, name: np.full(len(exits.shots), float(np.mean(numbers[name])))}))
    one, other = (ta.discover(dataset, seed=1).record for dataset in (constant, without))
    assert (one.verdict, one.mismatch.p_value) == (other.verdict, other.mismatch.p_value)
    assert one.data.fitted == other.data.fitted


@pytest.fixture(scope="module")
def exits() -> ta.Dataset:
    """Thirty shots of the example's rig with measured speed and spin of the ball."""
    rng = np.random.default_rng(4)
    ratio, hood = rng.uniform(0.4, 0.8, 30), rng.uniform(35.0, 55.0, 30)
    rig = structs.replace(ta.load_dataset(EXAMPLE).rig, target=None)      # exits alone are evidence
    surface = ratio * 594.0 * (0.0508 + 0.5625 * 0.0349) / 2.0
    shots = {"shot_id": [str(k) for k in range(30)], "distance_m": rng.uniform(2.0, 5.0, 30), "hood_deg": hood,
             "motor_ratio": ratio, "exit_speed_m_s": surface * 0.9 + rng.normal(0.0, 0.1, 30),
             "exit_spin_rev_s": ratio * 40.0 + rng.normal(0.0, 0.5, 30)}
    return ta.dataset(shots, rig=rig)


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
    assert found.record.next and found.next == f"Measure {found.record.next[0]['what']}."
    for step in found.record.next:
        assert step["do"] == "measure" and f"next: measure {step['what']}" in found.lines()
        for term in step["shows"]:                        # with one test alone, too, at most a little would be seen
            assert could[term].smallest is None or could[term].smallest > 0.3 * could[term].usual, term


SEEN = TermIdentifiability("wind_x", "flight", "m/s", 0.8, 1.0, 1.0, 60, 0.4, 0.99, None, (), None, 0.0)


EMPTY = rec.FindingRecord(rec.DataSummary(120, "L0", (), ("gravity",), {}, {"by": "shot", "count": 120}),
                          rec.Mismatch(False, 0.3, 0.05, {}, 7, {}),
                          rec.Where(None, None, None, None, {}, None, None, (), None), "none", "", None, None)


def test_what_could_not_have_been_shown_is_told_first() -> None:
    blind = structs.replace(SEEN, smallest=3.0)
    unseen = structs.replace(SEEN, term="spin_decay", unit="1/s", usual=0.4, smallest=None, why=TAKEN)
    other = structs.replace(SEEN, term="ball_wear", smallest=None, why=UNTOUCHED)
    sight = Sight(120, "L0", (), (other, unseen, blind, SEEN), (), ())
    listed = blind_terms(sight)
    assert [one.term for one in listed] == ["wind_x", "spin_decay", "ball_wear"]
    assert tell_none(EMPTY, listed, sight).told.change == (
        "Nothing found; these 120 shots could not have shown head or tail wind below 3.0 m/s, spin decay of any size "
        "or ball wear of any size.")
    vast = structs.replace(other, unit="1", smallest=8.65)       # of a speed, ball wear takes a share
    assert "ball wear of any size" in tell_none(EMPTY, [vast], sight).told.change
    assert tell_none(EMPTY, [], sight).told.change.startswith("Nothing found: 120 shots differ from the simulation by")
    assert tell_none(EMPTY, listed, sight, tracker="The tracker is off.").sentence.startswith("The tracker is off. Sm")


@pytest.mark.slow
def test_a_ball_faster_than_its_wheels_is_said_beside_the_fit() -> None:
    week = ta.load_dataset(EXAMPLE)
    slower = {**week.shots.numbers, "motor_ratio": 0.8 * week.shots.number("motor_ratio")}
    base = ta.dataset({"shot_id": week.shots.shot_id, **slower}, rig=week.rig)
    truth = point_belief({"drag": {"cd": 0.77}, "magnus": {"cl": 0.1}, "exit_efficiency": {"loss": -0.035}})
    ahead, rng = np.array(ta.predict(base, truth).column("deviation_m"), float), np.random.default_rng(1)
    speed = 1.035 * launch_state(base.rig, base.shots)["exit_speed_m_s"]
    fast = ta.dataset({"shot_id": week.shots.shot_id, **slower, "miss_height_m": ahead + rng.normal(0.0, 0.05, 48),
                       "exit_speed_m_s": speed + rng.normal(0.0, 0.05, 48)}, rig=week.rig)
    found = ta.discover(fast, believe=TERMS, accept=["reach"])
    for said in (str(ta.fit(fast, TERMS, accept=["reach"])), found.sentence):
        assert re.search(r"exit_efficiency\.loss is below 0 \(-0\.03.*balls leave faster than the wheels", said)


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
