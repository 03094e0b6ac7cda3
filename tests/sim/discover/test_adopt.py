"""A named effect is believed from then on, and the simulator that believes it forecasts better."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

import truearc as ta
from tests.sim.discover.odd_rigs import make_drops
from tests.sim.few_terms import few_terms
from truearc.sim.data.dataset import Dataset, Shots, circumstances_of
from truearc.sim.discover import investigate as adopt
from truearc.sim.discover.finding import Adoption
from truearc.sim.discover.investigate import Investigation, discover, judge_adoption, make_belief, with_worth
from truearc.sim.discover.report.story import console_lines, say_adopted
from truearc.sim.infer.belief import Belief, Curve, before_the_shot, load_belief, point_belief
from truearc.sim.infer.launcher import Launcher
from truearc.sim.infer.likelihood.data import take_in
from truearc.sim.infer.likelihood.layout import lay_out
from truearc.sim.infer.room import ROOM, has_room
from truearc.sim.physics.simulate import classify, predict
from truearc_proof.truth.generate import shoot
from truearc_proof.truth.world import make_world

pytestmark = pytest.mark.slow
SHOTS = 96
FEW = few_terms("rapid_fire", "hood_offset", "wheel_slip", "wind_x")


@pytest.fixture(scope="module")
def hasty() -> tuple[Dataset, Investigation]:
    """A robot that shoots too soon after the shot before."""
    dataset = shoot(make_world({"rapid_fire": 0.12}, "L1", SHOTS, 1, side=True))
    return dataset, discover(dataset, seed=1, terms=FEW)


@pytest.fixture(scope="module")
def season() -> tuple[Dataset, Dataset]:
    """Earlier and later shots of a world with an unexplained effect."""
    whole = shoot(make_world({"far_kick": 0.15}, "L2", 128, 3))
    return whole.take(range(64)), whole.take(range(64, 128))


@pytest.fixture(scope="module")
def nameless(season: tuple[Dataset, Dataset]) -> Investigation:
    return discover(season[0], seed=1, terms=FEW)


def right(dataset: Dataset, coefficients: dict[str, dict[str, float]]) -> float:
    """Share of outcomes that the simulator forecasts without any scatter: another code than the fit's."""
    height_m = predict(dataset.facts, coefficients, dataset.shots, circumstances=circumstances_of(dataset)).height_m
    return float(np.mean(classify(dataset.facts, height_m) == np.array(dataset.shots.text("outcome"))))


def test_the_named_effect_is_among_the_coefficients(hasty: tuple[Dataset, Investigation], tmp_path: Path) -> None:
    _, found = hasty
    belief, provenance = make_belief(found)
    assert provenance["adopted"] == ["rapid_fire"] and provenance["shots"] == SHOTS
    (interval,) = found.finding.what[0].parameters.values()
    # larger than usual: by the prior of the usual size, with which names are compared, it is drawn towards zero
    adopted, usual = belief.coefficients["rapid_fire"]["loss"], float(found.steps[0].refit.amplitude[0])
    assert usual < adopted < interval.value + 0.05 * interval.sd
    row = belief.names.index("rapid_fire.loss")
    assert 0.5 * interval.sd < belief.covariance[row, row]**0.5 <= 1.4 * interval.sd
    assert set(belief.coefficients) == {"drag", "magnus", "exit_efficiency", "rapid_fire", *ROOM}
    assert 0.003 < belief.scatter["speed"] < 0.05 and 0.02 < belief.scatter["elevation_deg"] < 2.0
    assert not any(name.startswith(("track_", "scatter.distance")) for name in belief.names)
    path = tmp_path / "adopted.toml"
    replace(belief, provenance=provenance).save(path)
    again = load_belief(path)
    assert again.coefficients == belief.coefficients and np.allclose(again.covariance, belief.covariance)


def test_what_foretells_unseen_shots_worse_is_not_adopted(hasty: tuple[Dataset, Investigation]) -> None:
    found = hasty[1]
    fit = structs.replace(found.finding.fit, gain_per_shot=-0.1, gain_se=0.02)
    worse = structs.replace(found.finding, fit=fit)
    belief, provenance = make_belief(replace(found, finding=worse))
    assert "rapid_fire" not in belief.coefficients and provenance["adopted"] == []
    assert "are worse" in provenance["refused"]


