"""A term that leaves something out is refused, with the class and what is missing."""

from typing import Any

import pytest

from tests.sim.physics.own import Flex
from truearc.errors import InputError
from truearc.sim.physics.catalogue import TERMS, check_term
from truearc.sim.physics.term import (
    Exit,
    Instrument,
    LaunchTerm,
    Parameter,
    Phrase,
    Prior,
    Rig,
    Values,
    WatchTerm,
)

PRIOR = Prior("linear", 0.0, 1.0, "a reason")


def number(**changed: Any) -> tuple[Parameter, ...]:
    said = {"name": "angle_deg", "unit": "deg", "low": -1.0, "high": 1.0, "default": 0.0, "source": "a source",
            "prior": PRIOR, "meaning": "an angle"}
    return (Parameter(**{**said, **changed}),)


@pytest.mark.parametrize("field", ["order", "parameters", "direction", "sentence", "phrase", "instrument"])
def test_term_without_a_declaration_is_refused(field: str) -> None:
    declared = {name: value for name, value in vars(Flex).items() if name != field and not name.startswith("_abc")}
    bare = type("Bare", (LaunchTerm,), declared)
    with pytest.raises(InputError, match=rf"^Bare: {field}: "):
        check_term(bare())


@pytest.mark.parametrize(("changed", "message"), [
    ({"name": "Hood flex"}, "name: 'Hood flex'"), ({"direction": "up"}, "direction: 'up' is none of along"),
    ({"order": (5, "")}, "order: "), ({"sentence": "It bends"}, "full stop"), ({"__doc__": None}, "no docstring"),
    ({"phrase": Phrase("bends", "unbends", 1.0, "")}, "phrase: "), ({"label": ""}, "label: is empty"),
    ({"instrument": None}, "instrument: "), ({"instrument": Instrument("ruler", "a ruler", 0.0)}, "not above 0"),
    ({"follows": "moonlight", "record": "the moon"}, "follows: 'moonlight'"),
    ({"follows": "curve_by"}, "record: is empty"),
    ({"positive": 1.0}, "positive: "), ({"law_sd": 0.0}, "law_sd: "),
    ({"calibration_sd": 0.1}, "calibration_sd: "), ({"parameters": ()}, "parameters: expected a tuple"),
    ({"parameters": (*number(), *number())}, "two have one name"),
    ({"parameters": number(unit="foot")}, "unit: got 'foot'"),
    ({"parameters": number(default=3.0)}, "not within -1.0 to 1.0"), ({"parameters": number(source="")}, "source: is"),
    ({"parameters": number(meaning="")}, "meaning: is empty"), ({"parameters": number(prior=None)}, "has no prior"),
    ({"parameters": number(low=0.5, default=0.6)}, "whose default is 0"),
    ({"parameters": number(prior=Prior("log", -1.0, 1.0, "a reason"))}, "prior: its scale"),
    ({"parameters": number(fit_each_ball=True)}, "by_ball: ")])
def test_wrong_declaration_is_named(changed: dict[str, Any], message: str) -> None:
    wrong = type("Wrong", (Flex,), {"__doc__": "A law.", **changed})
    with pytest.raises(InputError, match=r"^Wrong: ") as caught:
        check_term(wrong())
    assert message in str(caught.value)


def test_every_problem_is_named_at_once() -> None:
    class Nothing(LaunchTerm):
        """Declares nothing."""

        def leave(self, rig: Rig, values: Values, exit: Exit) -> Exit:
            return exit

    with pytest.raises(InputError) as caught:
        check_term(Nothing())
    assert all(f"{field}: " in str(caught.value) for field in ("order", "direction", "sentence", "phrase",
                                                               "instrument", "parameters"))


def test_what_is_no_term_is_refused() -> None:
    with pytest.raises(InputError, match="'hood_flex': expected an instance of SensingTerm"):
        check_term("hood_flex")       # type: ignore[arg-type]


def test_complete_terms_pass() -> None:
    check_term(Flex())
    for term in TERMS:
        check_term(term)
    assert any(isinstance(term, WatchTerm) and term.calibration_sd for term in TERMS)
