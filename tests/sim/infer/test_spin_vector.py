"""Spin about any axis, measured: tracks flown by SciPy's DOP853 with drag and the lift of the whole spin."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import truearc as ta
from benchmarks.lift import CL, RIG, tracked
from tests.sim.few_terms import few_terms
from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.discover.report.build_finding import untested
from truearc.sim.infer.likelihood.data import take_in
from truearc.sim.infer.plausibility.check import check_plausible


@pytest.mark.slow
@pytest.mark.parametrize("launched", [False, True])
def test_lift_is_named_from_spin_about_any_axis(launched: bool) -> None:
    spins = np.random.default_rng(7).normal(0.0, 6.0, (16, 3))
    rivals = few_terms("wind_x", "wind_y", "wind_z", "spin_decay", "spin_drag", "drag_reynolds", "buoyancy")
    finding = ta.discover(tracked(spins, launched), believe=["gravity", "drag"], terms=rivals)
    assert finding.verdict == "named" and finding.record.set == ("magnus",), finding.sentence
    cl = finding.record.what[0].parameters["cl"]
    assert cl.low90 < CL < cl.high90 and cl.high90 - cl.low90 < 0.05


def test_backspin_is_the_two_wheel_case() -> None:
    """Backspin turns the top of the ball backwards: about the right of it, -y."""
    spins = np.random.default_rng(9).uniform(-5.0, 5.0, (12, 3)) * [0.0, 1.0, 0.0]
    whole = tracked(spins, launched=True)
    plain = Dataset("plain", RIG, Shots(whole.shots.shot_id, {
        **{name: whole.shots.number(name) for name in ("exit_speed_m_s", "exit_deg")},
        "exit_spin_rev_s": -spins[:, 1]}, {}), whole.tracks)
    lanes, other = take_in(whole).lanes, take_in(plain).lanes
    assert np.allclose(np.asarray(lanes.rolling.spin_rev_s), np.asarray(other.rolling.spin_rev_s))
    assert np.allclose(np.asarray(lanes.side_spin_rev_s), 0.0) and np.allclose(np.asarray(other.side_spin_rev_s), 0.0)


def test_a_spin_without_a_part_is_refused_and_so_are_revolutions_per_minute(tmp_path: Path) -> None:
    dataset = tracked(np.full((12, 3), 4.0), launched=True)
    numbers = dict(dataset.shots.numbers)
    fast = {name: 60.0 * column if "spin" in name else column for name, column in numbers.items()}
    with pytest.raises(ta.InputError, match="rename the column to exit_spin_x_rpm"):
        check_plausible(Dataset("rpm", RIG, Shots(dataset.shots.shot_id, fast, {}), dataset.tracks))
    check_plausible(dataset)
    del numbers["exit_spin_z_rev_s"]
    ta.save_dataset(tmp_path / "d", Dataset("part", RIG, Shots(dataset.shots.shot_id, numbers, {}), dataset.tracks))
    with pytest.raises(ta.InputError, match=r"exit_spin_x_rev_s.*stands without exit_spin_z_rev_s"):
        ta.load_dataset(tmp_path / "d")


def test_a_spin_with_a_part_unknown_is_not_used() -> None:
    dataset = tracked(np.full((12, 3), 4.0), launched=False)
    numbers = dataset.shots.numbers | {"exit_spin_z_rev_s": np.where(np.arange(12) == 3, np.nan, 4.0)}
    part = Dataset("part", RIG, Shots(dataset.shots.shot_id, numbers, {}), dataset.tracks)
    spin = np.asarray(take_in(part).lanes.spin_rev_s)
    assert np.array_equal(spin[0], [4.0, 4.0, 4.0]) and np.array_equal(spin[3], [0.0, 0.0, 0.0])


def test_lift_without_a_spin_is_said_to_be_untested() -> None:
    """Else rising air, named for sure, would be a wrong answer without a warning."""
    spun = tracked(np.random.default_rng(7).normal(0.0, 6.0, (12, 3)), launched=False)
    bare = replace(spun, shots=Shots(spun.shots.shot_id, {}, {}))
    assert any("lift" in line for line in untested(bare)) and not any("lift" in line for line in untested(spun))
