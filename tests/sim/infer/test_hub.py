"""From shots at an opening that faces up to a fit, forecasts and a finding."""

import numpy as np
import pytest

import truearc as ta
from tests.sim.infer.hubs import CD, HUB, LOSS, RIG, make_shots
from truearc.errors import InputError
from truearc.sim.check.check import check_plausible

BELIEVED = ("gravity", "drag", "magnus", "exit_efficiency")


@pytest.fixture(scope="module")
def fitted() -> ta.Fit:
    return ta.fit(make_shots(1, 150), terms=BELIEVED[1:])


def test_fit_of_shots_at_a_hub_finds_the_launcher(fitted: ta.Fit) -> None:
    assert fitted.converged and not fitted.dataset.accepted
    rows = {row[0]: row[1:4] for row in fitted.table().rows}
    for name, truth in (("drag.cd", CD), ("exit_efficiency.loss", LOSS)):
        value, low, high = rows[name]
        assert low - 0.5 * (high - low) < truth < high + 0.5 * (high - low), (name, value)
    assert fitted.holdout is not None and fitted.holdout.accuracy > 0.7


def test_predictions_say_where_balls_come_down(fitted: ta.Fit) -> None:
    later = make_shots(2, 60)
    table = ta.predict(later, fitted.belief)
    assert table.columns == ("shot_id", "along_m", "across_m", "angle_deg", "outcome", "side", "p_hit", "note")
    said = [row[4] for row in table.rows]
    assert set(said) <= {"hit", "miss"}
    seen = np.array([HUB.word(word) for word in later.shots.text("outcome")])
    assert (np.array(said) == seen).mean() > 0.7


@pytest.mark.slow
def test_discovery_reads_shots_at_a_hub() -> None:
    found = ta.discover(make_shots(3, 120, angle_deg=3.0), believe=BELIEVED)
    assert "120 shots, level L0" in "\n".join(found.lines())


def test_commands_for_upright_openings_say_so(fitted: ta.Fit) -> None:
    assert check_plausible(fitted.dataset).accepted == ()
    for command in (lambda: ta.train_gate(fitted.dataset, fitted.belief),
                    lambda: ta.follow(fitted.dataset, fitted.belief), lambda: ta.identifiability(RIG)):
        with pytest.raises(InputError, match=r"target\.facing: is up"):
            command()
