"""Simulated shots against a DOP853 flight written from the paper alone, and the sample's own promises."""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import truearc.cli.main as truearc
from truearc.errors import InputError
from truearc.robot.config.rig_spec import Ball, LauncherFacts, Noise, Rig, Target, Wheel
from truearc.sim.data.dataset import Shots
from truearc.sim.data.files import load_dataset, save_rig
from truearc.sim.infer.belief import Belief, draw, point_belief
from truearc.sim.paper import synthetic
from truearc.sim.paper.synthetic import (
    AXES,
    SHAPE,
    assign,
    check_belief,
    fly_draws,
    grid_shots,
    label_grid,
    label_grid_draws,
    load_provenance,
    near_places,
    sample_balanced,
    sample_shots,
    synthesise,
    taken_configurations,
)
from truearc.sim.physics.simulate import classify

RIG = Rig(Ball(0.14, 0.0889), LauncherFacts(0.75, 594.0, (Wheel("lower", 0.0508, 1.0, 180.0),
                                                            Wheel("upper", 0.0349, 0.5625, 0.0))), Target(2.44))
CD, CL = 0.91, 0.06                               # the paper's own estimate
BELIEF = {"drag": {"cd": CD}, "magnus": {"cl": CL}}
CONFIGURATIONS = 468_236
WHEELS = (Wheel("lower", 0.0508, 1.0, 180.0), Wheel("upper", 0.0349, 0.5625, 0.0))
NO_AIR = {"drag": {"cd": 0.0}}
STILL = Noise(0.0, 0.0, 0.0, 0.0)
GRAVITY_M_S2 = 9.81


@pytest.fixture(scope="module")
def outcomes() -> np.ndarray:
    return label_grid(RIG, BELIEF)


def paper_height_m(distance_m: float, motor_ratio: float, hood_deg: float) -> float:
    """Eq. 1-12 in the plane; nan if the ball meets the floor or turns back before the target."""
    mass, radius, rho = 0.14, 0.0889, 1.2
    lower, upper = motor_ratio * 594.0 * 0.0508, motor_ratio * 594.0 * 9 / 16 * 0.0349
    speed, spin = (lower + upper) / 2, (lower - upper) / (2 * math.pi * radius)
    drag = 0.5 * CD * math.pi * radius**2 * rho / mass
    lift = CL * 4 / 3 * 4 * math.pi**2 * radius**3 * spin * rho / mass

    def rates(_: float, state: np.ndarray) -> list[float]:
        _, _, vx, vy = state
        v = math.hypot(vx, vy)
        return [vx, vy, -lift * vy - drag * v * vx, lift * vx - drag * v * vy - 9.81]

    ends = [lambda t, s: s[0] - distance_m, lambda t, s: s[1], lambda t, s: s[2]]
    for end in ends:
        end.terminal = True                       # type: ignore[attr-defined]
    theta = math.radians(hood_deg)
    start = [0.0, 0.75, speed * math.cos(theta), speed * math.sin(theta)]
    if start[2] <= 0.0:
        return math.nan
    flight = solve_ivp(rates, (0.0, 60.0), start, "DOP853", rtol=1e-11, atol=1e-12, events=ends, max_step=0.05)
    return float(flight.y_events[0][0][1]) if len(flight.t_events[0]) else math.nan


def paper_outcome(height_m: float) -> str:
    deviation = abs(height_m - 2.44)
    return "three" if deviation <= 0.07 else "two" if deviation <= 0.35 else "miss"


def test_the_grid_is_the_one_that_the_seed_states() -> None:
    shots = grid_shots(np.arange(CONFIGURATIONS))
    assert math.prod(SHAPE) == CONFIGURATIONS == len(shots)
    for name, low, high, step, count in (("motor_ratio", 0.0, 1.0, 0.01, 101), ("hood_deg", 15.0, 75.0, 1.0, 61),
                                         ("distance_m", 1.0, 16.0, 0.2, 76)):
        values = np.unique(shots.number(name))
        assert len(values) == count and values[0] == low and values[-1] == high
        np.testing.assert_allclose(np.diff(values), step, rtol=1e-12)
        assert [repr(float(value)) for value in values] == [repr(round(float(value), 2)) for value in values]
    assert len(set(zip(*(shots.number(axis.name) for axis in AXES), strict=True))) == CONFIGURATIONS


