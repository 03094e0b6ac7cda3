"""Some of benchmarks/soak.py, and that it would see a leak. TRUEARC_SOAK_S: how long, in seconds."""

import os
import sys
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from benchmarks.loop import judge
from benchmarks.soak import Sample, growth_mb, judge_memory, judge_recording, soak
from tests.robot.good_tick import CONFIG
from tests.robot.recording.test_writer import ticks
from truearc.robot.recording.session import make_header
from truearc.robot.recording.writer import SessionWriter
from truearc.robot.runtime import Lateness

SECONDS = float(os.environ.get("TRUEARC_SOAK_S", "30"))
TICK_NS = 5_000_000
MS = 1_000_000


def held(rss_mb, files=lambda t_s: 10, threads=lambda t_s: 5):
    return [Sample(t_s, rss_mb(t_s), files(t_s), threads(t_s)) for t_s in range(120)]


def test_what_grows_and_goes_on_is_a_leak_and_what_has_stopped_is_none():
    assert growth_mb(held(lambda t_s: 80.0 + 0.1 * t_s)) == pytest.approx(6.0, abs=0.5)
    assert growth_mb(held(lambda t_s: 80.0 + min(t_s, 50))) == 0.0
    assert judge_memory({"control": held(lambda t_s: 80.0 + t_s % 3)}) == []
    assert "control has grown by" in judge_memory({"control": held(lambda t_s: 80.0 + 0.1 * t_s)})[0]
    hour = [Sample(t_s, 80.0 + 17.0 * t_s / 3600.0, 10, 5) for t_s in range(3600)]      # what the index of it needs
    assert judge_memory({"recorder": hour}) == [] and judge_memory({"control": hour})


@pytest.mark.parametrize(("skip", "slow", "words"), [
    (lambda cycle: False, 1.0, ""), (lambda cycle: cycle == 300, 1.0, "tick 300 is missing"),
    (lambda cycle: False, 1.0004, "drifted by")])
def test_a_recording_that_lacks_ticks_or_drifts_is_told(skip, slow, words, tmp_path):
    recorder = SessionWriter(tmp_path / "s", make_header(CONFIG, None, None), CONFIG, None, lossless=True)
    lateness = Lateness(recorder.keep_lateness, TICK_NS)
    last_ns = 0
    for tick in ticks(600):
        t_ns = round(slow * tick.inputs.t_ns) + TICK_NS
        if tick.inputs.cycle > 1:
            lateness.note(t_ns, 0)
        if not skip(tick.inputs.cycle):
            recorder.record(replace(tick, inputs=replace(tick.inputs, t_ns=t_ns)), None)
            last_ns = t_ns
    lateness.close()
    recorder.close()
    wrong, summary = judge_recording(tmp_path / "s", 200, last_ns)
    assert (wrong == []) == (words == "") and words in " ".join(wrong) and "ticks in" in summary[0]


def test_a_late_tick_is_excused_when_a_bare_loop_was_late_for_half_of_its_time():
    came, late = np.array([5, 10, 22, 25, 30, 47]) * MS, np.array([0, 0, 7, 5, 0, 12]) * MS
    stalls = np.array([[16, 21], [46, 51], [90, 99]]) * MS     # the third came after the last tick
    told = judge(came, late, TICK_NS, stalls, 30.0)
    assert (told.missed, told.excused, sorted(told.stalls_us)) == (3, 1, [5000.0, 5000.0])


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
def test_a_long_run_leaves_nothing_behind(tmp_path: Path, capsys):
    assert soak(SECONDS, tmp_path), capsys.readouterr().out
