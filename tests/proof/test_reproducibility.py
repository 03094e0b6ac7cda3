"""Marks of one world, made twice: another machine's last digits are no cheat, anything else is one."""

from typing import Any

import numpy as np
import pytest
from msgspec import structs

from truearc_proof.rounds.grader import Graded
from truearc_proof.rounds.reproducibility import compare
from truearc_proof.scoring.score_world import Mark

MARK = Mark("w1", "numpy", "one", "L1", 300, ("wind_x",), 20.0, True, 0.01, "named", ("wind_x",), 1, True, True, True,
            True, None, True, 0.5, 0.1, 0.2, (0.9, 0.8, 0.85, 0.9), None, ("wind_x",))
WAS = Graded("w1", MARK)


def changed(**how: Any) -> Graded:
    return Graded("w1", structs.replace(MARK, **how))


def test_last_digits_and_the_luck_of_the_draw_are_told_and_are_no_change() -> None:
    other, off = compare(WAS, changed(error=float(np.nextafter(0.5, 1.0)), strength=20.0 + 1e-9,
                                      allowed=(0.87, 0.8, 0.85, 0.9)))
    assert other == ()
    assert off["allowed"] == pytest.approx(0.03) and 0.0 < off["error"] < 1e-15 and off["oracle_gain"] == 0.0
    assert off["strength"] == pytest.approx(5e-11, rel=1e-3)


@pytest.mark.parametrize("how", [
    {"verdict": "set"}, {"names": ("wheel_slip",)}, {"hidden": ("wheel_slip",)}, {"first": False}, {"alias": None},
    {"found": False}, {"gain": 0.1 + 1e-12}, {"p_value": 0.02}, {"error": 0.5001}, {"error": None},
    {"error": float("nan")}, {"oracle_gain": 0.2001}, {"strength": 20.001}, {"allowed": (0.9, 0.7, 0.85, 0.9)},
    {"allowed": None}, {"allowed": (0.9,)}], ids=str)
def test_whatever_else_is_otherwise_is_named(how: dict[str, Any]) -> None:
    (line,) = compare(WAS, changed(**how)).other
    (name, value), = how.items()
    assert line == f"{name} is {value!r}, was {getattr(MARK, name)!r}"


def test_what_was_said_with_further_shots_is_compared_too() -> None:
    assert compare(Graded("w1", MARK, MARK), WAS).other == ("with further shots: was marked only once",)
    (line,) = compare(Graded("w1", MARK, MARK), Graded("w1", MARK, structs.replace(MARK, verdict="set"))).other
    assert line == "with further shots: verdict is 'set', was 'named'"