def test_labels_are_those_of_an_independent_flight(outcomes: np.ndarray) -> None:
    rng = np.random.default_rng(11)
    chosen = np.concatenate([rng.choice(np.flatnonzero(outcomes == outcome), 60) for outcome in
                             ("miss", "two", "three")] + [rng.integers(0, CONFIGURATIONS, 60)])
    shots = grid_shots(chosen)
    compared = 0
    for row, outcome in enumerate(outcomes[chosen]):
        height = paper_height_m(*(float(shots.number(name)[row]) for name in ("distance_m", "motor_ratio", "hood_deg")))
        if min(abs(abs(height - 2.44) - 0.07), abs(abs(height - 2.44) - 0.35), 1.0) < 1e-4:
            continue                              # on the very edge either is right
        assert outcome == paper_outcome(height), shots.shot_id[row]
        compared += 1
    assert compared > 230


def test_every_outcome_is_on_the_grid_and_most_is_misses(outcomes: np.ndarray) -> None:
    shares = {outcome: (outcomes == outcome).mean() for outcome in ("miss", "two", "three")}
    assert shares["miss"] > 0.9
    # a window of +-0.07 m inside one of +-0.35 m: a fifth of those who come near, near enough
    assert shares["three"] / (shares["three"] + shares["two"]) == pytest.approx(0.2, abs=0.02)


@given(st.integers(3, 90), st.integers(0, 2**32), st.sets(st.integers(0, 299), max_size=120))
def test_the_sample_is_balanced_and_avoids_what_is_taken(count: int, seed: int, taken: set[int]) -> None:
    outcomes = np.array(["miss", "two", "three"] * 100)
    left = [sum(outcomes[place] == outcome for place in set(range(300)) - taken) for outcome in
            ("miss", "two", "three")]
    forbidden = np.array(sorted(taken), np.int64)
    if min(left) < math.ceil(count / 3):
        return
    chosen = sample_balanced(outcomes, count, forbidden, seed)
    counts = [int((outcomes[chosen] == outcome).sum()) for outcome in ("miss", "two", "three")]
    assert sum(counts) == count == len(set(chosen.tolist()))
    assert max(counts) - min(counts) <= 1
    assert not set(chosen.tolist()) & taken
    assert np.array_equal(chosen, sample_balanced(outcomes, count, forbidden, seed))


def test_another_seed_is_another_sample() -> None:
    outcomes = np.array(["miss", "two", "three"] * 1000)
    one, two = (sample_balanced(outcomes, 300, np.zeros(0, np.int64), seed) for seed in (0, 1))
    assert not np.array_equal(one, two)


def test_a_rare_outcome_is_named_and_so_is_a_sample_too_small() -> None:
    outcomes = np.array(["miss"] * 50 + ["two"] * 50 + ["three"] * 4)
    assert len(sample_balanced(outcomes, 12, np.zeros(0, np.int64), 0)) == 12
    with pytest.raises(InputError, match="only 3 configurations of the grid are a 'three'"):
        sample_balanced(outcomes, 12, np.array([103]), 0)
    with pytest.raises(InputError, match="-n is 2"):
        sample_balanced(outcomes, 2, np.zeros(0, np.int64), 0)
    with pytest.raises(InputError, match="--seed is -1"):
        sample_balanced(outcomes, 12, np.zeros(0, np.int64), -1)


@given(st.lists(st.integers(0, CONFIGURATIONS - 1), min_size=1, max_size=30, unique=True), st.integers(0, 2**32))
def test_a_recorded_configuration_takes_the_nearest_on_the_grid(places: list[int], seed: int) -> None:
    shots = grid_shots(np.array(places))
    rng = np.random.default_rng(seed)
    measured = {axis.name: shots.number(axis.name) + rng.uniform(-0.49, 0.49, len(places)) / axis.per_unit
                for axis in AXES}
    assert taken_configurations(Shots(shots.shot_id, measured, {})).tolist() == sorted(places)


def test_shots_beside_the_grid_or_with_gaps_take_nothing() -> None:
    shots = Shots(("beyond", "gap", "on"), {"motor_ratio": np.array([0.5, 0.5, 0.5]),
                                            "hood_deg": np.array([45.0, np.nan, 45.0]),
                                            "distance_m": np.array([16.2, 5.0, 5.0])}, {})
    assert taken_configurations(shots).tolist() == [50 * 61 * 76 + 30 * 76 + 20]


