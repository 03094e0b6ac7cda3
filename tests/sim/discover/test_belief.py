"""One rig, two sessions: what the first left is believed in the second, where only what has changed is named."""

from dataclasses import replace

import pytest

from truearc.sim.discover.finding import FindingRecord
from truearc.sim.discover.investigate import ball_effects, discover, judge_adoption, make_belief
from truearc.sim.infer.belief import Belief
from truearc_proof.truth.generate import shoot
from truearc_proof.truth.world import World, make_world

pytestmark = pytest.mark.slow
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


def test_nothing_has_changed_whether_or_not_home_is_looked_at_again(belief: Belief) -> None:
    dataset = shoot(later(31))
    since = discover(dataset, belief=belief, since=shoot(FIRST)).finding
    assert since.verdict == "none", since.sentence
    finding = discover(dataset, belief=belief).finding
    assert finding.verdict == "none", finding.sentence
    assert set(finding.data.believed) == {"gravity", "drag", "magnus", "exit_efficiency"}


def test_a_believed_number_that_has_changed_is_named_with_both_values(belief: Belief) -> None:
    finding = ask(later(33, cd=1.4), belief)
    first = finding.what[0]
    assert finding.verdict == "named" and first.term == "drag", finding.sentence
    assert first.believed == pytest.approx(belief.value("drag.cd"))
    assert first.parameters["cd"].low90 < 1.4 * FIRST.cd < first.parameters["cd"].high90
    assert "and not" in finding.sentence


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


def test_denser_air_is_one_thing_and_not_two(belief: Belief) -> None:
    world = later(35)
    finding = ask(replace(world, cd=1.2 * world.cd, lift_slope=1.2 * world.lift_slope), belief)
    assert finding.verdict in ("named", "set") and finding.also == (), finding.sentence
    assert "air_change" in (finding.set or ())
    size = next(one for one in finding.what if one.term == "air_change").parameters["share"]
    assert size.low90 < 0.2 < size.high90


def test_what_was_not_there_before_is_named_as_ever(belief: Belief) -> None:
    finding = ask(later(34, hood_offset=1.5), belief)
    first = finding.what[0]
    assert finding.verdict == "named" and first.term == "hood_offset", finding.sentence
    assert first.believed is None
    assert first.parameters["angle_deg"].value == pytest.approx(1.5, abs=0.4)
