"""Sessions that were recorded once and are kept: whoever changes what a tick makes of its inputs, or a driver of its
frames, sees it here.

`golden*` are `truearc emulate --trials 1 --seed 11`, without its image; `golden_faults*` are `faulty_session.py`, in
which devices, wires, camera and button box fail. Those without a number are of format 1, recorded by the code of tag
proof-1 and older, and are never recorded again: they show that old sessions are read without loss. When a change is
meant, record the others again, and say in the commit what has changed.
"""

import platform
import sys
import tarfile
from pathlib import Path

import pytest
from msgspec import UNSET
from msgspec.structs import replace

from tests.robot.samples import check
from truearc.robot.reasons import LEGACY_TEXT, texts
from truearc.robot.recording.reader import TickReader
from truearc.robot.recording.replay.recompute import LATER, replay, replay_frames
from truearc.robot.recording.rows import Rows2
from truearc.robot.recording.session import FORMAT, FORMAT_1, load_header, load_trials

HERE = Path(__file__).parent
TICKS = {"golden": 1116, "golden_2": 1116, "golden_faults": 1081, "golden_faults_2": 1081}
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
    assert load_header(golden).format == (FORMAT if golden.name.endswith("_2") else FORMAT_1)
    codes = set()
    for tick, _ in TickReader(golden):
        missed = () if tick.inputs.missed is None else (tick.inputs.missed,)
        for reason in (*tick.verdict.reasons, *tick.inputs.faults, *missed):
            check(reason)
            codes.add(reason.code)
    assert LEGACY_TEXT.name not in codes and len(codes) > (25 if "faults" in golden.name else 8)


def test_a_row_is_written_as_it_was_read(golden: Path) -> None:
    reader = TickReader(golden)
    for tick, row in reader:
        if LATER not in row:          # of the memory; absent in the oldest session
            tick = replace(tick, memory=replace(tick.memory, aim_place_m=UNSET))
        assert reader.rows.encode_tick(tick) == row
    lines = (golden / "trials.jsonl").read_bytes().splitlines()
    assert [reader.rows.encode_trial(trial) for trial in load_trials(golden)] == lines


def test_both_formats_say_the_same(tmp_path: Path) -> None:
    """The session with faults was recorded by old and new code from the same emulated devices."""
    rows = []
    for name in ("golden_faults", "golden_faults_2"):
        with tarfile.open(HERE / f"{name}.tar.xz") as tar:
            tar.extractall(tmp_path / name, filter="data")
        ticks = [tick for tick, _ in TickReader(tmp_path / name)]
        rows.append([([reason.code for reason in tick.verdict.reasons], [fault.code for fault in tick.inputs.faults],
                      tick.estimate, tick.command) for tick in ticks])
    assert rows[0] == rows[1]


def test_sentences_in_parameters_of_older_recordings_stay_as_they_were() -> None:
    causes = (b'{"code":"disk_error","params":{"detail":"can0.log has been deleted"}}',
              b'{"code":"pipe_closed","params":{"detail":"the sender has ended"}}',
              b'{"code":"frame_unexpected","params":{"device":"spark 3","frame":"0x0205b883","wanted":"its STATUS_2"}}')
    row = b'{"outcome":{"trial":3,"t_ns":5,"outcome":"held","reasons":[' + b",".join(causes) + b']},"shot":null}'
    trial = Rows2().decode_trial(row)
    assert Rows2().encode_trial(trial) == row
    assert texts(trial.outcome.reasons) == ["can0.log has been deleted",
                                            "pipe from another process: the sender has ended",
                                            "spark 3: unexpected frame 0x0205b883; expected its STATUS_2"]