def test_recorded_configurations_are_replaced(outcomes: np.ndarray) -> None:
    first = sample_balanced(outcomes, 90, np.zeros(0, np.int64), 5)
    shots = synthesise(RIG, point_belief(BELIEF), 90, grid_shots(first), 5)
    assert len(shots) == 90
    assert not set(shots.shot_id) & set(grid_shots(first).shot_id)
    assert sorted(map(shots.text("outcome").count, ("miss", "two", "three"))) == [30, 30, 30]
    places = np.array([int(name.removeprefix("sim-")) for name in shots.shot_id])
    assert shots.text("outcome") == tuple(outcomes[places].tolist())


def test_a_rig_without_target_is_refused() -> None:
    with pytest.raises(InputError, match="target"):
        label_grid(Rig(RIG.ball, RIG.launcher), BELIEF)


def test_provenance_is_optional_but_not_rubbish(tmp_path) -> None:
    assert load_provenance(tmp_path) == {}
    for text in ("{", "[]"):
        (tmp_path / "synth.json").write_text(text)
        with pytest.raises(InputError, match=r"synth\.json"):
            load_provenance(tmp_path)


def make_rig(noise: Noise) -> Rig:
    return Rig(Ball(0.14, 0.0889), LauncherFacts(0.75, 594.0, WHEELS), Target(2.44), noise=noise)


def make_belief(speed: float, elevation_deg: float, cd_log_sd: float = 0.2) -> Belief:
    return Belief({"drag": {"cd": 0.5}}, {"speed": speed, "elevation_deg": elevation_deg}, ("drag.cd",),
                  np.array([[cd_log_sd**2]]))


@pytest.fixture(scope="module")
def belief() -> Belief:
    return make_belief(0.02, 0.5)


class Drawn(NamedTuple):
    """Outcomes of the grid, and what near_places was given and said on the way to them."""

    outcomes: np.ndarray
    height_m: np.ndarray
    near: np.ndarray


