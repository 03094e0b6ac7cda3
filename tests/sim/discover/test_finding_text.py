"""Findings as text and on disk: sizes and signs as the terms act; golden ones written again to the byte."""

import re
from pathlib import Path

import msgspec
import numpy as np
import pytest

from tests.sim.discover.made import stand_in
from truearc.errors import InputError
from truearc.robot.config.rig_spec import Ball, LauncherFacts, Rig, Wheel
from truearc.sim.discover import finding as rec
from truearc.sim.discover.detect.battery import Test
from truearc.sim.discover.detect.covariates import Covariate, CovariatePair, Factor
from truearc.sim.discover.detect.localization import Correction, Place
from truearc.sim.discover.identifiability import Sight
from truearc.sim.discover.report import finding_text as text
from truearc.sim.discover.report import story as stories
from truearc.sim.infer.likelihood.score_table import Column
from truearc.sim.infer.room import ROOM
from truearc.sim.physics.catalogue import TERMS, find_terms
from truearc.sim.physics.term import BallState, Exit, Opening, Vec, complete

WHERE = rec.Where("launch", None, None, None, {}, None, None, (), None)
BATTERY, WARMTH = (Covariate(((name, np.arange(4.0)),)) for name in ("battery_v", "temperature_c"))
FACTS = Rig(Ball(0.14, 0.0889), LauncherFacts(0.75, 594.0, (Wheel("lower", 0.05, 1.0, 180.0),
                                                             Wheel("upper", 0.03, 0.5, 0.0))))


def interval(value: float, sd: float, unit: str = "1") -> rec.Interval:
    return rec.Interval(value, sd, value - 2.0 * sd, value + 2.0 * sd, unit)


def named(term: str, value: float, sd: float, probability: float = 0.9, unit: str = "1") -> rec.Named:
    found = find_terms([term])[0]
    sizes = {found.parameters[0].name: interval(value, sd, unit)}
    return rec.Named(term, probability, sizes, found.sentence, found.stage)


def told(what: tuple[rec.Named, ...], chosen: tuple[str, ...] = (), p_value: float = 0.01) -> rec.Story:
    """The story for these names; the first alone unless more are chosen."""
    return stories.tell(record(what, chosen or (what[0].term,), p_value), None).told


def record(what: tuple[rec.Named, ...] = (), chosen: tuple[str, ...] | None = None, p_value: float = 0.01,
           steps: tuple[dict[str, object], ...] = (), where: rec.Where = WHERE) -> rec.FindingRecord:
    """A finding of these names without its story; without names, of something unknown."""
    verdict = "unknown" if chosen is None else "named" if len(chosen) == 1 else "set"
    return rec.FindingRecord(rec.DataSummary(20, "L0", ("2 shots",), ("gravity",), {}, {"by": "shot", "count": 20}),
                             rec.Mismatch(True, p_value, 0.05, {}, 7, {}), where, verdict, "", None, None, what=what,
                             set=chosen, next=steps)


PHRASES = {term.name: term.phrase for term in TERMS}


def test_shares_are_told_as_per_cent_with_their_interval() -> None:
    said = text.say_effect("exit_efficiency", interval(0.042, 0.005), "")
    assert said == "the ball leaves 4.2 % (90 %: 3.2 to 5.2 %) slower than the wheels' surfaces run"
    assert "1.5 cm (90 %: 0.5 to 2.5 cm) lower" in text.say_effect("target_height", interval(-0.015, 0.005, "m"), "")
    assert "3.0 % (90 %: 1.0 to 5.0 %) slower" in text.say_effect("battery_sag", interval(0.3, 0.1), "")


def test_a_change_is_told_before_the_new_value_and_with_its_sign() -> None:
    now, change = interval(-0.8, 0.1, "deg"), interval(-1.6, 0.1, "deg")
    hood = msgspec.structs.replace(named("hood_offset", 0.0, 1.0), parameters={"angle_deg": now}, believed=0.8,
                                   change=change)
    assert text.say_name(hood) == ("hood offset changed by -1.60° (90 %: -1.80 to -1.40°) from 0.80°; now the hood "
                                   "stands 0.80° (90 %: 0.60 to 1.00°) flatter than it reads")
    assert hood.size == change and named("drag", 0.5, 0.1).size.value == 0.5
    slip = text.interval_of("wheel_slip", interval(0.004, 0.001, "1/m/s"))
    assert slip == "0.40 % (90 %: 0.20 to 0.60 %) per m/s of wheel surface"
    assert text.interval_of("battery_sag", interval(0.3, 0.1)) == "3.0 % (90 %: 1.0 to 5.0 %) per tenth of voltage"
    assert text.interval_of("spin_decay", interval(-0.3, 0.1, "1/s")) == "-0.30 1/s (90 %: -0.50 to -0.10 1/s)"


