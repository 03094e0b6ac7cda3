"""What each kind of mark says about the height, and what is left out by name."""

import numpy as np
import pytest

from truearc.errors import InputError
from truearc.sim.data.dataset import Shots
from truearc.sim.gate.train import outcome_classes_of


def make(outcome: tuple[str, ...], side: tuple[str, ...] | None = None, **numbers: list[float]) -> Shots:
    n = len(outcome)
    columns = {name: np.full(n, value) for name, value in (("distance_m", 4.0), ("motor_ratio", 0.5),
                                                           ("hood_deg", 45.0))}
    columns |= {name: np.array(values) for name, values in numbers.items()}
    return Shots(tuple(f"s{k}" for k in range(n)), columns, {"outcome": outcome, "side": side or ("",) * n})


@pytest.mark.parametrize(("outcome", "side", "cells"), [
    ("three", "", "00100"), ("two", "", "01010"), ("miss", "", "10001"), ("miss", "low", "10000"),
    ("miss", "high", "00001"), ("two", "low", "01000"), ("two", "high", "00010"), ("two", "left", "01110"),
    ("miss", "right", "11111")])
def test_a_mark_says_where_the_height_may_have_been(outcome: str, side: str, cells: str) -> None:
    marks, left_out = outcome_classes_of(make((outcome,), (side,)), "DIR")
    assert "".join(str(int(cell)) for cell in marks.cells[0]) == cells and left_out == []
    assert marks.aside[0] == (outcome == "miss" and side == "right")


def test_silent_shots_are_counted_and_measured_ones_kept() -> None:
    shots = make(("three", "", "", "two"), distance_m=[4.0, 4.0, 4.0, np.nan],
                 miss_height_m=[np.nan, np.nan, 0.2, np.nan])
    marks, left_out = outcome_classes_of(shots, "DIR")
    assert marks.miss_m.tolist()[1:] == [0.2] and marks.level.tolist() == [2, -1]
    assert left_out == ["DIR: 1 of 4 shots left out: no outcome or miss_height_m",
                        "DIR: 1 of 4 shots left out: no distance_m"]
    with pytest.raises(InputError, match=r"nothing to train on; DIR: 2 of 2 shots left out: no outcome or "
                                         r"miss_height_m"):
        outcome_classes_of(make(("", "")), "DIR")


def test_repeats_of_a_configuration_are_one_group() -> None:
    shots = make(("three",) * 4)
    shots.texts["config_id"] = ("a", "b", "a", "")
    assert outcome_classes_of(shots, "DIR")[0].group.tolist() == [0, 1, 0, 2]
