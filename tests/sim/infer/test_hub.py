"""From shots at an opening that faces up to a fit, forecasts and a finding."""

from pathlib import Path

import numpy as np
import pytest

import truearc as ta
from tests.sim.infer.hubs import CD, CL, HUB, LOSS, RIG, make_shots
from truearc.cli.main import main
from truearc.errors import InputError
from truearc.robot.config.targets import refuse_up
from truearc.robot.gate import FEATURES, facing_up_of, load_gate_for
from truearc.sim.discover.investigate import score_since
from truearc.sim.infer.belief import Belief

BELIEF = Belief({"drag": {"cd": CD}, "magnus": {"cl": CL}, "exit_efficiency": {"loss": LOSS}},
                {"speed": 0.015, "elevation_deg": 0.45},
                ("drag.cd", "magnus.cl", "exit_efficiency.loss", "scatter.speed", "scatter.elevation_deg"),
                np.diag(np.array([0.05, 0.003, 0.01, 0.2, 0.3])**2))
BELIEVED = ("gravity", "drag", "magnus", "exit_efficiency")


@pytest.fixture(scope="module")
def fitted() -> ta.Fit:
    return ta.fit(make_shots(1, 150), terms=BELIEVED[1:])


@pytest.mark.slow
def test_fit_of_shots_at_a_hub_finds_the_launcher(fitted: ta.Fit) -> None:
    assert fitted.converged and not fitted.dataset.accepted
    rows = {row[0]: row[1:4] for row in fitted.table().rows}
    for name, truth in (("drag.cd", CD), ("exit_efficiency.loss", LOSS)):
        value, low, high = rows[name]
        assert low - 0.5 * (high - low) < truth < high + 0.5 * (high - low), (name, value)
    assert "where a ball comes down at" in str(fitted) and "the height at" not in str(fitted)
    assert fitted.holdout is not None and fitted.holdout.accuracy > 0.7


@pytest.mark.slow
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
    assert "shots: 120, level L0" in "\n".join(found.lines())


@pytest.mark.slow
def test_gate_at_a_hub_knows_what_hits(tmp_path: Path) -> None:
    shots, later = (make_shots(seed, n, far_m=3.5, high_deg=66.0) for seed, n in ((4, 120), (6, 200)))
    training = ta.train_gate(shots, BELIEF)
    features = np.column_stack([later.shots.number(one.name) for one in FEATURES])
    p_hit, hit = training.gate.probabilities(features)[:, 1], np.array(later.shots.text("outcome")) == "two"
    assert abs(p_hit.mean() - hit.mean()) < 0.08 and ((p_hit > 0.5) == hit).mean() > 0.75
    training.save(tmp_path / "gate")
    assert main(["export", str(tmp_path / "gate"), "-o", str(tmp_path / "gate.onnx")]) == 0
    assert main(["verify", str(tmp_path / "gate.onnx"), "--weights", str(tmp_path / "gate")]) == 0
    assert load_gate_for(tmp_path / "gate.onnx", RIG).target == facing_up_of(RIG)


def test_the_papers_method_is_refused() -> None:
    with pytest.raises(InputError, match=r"target\.facing: is up"):
        refuse_up(HUB, "the paper's method")


@pytest.mark.slow
def test_follow_tells_a_steeper_launch_from_no_change() -> None:
    steady, changed = (ta.follow(make_shots(7, 24, angle_deg=angle), BELIEF) for angle in (0.0, 6.0))
    assert steady.alarm is None and max(steady.e_values) < 10.0
    assert changed.alarm is not None and changed.alarm < 20


@pytest.mark.slow
def test_chances_for_very_many_beliefs_are_near_the_exact_ones() -> None:
    plane = score_since(make_shots(7, 40), BELIEF).plane
    assert plane is not None
    rng = np.random.default_rng(0)
    for shot in range(len(plane.rows)):
        mean_m = plane.mean_m[shot] + rng.normal(0.0, 0.3, 30)
        spread_m = plane.spread_m[shot] * np.exp(rng.normal(0.0, 0.2, 30))
        moved = [rng.normal(0.0, sd, 30) for sd in (0.02, 0.1, 0.1, 0.0, 0.03, 0.1)]
        exact = plane.seen.take(np.full(30, shot)).moved(np.stack(moved, axis=1)).share(mean_m, spread_m)
        off = np.abs(plane.seen.chance(shot, mean_m, spread_m, moved) - exact).max()
        assert off < (0.05 if np.isfinite(plane.seen.rise[shot, 0]) else 0.01)           # it hardly reaches the rim


@pytest.mark.slow
def test_hub_shows_a_loss_of_speed_and_a_wrong_rim() -> None:
    sight = ta.identifiability(RIG, believe=BELIEVED[:3], shots=200)
    found = {one.term: one for one in sight.sight.terms}
    assert found["exit_efficiency"].information > 0.0 and found["rim_catch"].power > 0.0
