"""A tracker that was calibrated again between two sessions: flights that are made and seen through a changed camera."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from tests.sim.discover.odd_rigs import make_drops
from truearc.robot.config.rig_spec import Site, Tracker
from truearc.sim.data.dataset import Dataset
from truearc.sim.discover.decide import Step
from truearc.sim.discover.detect.battery import (
    ReferenceSession,
    TrackerChange,
    can_compare,
    compare_trackers,
    rivals_of,
)
from truearc.sim.discover.investigate import make_search
from truearc.sim.discover.next_steps import next_steps
from truearc.sim.discover.report import build_finding
from truearc.sim.discover.select.terms import Naming
from truearc.sim.infer.belief import Belief
from truearc.sim.infer.fit import fit_believed
from truearc.sim.infer.launcher import Launcher, LauncherFit
from truearc.sim.infer.likelihood.data import every_column, take_in
from truearc.sim.infer.likelihood.layout import lay_out
from truearc.sim.physics.catalogue import find_terms
from truearc_proof.truth.generate import shoot
from truearc_proof.truth.world import make_world

BELIEF = Belief({"drag": {"cd": 0.5}, "magnus": {"cl": 0.2}}, {}, ("drag.cd", "magnus.cl"), np.diag([1e-4, 1e-4]))


def seen(seed: int, scale: float = 1.0, pitch_deg: float = 0.0, roll_deg: float = 0.0) -> Dataset:
    """Shots through a camera that sees lengths too long, what lies ahead too high, or what lies left too high."""
    dataset = shoot(make_world({}, "L2", 24, seed, side=True))
    assert dataset.tracks is not None
    x, y, z = (scale * one for one in (dataset.tracks.x_m, dataset.tracks.y_m, dataset.tracks.z_m))
    pitch, roll = np.radians([pitch_deg, roll_deg])
    x, z = x * np.cos(pitch) - z * np.sin(pitch), z * np.cos(pitch) + x * np.sin(pitch)
    y, z = y * np.cos(roll) - z * np.sin(roll), z * np.cos(roll) + y * np.sin(roll)
    facts = msgspec.structs.replace(dataset.facts, tracker=Tracker(scale_sd=0.01, tilt_sd_deg=1.0, clock_sd=0.001))
    return replace(dataset, facts=facts, tracks=replace(dataset.tracks, x_m=x, y_m=y, z_m=z))


def fit(dataset: Dataset) -> LauncherFit:
    intake = take_in(dataset)
    return fit_believed(Launcher(intake, lay_out(intake, ("gravity", "drag", "magnus"), belief=BELIEF)))


@pytest.fixture(scope="module")
def home() -> LauncherFit:
    return fit(seen(5))


def test_a_tracker_that_is_the_same_has_no_change(home: LauncherFit) -> None:
    assert compare_trackers(fit(seen(6)), home, 0.05) is None


def test_a_tracker_that_was_compared_is_said_to_be_and_without_tracks_none_was(home: LauncherFit) -> None:
    for dataset, said in ((seen(6), "no change is seen"), (replace(seen(6), tracks=None), "")):
        later = fit(dataset)
        search = make_search(dataset, home=ReferenceSession(home, every_column(seen(5))))
        sentence = build_finding._tracker(later, search)[1]
        assert can_compare(later, home) == bool(said) and said in sentence and bool(sentence) == bool(said)


@pytest.mark.parametrize(("leader", "indoor", "instrument"), [
    ("track_perspective.per_m", True, "ruler_two_heights"), ("drag.cd", False, "anemometer"), ("drag.cd", True, None)])
def test_what_has_no_name_is_measured_by_its_nearest_name_or_the_wind_outdoors(home: LauncherFit, leader: str,
                                                                             indoor: bool, instrument: str) -> None:
    """The fall of a ball is on film already, and in a hall there is no wind to speak of."""
    rig = msgspec.structs.replace(home.model.data.rig, site=Site(indoor=indoor))
    fitted, nobody = replace(home, model=replace(home.model, data=replace(home.model.data, rig=rig))), np.zeros(0)
    step = Step(Naming((), {}, {leader: 0.0}), None, nobody, nobody, nobody, None, (), fitted, unknown=True)
    found = [one["instrument"] for one in next_steps(seen(5), step, None) if "instrument" in one]
    assert found == ([instrument] if instrument else [])


@pytest.mark.parametrize(("known", "leader", "asked"), [
    (False, "wind_z", True), (False, "drag", False), (True, "wind_z", False)])
def test_what_may_be_lift_asks_for_the_spin_where_nobody_knows_it(known: bool, leader: str, asked: bool) -> None:
    """Without spin there is no lift to test, and rising air stands for it."""
    drops = make_drops(14, 2)
    shots = replace(drops.shots, numbers={"exit_spin_rev_s": np.full(14, 2.0)}) if known else drops.shots
    dataset, nobody = replace(drops, shots=shots), np.zeros(0)
    intake = take_in(dataset)
    fitted = fit_believed(Launcher(intake, lay_out(intake, ("gravity", "drag"))))
    name = f"{leader}.{find_terms([leader])[0].parameters[0].name}"
    step = Step(Naming((), {}, {name: 0.0}), None, nobody, nobody, nobody, None, (), fitted, chosen=(name,))
    assert [one.get("record") == "exit_spin_rev_s" for one in next_steps(dataset, step, (leader,))].count(True) == asked


@pytest.mark.parametrize(("changed", "name", "size"), [
    ({"scale": 1.03}, "track_scale.share", 0.03), ({"pitch_deg": 1.0}, "track_tilt.angle_deg", 1.0),
    ({"roll_deg": -2.0}, "track_roll.angle_deg", -2.0)])
def test_what_was_done_to_the_tracker_is_found(home: LauncherFit, changed: dict[str, float], name: str,
                                              size: float) -> None:
    later = fit(seen(6, **changed))
    found = compare_trackers(later, home, 0.05)
    assert isinstance(found, TrackerChange) and name in found.together
    (one,) = (one for one in found.numbers if one.name == name)
    assert one.change == pytest.approx(size, abs=4.0 * one.sd) and one.sd < 0.3 * abs(size)


def test_a_crosswind_may_be_a_tracker_that_leans(home: LauncherFit) -> None:
    rivals = [one.name for one in rivals_of(fit(seen(6, roll_deg=2.0)), home, "wind_y.speed_m_s")]
    assert rivals[0] == "wind_y.speed_m_s" and "track_roll.angle_deg" in rivals
    assert rivals_of(home, home, "nothing") == ()