def test_spin_decay_is_told_as_a_time_constant_whose_ends_swap() -> None:
    """After the time constant the term itself leaves 1/e of the spin."""
    said = text.say_effect("spin_decay", rec.Interval(0.5, 0.07, 0.4, 0.625, "1/s"), "")
    assert said == "the ball loses spin in flight, with a time constant of 2.00 s (90 %: 1.60 to 2.50 s)"
    spinning = BallState(Vec(0.0, 0.0, 1.0), Vec(9.0, 0.0, 1.0), Vec(0.0, -5.0, 0.0), 2.0)
    later = find_terms(["spin_decay"])[0].meet(FACTS, {"rate_per_s": 0.5}, spinning)
    assert float(later.spin_rev_s.y) == pytest.approx(-5.0 / np.e, rel=1e-6)
    unsure = text.say_effect("spin_decay", rec.Interval(0.2, 0.2, -0.1, 0.5, "1/s"), "")
    assert unsure.endswith("with a time constant of 5.0 s (90 %: at least 2.0 s)")
    assert text.size_of("spin_decay", 0.4, "1/s") == "2.5 s (time constant)"


@pytest.mark.parametrize(("p_value", "said"), [
    (1.0 / 2000.0, "at most 1 dataset in 2,000"), (2.0 / 2000.0, "1 dataset in 1,000"),
    (3.0 / 2000.0, "1 dataset in 670"), (0.0105, "1 dataset in 95"), (0.05, "1 dataset in 20"),
    (0.41, "41 datasets in 100"), (1.0, "100 datasets in 100")])
def test_a_p_value_is_told_as_a_share_of_datasets_in_which_nothing_is_missing(p_value: float, said: str) -> None:
    assert text.say_chance(p_value) == f"{said} would look this extreme"
    whole = f"If nothing were missing, {said} would look this extreme (p = {p_value:.2g}"
    assert told((named("drag", 0.5, 0.1),), p_value=p_value).sure.startswith(whole)
    none = msgspec.structs.replace(record(p_value=p_value), verdict="none")
    assert stories.tell_none(none, [], Sight(20, "L0", (), (), (), ())).told.sure.startswith(whole)


@pytest.mark.parametrize(("term", "word"), [
    ("hood_offset", "steeper"), ("encoder_scale", "faster"), ("exit_efficiency", "slower"), ("wheel_slip", "slips"),
    ("ball_wear", "slower"), ("battery_sag", "slower"), ("release_height", "higher"), ("ball_compression", "faster")])
def test_launch_words_have_the_sign_of_the_term(term: str, word: str) -> None:
    """A positive amplitude through the term's own hook, and what the phrase for it says."""
    found = find_terms([term])[0]
    values = {**complete(found, None), found.parameters[0].name: 0.01}
    before = Exit(10.0, 0.8, 5.0, 0.0)
    after = found.sense(FACTS, values, before, 5.0)[0] if found.stage == "sensing" else found.leave(FACTS, values,
                                                                                                   before)
    change = {"steeper": after.elevation_rad - before.elevation_rad, "higher": after.above_m - before.above_m,
              "slower": before.speed_m_s - after.speed_m_s, "slips": before.speed_m_s - after.speed_m_s,
              "faster": after.speed_m_s - before.speed_m_s + after.spin_rev_s - before.spin_rev_s}[word]
    # a battery's sensitivity is stated for a weaker one, so its effect turns with the voltage's sign
    assert (-change if term == "battery_sag" else change) > 0.0
    assert word in PHRASES[term].more and word not in PHRASES[term].less


