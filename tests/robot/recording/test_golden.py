"""Sessions that were recorded once and are kept: whoever changes what a tick makes of its inputs, or a driver of its
frames, sees it here.

`golden_2` is `truearc emulate --trials 1 --seed 11`, without its image; `golden_faults_2` is `faulty_session.py`, in
which devices, wires, camera and button box fail. When a change is meant, record them again, and say in the commit what
has changed.
"""

import platform
import sys
import tarfile
from pathlib import Path

import pytest

from tests.robot.samples import check
from truearc.robot.recording.reader import TickReader
from truearc.robot.recording.replay import replay, replay_frames
from truearc.robot.recording.session import FORMAT, encode_row, load_header, load_trials

HERE = Path(__file__).parent
TICKS = {"golden_2": 1115, "golden_faults_2": 1081}
ELSEWHERE = sys.platform != "linux" or platform.machine() != "x86_64"
same_machine = pytest.mark.skipif(ELSEWHERE, reason="another C library rounds sines otherwise; recorded on Linux, "
                                  "x86-64")


@pytest.fixture(scope="module", params=TICKS)
def golden(request, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("golden") / request.param
    with tarfile.open(HERE / f"{request.param}.tar.xz") as tar:
        tar.extractall(folder, filter="data")
    return folder


@same_machine
def test_every_output_is_what_it_was(golden: Path) -> None:
    assert replay(golden).ticks == TICKS[golden.name]


@same_machine
def test_every_reading_is_what_it_was_from_the_frames_on(golden: Path) -> None:
    replayed, again = replay_frames(golden)
    assert replayed.ticks == TICKS[golden.name] and again.frames > 3 * TICKS[golden.name]


def test_a_recorded_reason_has_what_its_code_declares(golden: Path) -> None:
    assert load_header(golden).format == FORMAT
    codes = set()
    for tick, _ in TickReader(golden):
        missed = () if tick.inputs.missed is None else (tick.inputs.missed,)
        for reason in (*tick.verdict.reasons, *tick.inputs.faults, *missed):
            check(reason)
            codes.add(reason.code)
    assert len(codes) > (25 if "faults" in golden.name else 8)


def test_a_row_is_written_as_it_was_read(golden: Path) -> None:
    for tick, row in TickReader(golden):
        assert encode_row(tick) == row
    lines = (golden / "trials.jsonl").read_bytes().splitlines()
    assert [encode_row(trial) for trial in load_trials(golden)] == lines
