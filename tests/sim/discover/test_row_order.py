"""Where a table has no time, no answer depends on the order of its rows; where it has, that order is by time."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import truearc as ta
from tests.sim.few_terms import few_terms
from truearc.sim.infer.likelihood.data import number_columns

SHEET = ta.load_dataset(Path(__file__).parents[3] / "examples" / "spreadsheet")
HASH = re.compile(r'"sha256": "[0-9a-f]{64}"')
FEW = few_terms("wheel_slip", "hood_offset", "battery_sag", "rapid_fire", "hood_backlash", "ball_wear")


def shuffled(dataset: ta.Dataset, order: list[int]) -> ta.Dataset:
    """The same shots in another order, their samples with them."""
    place = np.argsort(order)
    tracks = dataset.tracks and replace(dataset.tracks, shot=place[dataset.tracks.shot])
    traces = dataset.traces and replace(dataset.traces, shot=place[dataset.traces.shot])
    return replace(dataset, shots=dataset.shots.take(order), tracks=tracks, traces=traces)


def renumbered(dataset: ta.Dataset) -> ta.Dataset:
    """Without the names of shots, as a table whose rows are counted."""
    return replace(dataset, shots=replace(dataset.shots, shot_id=tuple(map(str, range(len(dataset.shots))))))


def with_columns(dataset: ta.Dataset, **columns: np.ndarray) -> ta.Dataset:
    return replace(dataset, shots=replace(dataset.shots, numbers={**dataset.shots.numbers, **columns}))


@cache
def finding_as_written() -> ta.Finding:
    return ta.discover(renumbered(SHEET), seed=3, terms=FEW)


@pytest.mark.slow
def test_a_finding_is_the_same_for_every_order_of_rows() -> None:
    """Of one order at random: each takes seconds."""
    order = np.random.default_rng().permutation(len(SHEET.shots)).tolist()
    again = ta.discover(renumbered(shuffled(SHEET, order)), seed=3, terms=FEW)
    one, other = (HASH.sub("", found.to_json()) for found in (again, finding_as_written()))   # of the rows as they came
    assert one == other, order


@settings(max_examples=20)
@given(order=st.permutations(range(40)), seed=st.integers(0, 9))
def test_sorted_samples_stay_with_their_shots(order: list[int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    shots = np.repeat(np.arange(40), 3)
    tracks = ta.dataset(rig=SHEET.rig, shots={"shot_id": [str(k) for k in range(40)], "hood_deg": np.full(40, 45.0),
                                              "distance_m": rng.choice([3.0, 4.0], 40)},
                        tracks={"shot_id": [str(k) for k in shots], "t_s": np.tile([0.0, 0.1, 0.2], 40),
                                "x_m": rng.normal(size=120), "y_m": np.zeros(120), "z_m": rng.normal(size=120)})
    one, other = tracks.in_order(), renumbered(shuffled(tracks, order)).in_order()
    assert one.tracks is not None and other.tracks is not None
    for name in ("shot", "t_s", "x_m", "z_m"):
        np.testing.assert_array_equal(getattr(one.tracks, name), getattr(other.tracks, name))
    at = tracks.shots.shot_id.index(one.shots.shot_id[7])
    np.testing.assert_array_equal(one.tracks.x_m[one.tracks.shot == 7], tracks.tracks.x_m[tracks.tracks.shot == at])


@pytest.mark.parametrize("t_s", [None, np.zeros(48), np.where(np.arange(48) == 5, np.nan, np.arange(48.0))])
def test_without_times_nothing_goes_by_the_order(t_s: np.ndarray | None) -> None:
    one = SHEET if t_s is None else with_columns(SHEET, t_s=t_s)
    columns = number_columns(one)
    assert "order_in_session" not in columns and "since_last_shot_s" not in columns
    assert np.isnan(columns["hood_change"]).all() and "shots_of_ball" not in columns


def test_with_times_the_order_is_theirs() -> None:
    timed = with_columns(SHEET, t_s=10.0 * np.arange(48))
    order = np.random.default_rng(1).permutation(48).tolist()
    assert timed.in_order() is timed
    again = shuffled(timed, order).in_order()
    assert again.shots.shot_id == timed.shots.shot_id
    columns, mixed = number_columns(timed), number_columns(shuffled(timed, order))
    for name in ("order_in_session", "since_last_shot_s", "hood_change"):
        np.testing.assert_array_equal(columns[name][order], mixed[name])


def test_what_needs_an_order_is_said_to_be_untested() -> None:
    found, timed = finding_as_written(), ta.discover(with_columns(SHEET, t_s=10.0 * np.arange(48)), seed=3, terms=FEW)
    assert any(line.startswith("not tested: what goes with the order of the shots") for line in found.lines())
    assert found.record.data.untested and timed.record.data.untested == ()
