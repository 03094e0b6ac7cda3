"""Recordings through the API: ticks as often as wanted, trials, configuration, and what is not a recording."""

import itertools
from pathlib import Path

import pytest

import truearc as ta


def test_ticks_come_in_order_as_often_as_wanted(plain: Path) -> None:
    recording = ta.Recording(plain)
    ticks = list(recording)
    assert len(ticks) > 1000 and len(list(recording)) == len(ticks) and recording.cut_short is None
    assert all(one.inputs.t_ns < other.inputs.t_ns for one, other in itertools.pairwise(ticks))
    assert all(tick.verdict.fire != bool(tick.verdict.reasons) for tick in ticks)


def test_a_recording_prints_and_has_its_trials_and_rig(plain: Path, tmp_path: Path) -> None:
    with pytest.raises(ta.InputError, match=r"session\.json"):
        ta.Recording(tmp_path)
    recording = ta.Recording(str(plain))
    assert all(trial.shot is not None for trial in recording.trials) and recording.config.rig.ball.mass_kg > 0.0
    assert str(recording).startswith(f"{plain}: 2 trials (")
    assert recording._repr_html_().startswith("<pre>")
