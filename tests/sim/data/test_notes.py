"""Notes on a dataset that can be read: copies, empty cells, outcomes of one kind, a voltage that stands still."""

from pathlib import Path

import numpy as np
import pytest

import truearc as ta
from tests.sim.data.files import FACTS

EXAMPLE = Path(__file__).parents[3] / "examples" / "spreadsheet"
SHOTS = 40


def notes(**columns: object) -> tuple[str, ...]:
    """Of forty measured shots with these columns in place of theirs, or beside them."""
    rng = np.random.default_rng(0)
    table = {"shot_id": [f"s{k}" for k in range(SHOTS)], "distance_m": rng.uniform(2.0, 5.0, SHOTS).round(3),
             "hood_deg": rng.uniform(40.0, 55.0, SHOTS).round(1), "motor_ratio": rng.uniform(0.4, 0.8, SHOTS).round(4),
             "outcome": ["three", "miss"] * (SHOTS // 2), "t_s": 7.0 * np.arange(SHOTS)}
    return ta.dataset({name: one for name, one in {**table, **columns}.items() if one is not None}, rig=FACTS).notes()


def counted(value: float, *rows: int) -> list[float]:
    """A column that counts, with one value in these rows."""
    return [value if row in rows else float(row) for row in range(SHOTS)]


def test_sound_tables_are_passed_without_a_note() -> None:
    assert notes() == () and ta.load_dataset(EXAMPLE).notes() == ()


def test_a_row_that_is_there_twice_is_noted() -> None:
    rng = np.random.default_rng(1)
    distance, hood, ratio = rng.uniform(2.0, 5.0, SHOTS), rng.uniform(40.0, 55.0, SHOTS), rng.uniform(0.4, 0.8, SHOTS)
    for column in (distance, hood, ratio):
        column[[7, 9]] = column[[5, 5]]
    said, = notes(distance_m=distance, hood_deg=hood, motor_ratio=ratio, t_s=None)
    assert said.startswith("rows that repeat an earlier one but for the name: 2 (s7 as s5, s9 as s5); ")


@pytest.mark.parametrize(("rows", "of", "said"), [
    ([7], [5], "1 (s7 as s5)"), ([20, 21, 22], [4, 5, 6], "3 (s20 as s4, s21 as s5, s22 as s6)"),
    ([*range(20, 40)], [*range(20)], "20 (s20 as s0, s21 as s1, s22 as s2, ...)"), ([*range(20, 40)], [0] * 20, "")])
def test_copies_under_other_numbers_are_noted_alone_or_in_blocks(rows: list[int], of: list[int], said: str) -> None:
    rng = np.random.default_rng(1)
    columns = {name: rng.uniform(low, high, SHOTS) for name, low, high in (
        ("distance_m", 2.0, 5.0), ("hood_deg", 40.0, 55.0), ("motor_ratio", 0.4, 0.8))}
    for column in columns.values():
        column[rows] = column[of]
    found = notes(**columns, outcome=["three", "miss"] * 20, t_s=1.0 + np.arange(SHOTS))
    expected = () if not said else (f"rows that repeat an earlier one but for the name: {said}; a shot that is "
                                        "written twice counts twice",)
    assert found == expected


def test_repeated_settings_without_times_are_no_copies() -> None:
    same = np.arange(SHOTS) // 8
    assert notes(distance_m=2.0 + same, hood_deg=40.0 + same, motor_ratio=0.4 + 0.05 * same, t_s=None) == ()


def test_two_shots_of_one_instant_are_noted() -> None:
    said, = notes(t_s=counted(11.0, 11, 12))
    assert said.startswith("t_s: shots at the same instant as an earlier one: 1 (s12 as s11); ")
    assert notes(t_s=counted(11.0, 11, 12), session=["a"] * 12 + ["b"] * 28) == ()


def test_empty_cells_are_counted_by_column() -> None:
    def some(*rows: int) -> list[float]:
        return [np.nan if row in rows else 3.0 + 0.01 * row for row in range(SHOTS)]

    assert notes(distance_m=some(1, 5, 8)) == (
        "distance_m: 3 of 40 empty: where these shots passed the target is not used",)
    assert notes(t_s=some(4)) == ("t_s: 1 of 40 empty: so the order of the shots is not used at all",)
    assert notes(hood_deg=some(2), exit_deg=some()) == ()
    assert notes(hood_deg=some(2)) == ("hood_deg: 1 of 40 empty: without exit_deg these shots are not used",)
    said, = notes(battery_v=some(2, 3), temperature_c=some(0))
    assert said.startswith("cells empty of 40: battery_v 2, temperature_c 1: these shots tell nothing of what goes")
    assert notes(outcome=["", *["three", "miss"] * 19, "two"]) == (
        "outcome: 1 of 40 empty: nothing is known of where these shots went",)


@pytest.mark.parametrize(("outcome", "said"), [
    (["three", "two"], "only makes: nothing can be learnt about misses; "),
    (["miss", "miss"], "only misses: nothing can be learnt about makes; ")])
def test_outcomes_of_one_kind_are_noted_unless_more_was_seen(outcome: list[str], said: str) -> None:
    line, = notes(outcome=outcome * (SHOTS // 2))
    assert line.startswith(said)
    assert notes(outcome=outcome * (SHOTS // 2), miss_height_m=np.linspace(-0.1, 0.1, SHOTS)) == ()


def test_scores_from_wheels_that_stand_are_named() -> None:
    outcome, ratio = ["two", "miss"] * 20, np.linspace(0.4, 0.6, SHOTS)
    said, = notes(motor_ratio=np.where(np.arange(SHOTS) < 10, 0.0, ratio), outcome=outcome)
    assert said.startswith("speed 0 in 5 of 40 shots, which scored (s0, s2, s4, ...): ")
    assert notes(motor_ratio=0.0 * ratio, wheel_lower_rad_s=400.0 * ratio, outcome=outcome) == ()


def test_a_voltage_that_never_moves_is_noted() -> None:
    said, = notes(battery_v=[12.0] * SHOTS)
    assert said.startswith("battery_v: the voltage never changes (12 V in 40 shots)")
    assert notes(battery_v=np.linspace(12.6, 11.9, SHOTS)) == ()
