"""coefficients.toml: beliefs and curves read back, draw with their covariance, and refuse what is none by name."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.sim.physics.rigs import GUPPY
from truearc.errors import InputError
from truearc.sim.data.dataset import ORDINARY, Shots
from truearc.sim.discover.detect.covariates import smooth_shapes, spline_knots
from truearc.sim.infer import belief as bel
from truearc.sim.infer.forecast import forecast
from truearc.sim.physics.catalogue import effective, flight_terms
from truearc.sim.physics.flight import path
from truearc.sim.physics.simulate import fly_rows, launch_of, predict
from truearc.sim.physics.term import Exit

NAMES = ("drag.cd", "exit_efficiency.loss", "magnus.cl", "scatter.speed")
POSITIVE = st.floats(1e-3, 5.0)
TEXT = st.text(alphabet=st.characters(codec="utf-8"), max_size=20)
PLAIN = st.one_of(TEXT, st.floats(allow_nan=False, allow_infinity=False), st.integers(0, 10**9), st.booleans())


def _belief(cd=0.5, cl=0.05, loss=0.25, speed=0.02, factor=None) -> bel.Belief:
    factor = np.diag([0.2, 0.05, 0.01, 0.3]) if factor is None else factor
    return bel.Belief({"drag": {"cd": cd}, "magnus": {"cl": cl}, "exit_efficiency": {"loss": loss}},
                  {"speed": speed, "elevation_deg": 0.4}, NAMES, factor @ factor.T)


@settings(deadline=None, max_examples=40)
@given(POSITIVE, st.floats(-2, 2), st.floats(-0.5, 0.9), POSITIVE,
       st.lists(st.floats(-1, 1), min_size=16, max_size=16), st.dictionaries(TEXT.filter(bool), PLAIN))
def test_what_is_saved_reads_back(tmp_path_factory, cd, cl, loss, speed, numbers, provenance):
    path = tmp_path_factory.mktemp("b") / "coefficients.toml"
    belief = _belief(cd, cl, loss, speed, np.array(numbers).reshape(4, 4))
    replace(belief, provenance=provenance).save(path)
    again = bel.load_belief(path)
    assert (again.coefficients, again.scatter, again.names) == (belief.coefficients, belief.scatter, belief.names)
    np.testing.assert_array_equal(again.covariance, belief.covariance)
    assert again.provenance == provenance


def test_the_grids_file_is_a_belief_without_doubt(tmp_path):
    path = tmp_path / "coefficients.toml"
    bel.point_belief({"drag": {"cd": 0.91}, "magnus": {"cl": 0.06}}).save(path)
    belief = bel.load_belief(path)
    assert (belief.scatter, belief.names, belief.covariance.shape) == ({}, (), (0, 0))
    assert [one.coefficients for one in bel.draw(belief, 3, np.random.default_rng(0))] == [belief.coefficients] * 3


@pytest.mark.parametrize(("belief", "key"), [
    (bel.point_belief({"drag": {"cd": -0.5}}), "drag.cd: -0.5 is below 0"),
    (bel.point_belief({"drag": {"cd": float("nan")}}), "drag.cd"),
    (replace(_belief(), covariance=-np.eye(4)), "covariance.matrix")])
def test_what_could_not_be_read_is_not_saved(belief: bel.Belief, key: str, tmp_path) -> None:
    path = tmp_path / "coefficients.toml"
    path.write_text("the last one", encoding="utf-8")
    with pytest.raises(InputError, match=key):
        belief.save(path)
    assert path.read_text(encoding="utf-8") == "the last one"


def test_draws_have_the_covariance_on_the_parameters_own_scales():
    factor = np.array([[0.2, 0, 0, 0], [-0.04, 0.02, 0, 0], [0.0, 0.005, 0.01, 0], [0, 0, 0, 0.3]])
    belief = _belief(factor=factor)
    drawn = bel.draw(belief, 20_000, np.random.default_rng(1))
    assert all(one.names == () for one in drawn)
    cd, cl, loss = (np.array([one.coefficients[term][key] for one in drawn])
                    for term, key in (("drag", "cd"), ("magnus", "cl"), ("exit_efficiency", "loss")))
    speed = np.array([one.scatter["speed"] for one in drawn])
    numbers = np.stack([np.log(cd), -np.log1p(-loss), cl, np.log(speed)])
    np.testing.assert_allclose(numbers.mean(1), [np.log(0.5), -np.log(0.75), 0.05, np.log(0.02)], atol=0.01)
    np.testing.assert_allclose(np.cov(numbers), belief.covariance, atol=2e-3)
    assert cd.min() > 0.0 and loss.max() < 1.0
    assert {one.scatter["elevation_deg"] for one in drawn} == {0.4}         # not among the names: exact
    once, again = (bel.draw(belief, 5, np.random.default_rng(1)) for _ in range(2))
    assert [one.coefficients for one in once] == [one.coefficients for one in again]


GOOD = """schema = "truearc.coefficients/1"
[drag]
cd = 0.5
[scatter]
speed = 0.02
[covariance]
names = ["drag.cd", "scatter.speed"]
matrix = [[0.04, 0.001], [0.001, 0.09]]
"""


@pytest.mark.parametrize(("old", "new", "message"), [
    ("coefficients/1", "coefficients/9", "schema is 'truearc.coefficients/9'"),
    ("[drag]", "[drug]", "no term 'drug'"),
    ("cd =", "dc =", "drag.dc: drag has no such parameter"),
    ("cd = 0.5", "cd = nan", "drag.cd: nan is not a finite number"),
    ("cd = 0.5", "cd = ", "Invalid value"),
    ("[drag]\ncd", "drag", "drag is not a table"),
    ("speed = 0.02", "spin = 0.02", "scatter.spin: there is no such number"),
    ("speed = 0.02", "speed = -0.02", "scatter.speed: -0.02 is not a number above 0"),
    ("[scatter]\nspeed = 0.02\n", "", "covariance.names: scatter.speed has no value"),
    ('"drag.cd", ', "", "covariance.matrix: not 1 rows of 1 numbers"),
    ('"drag.cd"', '"drag.cx"', "covariance.names: drag.cx has no value"),
    ('"scatter.speed"]', '"drag.cd"]', "is not a list of different names"),
    ("[0.001, 0.09]", "[0.001, nan]", "not finite and symmetric"),
    ("[[0.04, 0.001], [0.001, 0.09]]", "[[0.04, 0.1], [0.1, 0.09]]", "negative variance"),
    ("cd = 0.5", "cd = 0.0", "drag.cd: 0 has no place on its scale, which is log"),
    ("cd = 0.5", "cd = 0.5\n[free_speed]\nshare = 1.0", "free_speed: has no [curve.free_speed]"),
    ("[covariance]", "[curve.free_push]\nvalue = []\notherwise = 0.1\n[covariance]", "free_push: no term takes it")])
def test_a_bad_file_is_named(tmp_path, old, new, message):
    path = tmp_path / "coefficients.toml"
    path.write_text(GOOD)
    assert bel.load_belief(path).names == ("drag.cd", "scatter.speed")
    path.write_text(GOOD.replace(old, new))
    with pytest.raises(InputError) as error:
        bel.load_belief(path)
    assert "coefficients.toml" in str(error.value)
    assert message in str(error.value)


KNOTS = (2.0, 3.0, 4.0, 6.0)
CURVE = bel.Curve((0.0, 0.02, 0.01, 0.05), 0.03, "distance_m", KNOTS, low=1.5, high=7.0)
AIR = {"drag": {"cd": 0.5}, "magnus": {"cl": 0.06}}
CONFIGURATIONS = Shots(("a", "b", "c"), {"distance_m": np.array([2.5, 4.0, 5.0]), "hood_deg": np.full(3, 50.0),
                                         "motor_ratio": np.full(3, 0.6)}, {})


def size_of(curve: bel.Curve, columns: dict, n: int) -> np.ndarray:
    return np.asarray(bel.along({"free_speed": curve}, ORDINARY, columns, n).free_speed)


def test_it_is_the_spline_that_discovery_fits() -> None:
    x = np.random.default_rng(0).uniform(1.0, 9.0, 200)
    shapes = np.concatenate([np.ones((200, 1)), smooth_shapes(x)], axis=1)
    knots = spline_knots(x)
    wanted = shapes @ [0.3, 1.0, -2.0, 0.5, 1.5][:shapes.shape[1]]
    value = np.linalg.lstsq(bel.natural(knots, x), wanted, rcond=None)[0]
    assert np.allclose(bel.natural(knots, x) @ value, wanted, atol=1e-9)


def test_through_its_knots_straight_beyond_and_level_where_nothing_was_recorded() -> None:
    size = size_of(CURVE, {"distance_m": [*KNOTS, 6.5, 7.0, 7.5, 99.0, 1.5, 0.1]}, 10)
    assert np.allclose(size[:4], CURVE.value)
    assert size[5] - size[4] == pytest.approx(size[4] - size[3])
    assert size[5] == size[6] == size[7]
    assert size[8] == size[9]


def test_where_the_covariate_is_unknown_it_is_the_mean() -> None:
    assert size_of(CURVE, {"distance_m": [np.nan, 3.0]}, 2) == pytest.approx([0.03, 0.02])
    assert size_of(CURVE, {}, 2) == pytest.approx([0.03, 0.03])
    assert size_of(bel.Curve((), 0.4), {"distance_m": [1.0]}, 1) == pytest.approx([0.4])
    by_text = bel.Curve((0.1, -0.1), 0.0, "supplier", levels=("north", "south"))
    assert size_of(by_text, {"supplier": ("south", "", "north")}, 3) == pytest.approx([-0.1, 0.0, 0.1])


def test_before_the_shot_the_launch_and_the_distance_tell() -> None:
    assert bel.before_the_shot({}, GUPPY, CONFIGURATIONS) is ORDINARY
    around = bel.before_the_shot({"free_speed": CURVE}, GUPPY, CONFIGURATIONS)
    assert np.allclose(around.free_speed, size_of(CURVE, {"distance_m": [2.5, 4.0, 5.0]}, 3))
    fast = replace(CONFIGURATIONS, numbers={**CONFIGURATIONS.numbers, "motor_ratio": np.array([0.5, 0.6, 0.7])})
    by_speed = bel.Curve((0.0, 1.0), 9.0, "exit_speed_m_s", (0.0, 100.0))
    sizes = np.asarray(bel.before_the_shot({"free_push": by_speed}, GUPPY, fast).free_push)
    assert np.allclose(sizes / sizes[0], [1.0, 1.2, 1.4])


@pytest.mark.parametrize(("term", "values", "launch"), [
    ("free_speed", {"share": 1.0}, lambda at, c: (at._replace(speed_m_s=at.speed_m_s * np.exp(c)), 0.0)),
    ("free_elevation", {"angle_rad": 1.0}, lambda at, c: (at._replace(elevation_rad=at.elevation_rad + c), 0.0)),
    ("free_distance", {"bias_m": 1.0}, lambda at, c: (at, c))])
def test_it_changes_what_its_term_says(term, values, launch) -> None:
    around = bel.along({term: CURVE}, ORDINARY, CONFIGURATIONS.numbers, 3)
    with_it = predict(GUPPY, {**AIR, term: values}, CONFIGURATIONS, circumstances=around).height_m
    exit, farther_m = launch(launch_of(GUPPY, CONFIGURATIONS), np.asarray(getattr(around, term)))
    by_hand = fly_rows(GUPPY, AIR, exit, CONFIGURATIONS.numbers["distance_m"] + farther_m).height_m
    assert np.allclose(with_it, by_hand, atol=1e-9)
    assert not np.allclose(with_it, predict(GUPPY, AIR, CONFIGURATIONS).height_m, atol=1e-3)


def test_a_push_against_the_flight_that_goes_with_speed_is_linear_drag() -> None:
    """dv/dt = -k v: x = v0 cos (1 - exp(-k t)) / k."""
    k = 0.4
    values = effective({"free_push": {"size_m_s2": 10.0 * k, "along": -1.0, "with_speed": 1.0}},
                       ORDINARY._replace(free_push=np.ones(1)))
    flown = path(GUPPY, flight_terms({"free_push"}), values, Exit(np.array([10.0]), np.array([0.6]), np.zeros(1)),
                 points=101, step_s=0.01)
    assert float(flown.position_m.x[100, 0]) == pytest.approx(10.0 * np.cos(0.6) * (1.0 - np.exp(-k)) / k, rel=1e-7)


def test_it_comes_back_from_disk(tmp_path: Path) -> None:
    by_ball = bel.Curve((0.1, 0.2), 0.15, "ball", levels=("a", "b"))
    for number, curve in enumerate((CURVE, bel.Curve((), -0.2), by_ball)):
        file = tmp_path / f"{number}.toml"
        belief = replace(bel.point_belief({**AIR, "free_speed": {"share": 1.0}}), curves={"free_speed": curve})
        replace(belief, provenance={"method": "x"}).save(file)
        assert bel.load_belief(file).curves == {"free_speed": curve}


@pytest.mark.parametrize(("table", "said"), [
    ("otherwise = 0.0", "value"), ("value = [1.0]\notherwise = 0.0\nat = [1.0, 2.0]\ncovariate = 'x'", "1 of them"),
    ("value = [1.0, 2.0]\notherwise = 0.0\nat = [2.0, 1.0]\ncovariate = 'x'", "rising"),
    ("value = [nan, 2.0]\notherwise = 0.0\nat = [0.0, 1.0]\ncovariate = 'x'", "finite"),
    ("value = []\notherwise = 0.0\nshape = 'odd'", "shape")])
def test_a_table_that_is_no_curve_is_refused(tmp_path: Path, table: str, said: str) -> None:
    file = tmp_path / "c.toml"
    file.write_text(f'schema = "truearc.coefficients/1"\n[curve.free_speed]\n{table}\n')
    with pytest.raises(InputError, match=said):
        bel.load_belief(file)


@pytest.mark.parametrize("curve", [
    CURVE, bel.Curve((), 0.02), bel.Curve((0.01, 0.02), 0.0, "ball", levels=("a", "b")),
    bel.Curve((0.01, 0.02, 0.0, -0.01, 0.01), 0.0, over={"distance_m": (2.0, 6.0)})])
def test_points_that_are_in_doubt_make_heights_doubtful(curve: bel.Curve, tmp_path: Path) -> None:
    """Against heights flown with one point moved, and heights of beliefs that were drawn; two curves at once."""
    curves = {"free_elevation": bel.Curve((), 0.01), "free_speed": curve}
    named = ("curve.free_elevation.0", *(f"curve.free_speed.{key}" for key in curve.keys))
    belief = bel.Belief({**AIR, "free_elevation": {"angle_rad": 1.0}, "free_speed": {"share": 1.0}},
                    {"speed": 1e-9, "elevation_deg": 1e-9}, named, np.diag(np.full(len(named), 0.004**2)), curves)
    replace(belief, provenance={"method": "x"}).save(tmp_path / "c.toml")
    belief = bel.load_belief(tmp_path / "c.toml")
    assert belief.curves == curves and belief.values() == pytest.approx([0.01, *curve.points])
    slopes = np.zeros((3, len(named)))
    for k, name in enumerate(named):
        ends = [flown(bel.replace_values(belief, belief.values() + step * np.eye(len(named))[k]))
                for step in (1e-4, -1e-4)]
        slopes[:, k] = (ends[0] - ends[1]) / 2e-4
        assert name not in bel.replace_values(belief, belief.values()).names
    told = forecast(GUPPY, belief, CONFIGURATIONS)
    assert np.allclose(told.height_m, flown(belief), atol=1e-6)
    assert np.allclose(told.parameter_m, 0.004 * np.linalg.norm(slopes, axis=1), rtol=1e-3)
    some = np.array([flown(one) for one in bel.draw(belief, 400, np.random.default_rng(0))])
    assert np.allclose(some.std(0), told.parameter_m, rtol=0.15)


def flown(belief: bel.Belief) -> np.ndarray:
    around = bel.before_the_shot(belief.curves, GUPPY, CONFIGURATIONS)
    return np.asarray(predict(GUPPY, belief.coefficients, CONFIGURATIONS, circumstances=around).height_m)


@pytest.mark.parametrize(("change", "said"), [
    ({"names": ("curve.free_speed.7",)}, "free_speed.7 has no value"),
    ({"names": ("curve.free_push.0",)}, "free_push.0 has no value"),
    ({"coefficients": AIR}, "no term takes it"),
    ({"curves": {}, "names": (), "covariance": np.zeros((0, 0))}, "how large")])
def test_curves_and_terms_that_do_not_go_together_are_refused(change: dict, said: str, tmp_path: Path) -> None:
    belief = bel.Belief({"free_speed": {"share": 1.0}}, {}, ("curve.free_speed.0",), np.eye(1), {"free_speed": CURVE})
    with pytest.raises(InputError, match=said):              # by the reader, which asks before anything is written
        replace(belief, **change, provenance={"method": "x"}).save(tmp_path / "c.toml")
