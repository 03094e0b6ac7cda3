"""A session that was recorded once and is kept: whoever changes what a tick makes of its inputs, or a driver of its
frames, sees it here.

Recorded by `truearc emulate --trials 1 --seed 11`, without its image. When a change is meant, record it anew, and say
in the commit what has changed.
"""

import platform
import sys
import tarfile
from pathlib import Path

import pytest

from truearc.robot.recording.replay.recompute import replay, replay_frames

TICKS = 1116
ELSEWHERE = sys.platform != "linux" or platform.machine() != "x86_64"


@pytest.fixture(scope="module")
def golden(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("golden")
    with tarfile.open(Path(__file__).with_name("golden.tar.xz")) as tar:
        tar.extractall(folder, filter="data")
    return folder


@pytest.mark.skipif(ELSEWHERE, reason="another C library rounds sines otherwise; recorded on Linux, x86-64")
def test_every_output_is_what_it_was(golden: Path) -> None:
    assert replay(golden).ticks == TICKS


@pytest.mark.skipif(ELSEWHERE, reason="another C library rounds sines otherwise; recorded on Linux, x86-64")
def test_every_reading_is_what_it_was_from_the_frames_on(golden: Path) -> None:
    replayed, again = replay_frames(golden)
    assert replayed.ticks == TICKS and again.frames > 3 * TICKS
