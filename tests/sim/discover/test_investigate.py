"""Discovery from end to end: concealed effects found, placed and named, nothing found where there is nothing."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from tests.sim.discover.odd_rigs import make_drops, make_three_wheels
from tests.sim.few_terms import few_terms
from truearc.sim.data.dataset import Dataset, Shots, join_datasets
from truearc.sim.discover.finding import FindingRecord, make_json
from truearc.sim.discover.investigate import Investigation, discover
from truearc_proof.truth.generate import shoot
from truearc_proof.truth.world import make_world

pytestmark = pytest.mark.slow
SHOTS = {"L1": 96, "L2": 32}      # few sizes: each is compiled
MORE = 60                             # for what is hard to tell


def concealed(level: str, effects: Mapping[str, float], seed: int, shots: int | None = None) -> Dataset:
    """A world of the sealed truth; outcomes come with the side."""
    return shoot(make_world(effects, level, shots or SHOTS[level], seed, side=True))


def look(level: str, effects: Mapping[str, float], seed: int = 1, shots: int | None = None) -> Investigation:
    return discover(concealed(level, effects, seed, shots), seed=seed)


def assert_named(finding: FindingRecord, name: str, amount: float) -> None:
    """Leading or in the set, with an amplitude about right."""
    assert finding.mismatch.found and finding.verdict in ("named", "set"), finding.sentence
    assert finding.set is not None and name in finding.set, finding.set
    found = next(one for one in finding.what if one.term == name)
    (interval,) = found.parameters.values()
    assert abs(interval.value - amount) < 4.5 * interval.sd, (interval, amount)
    assert interval.low90 <= interval.value <= interval.high90
    assert all(0.0 <= one.probability <= 1.0 for one in finding.what)      # of being among what is missing


@pytest.mark.parametrize(("name", "amount", "stage", "covariate"), [
    ("battery_sag", 0.75, "launch", "battery_v"), ("rapid_fire", 0.12, "launch", "since_last_shot_s"),
    ("hood_backlash", -1.8, "sensing", "hood_change"), ("ball_wear", 0.12, "launch", "shots_of_ball")])
def test_effects_that_go_with_telemetry_are_named_from_outcomes(name, amount, stage, covariate):
    finding = look("L1", {name: abs(amount)}).finding        # there backlash is how far short the hood comes
    assert_named(finding, name, amount)
    assert finding.data.level == "L1"
    assert (finding.where.stage, finding.where.covariate) == (stage, covariate)
    assert finding.where.stage_probability is not None
    assert sum(finding.where.stage_probability.values()) == pytest.approx(1.0)


@pytest.mark.parametrize(("name", "amount", "stage", "direction"), [
    ("wind_x", 1.5, "flight", "along"), ("hood_offset", 2.0, "sensing", "vertical"),
    ("drag_reynolds", -1.2, "flight", "along"), ("lift_saturation", 2.0, "flight", "vertical")])
def test_effects_in_tracks_are_named(name: str, amount: float, stage: str, direction: str) -> None:
    finding = look("L2", {name: amount}).finding
    assert finding.what[0].term == name
    assert_named(finding, name, amount)
    assert finding.data.level == "L2"
    assert (finding.where.stage, finding.where.direction) == (stage, direction)


def test_a_named_effect_makes_forecasts_better_and_the_same_again() -> None:
    finding, again = (look("L2", {"spin_decay": 1.2}).finding for _ in range(2))
    assert make_json(finding) == make_json(again)
    assert finding.what[0].term == "spin_decay" and finding.what[0].stage == "flight"
    assert finding.where.times_s is None or 0.0 <= finding.where.times_s[0] < finding.where.times_s[1] < 2.0
    assert_named(finding, "spin_decay", 1.2)
    fit = finding.fit
    assert fit is not None and fit.gain_per_shot is not None and fit.gain_se is not None
    assert fit.gain_per_shot > 2.0 * fit.gain_se > 0.0
    assert fit.height_rmse_after_m is not None and fit.height_rmse_before_m is not None
    assert fit.height_rmse_after_m < fit.height_rmse_before_m
    assert fit.heldout_shots == SHOTS["L2"]


def test_two_effects_are_named_one_after_the_other() -> None:
    rivals = few_terms("spin_decay", "hood_offset", "wind_x", "wheel_slip", "drag_reynolds", "lift_saturation")
    finding = discover(concealed("L2", {"spin_decay": 1.2, "hood_offset": 2.0}, 1), seed=1, terms=rivals).finding
    assert {finding.what[0].term, *(further.what[0].term for further in finding.also)} == {"spin_decay", "hood_offset"}


def test_what_no_term_says_is_called_unknown_and_placed() -> None:
    """A sideways push with the temperature: not in the catalogue."""
    finding = look("L2", {"seam_force": 1.5}, shots=MORE).finding
    assert finding.verdict == "unknown" and finding.set is None
    assert (finding.where.stage, finding.where.direction, finding.where.covariate) == (
        "flight", "lateral", "temperature_c")
    assert finding.unknown is not None and finding.unknown.unit == "m/s2"
    # 0.15 m/s2 a degree over some twenty degrees
    assert 1.0 < abs(finding.unknown.amplitude) < 6.0


@pytest.mark.parametrize(("level", "seed"), [("L1", 1), ("L1", 2), ("L2", 1), ("L2", 2)])
def test_nothing_is_found_where_there_is_nothing(level: str, seed: int) -> None:
    finding = look(level, {}, seed).finding
    assert finding.verdict == "none" and not finding.mismatch.found
    assert finding.mismatch.p_value is not None and finding.mismatch.p_value > 0.05
    assert finding.what == () and finding.set is None and finding.also == ()
    assert finding.data.level == level and finding.data.left_out == ()


def test_a_rig_of_three_wheels_is_understood() -> None:
    """Flown by DOP853 from the closed form of three evenly spaced wheels; heights measured, so that little hides."""
    sagging = discover(make_three_wheels(0.4, 60, 1), ("gravity", "drag", "magnus")).finding
    assert_named(sagging, "battery_sag", 0.4)
    assert sagging.where.covariate == "battery_v"
    assert sagging.data.fitted["all"]["drag.cd"] == pytest.approx(0.5, abs=0.2)


@pytest.mark.filterwarnings("error")
def test_balls_that_fall_straight_down_show_their_drag() -> None:
    finding = discover(make_drops(14, 2), ("gravity",)).finding
    (first, *_) = finding.what
    assert finding.mismatch.found and first.term == "drag"
    assert finding.verdict != "unknown"          # a curve fitted far from the truth must not beat the true name
    assert abs(first.parameters["cd"].value - 0.5) < 3.0 * first.parameters["cd"].sd < 0.1
    assert (finding.where.stage, finding.where.direction) == ("flight", "along")


def test_what_changes_at_once_is_told_as_a_step() -> None:
    """A hood that slips by two degrees half way through one long session, and a driver who goes on aiming."""
    before, after = (shoot(make_world(effects, "L0", 300, 825)) for effects in ({}, {"hood_offset": 2.0}))
    whole = join_datasets(before.take(range(150)), after.take(range(150, 300)))
    shots = replace(whole.shots, numbers={**whole.shots.numbers, "t_s": 20.0 * np.arange(300)},
                    texts={**whole.shots.texts, "session": ("day1",) * 300})
    finding = discover(replace(whole, shots=shots), seed=1).finding
    assert finding.verdict == "unknown" and finding.unknown is not None
    assert "a step, not a drift" in finding.sentence
    assert finding.unknown.amplitude == pytest.approx(np.radians(2.0), abs=np.radians(1.0))
    cut = float(finding.sentence.split("is above ")[1].split(",")[0])
    assert finding.unknown.covariate in ("t_s", "order_in_session")
    assert 110 < cut / (20.0 if finding.unknown.covariate == "t_s" else 1.0) < 190


def test_a_few_sessions_that_differ_by_luck_are_told_as_sessions_and_get_no_name() -> None:
    """Five sessions are too few to know how sessions differ; that they do is not a law of motion."""
    dataset = shoot(make_world({}, "L0", 300, 990003))
    session = np.arange(300) * 5 // 300
    luck = 1.0 + 0.015 * np.random.default_rng(3).normal(size=5)
    numbers = {**dataset.shots.numbers, "motor_ratio": dataset.shots.number("motor_ratio") * luck[session]}
    texts = {**dataset.shots.texts, "session": tuple(f"s{number}" for number in session)}
    told = discover(replace(dataset, shots=Shots(dataset.shots.shot_id, numbers, texts))).finding
    assert told.mismatch.found and told.verdict == "unknown", told.sentence
    assert told.where.covariate == "session" and told.set is None
