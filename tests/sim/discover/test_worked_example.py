"""The figures of docs/explanation/how-discovery-reasons.md."""

import numpy as np
import pytest

from truearc.sim.discover.investigate import discover
from truearc_proof.truth.generate import shoot
from truearc_proof.truth.world import make_world

TRUTH = 0.012                         # lost per m/s


@pytest.mark.slow
def test_the_worked_example_is_as_the_page_says() -> None:
    found = discover(shoot(make_world({"wheel_slip": TRUTH}, "L0", 300, 11)), seed=0)
    finding = found.finding
    assert finding.mismatch.p_value == pytest.approx(0.0105)
    assert finding.verdict == "named" and finding.set == ("wheel_slip",)
    assert [round(one.probability, 2) for one in finding.what[:2]] == [0.90, 0.06]
    assert finding.unexplained == pytest.approx(0.04, abs=0.005)
    interval = finding.what[0].parameters["loss_per_m_s"]
    assert (round(100 * interval.low90, 1), round(100 * interval.high90, 1)) == (0.8, 2.7)
    assert interval.low90 < TRUTH < interval.high90
    naming = found.steps[0].naming
    assert sum(one.visible for one in naming.candidates) == 17
    assert round(float(np.log(0.55 / 17)), 2) == -3.43
    leader = naming.refits["wheel_slip.loss_per_m_s"]
    assert round(100 * float(leader.amplitude[0]), 1) == 1.7 and round(100 * float(leader.sd[0]), 1) == 0.5
