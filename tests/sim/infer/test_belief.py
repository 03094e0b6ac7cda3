"""coefficients.toml: beliefs read back exactly, draw with their covariance, and refuse what is none by name."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from truearc.errors import InputError
from truearc.sim.infer.belief import Belief, draw, load_belief, point_belief

NAMES = ("drag.cd", "exit_efficiency.loss", "magnus.cl", "scatter.speed")
POSITIVE = st.floats(1e-3, 5.0)
TEXT = st.text(alphabet=st.characters(codec="utf-8"), max_size=20)
PLAIN = st.one_of(TEXT, st.floats(allow_nan=False, allow_infinity=False), st.integers(0, 10**9), st.booleans())


def _belief(cd=0.5, cl=0.05, loss=0.25, speed=0.02, factor=None) -> Belief:
    factor = np.diag([0.2, 0.05, 0.01, 0.3]) if factor is None else factor
    return Belief({"drag": {"cd": cd}, "magnus": {"cl": cl}, "exit_efficiency": {"loss": loss}},
                  {"speed": speed, "elevation_deg": 0.4}, NAMES, factor @ factor.T)


@settings(deadline=None, max_examples=40)
@given(POSITIVE, st.floats(-2, 2), st.floats(-0.5, 0.9), POSITIVE,
       st.lists(st.floats(-1, 1), min_size=16, max_size=16), st.dictionaries(TEXT.filter(bool), PLAIN))
def test_what_is_saved_reads_back(tmp_path_factory, cd, cl, loss, speed, numbers, provenance):
    path = tmp_path_factory.mktemp("b") / "coefficients.toml"
    belief = _belief(cd, cl, loss, speed, np.array(numbers).reshape(4, 4))
    replace(belief, provenance=provenance).save(path)
    again = load_belief(path)
    assert (again.coefficients, again.scatter, again.names) == (belief.coefficients, belief.scatter, belief.names)
    np.testing.assert_array_equal(again.covariance, belief.covariance)
    assert again.provenance == provenance


def test_the_grids_file_is_a_belief_without_doubt(tmp_path):
    path = tmp_path / "coefficients.toml"
    point_belief({"drag": {"cd": 0.91}, "magnus": {"cl": 0.06}}).save(path)
    belief = load_belief(path)
    assert (belief.scatter, belief.names, belief.covariance.shape) == ({}, (), (0, 0))
    assert [one.coefficients for one in draw(belief, 3, np.random.default_rng(0))] == [belief.coefficients] * 3


@pytest.mark.parametrize(("belief", "key"), [
    (point_belief({"drag": {"cd": -0.5}}), "drag.cd: -0.5 is below 0"),
    (point_belief({"drag": {"cd": float("nan")}}), "drag.cd"),
    (replace(_belief(), covariance=-np.eye(4)), "covariance.matrix"),
])
def test_what_could_not_be_read_is_not_saved(belief: Belief, key: str, tmp_path) -> None:
    path = tmp_path / "coefficients.toml"
    path.write_text("the last one", encoding="utf-8")
    with pytest.raises(InputError, match=key):
        belief.save(path)
    assert path.read_text(encoding="utf-8") == "the last one"


def test_draws_have_the_covariance_on_the_parameters_own_scales():
    factor = np.array([[0.2, 0, 0, 0], [-0.04, 0.02, 0, 0], [0.0, 0.005, 0.01, 0], [0, 0, 0, 0.3]])
    belief = _belief(factor=factor)
    drawn = draw(belief, 20_000, np.random.default_rng(1))
    assert all(one.names == () for one in drawn)
    cd, cl, loss = (np.array([one.coefficients[term][key] for one in drawn])
                    for term, key in (("drag", "cd"), ("magnus", "cl"), ("exit_efficiency", "loss")))
    speed = np.array([one.scatter["speed"] for one in drawn])
    numbers = np.stack([np.log(cd), -np.log1p(-loss), cl, np.log(speed)])
    np.testing.assert_allclose(numbers.mean(1), [np.log(0.5), -np.log(0.75), 0.05, np.log(0.02)], atol=0.01)
    np.testing.assert_allclose(np.cov(numbers), belief.covariance, atol=2e-3)
    assert cd.min() > 0.0 and loss.max() < 1.0
    assert {one.scatter["elevation_deg"] for one in drawn} == {0.4}         # not among the names: exact
    once, again = (draw(belief, 5, np.random.default_rng(1)) for _ in range(2))
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
    ("cd = 0.5", "cd = true", "drag.cd: True is not a finite number"),
    ("cd = 0.5", "cd = ", "Invalid value"),
    ("[drag]\ncd", "drag", "drag is not a table"),
    ("speed = 0.02", "spin = 0.02", "scatter.spin: there is no such scatter"),
    ("speed = 0.02", "speed = -0.02", "scatter.speed: -0.02 is not a number above 0"),
    ("speed = 0.02", "speed = true", "scatter.speed: True is not a number above 0"),
    ("[scatter]\nspeed = 0.02\n", "", "covariance.names: scatter.speed has no value"),
    ('"drag.cd", ', "", "covariance.matrix: not 1 rows of 1 numbers"),
    ('"drag.cd"', '"drag.cx"', "covariance.names: drag.cx has no value"),
    ('"scatter.speed"]', '"drag.cd"]', "is not a list of different names"),
    ("[0.001, 0.09]", "[0.002, 0.09]", "not finite and symmetric"),
    ("[0.001, 0.09]", "[0.001, nan]", "not finite and symmetric"),
    ("[[0.04, 0.001], [0.001, 0.09]]", "[[0.04, 0.1], [0.1, 0.09]]", "negative variance"),
    ("cd = 0.5", "cd = 0.0", "drag.cd: 0 has no place on its scale, which is log"),
    ("cd = 0.5", "cd = 0.5\n[free_speed]\nshare = 1.0", "free_speed: has no [curve.free_speed]"),
    ("[covariance]", "[curve.free_push]\nvalue = []\notherwise = 0.1\n[covariance]", "free_push: no term takes it"),
])
def test_a_bad_file_is_named(tmp_path, old, new, message):
    path = tmp_path / "coefficients.toml"
    path.write_text(GOOD)
    assert load_belief(path).names == ("drag.cd", "scatter.speed")
    path.write_text(GOOD.replace(old, new))
    with pytest.raises(InputError) as error:
        load_belief(path)
    assert "coefficients.toml" in str(error.value)
    assert message in str(error.value)
