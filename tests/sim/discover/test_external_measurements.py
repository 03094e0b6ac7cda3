"""External measurements of a term: reading and weight."""

import numpy as np
import pytest
from scipy.stats import norm

from truearc.errors import InputError
from truearc.sim.discover.select.terms import nats_measured
from truearc.sim.infer.likelihood.layout import Measurement, column_of, read_measured
from truearc_proof.rounds.worlds import PARAMETER

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
    with pytest.raises(InputError, match="--measured"):
        read_measured([word], "--measured")
    assert read_measured(["wind_x=-1.5,0.2"], "--measured") == {"wind_x.speed_m_s": (-1.5, 0.2)}
