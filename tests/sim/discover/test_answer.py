"""A name that only stands in for what is missing."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from sim.discover.answer import is_stand_in
from sim.discover.covariates import Covariate
from sim.discover.step import Step


def step(covariate: str | None, direction: str, unknown: bool) -> Step:
    what = None if covariate is None else Covariate(((covariate, np.zeros(3)),))
    column = SimpleNamespace(kind="free", follows="", direction=direction)
    place: Any = SimpleNamespace(test=SimpleNamespace(what=what), column=column)
    return cast(Step, SimpleNamespace(place=place, unknown=unknown))


def test_a_name_stands_in_where_something_without_a_name_is_left_in_its_direction() -> None:
    first = step("distance_m", "along", False)
    assert is_stand_in((first, step("distance_m", "along", True)))
    assert is_stand_in((first, step("t_s", "along", False), step("hood_deg", "along", True)))
    for left in (step("distance_m", "vertical", True), step("distance_m", "along", False)):
        assert not is_stand_in((first, left))           # another effect, or one that has a name
    assert not is_stand_in((first,))


def test_what_has_no_name_anyhow_stands_in_for_nothing() -> None:
    assert not is_stand_in((step("distance_m", "along", True), step("distance_m", "along", True)))
