"""What data allow: ceilings, worth of further shots, and sealed shots."""


import numpy as np
import pytest
from scipy.stats import norm

from tests.sim.discover.made import column, gaussian
from truearc.sim.infer.belief import Belief, point_belief
from truearc.sim.infer.likelihood.score_table import ScoreTable
from truearc_proof.rounds.marks import FALSE_ALARM, ceiling_of, measure, off_m, shoot_unseen
from truearc_proof.rounds.worlds import NUMPY, Drawn
from truearc_proof.truth.generate import shoot
from truearc_proof.truth.world import make_world

N = 400


def evidence_of(names: tuple[str, ...], slopes: np.ndarray) -> ScoreTable:
    stages = {"hood_offset": "sensing"}
    columns = tuple(column(f"{name}.amplitude", "term", stages.get(name, "flight")) for name in names)
    return gaussian(np.zeros(N), slopes, columns)


def straight(count: int) -> np.ndarray:
    """Columns at right angles to one another, each of information 100."""
    return np.linalg.qr(np.random.default_rng(0).normal(size=(N, count)))[0] * 10.0


def test_two_terms_of_one_slope_are_of_one_class() -> None:
    slopes = straight(1)
    found = ceiling_of(evidence_of(("wind_x", "hood_offset"), np.concatenate([slopes, slopes], axis=1)), "L2",
                       "hood_offset.amplitude", 2.0, 1)
    assert found == (1.0, ("wind_x",))


def test_terms_at_right_angles_are_told_apart_and_the_threshold_knows_their_number() -> None:
    names = ("wind_x", "wind_z", "hood_offset", "drag_reynolds", "buoyancy")
    found = ceiling_of(evidence_of(names, straight(5)), "L2", "wind_x.amplitude", 0.3, 2)
    critical = norm.isf(0.5 * (1.0 - 0.95**0.2))
    missed = norm.cdf(critical - 3.0) - norm.cdf(-critical - 3.0)
    assert found == (pytest.approx(1.0 - missed * 0.95**0.8, abs=0.03), ())


def test_the_eigenvectors_signs_which_are_the_machine_s_change_no_draw(monkeypatch: pytest.MonkeyPatch) -> None:
    slopes = straight(3) @ np.random.default_rng(1).normal(size=(3, 3))
    evidence = evidence_of(("wind_x", "wind_z", "hood_offset"), slopes)
    here = ceiling_of(evidence, "L2", "wind_x.amplitude", 0.2, 1)
    usual = np.linalg.eigh
    monkeypatch.setattr(np.linalg, "eigh", lambda one: (usual(one)[0], -usual(one)[1]))
    assert ceiling_of(evidence, "L2", "wind_x.amplitude", 0.2, 1) == here


@pytest.mark.parametrize(("level", "allows"), [("L0", False), ("L1", True)])
def test_wear_can_be_found_only_where_balls_are_told_apart(level: str, allows: bool) -> None:
    drawn = Drawn("w0001", NUMPY, "one", level, 300, 5, {"drag_wear": 0.5})
    dataset = shoot(make_world(drawn.effects, level, 300, 5, ()))
    allowed = measure(drawn, dataset).allowed
    assert allowed is not None
    assert (allowed[0] > 0.9) == allows
    assert (allowed[0] == FALSE_ALARM) != allows


def drawn(effects: dict[str, float], engine: str = "numpy") -> Drawn:
    return Drawn("w1", engine, "one", "L0", 200, 41, effects)


def truth(one: Drawn, more: dict[str, dict[str, float]]) -> Belief:
    """The world's own coefficients in the catalogue's words (truearc_proof.rounds.worlds)."""
    world = make_world(one.effects, one.level, one.shots, one.seed)
    return point_belief({"drag": {"cd": world.cd}, "magnus": {"cl": world.lift_slope * 3.0 / 32.0},
                         "exit_efficiency": {"loss": 1.0 - world.efficiency}} | more)


@pytest.mark.parametrize(("name", "amount", "term"), [
    ("release_height", 0.3, {"above_m": 0.3}), ("wind_x", 3.0, {"speed_m_s": 3.0})])
def test_the_true_term_is_off_by_luck_alone(name: str, amount: float, term: dict[str, float]) -> None:
    one, null = drawn({name: amount}), drawn({})
    unseen, luck = shoot_unseen(one), shoot_unseen(null)
    assert unseen is not None and luck is not None
    own = shoot(make_world(one.effects, one.level, one.shots, one.seed))
    assert not set(unseen.dataset.shots.number("distance_m")) & set(own.shots.number("distance_m"))
    best = off_m(truth(null, {}), luck)
    assert 0.7 * best < off_m(truth(one, {name: term}), unseen) < 1.15 * best
    assert off_m(truth(one, {}), unseen) > 1.3 * best


@pytest.mark.slow
def test_mujoco_s_robot_is_shot_again_with_what_is_hidden_in_it() -> None:
    """A launcher that stands higher than stated throws as much higher."""
    one = Drawn("w1", "mujoco", "one", "L0", 40, 900, {"release_height_error_m": 0.4}, change="release_height")
    unseen = shoot_unseen(one)
    assert unseen is not None and 30 <= np.isfinite(unseen.above_m).sum() <= 40
    low = shoot_unseen(Drawn("w1", "mujoco", "clean", "L0", 40, 900, change="nothing"))
    assert low is not None
    assert np.nanmean(unseen.above_m) - np.nanmean(low.above_m) == pytest.approx(0.4, abs=0.1)
