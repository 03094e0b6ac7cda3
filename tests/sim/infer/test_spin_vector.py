"""Tracks and times of other code's flights: spin about any axis, falls with drag, flights that differ."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import truearc as ta
from tests.sim.few_terms import few_terms
from truearc.robot.config.rig_spec import Air, Ball, Believe, LauncherFacts, Noise, Rig, Tracker
from truearc.sim.check.check import check_plausible
from truearc.sim.data.dataset import Dataset, Shots, Times, Tracks
from truearc.sim.discover.report.build_finding import untested
from truearc.sim.infer.likelihood.data import take_in

MASS, RADIUS, AIR, CD, CL, NOISE_M = 0.14, 0.0889, 1.2, 0.5, 0.12, 0.004
RIG = Rig(Ball(MASS, RADIUS), LauncherFacts(release_height_m=1.0), air=Air(AIR), noise=Noise(track_m=NOISE_M),
          tracker=Tracker(calibrated=True), believe=Believe(()))
FRAMES_S = np.linspace(0.0, 0.6, 31)


def fly(start: np.ndarray, spin_rev_s: np.ndarray) -> np.ndarray:
    """Positions [31, 3]: m a = m g - cd/2 A rho |v| v + cl 4/3 (4 pi^2 r^3 rho) s x v, s in turns a second."""
    drag = 0.5 * CD * np.pi * RADIUS**2 * AIR / MASS
    lift = CL * 4.0 / 3.0 * 4.0 * np.pi**2 * RADIUS**3 * AIR / MASS

    def rate(_: float, y: np.ndarray) -> np.ndarray:
        v = y[3:]
        return np.concatenate([v, [0.0, 0.0, -9.81] - drag * np.linalg.norm(v) * v + lift * np.cross(spin_rev_s, v)])

    return solve_ivp(rate, (0.0, 0.6), start, "DOP853", t_eval=FRAMES_S, rtol=1e-10, atol=1e-12).y[:3].T


def tracked(spins: np.ndarray, launched: bool, seed: int = 0) -> Dataset:
    """Flights of these spins [n, 3] about (x, y, z); launched: with the speed and the angle as the launcher says."""
    rng = np.random.default_rng(seed)
    n = len(spins)
    speed, deg = rng.uniform(7.0, 10.0, n), rng.uniform(35.0, 60.0, n)
    ahead = np.stack([np.cos(np.radians(deg)), np.zeros(n), np.sin(np.radians(deg))], axis=1)
    places = [fly(np.concatenate([[0.0, 0.0, 1.0], v]), spin) + rng.normal(0.0, NOISE_M, (31, 3))
              for v, spin in zip(speed[:, None] * ahead, spins, strict=True)]
    numbers = dict(zip(("exit_spin_x_rev_s", "exit_spin_y_rev_s", "exit_spin_z_rev_s"), spins.T, strict=True))
    if launched:
        numbers |= {"exit_speed_m_s": speed, "exit_deg": deg}
    tracks = Tracks(np.repeat(np.arange(n), 31), np.tile(FRAMES_S, n), *np.concatenate(places).T)
    return Dataset("spun", RIG, Shots(tuple(f"s{k}" for k in range(n)), numbers, {}), tracks)


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
    with pytest.raises(ta.InputError, match="rename each to exit_spin_x_rpm"):
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


G, FALL_CD, SIGMA_S, TOP_M = 9.81, 0.6, 0.02, 24.0
BALLS = ((0.05, 0.05), (0.14, 0.0889), (0.5, 0.12))        # mass_kg, radius_m


def fall_s(height_m: np.ndarray, mass_kg: np.ndarray, radius_m: np.ndarray, cd: float) -> np.ndarray:
    """Of a fall from rest: v' = g - k v^2 has h = ln cosh(sqrt(g k) t) / k."""
    k = 0.5 * cd * AIR * np.pi * radius_m**2 / mass_kg
    return np.asarray(np.arccosh(np.exp(k * height_m)) / np.sqrt(G * k))


def drops(cd: float, seed: int, each: int = 2) -> Dataset:
    """`each` drops of three balls from four heights, every one with its own time."""
    height_m, ball = (one.ravel() for one in np.meshgrid([5.0, 10.0, 15.0, 20.0], np.repeat(np.arange(3), each)))
    mass_kg, radius_m = np.array(BALLS)[ball.astype(int)].T
    t_s = fall_s(height_m, mass_kg, radius_m, cd) + SIGMA_S * np.random.default_rng(seed).normal(size=len(ball))
    rig = Rig(Ball(*BALLS[1]), LauncherFacts(release_height_m=TOP_M), air=Air(AIR), believe=Believe(()))
    return Dataset("drops", rig, Shots(tuple(f"d{k}" for k in range(len(ball))), {
        "mass_kg": mass_kg, "radius_m": radius_m}, {}), times=Times(
            np.arange(len(ball)), t_s, TOP_M - height_m, np.full(len(ball), SIGMA_S)))


@pytest.mark.slow
def test_drag_is_fitted_from_falls_within_its_interval() -> None:
    off = []
    for seed in range(6):
        fit = ta.fit(drops(FALL_CD, seed), ["gravity", "drag"])
        assert "fitted to 24 of 24 shots: 24 times at heights" in str(fit)
        cd, = (one for one in fit.intervals if one.name == "drag.cd")
        off.append((cd.value - FALL_CD) / ((cd.high90 - cd.low90) / 3.29))
    assert np.abs(off).max() < 3.5 and 0.3 < np.std(off) < 2.0


@pytest.mark.slow
def test_drag_is_named_from_falls_with_its_size() -> None:
    finding = ta.discover(drops(FALL_CD, 1), believe=["gravity"])
    assert finding.verdict == "named" and finding.record.set == ("drag",)
    interval = finding.record.what[0].parameters["cd"]
    assert interval.low90 < FALL_CD < interval.high90 and interval.high90 - interval.low90 < 0.2


@pytest.mark.slow
def test_nothing_is_found_where_nothing_is_missing_and_no_tracker_is_blamed() -> None:
    finding = ta.discover(drops(FALL_CD, 2), believe=["gravity", "drag"])
    assert finding.verdict == "none"
    assert not any(name.startswith("track_") for name in finding.record.mismatch.tests)


@pytest.mark.slow
def test_times_that_scatter_by_more_than_they_say_are_told() -> None:
    dataset = drops(FALL_CD, 3)
    assert dataset.times is not None
    times = Times(**(vars(dataset.times) | {"sigma_s": dataset.times.sigma_s / 5.0}))
    said = ta.discover(Dataset("d", dataset.rig, dataset.shots, times=times), believe=["gravity", "drag"])
    assert "of their standard deviations (sigma_s)" in said.sentence


@pytest.mark.slow
def test_a_shot_without_any_time_is_left_out_and_said() -> None:
    dataset = drops(FALL_CD, 5)
    assert dataset.times is not None
    kept = dataset.times.shot > 0
    fewer = Times(*(column[kept] for column in vars(dataset.times).values()))
    left = ta.fit(Dataset("d", dataset.rig, dataset.shots, times=fewer), ["gravity", "drag"])
    assert any("(d0)" in line for line in left.solution.fitted.model.data.left_out)
