"""What was named is believed from then on, and the simulator that believes it foretells better."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

from sim.belief import load_belief, save_belief
from sim.circumstances import circumstances_of
from sim.curve import before_the_shot
from sim.discover.adopt import make_belief
from sim.discover.discover import Investigation, discover
from sim.physics.shot import classify, predict
from sim.prove.truth.shoot import shoot
from sim.prove.truth.world import make_world
from sim.shots import Dataset, Shots

pytestmark = pytest.mark.slow
SHOTS = 100


@pytest.fixture(scope="module")
def hasty() -> tuple[Dataset, Investigation]:
    """A robot that shoots too soon after the shot before."""
    dataset = shoot(make_world({"rapid_fire": 0.12}, "L1", SHOTS, 1, side=True))
    return dataset, discover(dataset, seed=1)


@pytest.fixture(scope="module")
def nameless() -> Investigation:
    return discover(shoot(make_world({"far_kick": 0.15}, "L2", 120, 3)), seed=1)


def right(dataset: Dataset, coefficients: dict[str, dict[str, float]]) -> float:
    """Share of outcomes that the simulator foretells without any scatter: another code than the fit's."""
    height_m = predict(dataset.facts, coefficients, dataset.shots, circumstances=circumstances_of(dataset)).height_m
    return float(np.mean(classify(dataset.facts, height_m) == np.array(dataset.shots.text("outcome"))))


def test_the_named_effect_is_among_the_coefficients(hasty: tuple[Dataset, Investigation], tmp_path: Path) -> None:
    _, found = hasty
    belief, provenance = make_belief(found)
    assert provenance["adopted"] == ["rapid_fire"] and provenance["shots"] == SHOTS
    (interval,) = found.finding.what[0].parameters.values()
    assert belief.coefficients["rapid_fire"]["loss"] == pytest.approx(interval.value)
    row = belief.names.index("rapid_fire.loss")
    assert 0.5 * interval.sd < belief.covariance[row, row]**0.5 <= 1.001 * interval.sd
    assert set(belief.coefficients) == {"drag", "magnus", "exit_efficiency", "rapid_fire"}
    assert 0.003 < belief.scatter["speed"] < 0.05 and 0.02 < belief.scatter["elevation_deg"] < 2.0
    assert not any(name.startswith(("track_", "scatter.distance")) for name in belief.names)
    path = tmp_path / "adopted.toml"
    save_belief(path, belief, provenance)
    again = load_belief(path)
    assert again.coefficients == belief.coefficients and np.allclose(again.covariance, belief.covariance)


def test_what_foretells_unseen_shots_worse_is_not_adopted(hasty: tuple[Dataset, Investigation]) -> None:
    found = hasty[1]
    fit = structs.replace(found.finding.fit, gain_per_shot=-0.1, gain_se=0.02)
    worse = structs.replace(found.finding, fit=fit)
    belief, provenance = make_belief(replace(found, finding=worse))
    assert "rapid_fire" not in belief.coefficients and provenance["adopted"] == []
    assert "surely worse" in provenance["refused"]


def test_a_curve_beside_which_a_coefficient_is_impossible_is_not_adopted(nameless: Investigation) -> None:
    found = nameless
    last = found.steps[-1]
    assert last.place is not None
    correction = last.place.correction
    k = [column.name for column in correction.evidence.columns].index("drag.cd") - 1
    shared = correction.shared.copy()
    shared[k] = -5.0
    place = replace(last.place, correction=replace(correction, shared=shared))
    belief, provenance = make_belief(replace(found, steps=(*found.steps[:-1], replace(last, place=place))))
    assert belief.curve is None and belief.coefficients["drag"]["cd"] > 0.0
    assert "drag.cd would be impossible" in provenance["refused"]


def test_the_simulator_that_believes_it_foretells_better(hasty: tuple[Dataset, Investigation]) -> None:
    dataset, found = hasty
    adopted = make_belief(found)[0].coefficients
    without = {name: values for name, values in adopted.items() if name != "rapid_fire"}
    assert right(dataset, adopted) > right(dataset, without) + 0.03


def test_without_a_finding_the_fit_alone_is_adopted() -> None:
    found = discover(shoot(make_world({}, "L1", SHOTS, 1, side=True)), seed=1)
    belief, provenance = make_belief(found)
    assert provenance["adopted"] == [] and provenance["verdict"] == "none"
    assert set(belief.coefficients) == {"drag", "magnus", "exit_efficiency"}
    assert belief.coefficients["drag"]["cd"] == pytest.approx(found.finding.data.fitted["all"]["drag.cd"])


def test_data_that_say_nothing_lead_to_no_belief() -> None:
    shots = Shots(tuple(map(str, range(20))), {"distance_m": np.linspace(2.0, 6.0, 20)}, {})
    with pytest.raises(ValueError, match="no test"):
        make_belief(discover(Dataset("mute", make_world().facts, shots)))


def test_what_has_no_name_is_adopted_as_a_curve(nameless: Investigation, tmp_path: Path) -> None:
    """Beyond some distance the ball leaves faster than it should: nobody knows why, but other shots are foretold."""
    found, unseen = nameless, shoot(make_world({"far_kick": 0.15}, "L2", 120, 4))
    assert found.finding.verdict == "unknown"
    belief, provenance = make_belief(found)
    assert provenance["adopted"] == ["launch speed by distance_m"]
    save_belief(tmp_path / "adopted.toml", belief, provenance)
    adopted = load_belief(tmp_path / "adopted.toml")
    assert adopted.curve is not None and adopted.curve.covariate == "distance_m"
    around = before_the_shot(adopted.curve, unseen.facts, unseen.shots)
    with_it = predict(unseen.facts, adopted.coefficients, unseen.shots, circumstances=around).height_m
    plain = {name: values for name, values in adopted.coefficients.items() if name != "free_speed"}
    without = predict(unseen.facts, plain, unseen.shots).height_m
    truth = np.array(unseen.shots.text("outcome"))
    share = [np.mean(classify(unseen.facts, height_m) == truth) for height_m in (with_it, without)]
    assert share[0] > share[1] + 0.03
