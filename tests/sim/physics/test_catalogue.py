"""The catalogue as a value: order, names, and every declared field used somewhere."""

import ast
import dataclasses
import pickle
from pathlib import Path

import numpy as np
import pytest

from tests.sim.physics.own import Flex
from tests.sim.physics.rigs import GUPPY
from tools.pages import TERMS_BEGIN, TERMS_END, put_terms
from truearc import sim
from truearc.errors import InputError
from truearc.sim.data.dataset import Shots
from truearc.sim.physics.catalogue import (
    BUILT_IN,
    TERMS,
    Catalogue,
    as_catalogue,
    catalogue,
    find_parameter,
    find_terms,
)
from truearc.sim.physics.nonparametric import NAMELESS
from truearc.sim.physics.simulate import predict
from truearc.sim.physics.term import STAGES, InFlight, Parameter, Term
from truearc.sim.physics.term_fields import Instrument, Phrase, Prior

ROOT = Path(sim.__file__).parent.parent
BIG = Catalogue((*TERMS, Flex()))
ORDER = ("hood_offset hood_backlash encoder_scale distance_scale distance_bias vision_latency track_scale track_tilt "
         "track_roll track_clock track_perspective wheel_slip exit_efficiency wheel_droop ball_compression ball_wear "
         "ball_spread battery_sag rapid_fire release_height spin_decay wind_x wind_y wind_z gravity drag magnus "
         "spin_drag drag_reynolds lift_saturation drag_wear air_density air_change buoyancy added_mass "
         "target_height rim_catch")


def test_terms_act_in_the_order_they_declare() -> None:
    assert BUILT_IN.names == tuple(ORDER.split())
    assert Catalogue(TERMS[::-1]) == BUILT_IN
    for stage in STAGES:
        places = [term.order[0] for term in TERMS if term.stage == stage]
        assert places == sorted(set(places))


def test_a_further_term_finds_its_place_by_what_it_declares() -> None:
    names = BIG.names
    assert names.index("track_perspective") + 1 == names.index("flex") == names.index("wheel_slip") - 1
    assert find_terms(["drag", "flex"], BIG) == (Flex(), *find_terms(["drag"]))
    assert find_parameter("flex.angle_deg", BIG) is Flex.parameters[0]
    assert BIG.get("flex") == Flex() and BIG.get("free_push") == NAMELESS[-1] and BIG.get("magic") is None


def test_the_usual_catalogue_is_not_changed_by_another() -> None:
    assert as_catalogue(None) is catalogue() and as_catalogue(BIG) is BIG and as_catalogue([*BUILT_IN]) == BUILT_IN
    with pytest.raises(InputError, match="no term 'flex'"):
        find_terms(["flex"])


def test_names_that_are_taken_are_refused() -> None:
    for taken in ("drag", "free_push"):
        second = type("Second", (Flex,), {"__doc__": "A law.", "name": taken})
        with pytest.raises(InputError, match=f"Second: there is a term '{taken}' already"):
            Catalogue((*TERMS, second()))


def test_terms_are_equal_by_class_hashable_and_picklable() -> None:
    assert Flex() == Flex() and hash(BIG) == hash(Catalogue((Flex(), *TERMS))) and BIG != BUILT_IN
    assert pickle.loads(pickle.dumps(BIG)) == BIG
    assert repr(Flex()) == "Flex()"


def test_shots_fly_with_a_further_term() -> None:
    shots = Shots(("a", "b"), {"motor_ratio": np.array([0.5, 0.6]), "hood_deg": np.array([50.0, 45.0]),
                               "distance_m": np.array([2.0, 3.0])}, {})
    lower = Shots(shots.shot_id, {**shots.numbers, "hood_deg": shots.numbers["hood_deg"] - 2.0}, {})
    coefficients = {"drag": {"cd": 0.5}}
    flexed = predict(GUPPY, {**coefficients, "flex": {"angle_deg": 2.0}}, shots, among=BIG)
    np.testing.assert_allclose(flexed.height_m, predict(GUPPY, coefficients, lower).height_m, rtol=1e-9)
    with pytest.raises(InputError, match="no term 'flex'"):
        predict(GUPPY, {"flex": {"angle_deg": 2.0}}, shots)


def test_every_declared_field_is_used_beside_the_declarations() -> None:
    """By the product or the page of terms: a field that only the check reads would be a burden without a use."""
    own = {"term.py", "term_fields.py", "term_check.py"}
    files = [path for folder in ("sim", "truearc", "tools") for path in (ROOT / folder).rglob("*.py")
             if not (path.parent.name == "physics" and path.name in own) and path.parent.parent.name != "terms"]
    read = {node.attr for path in files for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
            if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Load)}
    declared = {*Term.__annotations__, *InFlight.__annotations__, *Phrase._fields, *Instrument._fields,
                *(field.name for kind in (Parameter, Prior) for field in dataclasses.fields(kind))}
    assert len(declared) > 30
    assert declared - read == set()


def test_every_term_is_on_the_page_of_terms() -> None:
    page = (ROOT / "docs" / "reference" / "terms.md").read_text(encoding="utf-8")
    assert all(f"| `{name}` |" in page for name in BUILT_IN.names)


@pytest.mark.parametrize("page", ["no marks", TERMS_BEGIN, TERMS_END])
def test_a_page_without_marks_is_refused(page: str) -> None:
    with pytest.raises(ValueError, match="lacks"):
        put_terms(page)
