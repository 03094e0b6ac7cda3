"""Some of benchmarks/soak.py, and that it would see a leak. TRUEARC_SOAK_S: how long, in seconds."""

import os
import sys
from pathlib import Path

import pytest

from benchmarks.soak import Sample, growth_mb, judge_memory, soak

SECONDS = float(os.environ.get("TRUEARC_SOAK_S", "30"))


def held(rss_mb, files=lambda t_s: 10, threads=lambda t_s: 5):
    return [Sample(t_s, rss_mb(t_s), files(t_s), threads(t_s)) for t_s in range(120)]


def test_what_grows_and_goes_on_is_a_leak_and_what_has_stopped_is_none():
    assert growth_mb(held(lambda t_s: 80.0 + 0.1 * t_s)) == pytest.approx(6.0, abs=0.5)
    assert growth_mb(held(lambda t_s: 80.0 + min(t_s, 50))) == 0.0
    assert judge_memory({"control": held(lambda t_s: 80.0 + t_s % 3)}) == []
    assert "control has grown by" in judge_memory({"control": held(lambda t_s: 80.0 + 0.1 * t_s)})[0]
    hour = [Sample(t_s, 80.0 + 17.0 * t_s / 3600.0, 10, 5) for t_s in range(3600)]      # what the index of it needs
    assert judge_memory({"recorder": hour}) == [] and judge_memory({"control": hour})


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
def test_a_long_run_leaves_nothing_behind(tmp_path: Path, capsys):
    assert soak(SECONDS, tmp_path), capsys.readouterr().out
