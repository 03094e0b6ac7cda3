"""Two sessions of one rig: only what has changed is named; several names are parted by a tape, or averaged."""

from dataclasses import replace

import numpy as np
import pytest

import truearc as ta
from truearc.sim.data.dataset import Dataset, circumstances_of
from truearc.sim.discover.finding import FindingRecord
from truearc.sim.discover.investigate import (
    Investigation,
    ball_effects,
    discover,
    judge_adoption,
    make_belief,
    with_own_priors,
)
from truearc.sim.discover.report.story import say_adopted
from truearc.sim.discover.select.simulations import mixed, shares
from truearc.sim.infer.belief import Belief, Coefficients, load_belief, point_belief
from truearc.sim.infer.launcher import coefficients_of
from truearc.sim.infer.likelihood.layout import Measurement
from truearc.sim.infer.likelihood.score_table import ScoreTable
from truearc.sim.infer.room import ROOM
from truearc.sim.physics.catalogue import BUILT_IN
from truearc.sim.physics.simulate import opening_of, predict
from truearc_proof.truth.generate import shoot
from truearc_proof.truth.world import World, make_world

SHOTS = 32                            # few sizes: each is compiled
FIRST = make_world({}, "L2", SHOTS, 21, side=True)


@pytest.fixture(scope="module")
def belief() -> Belief:
    return make_belief(discover(shoot(FIRST)))[0]


def later(seed: int, **changes: float) -> World:
    """The same rig, shot again."""
    other = make_world({name: changes.pop(name) for name in ("hood_offset",) if name in changes}, "L2", SHOTS, seed,
                       side=True)
    return replace(other, cd=FIRST.cd * changes.get("cd", 1.0), lift_slope=FIRST.lift_slope,
                   efficiency=FIRST.efficiency)


def ask(world: World, belief: Belief) -> FindingRecord:
    return discover(shoot(world), belief=belief).finding


@pytest.mark.slow
def test_nothing_has_changed_whether_or_not_home_is_looked_at_again(belief: Belief) -> None:
    dataset = shoot(later(31))
    since = discover(dataset, belief=belief, since=shoot(FIRST)).finding
    assert since.verdict == "none", since.sentence
    finding = discover(dataset, belief=belief).finding
    assert finding.verdict == "none", finding.sentence
    assert set(finding.data.believed) == {"gravity", "drag", "magnus", "exit_efficiency"}


@pytest.mark.slow
def test_a_believed_number_that_has_changed_is_named_with_its_change_and_value(belief: Belief) -> None:
    finding = ask(later(33, cd=1.4), belief)
    first = finding.what[0]
    assert finding.verdict == "named" and first.term == "drag", finding.sentence
    assert first.believed == pytest.approx(belief.value("drag.cd"))
    assert first.parameters["cd"].low90 < 1.4 * FIRST.cd < first.parameters["cd"].high90
    assert first.size.low90 < 0.4 * FIRST.cd < first.size.high90
    assert finding.sentence.index("Drag changed by ") < finding.sentence.index("; now the air slows the ball")


@pytest.mark.slow
def test_a_change_is_adopted_unless_other_balls_would_be_foretold_worse_by_it(belief: Belief) -> None:
    dataset = shoot(later(33, cd=1.4))
    nobodys = {name: texts for name, texts in dataset.shots.texts.items() if name != "ball_id"}
    found = discover(replace(dataset, shots=replace(dataset.shots, texts=nobodys)), belief=belief)
    assert found.fitted is not None and len(ball_effects(found.fitted.scores))
    adopted, provenance = make_belief(found)
    assert provenance["adopted"] == ["drag"] and "refused" not in provenance
    kept, provenance = make_belief(found, judge_adoption(found, lambda before, after: (-2.0, -1.0)))
    assert provenance["adopted"] == [] and "other balls" in provenance["refused"]
    assert kept.value("drag.cd") < adopted.value("drag.cd")


@pytest.mark.slow
def test_denser_air_is_one_thing_and_not_two(belief: Belief) -> None:
    world = later(35)
    finding = ask(replace(world, cd=1.2 * world.cd, lift_slope=1.2 * world.lift_slope), belief)
    assert finding.verdict in ("named", "set") and finding.also == (), finding.sentence
    assert "air_change" in (finding.set or ())
    size = next(one for one in finding.what if one.term == "air_change").parameters["share"]
    assert size.low90 < 0.2 < size.high90


