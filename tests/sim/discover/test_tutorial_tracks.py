"""Figures of pages: tutorials/tracks.md, of flights that no truearc computed, and how-discovery-reasons.md."""

import re
import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace as changed

import truearc as ta
from tests.sim.few_terms import few_terms
from truearc.cli.main import main
from truearc.robot.config.rig_spec import Tracker
from truearc.sim.discover.investigate import discover
from truearc_proof.truth.generate import shoot
from truearc_proof.truth.world import make_world

ROOT = Path(__file__).parents[3]
EXAMPLE = ROOT / "examples" / "tracks"


def test_tracks_are_those_of_the_script(tmp_path: Path) -> None:
    make = runpy.run_path(str(EXAMPLE / "make.py"))
    make["main"](tmp_path)
    for name in ("shots.csv", "tracks.csv"):
        assert (tmp_path / name).read_text(encoding="utf-8") == (EXAMPLE / name).read_text(encoding="utf-8")


@pytest.mark.slow
def test_lift_is_named_with_the_coefficient_of_the_script() -> None:
    make = runpy.run_path(str(EXAMPLE / "make.py"))
    page = (ROOT / "docs" / "tutorials" / "tracks.md").read_text(encoding="utf-8")
    low, high = map(float, re.findall(r"coefficient of 0\.098 \(90 %: ([\d.]+) to ([\d.]+)\)", page)[0])
    found = ta.discover(ta.load_dataset(EXAMPLE), believe=["gravity", "drag"], seed=0)
    assert found.verdict == "named" and found.best.term == "magnus"
    assert found.best.interval90 == pytest.approx((low, high), abs=6e-4)
    assert low < make["CL"] < high


@pytest.mark.slow
def test_a_fit_says_whether_its_terms_explain_the_tracks_and_believes_no_error_of_the_tracker() -> None:
    flights = ta.load_dataset(EXAMPLE)
    without = ta.fit(flights, terms=["gravity", "drag"])
    whole = ta.fit(flights, terms=["gravity", "drag", "magnus", "track_roll"])
    assert "something is missing: truearc discover looks for it" in str(without)
    noise_mm = [float(one) for one in re.findall(r"noise \(x ([\d.]+), y ([\d.]+), z ([\d.]+) mm", str(whole))[0]]
    assert noise_mm == pytest.approx([5.0] * 3, rel=0.15) and "something is missing" not in str(whole)
    assert set(whole.belief.coefficients) == {"drag", "magnus"}


@pytest.mark.slow
def test_a_clock_that_is_wrong_although_it_was_checked_is_said_beside_what_was_found() -> None:
    flights = ta.load_dataset(EXAMPLE)
    slow = replace(flights, tracks=replace(flights.tracks, t_s=1.08 * flights.tracks.t_s),
                   facts=changed(flights.rig, tracker=Tracker(calibrated=True)))
    found = ta.discover(slow, believe=["gravity", "drag"], seed=0)
    assert found.verdict == "named" and found.best.term == "magnus"
    assert found.record.data.improbable["track_clock.share"] < -0.03      # true: 1 / 1.08 - 1
    assert "the tracker may be as wrong as that" in found.sentence


@pytest.mark.slow
def test_a_wrong_scale_of_tracks_is_said_as_lengths_or_clock() -> None:
    flights, believed = ta.load_dataset(EXAMPLE), ["gravity", "drag", "magnus"]
    far = {f"{axis}_m": 1.02 * getattr(flights.tracks, f"{axis}_m") for axis in "xyz"}
    wrong = replace(flights, tracks=replace(flights.tracks, **far))
    found = ta.discover(wrong, believe=believed, seed=0)
    assert (found.verdict, found.record.set) == ("none", None)
    assert found.record.tracker.set == ("track_scale", "track_clock")
    assert re.match(r"The tracker is off: the tracker sees lengths (1\.[89]|2\.[01]) \(± 0\.1\) % too long, or the "
                    r"tracker's clock runs 0\.9\d \(± 0\.0\d\) % slow, or a part of each: measure", found.sentence)
    assert {"ruler", "stopwatch"} <= {step["instrument"] for step in found.record.next}
    assert "warning: the tracker is off: the tracker sees lengths" in str(ta.fit(wrong, terms=believed))
    assert "the tracker is off" not in str(ta.fit(flights, terms=believed))


@pytest.mark.slow
def test_a_measurement_that_the_flights_contradict_is_a_warning(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["discover", str(EXAMPLE), "--believe", "gravity,drag", "--measured", "magnus=0.0,0.01", "--quiet"]
    assert main(words) == 0
    said = capsys.readouterr().out
    assert re.search(r"warning: --measured magnus: 0 was measured, and these shots say 0\.0\d+", said)


@pytest.mark.slow
def test_a_floor_off_level_is_told_from_a_crosswind_in_one_session() -> None:
    """The same flights through a camera that sees what lies left too high by 2 degrees."""
    flights, roll = ta.load_dataset(EXAMPLE), np.radians(2.0)
    y, z = flights.tracks.y_m, flights.tracks.z_m
    turned = replace(flights.tracks, y_m=y * np.cos(roll) - z * np.sin(roll), z_m=z * np.cos(roll) + y * np.sin(roll))
    found = ta.discover(replace(flights, tracks=turned), believe=["gravity", "drag", "magnus"], seed=0,
                        terms=few_terms("wind_x", "wind_y", "drag_reynolds", "spin_decay"))
    assert found.verdict == "named" and found.best is not None and found.best.term == "track_roll"
    low, high = found.best.interval90
    assert low - 0.05 < 2.0 < high + 0.05
    assert all(one.probability < 0.05 for one in found.effects if one.term == "wind_y")
    fit = found.record.fit
    assert fit.side_rmse_after_m < 0.5 * fit.side_rmse_before_m
    assert "how far to the side tracks end" in str(found) and "where tracks end" not in str(found)


TRUTH = 0.012                         # lost per m/s


@pytest.mark.slow
def test_the_worked_example_is_as_the_page_says() -> None:
    found = discover(shoot(make_world({"wheel_slip": TRUTH}, "L0", 300, 11)), seed=0)
    finding = found.finding
    assert finding.mismatch.p_value == pytest.approx(0.0105)
    assert finding.verdict == "named" and finding.set == ("wheel_slip",)
    assert [round(one.probability, 2) for one in finding.what[:2]] == [0.90, 0.06]
    assert finding.unexplained == pytest.approx(0.04, abs=0.005)
    interval = finding.what[0].parameters["loss_per_m_s"]
    assert (round(100 * interval.low90, 1), round(100 * interval.high90, 1)) == (0.8, 2.6)
    assert interval.low90 < TRUTH < interval.high90
    naming = found.steps[0].naming
    assert sum(one.visible for one in naming.candidates) == 17
    assert round(float(np.log(0.55 / 17)), 2) == -3.43
    leader = naming.refits["wheel_slip.loss_per_m_s"]
    assert round(100 * float(leader.amplitude[0]), 1) == 1.7 and round(100 * float(leader.sd[0]), 1) == 0.5
