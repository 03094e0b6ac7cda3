"""coefficients.toml reads back exactly; what the catalogue does not know is refused by name."""

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from truearc.errors import InputError
from truearc.sim.infer.belief import load_belief, point_belief

FLOATS = st.floats(allow_nan=False, allow_infinity=False)
TEXT = st.text(alphabet=st.characters(codec="utf-8"), max_size=20)
PLAIN = st.one_of(TEXT, FLOATS, st.integers(0, 10**9), st.booleans())


@settings(deadline=None)
@given(FLOATS.map(abs), FLOATS, st.dictionaries(TEXT.filter(bool), PLAIN))
def test_what_is_saved_reads_back(tmp_path_factory, cd, cl, provenance):
    path = tmp_path_factory.mktemp("c") / "coefficients.toml"
    coefficients = {"drag": {"cd": cd}, "magnus": {"cl": cl}}
    replace(point_belief(coefficients), provenance=provenance).save(path)
    assert load_belief(path).coefficients == coefficients
    assert load_belief(path).provenance == provenance


GOOD = 'schema = "truearc.coefficients/1"\n[drag]\ncd = 0.91\n'


@pytest.mark.parametrize(("old", "new", "message"), [
    ("coefficients/1", "coefficients/9", "schema is 'truearc.coefficients/9'"),
    ("[drag]", "[drug]", "no term 'drug'"),
    ("cd =", "dc =", "drag.dc: drag has no such parameter"),
    ("0.91", "nan", "drag.cd: nan is not a finite number"),
    ("0.91", "true", "drag.cd: True is not a finite number"),
    ("0.91", "", "Invalid value"),
    ("[drag]\ncd", "drag", "drag is not a table"),
])
def test_a_bad_file_is_named(tmp_path, old, new, message):
    path = tmp_path / "coefficients.toml"
    path.write_text(GOOD)
    assert load_belief(path).coefficients == {"drag": {"cd": 0.91}}
    path.write_text(GOOD.replace(old, new))
    with pytest.raises(InputError) as error:
        load_belief(path)
    assert "coefficients.toml" in str(error.value)
    assert message in str(error.value)