@pytest.mark.slow
def test_what_was_not_there_before_is_named_as_ever(belief: Belief) -> None:
    finding = ask(later(34, hood_offset=1.5), belief)
    first = finding.what[0]
    assert finding.verdict == "named" and first.term == "hood_offset", finding.sentence
    assert first.believed is None
    assert first.parameters["angle_deg"].value == pytest.approx(1.5, abs=0.4)


TARGET = "target_height.rise_m"


@pytest.fixture(scope="module")
def raised() -> tuple[Dataset, Investigation]:
    """A target that stands too high: at L0 the same as a launcher that is too low, or a camera that is off."""
    dataset = shoot(make_world({"target_height": 0.25}, "L0", 192, 7, side=True))
    return dataset, discover(dataset, seed=1)


def above_m(dataset: Dataset, coefficients: Coefficients) -> np.ndarray:
    """Heights above the opening's centre."""
    height_m = predict(dataset.facts, coefficients, dataset.shots, circumstances=circumstances_of(dataset)).height_m
    return np.asarray(height_m) - opening_of(dataset.facts, coefficients).centre_m


def believed_at(evidence: ScoreTable, believed: tuple[str, ...]) -> Coefficients:
    shared = evidence.pick(np.arange(evidence.first_shared, len(evidence.columns)))
    return point_belief(coefficients_of(shared, believed, BUILT_IN)).coefficients


@pytest.mark.slow
def test_it_forecasts_the_average_and_no_single_name_does(raised, tmp_path):
    dataset, found = raised
    assert found.finding.verdict == "set"
    step, believed = with_own_priors(found.steps[-1:]), found.finding.data.believed
    share = shares(step.naming)
    forecasts = {name: above_m(dataset, believed_at(step.naming.refits[name].scores, believed)) for name in share}
    before = above_m(dataset, believed_at(step.fitted.scores, believed))
    average = (1.0 - sum(share.values())) * before + sum(share[name] * forecasts[name] for name in share)
    belief, provenance = make_belief(found)
    off = {name: np.sqrt(np.nanmean((one - average)**2)) for name, one in {**forecasts, "nothing": before}.items()}
    averaged = mixed(step)                # before it gets its room
    assert averaged is not None
    adopted = np.sqrt(np.nanmean((above_m(dataset, believed_at(averaged.fitted.scores, believed)) - average)**2))
    assert adopted < 0.25 * min(off.values()), (adopted, off)
    assert provenance["averaged"] and len(provenance["adopted"]) == len(share) > 1
    named = {name.partition(".")[0] for name in share}
    assert set(belief.coefficients) == {*believed, *named, *ROOM} - {"gravity"}
    assert np.linalg.eigvalsh(belief.covariance).min() > 0.0
    assert {name for name in share if name not in belief.names} == set()
    adopted = ta.Finding("raised", found).adopt()
    assert say_adopted(found.finding, adopted.provenance).startswith("adopted: the average of ")
    adopted.save(tmp_path / "a.toml")
    assert load_belief(tmp_path / "a.toml").coefficients == belief.coefficients


@pytest.mark.slow
def test_one_name_that_stands_alone_is_adopted_alone(raised: tuple[Dataset, Investigation]) -> None:
    step = raised[1].steps[-1]
    sure = replace(step, naming=replace(step.naming, inclusion={step.naming.leader: 0.95}))
    assert mixed(sure) is None
    belief, provenance = make_belief(replace(raised[1], steps=(sure,)))
    assert provenance["adopted"] == [step.naming.leader.partition(".")[0]] and not provenance["averaged"]
    assert belief.coefficients[provenance["adopted"][0]]


@pytest.mark.slow
def test_a_tape_parts_what_shots_cannot(raised: tuple[Dataset, Investigation]) -> None:
    dataset, alone = raised[0], raised[1].finding
    assert alone.set is not None and len(alone.set) > 1 and "target_height" in alone.set
    there = discover(dataset, seed=1, measured={TARGET: Measurement(0.248, 0.01)}).finding
    assert there.set == ("target_height",) and there.verdict == "named"
    not_there = discover(dataset, seed=1, measured={TARGET: Measurement(0.002, 0.01)}).finding
    assert "target_height" not in (not_there.set or ())
    assert {one.term: one.probability for one in not_there.what}.get("target_height", 0.0) < 0.05
    assert there.mismatch.p_value == alone.mismatch.p_value == not_there.mismatch.p_value


@pytest.mark.slow
def test_what_is_believed_already_cannot_be_measured_beside(raised: tuple[Dataset, Investigation]) -> None:
    with pytest.raises(ta.InputError, match="exit_efficiency is believed already"):
        discover(raised[0], measured={"exit_efficiency.loss": Measurement(0.1, 0.01)})
