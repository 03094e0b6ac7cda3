"""Shots with uncertainty: the spread of heights is the one that goes in; labels mix where they must, and only there."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import truearc.cli.main as truearc
from truearc.errors import InputError
from truearc.robot.config.rig_spec import Ball, LauncherFacts, Noise, Rig, Target, Wheel
from truearc.sim.data.files import load_dataset, save_rig
from truearc.sim.infer.belief import Belief, draw, point_belief
from truearc.sim.paper import synthetic
from truearc.sim.paper.synthetic import (
    assign,
    check_belief,
    fly_draws,
    grid_shots,
    label_grid_draws,
    load_provenance,
    near_places,
    sample_shots,
    synthesise,
)
from truearc.sim.physics.simulate import classify

WHEELS = (Wheel("lower", 0.0508, 1.0, 180.0), Wheel("upper", 0.0349, 0.5625, 0.0))
NO_AIR = {"drag": {"cd": 0.0}}
STILL = Noise(0.0, 0.0, 0.0, 0.0)
GRAVITY_M_S2 = 9.81


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