def test_other_words_have_the_sign_of_the_term() -> None:
    def values(name: str) -> dict[str, float]:
        found = find_terms([name])[0]
        return {**complete(found, None), found.parameters[0].name: 0.01}

    for name in ("distance_scale", "distance_bias"):
        assert find_terms([name])[0].sense(FACTS, values(name), Exit(9.0, 0.8, 0.0), 5.0)[1] > 5.0
        assert "farther" in PHRASES[name].more
    ball = BallState(Vec(0.0, 0.0, 1.0), Vec(9.0, 0.0, 1.0), Vec(0.0, 0.0, 0.0))
    assert find_terms(["wind_x"])[0].meet(FACTS, values("wind_x"), ball).velocity_m_s.x < 9.0
    assert "toward the target" in PHRASES["wind_x"].more
    assert find_terms(["target_height"])[0].arrive(values("target_height"), Opening(2.0, 0.1, 0.3)).centre_m > 2.0
    tracked = find_terms(["track_clock"])[0].watch(values("track_clock"), Vec(4.0, 0.0, 2.0), Vec(9.0, 0.0, 0.0), 0.5)
    assert tracked.x > 4.0 and "slow" in PHRASES["track_clock"].more


@pytest.mark.parametrize(("first", "second", "change", "sure"), [
    (1.0, 0.97, "Two things are off in flight, and these shots cannot tell", "drag (100%) and crosswind (97%)"),
    (0.6, 0.45, "Something is off in flight: if it is drag (60%), the air slows", "crosswind (45%) (two may be there"),
    (0.6, 0.35, "Something is off in flight: if it is drag (60%), the air", "it may also be crosswind (35%)."),
    (0.9, 0.06, "Most likely the air slows the ball", "crosswind (6%) cannot be excluded."),
    (0.15, 0.14, "Something is off in flight, and no name stands out: drag (15%) or cross", "crosswind (14%)")])
def test_names_that_cannot_be_told_apart_share_the_story(first: float, second: float, change: str, sure: str) -> None:
    what = (named("drag", 0.5, 0.1, first), named("wind_y", 1.0, 0.1, second, "m/s"))
    story = told(what, ("drag", "wind_y"))
    assert change in story.change and sure in story.sure
    (line,) = (line for line in stories.console_lines(record(what, ("drag", "wind_y"))) if line.startswith("names: "))
    assert line.endswith("(two together count for both)") == (first + second > 1.0)


def test_a_story_names_at_most_five_and_counts_the_rest() -> None:
    names = [term.name for term in TERMS if term.stage == "launch" and "phrase" in dir(term)][:8]
    what = tuple(named(name, 0.1, 0.01, 0.3 - 0.01 * k) for k, name in enumerate(names))
    story = told(what, tuple(names))
    assert story.sure.count("%)") == 4 and "or one of 3 others" in story.sure


def test_what_is_gained_is_told_in_outcomes_and_centimetres() -> None:
    said = stories.say_forecasts(rec.FitSummary(100, -0.9, -0.7, 0.2, 0.05, 0.19, 0.11, 0.71, 0.83))
    assert "83 of 100 outcomes right instead of 71 and heights within 11 cm instead of 19 cm" in said
    low, high = map(float, re.search(r"90 %: ([+-][\d.]+) to ([+-][\d.]+)\)", said.partition("log score")[2]).groups())
    assert (low, high) == (pytest.approx(0.2 - 1.645 * 0.05, abs=1e-3), pytest.approx(0.2 + 1.645 * 0.05, abs=1e-3))
    worse = stories.say_forecasts(rec.FitSummary(100, -0.9, -0.7, 0.2, 0.05, None, None, 0.83, 0.71))
    assert "does better (log score" in worse and "but forecasts 71 of 100 outcomes right instead of 83" in worse
    unclear = stories.say_forecasts(rec.FitSummary(100, -0.9, -0.89, 0.01, 0.05, None, None, 0.71, 0.72))
    assert "not clearly better" in unclear
    assert "scores worse" in stories.say_forecasts(rec.FitSummary(100, -0.9, -1.0, -0.1, 0.05, None, None, 0.71, 0.70))
    far = stories.say_forecasts(rec.FitSummary(100, -0.9, -0.7, 0.2, 0.05, 7.2, 0.84, None, None))
    assert "heights within 84 cm instead of 7.2 m" in far
    ends = stories.say_forecasts(rec.FitSummary(100, -0.9, -0.7, 0.2, 0.05, 0.06, 0.02, None, None, "track end"))
    assert "how high tracks end, from their first 40 %, within 2 cm instead of 6 cm" in ends