def test_what_would_lose_points_is_not_adopted(hasty, monkeypatch):
    """As where a hold-out shot, aimed by it, would have missed what it hit."""
    found = with_worth(hasty[1]).finding.adoption
    assert isinstance(found, Adoption) and found.refused is None and found.shots == SHOTS
    assert found.low90 <= found.gain <= found.high90 and 0.0 < found.gain < 3.0
    assert found.aimed_after > found.aimed_before
    lost = structs.replace(found, gain=-0.05, low90=-0.2, high90=0.1)
    monkeypatch.setattr(adopt, "judge_points", lambda investigation, taken, threshold: lost)
    belief, provenance = make_belief(hasty[1])
    assert provenance["adopted"] == [] and "rapid_fire" not in belief.coefficients
    assert provenance["refused"].startswith("aimed and gated by it, hold-out shots would have scored 0.05 points")
    assert make_belief(hasty[1], judge_adoption(hasty[1], threshold=None))[1]["adopted"] == ["rapid_fire"]
    said = with_worth(hasty[1]).finding
    assert isinstance(said.adoption, Adoption) and said.adoption.refused == provenance["refused"]
    assert any("not adopted as found: aimed and gated" in line for line in console_lines(said))


def test_of_an_unexplained_effect_the_nearest_names_are_adopted_where_they_clearly_score(hasty, monkeypatch):
    """Else nothing; and then a belief that was started from stays as it is, not fitted to what no term explains."""
    found = hasty[1]
    unnamed = replace(found, steps=tuple(replace(step, unknown=True, place=None, change=None) for step in found.steps))
    belief, provenance = make_belief(unnamed)
    assert provenance["adopted"][0].startswith("rapid_fire") and "rapid_fire" in belief.coefficients
    judged = with_worth(found).finding.adoption
    assert isinstance(judged, Adoption) and judged.low90 > 0.0
    unsure = structs.replace(judged, low90=0.0)
    monkeypatch.setattr(adopt, "judge_points", lambda investigation, taken, threshold: unsure)
    belief, provenance = make_belief(unnamed)
    assert provenance["adopted"] == [] and "rapid_fire" not in belief.coefficients
    before = point_belief({"drag": {"cd": 0.5}})
    kept, provenance = make_belief(replace(unnamed, belief=before))
    assert kept is before and say_adopted(found.finding, provenance).startswith("adopted: nothing, the belief stays")


def test_the_simulator_that_believes_it_foretells_better(hasty: tuple[Dataset, Investigation]) -> None:
    dataset, found = hasty
    adopted = make_belief(found)[0].coefficients
    without = {name: values for name, values in adopted.items() if name != "rapid_fire"}
    assert right(dataset, adopted) > right(dataset, without) + 0.03


def test_without_a_finding_the_fit_alone_is_adopted_with_room_for_what_it_gets_wrong() -> None:
    found = discover(shoot(make_world({}, "L1", SHOTS, 1, side=True)), seed=1, terms=FEW)
    belief, provenance = make_belief(found)
    assert provenance["adopted"] == [] and provenance["verdict"] == "none"
    assert set(belief.coefficients) == {"drag", "magnus", "exit_efficiency", *ROOM} and has_room(belief)
    place, fitted = belief.names.index("drag.cd"), found.finding.data.fitted["all"]["drag.cd"]
    doubt = 2.0 * belief.covariance[place, place]**0.5
    assert belief.coefficients["drag"]["cd"] == pytest.approx(fitted, rel=doubt)


def test_data_that_say_nothing_lead_to_no_belief() -> None:
    shots = Shots(tuple(map(str, range(20))), {"distance_m": np.linspace(2.0, 6.0, 20)}, {})
    with pytest.raises(ValueError, match="no test"):
        make_belief(discover(Dataset("mute", make_world().facts, shots)))


def test_what_has_no_name_is_adopted_as_a_curve(nameless, season, tmp_path):
    """Beyond some distance the ball leaves faster than it should: the cause is unknown, other shots are forecast."""
    found, unseen = nameless, season[1]
    assert found.finding.verdict == "unknown"
    belief, provenance = make_belief(found)
    assert provenance["adopted"] == ["launch speed by distance_m"]
    replace(belief, provenance=provenance).save(tmp_path / "adopted.toml")
    adopted = load_belief(tmp_path / "adopted.toml")
    assert adopted.curves["free_speed"].covariate == "distance_m"
    around = before_the_shot(adopted.curves, unseen.facts, unseen.shots)
    with_it = predict(unseen.facts, adopted.coefficients, unseen.shots, circumstances=around).height_m
    plain = {name: values for name, values in adopted.coefficients.items() if name != "free_speed"}
    without = predict(unseen.facts, plain, unseen.shots).height_m
    truth = np.array(unseen.shots.text("outcome"))
    share = [np.mean(classify(unseen.facts, height_m) == truth) for height_m in (with_it, without)]
    assert share[0] > share[1] + 0.03