@pytest.fixture(scope="module")
def drawn(belief: Belief) -> Drawn:
    seen: list[np.ndarray] = []

    def look_on(rig: Rig, belief: Belief, height_m: np.ndarray) -> np.ndarray:
        seen.extend([height_m, near_places(rig, belief, height_m)])
        return seen[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(synthetic, "near_places", look_on)
        outcomes = label_grid_draws(make_rig(Noise()), belief, 40, 5)
    return Drawn(outcomes, *seen)


def heights_without_air(belief: Belief, rig: Rig, copies: int) -> tuple[np.ndarray, float, np.ndarray]:
    """Drawn heights of one configuration, its speed by Eq. 11, and the heights' closed form for given noise."""
    place = np.full(copies, 60 * 61 * 76 + 30 * 76 + 20)             # ratio 0.6, 45 degrees, 5 m
    rng = np.random.default_rng(3)
    drawn = fly_draws(rig, grid_shots(place), assign([belief], copies, rng), rng)
    speed = 0.6 * 594.0 * (0.0508 + 0.5625 * 0.0349) / 2.0
    return drawn, speed, place


def in_vacuum(speed_m_s: np.ndarray, elevation_rad: np.ndarray, distance_m: np.ndarray) -> np.ndarray:
    return (0.75 + distance_m * np.tan(elevation_rad)
            - GRAVITY_M_S2 * distance_m**2 / (2.0 * (speed_m_s * np.cos(elevation_rad)) ** 2))


def test_without_any_doubt_every_flight_is_the_closed_form() -> None:
    drawn, speed, _ = heights_without_air(point_belief(NO_AIR, {"speed": 0.0, "elevation_deg": 0.0}),
                                          make_rig(STILL), 8)
    np.testing.assert_allclose(drawn, in_vacuum(speed, np.radians(45.0), 5.0), rtol=1e-9)


@pytest.mark.parametrize(("scatter", "noise"), [
    ({"speed": 0.03, "elevation_deg": 0.0}, STILL), ({"speed": 0.0, "elevation_deg": 1.5}, STILL),
    ({"speed": 0.0, "elevation_deg": 0.0}, Noise(0.2, 0.0, 0.0, 0.0)),
    ({"speed": 0.0, "elevation_deg": 0.0}, Noise(0.0, 1.2, 0.0, 0.0)),
])
def test_each_source_of_scatter_spreads_the_heights_as_it_does_in_vacuum(scatter: dict, noise: Noise) -> None:
    """Quantiles against an independent Monte Carlo of the closed form."""
    drawn, speed, _ = heights_without_air(point_belief(NO_AIR, scatter), make_rig(noise), 6000)
    rng = np.random.default_rng(11)
    z = rng.standard_normal((3, 200000))
    tilt_deg = np.hypot(scatter["elevation_deg"], noise.hood_deg)
    wanted = in_vacuum(speed * np.exp(scatter["speed"] * z[0]), np.radians(45.0 + tilt_deg * z[1]),
                       5.0 + noise.distance_m * z[2])
    low, middle, high = np.quantile(wanted, [0.1, 0.5, 0.9])
    assert np.quantile(drawn, [0.1, 0.5, 0.9]) == pytest.approx([low, middle, high], abs=0.05 * (high - low))


def test_coefficients_are_drawn_shot_by_shot(belief: Belief) -> None:
    rig, rng = make_rig(STILL), np.random.default_rng(0)
    place = np.full(4000, 75 * 61 * 76 + 30 * 76 + 35)
    beliefs = draw(make_belief(0.0, 0.0), 500, rng)
    draws = assign(beliefs, len(place), rng)
    counts = np.unique(draws.coefficients["drag"]["cd"], return_counts=True)[1]
    assert counts.tolist() == [8] * 500
    assert np.std(np.log(draws.coefficients["drag"]["cd"])) == pytest.approx(0.2, rel=0.1)
    heights = fly_draws(rig, grid_shots(place), draws, rng)
    order = np.argsort(draws.coefficients["drag"]["cd"], kind="stable")
    assert (np.diff(heights[order]) <= 1e-9).all()                   # more drag, lower
    assert len(np.unique(heights.round(9))) == 500


def test_labels_mix_near_the_target_and_nowhere_else(belief: Belief, drawn: Drawn) -> None:
    rig = make_rig(Noise())
    outcomes, height_m, near = drawn
    exact = classify(rig, height_m)
    assert 0.05 < np.mean(exact[near] != outcomes[near]) < 0.6
    beyond = np.setdiff1d(np.arange(len(exact)), near)
    assert (exact[beyond] == "miss").all() and (outcomes[beyond] == "miss").all()
    # nothing that could have scored is left out: of those left out that pass closest, flown with scatter, none scores
    rng = np.random.default_rng(8)
    closest = beyond[np.argsort(np.abs(np.nan_to_num(height_m[beyond], nan=-99.0) - 2.44))[:4000]]
    flown = fly_draws(rig, grid_shots(closest), assign(draw(belief, 50, rng), len(closest), rng), rng)
    assert np.mean(np.abs(flown - 2.44) <= 0.35) < 1e-3
    # far inside the three-point window a shot is less often a miss than at its edge
    off_m = np.abs(height_m - 2.44)
    assert np.mean(outcomes[off_m < 0.03] == "miss") < np.mean(outcomes[(off_m > 0.3) & (off_m < 0.35)] == "miss")


def test_the_sample_is_balanced_and_avoids_recorded_shots(belief: Belief, drawn: Drawn) -> None:
    one = sample_shots(drawn.outcomes, 90, None, 5)
    assert sorted(map(one.text("outcome").count, ("miss", "two", "three"))) == [30, 30, 30]
    assert not set(sample_shots(drawn.outcomes, 90, one, 5).shot_id) & set(one.shot_id)
    with pytest.raises(InputError, match="--draws is 0"):
        synthesise(make_rig(Noise()), belief, 90, None, 5, 0)


def test_the_door_repeats_the_shots_and_says_what_a_file_without_doubt_lacks(
        belief: Belief, drawn: Drawn, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save_rig(tmp_path / "rig.toml", make_rig(Noise()))
    point_belief(belief.coefficients).save(tmp_path / "grid.toml")
    belief.save(tmp_path / "ml.toml")
    words = ["paper", "synth", "--quiet", "--rig", f"{tmp_path}/rig.toml", "-n", "90", "--draws", "40", "--seed", "5"]
    assert truearc.main([*words, "--coefficients", f"{tmp_path}/grid.toml", "-o", f"{tmp_path}/a"]) == 2
    assert "grid.toml: has no [scatter] and no [covariance]" in capsys.readouterr().err
    assert not (tmp_path / "a").exists()
    assert truearc.main([*words, "--coefficients", f"{tmp_path}/ml.toml", "-o", f"{tmp_path}/b"]) == 0
    assert "40 sets of coefficients" in capsys.readouterr().out
    made = load_dataset(tmp_path / "b").shots
    again = sample_shots(drawn.outcomes, 90, None, 5)                # flown on its own, with the same seed
    assert made.shot_id == again.shot_id and made.text("outcome") == again.text("outcome")
    assert load_provenance(tmp_path / "b")["draws"] == 40
    assert load_provenance(tmp_path / "b")["scatter"] == belief.scatter
    check_belief(belief, "whole")
