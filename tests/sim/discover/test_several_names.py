"""Where several names are left: a measurement decides, or what is adopted forecasts their average, as code that shares
nothing with the fit works it out."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import truearc as ta
from truearc.errors import InputError
from truearc.sim.data.dataset import Dataset, circumstances_of
from truearc.sim.discover.investigate import Investigation, discover, make_belief, with_own_priors
from truearc.sim.discover.report.finding_text import say_adopted
from truearc.sim.discover.select.simulations import LEAST_SHARE, mixed, shares
from truearc.sim.infer.belief import Coefficients, load_belief, point_belief
from truearc.sim.infer.launcher import coefficients_of
from truearc.sim.infer.likelihood.layout import Measurement
from truearc.sim.infer.likelihood.score_table import ScoreTable
from truearc.sim.physics.catalogue import BUILT_IN
from truearc.sim.physics.simulate import opening_of, predict
from truearc_proof.truth.generate import shoot
from truearc_proof.truth.world import make_world

pytestmark = pytest.mark.slow
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


def test_it_forecasts_the_average_and_no_single_name_does(raised: tuple[Dataset, Investigation],
                                                          tmp_path: Path) -> None:
    dataset, found = raised
    assert found.finding.verdict == "set"
    step, believed = with_own_priors(found.steps[-1:]), found.finding.data.believed
    share = shares(step.naming)
    forecasts = {name: above_m(dataset, believed_at(step.naming.refits[name].scores, believed)) for name in share}
    before = above_m(dataset, believed_at(step.fitted.scores, believed))
    average = (1.0 - sum(share.values())) * before + sum(share[name] * forecasts[name] for name in share)
    belief, provenance = make_belief(found)
    off = {name: np.sqrt(np.nanmean((one - average)**2)) for name, one in {**forecasts, "nothing": before}.items()}
    adopted = np.sqrt(np.nanmean((above_m(dataset, belief.coefficients) - average)**2))
    assert adopted < 0.25 * min(off.values()), (adopted, off)
    assert provenance["averaged"] and len(provenance["adopted"]) == len(share) > 1
    assert set(belief.coefficients) == {*believed, *(name.partition(".")[0] for name in share)} - {"gravity"}
    assert np.linalg.eigvalsh(belief.covariance).min() > 0.0
    assert {name for name in share if name not in belief.names} == set()
    adopted = ta.Finding("raised", found).adopt()
    assert say_adopted(found.finding, adopted.provenance).startswith("adopted: the average of ")
    adopted.save(tmp_path / "a.toml")
    assert load_belief(tmp_path / "a.toml").coefficients == belief.coefficients


def test_nothing_is_as_likely_beforehand_as_all_names_together(raised: tuple[Dataset, Investigation]) -> None:
    naming = raised[1].steps[-1].naming
    share = shares(naming)
    odds = {name: np.exp(naming.nats[name]) / sum(one.visible for one in naming.candidates) for name in naming.refits}
    whole = 1.0 + sum(odds.values())
    assert share == pytest.approx({name: value / whole for name, value in odds.items() if value / whole >= LEAST_SHARE})
    assert list(share.values()) == sorted(share.values(), reverse=True)


def test_one_name_that_stands_alone_is_adopted_alone(raised: tuple[Dataset, Investigation]) -> None:
    step = raised[1].steps[-1]
    sure = replace(step, naming=replace(step.naming, inclusion={step.naming.leader: 0.95}))
    assert mixed(sure) is None
    belief, provenance = make_belief(replace(raised[1], steps=(sure,)))
    assert provenance["adopted"] == [step.naming.leader.partition(".")[0]] and not provenance["averaged"]
    assert belief.coefficients[provenance["adopted"][0]]


def test_a_tape_parts_what_shots_cannot(raised: tuple[Dataset, Investigation]) -> None:
    dataset, alone = raised[0], raised[1].finding
    assert alone.set is not None and len(alone.set) > 1 and "target_height" in alone.set
    there = discover(dataset, seed=1, measured={TARGET: Measurement(0.248, 0.01)}).finding
    assert there.set == ("target_height",) and there.verdict == "named"
    not_there = discover(dataset, seed=1, measured={TARGET: Measurement(0.002, 0.01)}).finding
    assert "target_height" not in (not_there.set or ())
    assert {one.term: one.probability for one in not_there.what}.get("target_height", 0.0) < 0.05
    assert there.mismatch.p_value == alone.mismatch.p_value == not_there.mismatch.p_value


def test_what_is_believed_already_cannot_be_measured_beside(raised: tuple[Dataset, Investigation]) -> None:
    with pytest.raises(InputError, match="exit_efficiency is believed already"):
        discover(raised[0], measured={"exit_efficiency.loss": Measurement(0.1, 0.01)})
