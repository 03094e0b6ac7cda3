"""Curves of effects without a name: what they are at a shot, and on disk."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from robot.config import BadInput
from sim.belief import load_belief, point_belief, save_belief
from sim.curve import Curve, along, before_the_shot, natural
from sim.discover.covariates import smooth_shapes, spline_knots
from sim.physics.catalogue import effective, flight_terms
from sim.physics.flight import path
from sim.physics.launch import Exit
from sim.physics.shot import ORDINARY, fly_rows, launch_of, predict
from sim.shots import Shots
from tests.sim.physics.rigs import GUPPY

KNOTS = (2.0, 3.0, 4.0, 6.0)
CURVE = Curve((0.0, 0.02, 0.01, 0.05), 0.03, "distance_m", KNOTS, low=1.5, high=7.0)
AIR = {"drag": {"cd": 0.5}, "magnus": {"cl": 0.06}}
CONFIGURATIONS = Shots(("a", "b", "c"), {"distance_m": np.array([2.5, 4.0, 5.0]), "hood_deg": np.full(3, 50.0),
                                         "motor_ratio": np.full(3, 0.6)}, {})


def test_it_is_the_spline_that_discovery_fits() -> None:
    x = np.random.default_rng(0).uniform(1.0, 9.0, 200)
    shapes = np.concatenate([np.ones((200, 1)), smooth_shapes(x)], axis=1)
    knots = spline_knots(x)
    wanted = shapes @ [0.3, 1.0, -2.0, 0.5, 1.5][:shapes.shape[1]]
    value = np.linalg.lstsq(natural(knots, x), wanted, rcond=None)[0]
    assert np.allclose(natural(knots, x) @ value, wanted, atol=1e-9)


def test_through_its_knots_straight_beyond_and_level_where_nothing_was_recorded() -> None:
    size = CURVE.size({"distance_m": [*KNOTS, 6.5, 7.0, 7.5, 99.0, 1.5, 0.1]}, 10)
    assert np.allclose(size[:4], CURVE.value)
    assert size[5] - size[4] == pytest.approx(size[4] - size[3])
    assert size[5] == size[6] == size[7]
    assert size[8] == size[9]


def test_where_the_covariate_is_unknown_it_is_the_mean() -> None:
    assert CURVE.size({"distance_m": [np.nan, 3.0]}, 2) == pytest.approx([0.03, 0.02])
    assert CURVE.size({}, 2) == pytest.approx([0.03, 0.03])
    assert Curve((), 0.4).size({"distance_m": [1.0]}, 1) == pytest.approx([0.4])
    by_text = Curve((0.1, -0.1), 0.0, "supplier", levels=("north", "south"))
    assert by_text.size({"supplier": ("south", "", "north")}, 3) == pytest.approx([-0.1, 0.0, 0.1])


def test_before_the_shot_the_launch_and_the_distance_tell() -> None:
    assert before_the_shot(None, GUPPY, CONFIGURATIONS) is ORDINARY
    around = before_the_shot(CURVE, GUPPY, CONFIGURATIONS)
    assert np.allclose(around.curve, CURVE.size({"distance_m": [2.5, 4.0, 5.0]}, 3))
    fast = replace(CONFIGURATIONS, numbers={**CONFIGURATIONS.numbers, "motor_ratio": np.array([0.5, 0.6, 0.7])})
    by_speed = Curve((0.0, 1.0), 9.0, "exit_speed_m_s", (0.0, 100.0))
    sizes = np.asarray(before_the_shot(by_speed, GUPPY, fast).curve)
    assert np.allclose(sizes / sizes[0], [1.0, 1.2, 1.4])


@pytest.mark.parametrize(("term", "values", "launch"), [
    ("free_speed", {"share": 1.0}, lambda at, c: (at._replace(speed_m_s=at.speed_m_s * np.exp(c)), 0.0)),
    ("free_elevation", {"angle_rad": 1.0}, lambda at, c: (at._replace(elevation_rad=at.elevation_rad + c), 0.0)),
    ("free_distance", {"bias_m": 1.0}, lambda at, c: (at, c))])
def test_it_changes_what_its_term_says(term, values, launch) -> None:
    around = along(CURVE, ORDINARY, CONFIGURATIONS.numbers, 3)
    with_it = predict(GUPPY, {**AIR, term: values}, CONFIGURATIONS, circumstances=around).height_m
    exit, farther_m = launch(launch_of(GUPPY, CONFIGURATIONS), np.asarray(around.curve))
    by_hand = fly_rows(GUPPY, AIR, exit, CONFIGURATIONS.numbers["distance_m"] + farther_m).height_m
    assert np.allclose(with_it, by_hand, atol=1e-9)
    assert not np.allclose(with_it, predict(GUPPY, AIR, CONFIGURATIONS).height_m, atol=1e-3)


def test_a_push_against_the_flight_that_goes_with_speed_is_linear_drag() -> None:
    """dv/dt = -k v: x = v0 cos (1 - exp(-k t)) / k."""
    k = 0.4
    values = effective({"free_push": {"size_m_s2": 10.0 * k, "along": -1.0, "with_speed": 1.0}},
                       ORDINARY._replace(curve=np.ones(1)))
    flown = path(GUPPY, flight_terms({"free_push"}), values, Exit(np.array([10.0]), np.array([0.6]), np.zeros(1)),
                 points=101, step_s=0.01)
    assert float(flown.position_m.x[100, 0]) == pytest.approx(10.0 * np.cos(0.6) * (1.0 - np.exp(-k)) / k, rel=1e-7)


def test_a_push_in_a_stretch_of_the_flight_pushes_only_there() -> None:
    values = effective({"free_push": {"size_m_s2": -2.0, "along": 1.0, "from_s": 0.2, "to_s": 0.5}},
                       ORDINARY._replace(curve=np.ones(1)))
    flown = path(GUPPY, flight_terms({"free_push"}), values, Exit(np.array([10.0]), np.array([0.0]), np.zeros(1)),
                 points=1001, step_s=0.001)
    speed = np.asarray(flown.velocity_m_s.x)[:, 0]
    assert speed[190] == pytest.approx(10.0)
    assert speed[1000] == pytest.approx(10.0 - 2.0 * 0.3, abs=0.005)


def test_it_comes_back_from_disk(tmp_path: Path) -> None:
    for number, curve in enumerate((CURVE, Curve((), -0.2), Curve((0.1, 0.2), 0.15, "ball", levels=("a", "b")))):
        file = tmp_path / f"{number}.toml"
        save_belief(file, replace(point_belief({**AIR, "free_speed": {"share": 1.0}}), curve=curve), {"method": "x"})
        assert load_belief(file).curve == curve


@pytest.mark.parametrize(("table", "said"), [
    ("otherwise = 0.0", "value"), ("value = [1.0]\notherwise = 0.0\nat = [1.0, 2.0]\ncovariate = 'x'", "1 of them"),
    ("value = [1.0, 2.0]\notherwise = 0.0\nat = [2.0, 1.0]\ncovariate = 'x'", "rising"),
    ("value = [nan, 2.0]\notherwise = 0.0\nat = [0.0, 1.0]\ncovariate = 'x'", "finite"),
    ("value = []\notherwise = 0.0\nshape = 'odd'", "shape")])
def test_a_table_that_is_no_curve_is_refused(tmp_path: Path, table: str, said: str) -> None:
    file = tmp_path / "c.toml"
    file.write_text(f'schema = "truearc.coefficients/1"\n[curve]\n{table}\n')
    with pytest.raises(BadInput, match=said):
        load_belief(file)


def test_a_covariate_that_hardly_ever_departs_has_two_knots_all_the_same() -> None:
    assert spline_knots(np.r_[np.zeros(992), np.ones(8)]) == pytest.approx([0.0, 1.0])
