"""Times at heights, against the closed form of a fall with quadratic drag, and of a throw without air."""

import numpy as np

import truearc as ta
from tests.sim.few_terms import few_terms
from truearc.robot.config.rig_spec import Air, Ball, Believe, LauncherFacts, Rig
from truearc.sim.data.dataset import Dataset, Shots, Times

G, AIR, CD, SIGMA_S, TOP_M = 9.81, 1.2, 0.6, 0.02, 24.0
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


def test_drag_is_fitted_from_falls_within_its_interval() -> None:
    off = []
    for seed in range(6):
        fit = ta.fit(drops(CD, seed), ["gravity", "drag"])
        assert "fitted to 24 of 24 shots: 24 times at heights" in str(fit)
        cd, = (one for one in fit.intervals if one.name == "drag.cd")
        off.append((cd.value - CD) / ((cd.high90 - cd.low90) / 3.29))
    assert np.abs(off).max() < 3.5 and 0.3 < np.std(off) < 2.0


def test_drag_is_named_from_falls_with_its_size() -> None:
    finding = ta.discover(drops(CD, 1), believe=["gravity"])
    assert finding.verdict == "named" and finding.record.set == ("drag",)
    interval = finding.record.what[0].parameters["cd"]
    assert interval.low90 < CD < interval.high90 and interval.high90 - interval.low90 < 0.2


def test_nothing_is_found_where_nothing_is_missing_and_no_tracker_is_blamed() -> None:
    finding = ta.discover(drops(CD, 2), believe=["gravity", "drag"])
    assert finding.verdict == "none"
    assert not any(name.startswith("track_") for name in finding.record.mismatch.tests)


def test_times_that_scatter_by_more_than_they_say_are_told() -> None:
    dataset = drops(CD, 3)
    assert dataset.times is not None
    times = Times(**(vars(dataset.times) | {"sigma_s": dataset.times.sigma_s / 5.0}))
    said = ta.discover(Dataset("d", dataset.rig, dataset.shots, times=times), believe=["gravity", "drag"])
    assert "of their standard deviations (sigma_s)" in said.sentence


def test_a_throw_is_timed_where_it_comes_by() -> None:
    """Without air a ball thrown upwards at v is back at its height after 2 v sin(a) / g, speeds from the wheels."""
    n = 24
    rng = np.random.default_rng(4)
    speed, deg = rng.uniform(6.0, 9.0, n), rng.uniform(40.0, 70.0, n)
    t_s = 2.0 * speed * np.sin(np.radians(deg)) / G
    rig = Rig(Ball(0.14, 0.0889), LauncherFacts(release_height_m=1.0), air=Air(0.0), believe=Believe(()))
    shots = Shots(tuple(f"s{k}" for k in range(n)), {"exit_speed_m_s": speed, "hood_deg": deg}, {})
    scatter = SIGMA_S * rng.normal(size=n)
    times = Times(np.arange(n), t_s + scatter, np.full(n, 1.0), np.full(n, SIGMA_S))
    assert ta.discover(Dataset("throws", rig, shots, times=times), believe=["gravity"],
                       terms=few_terms("hood_offset", "wind_x")).verdict == "none"


def test_a_shot_without_any_time_is_left_out_and_said() -> None:
    dataset = drops(CD, 5)
    assert dataset.times is not None
    kept = dataset.times.shot > 0
    fewer = Times(*(column[kept] for column in vars(dataset.times).values()))
    left = ta.fit(Dataset("d", dataset.rig, dataset.shots, times=fewer), ["gravity", "drag"])
    assert any("(d0)" in line for line in left.solution.fitted.model.data.left_out)
