"""A name that only stands in for what is missing."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from tests.sim.discover.made import stand_in
from truearc.sim.discover.detect.covariates import Covariate
from truearc.sim.discover.report.build_finding import is_stand_in
from truearc.sim.discover.select.selection_step import Step


def step(covariate: str | None, direction: str, unknown: bool, gain: float = 1.0) -> Step:
    what = None if covariate is None else Covariate(((covariate, np.zeros(3)),))
    column = SimpleNamespace(kind="free", follows="", direction=direction)
    place: Any = SimpleNamespace(test=SimpleNamespace(what=what), column=column)
    shots = np.arange(10.0)
    return stand_in(Step, place=place, unknown=unknown, before=shots, after=shots + gain,
                    free=shots + gain if unknown else None)


def test_a_name_stands_in_where_something_without_a_name_is_left_in_its_direction() -> None:
    first = step("distance_m", "along", False)
    assert is_stand_in((first, step("distance_m", "along", True)))
    assert is_stand_in((first, step("t_s", "along", False), step("hood_deg", "along", True)))
    for left in (step("distance_m", "vertical", True), step("distance_m", "along", False)):
        assert not is_stand_in((first, left))           # another effect, or one that has a name
    assert not is_stand_in((first,))


def test_a_name_that_explains_nearly_all_stands_though_a_trifle_is_left() -> None:
    first, small, larger = step("distance_m", "along", False, 20.0), *(
        step("distance_m", "along", True, gain) for gain in (0.5, 0.7))
    assert not is_stand_in((first, small)) and is_stand_in((first, larger))


def test_what_has_no_name_anyhow_stands_in_for_nothing() -> None:
    assert not is_stand_in((step("distance_m", "along", True), step("distance_m", "along", True)))