def test_a_curve_that_is_believed_is_not_found_again(nameless: Investigation, season: tuple[Dataset, Dataset]) -> None:
    """And what is new beside it is named; without the curve the same shots speak of it once more."""
    later, belief = season[1], make_belief(nameless)[0]
    curve = belief.curves["free_speed"]
    kept = [k for k, name in enumerate(belief.names) if not name.startswith("curve.")]
    plain = Belief({name: value for name, value in belief.coefficients.items() if name != "free_speed"}, belief.scatter,
                   tuple(belief.names[k] for k in kept), belief.covariance[np.ix_(kept, kept)])
    assert not discover(later, seed=1, belief=belief, terms=FEW).finding.mismatch.found
    assert discover(later, seed=1, belief=plain, terms=FEW).finding.mismatch.found
    numbers = {**later.shots.numbers, "hood_deg": later.shots.number("hood_deg") - 2.0}
    bent = discover(replace(later, shots=replace(later.shots, numbers=numbers)), seed=1, belief=belief, terms=FEW)
    assert bent.finding.verdict == "named" and bent.finding.what[0].term == "hood_offset"
    adopted, provenance = make_belief(bent)
    assert provenance["adopted"] == ["hood_offset"] and "refused" not in provenance
    assert adopted.coefficients["hood_offset"]["angle_deg"] == pytest.approx(2.0, abs=0.3)
    again = adopted.curves["free_speed"]
    assert again.at == curve.at and again.value != curve.value and np.allclose(again.value, curve.value, atol=0.02)


@pytest.mark.parametrize("curve", [
    Curve((0.01, 0.02, 0.0), 0.0, "distance_m", (2.0, 4.0, 6.0), low=2.0, high=6.0),
    Curve((0.01, 0.02, 0.0, -0.01, 0.01), 0.0, over={"distance_m": (2.0, 6.0)})])
def test_points_of_a_curve_are_felt_as_far_as_a_shot_goes_with_them(curve: Curve) -> None:
    """The same as a deviation of that shot's elevation, which the chain knows without any curve."""
    belief = replace(point_belief({"drag": {"cd": 0.5}, "magnus": {"cl": 0.06}, "free_elevation": {"angle_rad": 1.0}}),
                     curves={"free_elevation": curve})
    dataset = shoot(make_world({}, "L1", 40, 9))
    intake = take_in(dataset, belief.curves)
    layout = lay_out(intake, ("gravity", *belief.coefficients), belief=belief)
    model = Launcher(intake, layout)
    evidence, _ = model.linearise(model.middle())
    steeper = evidence.score[:, evidence.index("launch elevation")]
    by = curve.by({"distance_m": dataset.shots.number("distance_m")[intake.rows]}, len(intake.rows))
    for k in range(len(curve.value)):
        felt = evidence.score[:, evidence.index(f"curve.free_elevation.{k}")]
        assert np.allclose(felt, by[:, k] * steeper, atol=1e-9)
    first = evidence.columns[evidence.index("curve.free_elevation.0")]
    assert first.kind == "shared" and first.stage == "launch" and not first.told


def filmed(tilt_deg: float) -> Dataset:
    """Falling balls, drag 0.5, filmed by a camera that is tilted forwards about a place 5 m up."""
    drops = make_drops(14, 2)
    assert drops.tracks is not None
    x_m, z_m = drops.tracks.x_m, drops.tracks.z_m - 5.0
    cos, sin = np.cos(np.radians(tilt_deg)), np.sin(np.radians(tilt_deg))
    return replace(drops, tracks=replace(drops.tracks, x_m=cos * x_m - sin * z_m, z_m=5.0 + sin * x_m + cos * z_m))


def test_nothing_is_adopted_beside_a_tracker_error_at_its_bound() -> None:
    level = ta.discover(filmed(0.0), believe=["gravity"], terms=FEW)
    started = level.adopt()
    assert started.coefficients["drag"]["cd"] == pytest.approx(0.5, 0.1)
    tilted = ta.discover(filmed(20.0), believe=["gravity"], terms=FEW)     # the fit takes at most 15 degrees
    assert tilted.record.data.at_limit["track_tilt.angle_deg"] == 15.0
    assert "track_tilt.angle_deg at 15" in tilted.sentence
    with pytest.raises(ta.InputError, match="nothing is adopted: track_"):
        tilted.adopt()
    assert make_belief(replace(tilted.investigation, belief=started))[0] is started


def test_what_was_judged_with_the_finding_is_not_judged_again(hasty, monkeypatch):
    fresh, told = make_belief(hasty[1])
    found = ta.Finding(hasty[0].name, with_worth(hasty[1]))
    monkeypatch.setattr(adopt, "choose", None)
    belief = found.adopt()
    assert told.items() <= belief.provenance.items() and belief.coefficients == fresh.coefficients
    assert np.array_equal(belief.covariance, fresh.covariance)