@pytest.mark.parametrize(("what", "shape", "said"), [
    (BATTERY, "straight", "the ball leaves faster as the battery's voltage grows, by 12 % over its range"),
    (BATTERY, "step at 11.9", "faster where the battery's voltage is above 11.9, by 12 %: a step, not a drift"),
    (CovariatePair(BATTERY, WARMTH, np.zeros((2, 4))), "product",
     "up to 12 %, as the battery's voltage and the temperature go"),
    (Factor("supplier", ("a", "b"), np.zeros(4, int)), "a", "by up to 12 %, depending on supplier"),
    (None, "same", "by 12 %, in every shot alike"), (None, "measured", "by 12 % (90 %: 9 % to 15 %), in every shot")])
def test_what_has_no_name_is_described(what: Covariate | CovariatePair | Factor | None, shape: str, said: str) -> None:
    column = Column("launch speed", "free", "launch", "along", "1", 0.2, ("the ball leaves faster", "slower"))
    correction = stand_in(Correction)
    place = Place(Test("free", 0, what, shape, np.zeros(4)), column, 0, correction, {}, {}, None)
    ends = (-0.15, -0.09) if shape == "measured" else (None, None)
    unknown = rec.Unknown(None if what is None else what.name, "along", -0.12 if ends[0] else 0.12, "1", *ends)
    found = msgspec.structs.replace(record(), unknown=unknown)
    assert said in stories.tell(found, place).told.change


def test_a_name_that_shows_as_a_step_in_time_says_since_when() -> None:
    column = Column("launch elevation", "free", "launch", "vertical", "rad", 0.02, ("steeper", "flatter"))
    time = Covariate((("t_s", np.arange(4.0)),))
    where = msgspec.structs.replace(WHERE, stage_probability={"launch": 1.0})
    for what, shape, told in ((time, "step at 2990", True), (time, "straight", False), (BATTERY, "step at 12", False)):
        place = Place(Test("free", 0, what, shape, np.zeros(4)), column, 0, stand_in(Correction), {}, {}, None)
        said = stories.say_where(where, place)
        assert ("as a step where the time in the session is above 2990" in said) == told


def test_console_lines_name_steps_and_what_was_left_out() -> None:
    steps = ({"do": "measure", "what": "ball mass with a scale"},
             {"do": "shoot", "distance_m": 6.6, "hood_deg": 38.0, "motor_ratio": 0.62, "motor_rpm": 3517, "shots": 20,
              "separates": ["hood_offset", "wind_x"]})
    finding = record((named("drag", 0.5, 0.1, 0.7), named("wind_x", 1.0, 0.1, 0.0001)), ("drag",), steps=steps)
    lines = stories.console_lines(stories.retell(finding))
    assert "Next: Measure ball mass with a scale." in lines
    shoot = "next: 20 shots at 6.6 m, hood 38°, motor 0.62 (3517 rpm), to tell hood offset from head or tail wind"
    assert shoot in lines
    assert "next: measure ball mass with a scale" in lines and "left out: 2 shots" in lines
    assert "names: drag 70%" in lines
    sure = msgspec.structs.replace(finding, data=msgspec.structs.replace(finding.data, level="L2"),
                                   what=(named("drag", 0.5, 0.1, 0.99),))
    assert stories.tell(sure, None).told.sure.endswith("74 in 100 were right in sealed tests.")
    assert text.say_step(steps[0]) == "measure ball mass with a scale"


GOLDEN = sorted((Path(__file__).parents[2] / "golden" / "reference").glob("finding-*/finding.json"))


@pytest.mark.parametrize(("old", "new", "error"), [
    (b'"truearc.finding/1"', b'"truearc.finding/2"', "schema: got 'truearc.finding/2'"),
    (b'"verdict"', b'"said"', r"finding\.json: verdict: missing key"),
    (b'"shots"', b'"shots', "finding.json: ")])
def test_load_record_refuses_what_is_no_finding(tmp_path: Path, old: bytes, new: bytes, error: str) -> None:
    path = tmp_path / "finding.json"
    path.write_bytes(GOLDEN[0].read_bytes().replace(old, new, 1))
    with pytest.raises(InputError, match=error):
        rec.load_record(path)


def test_room_is_one_of_the_things_believed() -> None:
    assert text.list_believed(("gravity", *ROOM, "drag")) == "gravity, drag, room for errors of the model"
    assert text.list_believed(("gravity", "free_speed")) == "gravity, a curve of the launch speed"
