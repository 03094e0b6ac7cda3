"""A measurement decides between names that no shot can tell apart."""

import numpy as np
import pytest
from scipy.stats import norm

from robot.config import BadInput
from sim.discover.discover import discover
from sim.discover.measured import Measurement, column_of, nats_measured, read_measured
from sim.prove.grade import PARAMETER
from sim.prove.truth.shoot import shoot
from sim.prove.truth.world import make_world
from sim.shots import Dataset

TARGET = "target_height.rise_m"


def test_nats_are_the_ratio_of_two_likelihoods() -> None:
    said = nats_measured({TARGET: Measurement(0.09, 0.02)}, TARGET, 0.1, 0.03)
    assert said == pytest.approx(norm.logpdf(0.09, 0.1, np.hypot(0.02, 0.03)) - norm.logpdf(0.09, 0.0, 0.02))
    assert said > 5.0 and nats_measured({TARGET: Measurement(0.0, 0.02)}, TARGET, 0.1, 0.03) < -2.0
    assert nats_measured({TARGET: Measurement(0.09, 0.02)}, "wind_x.speed_m_s", 1.0, 0.1) == 0.0


@pytest.mark.parametrize("term", PARAMETER)
def test_a_term_is_measured_by_its_amplitude(term: str) -> None:
    assert column_of(term) == f"{term}.{PARAMETER[term][0]}"


@pytest.mark.parametrize("word", ["wind_x", "wind_x=1", "wind_x=1,0", "wind_x=1,-1", "wind_x=nan,1", "wind_x=a,b",
                                  "winds=1,1", "=1,1", "wind_x=1,2,3"])
def test_what_is_no_measurement_is_refused_by_option_and_word(word: str) -> None:
    with pytest.raises(BadInput, match="--measured"):
        read_measured([word], "--measured")
    assert read_measured(["wind_x=-1.5,0.2"], "--measured") == {"wind_x.speed_m_s": (-1.5, 0.2)}


@pytest.fixture(scope="module")
def raised() -> Dataset:
    """Of a target that stands too high: at L0 the same as a launcher that is too low, or a camera that is off."""
    return shoot(make_world({"target_height": 0.25}, "L0", 300, 7, side=True))


@pytest.mark.slow
def test_a_tape_parts_what_shots_cannot(raised: Dataset) -> None:
    alone = discover(raised, seed=1).finding
    assert alone.set is not None and len(alone.set) > 1 and "target_height" in alone.set
    there = discover(raised, seed=1, measured={TARGET: Measurement(0.248, 0.01)}).finding
    assert there.set == ("target_height",) and there.verdict == "named"
    not_there = discover(raised, seed=1, measured={TARGET: Measurement(0.002, 0.01)}).finding
    assert not_there.set is not None and "target_height" not in not_there.set
    assert there.mismatch.p_value == alone.mismatch.p_value == not_there.mismatch.p_value


def test_what_is_believed_already_cannot_be_measured_beside(raised: Dataset) -> None:
    with pytest.raises(BadInput, match="exit_efficiency is believed already"):
        discover(raised, measured={"exit_efficiency.loss": Measurement(0.1, 0.01)})
