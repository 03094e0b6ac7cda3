"""Recordings through the API: ticks as often as wanted, trials, configuration, and what is not a recording."""

import itertools
import tarfile
from pathlib import Path

import pytest

import truearc as ta

KEPT = Path(__file__).parents[1] / "robot" / "recording" / "golden_2.tar.xz"
TICKS = 1115


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("kept")
    with tarfile.open(KEPT) as tar:
        tar.extractall(folder, filter="data")
    return folder


def test_ticks_come_in_order_as_often_as_wanted(session: Path) -> None:
    recording = ta.Recording(session)
    for _ in range(2):
        ticks = list(recording)
        assert len(ticks) == TICKS and recording.cut_short is None
        assert all(one.inputs.t_ns < other.inputs.t_ns for one, other in itertools.pairwise(ticks))
        assert all(tick.verdict.fire != bool(tick.verdict.reasons) for tick in ticks)


def test_a_recording_prints_and_has_its_trials_and_rig(session: Path, tmp_path: Path) -> None:
    with pytest.raises(ta.InputError, match=r"session\.json"):
        ta.Recording(tmp_path)
    recording = ta.Recording(str(session))
    (trial,) = recording.trials
    assert trial.shot is not None and recording.config.rig.ball.mass_kg > 0.0
    assert str(recording).startswith(f"{session}: 1 trials (1 {trial.outcome.outcome})")
    assert recording._repr_html_().startswith("<pre>")
