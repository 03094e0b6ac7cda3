"""What was not measured, or is the same for every shot, says nothing, and no power is claimed from it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

import truearc as ta
from tests.sim.discover.odd_rigs import make_drops

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
    rig = without_target(ta.load_dataset(EXAMPLE).rig)
    surface = ratio * 594.0 * (0.0508 + 0.5625 * 0.0349) / 2.0
    shots = {"shot_id": [str(k) for k in range(30)], "distance_m": rng.uniform(2.0, 5.0, 30), "hood_deg": hood,
             "motor_ratio": ratio, "exit_speed_m_s": surface * 0.9 + rng.normal(0.0, 0.1, 30),
             "exit_spin_rev_s": ratio * 40.0 + rng.normal(0.0, 0.5, 30)}
    return ta.dataset(shots, rig=rig)


def without_target(rig: ta.Rig) -> ta.Rig:
    """The rig without a target: exits alone are evidence."""
    return structs.replace(rig, target=None)


def test_a_check_that_was_accepted_is_in_the_finding(exits: ta.Dataset) -> None:
    rig = structs.replace(exits.rig, ball=structs.replace(exits.rig.ball, mass_kg=300.0))
    heavy = replace(exits, facts=rig, shots=exits.shots.take(np.arange(12)))
    with pytest.raises(ta.InputError, match="check 'mass'; accept it by name"):
        ta.discover(heavy)
    found = ta.discover(heavy, accept=["mass"])
    said, = found.record.data.accepted
    assert said.startswith("mass: rig.toml: ball.mass_kg") and f"warning: {said}" in str(found)
