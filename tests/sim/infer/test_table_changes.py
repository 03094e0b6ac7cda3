"""Changes between versions of teams' tables: causes that were put in come out; any order of rows says the same."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks import real_tables as tables

AWAY_M, FLAT_DEG = np.array([3.0, 4.0, 5.0, 6.0]), np.array([58.0, 52.0, 48.0, 46.0])


def test_a_team_that_turns_its_wheels_up_makes_up_for_slower_balls() -> None:
    """Wheels up by 3 %: a ball that loses 3 % (1 - 1 / 1.03) of its speed needs it, and a flatter hood does as well
    only where one angle does it at all distances."""
    change = tables.Change(AWAY_M, np.zeros(4), np.full(4, 0.03), [FLAT_DEG])
    higher, causes = tables.explain(change, FLAT_DEG)
    assert np.all(higher > 0.0)
    size, left_m = causes["slower %"]
    assert size == pytest.approx(100.0 * (1.0 - 1.0 / 1.03), abs=0.1) and left_m < 0.02
    assert causes["flatter deg"][1] > 2.0 * left_m


def test_a_team_that_steepens_its_hood_makes_up_for_a_flatter_one() -> None:
    change = tables.Change(AWAY_M, np.full(4, 2.0), np.zeros(4), [FLAT_DEG])
    size, left_m = tables.explain(change, FLAT_DEG)[1]["flatter deg"]
    assert size == pytest.approx(2.0, abs=0.2) and left_m < 0.05
    assert tables.row_of("1", "a, b", tables.Change(AWAY_M, np.zeros(4), np.zeros(4), [FLAT_DEG]))[-1] == "-"


@pytest.mark.data
def test_any_order_of_rows_says_the_same(data_dir: Path) -> None:
    names = ("frc_shot_tables", "frc3476_tuning_history", "frc6328_event_corrections")
    paths = [str(data_dir / f"real/{name}.csv") for name in names]
    told, shuffled = (tables.changes(paths, seed) for seed in (None, 7))
    assert [one[:2] for one in told] == [one[:2] for one in shuffled]
    for (*_, one), (*_, other) in zip(told, shuffled, strict=True):
        assert all(np.array_equal(a, b) for a, b in zip(one[:3], other[:3], strict=True))
    (balls,) = (one for team, _, one in told if team == "254")
    assert balls.hood_deg.mean() == pytest.approx(5.2, abs=0.05)           # by hand, docs/measured/real-data.md
    whole = [one for team, said, one in told if team == "3476"][-1]
    assert (whole.hood_deg.min(), whole.hood_deg.max()) == (-8.5, -2.0) and not whole.share.any()
