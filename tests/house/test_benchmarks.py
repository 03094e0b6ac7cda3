"""Each command of benchmarks/ runs, in a quick form."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.house.here import ROOT, run_module
from truearc.sim.gate import train

# benchmark -> options that make it quick; DATA: the folder of shared recordings
QUICK = {
    "aim": "--rigs 1",
    "demo_seeds": "--seeds 1 --first 7 --quick --processes 1 --out worlds.jsonl",
    "compare": "DATA/real --steps 40 --left 1",
    "discovery": "--what nulls --level L0 --shots 60 --worlds 1 --only clean --seed 11 --processes 1 "
                 "--out worlds.jsonl",
    "discovery_speed": "--shots 60 --level L0",
    "fault_matrix": "--bus virtual --only strangers|disk.turns --out faults.jsonl",
    "faults": "--worlds 1 --shots 24 --seed 11 --only none --processes 1 --out worlds.jsonl",
    "follow": "--practices 1 --sessions 2 --seasons 0 --seed 11 --processes 1 --out practices.jsonl",
    "fuzz": "--minutes 0.05 --seed 1",
    "gate": "--calls 20 --rounds 1 --shots 40",
    "grid_fit": "--quick --runs 1 --launches 12",
    "kill": "--kills 2",
    "launcher_world": "--worlds 1 --level L1 --shots 24 --unseen 12 --seed 11 --processes 1 --out worlds.jsonl",
    "loop": "--trials 3",
    "power": "--level L0 --worlds 1 --shots 60 --seed 3 --processes 1 --out worlds.jsonl",
    "real_sets": "DATA/real --only speeds",
    "vision": "--frames 1 --clutter 5 --files 5",
    "vision_tag": "--frames 4 --distractors 4",
}
JUDGES = ("gate",)              # exit code 1 where a busy machine is too slow: not tested here
# Processes of their own: what they do to one (ends, pauses and hurries it, empties JAX's caches), and one as any other.
# The others run in this one, which has imported and compiled most of what they need: a tenth of the time.
APART = ("aim", "discovery", "fault_matrix", "fuzz", "kill", "loop")


def run(words: str, folder: Path, data: Path) -> subprocess.CompletedProcess[str]:
    """Run `python -m benchmarks.WORDS` in a folder."""
    return subprocess.run([sys.executable, "-m", *f"benchmarks.{words}".split()], cwd=folder,
                          capture_output=True, text=True, check=False, timeout=300,
                          env={**os.environ, "PYTHONPATH": str(ROOT), "TRUEARC_DATA": str(data)})


@pytest.mark.slow
@pytest.mark.parametrize("name", [pytest.param(name, marks=pytest.mark.data if "DATA" in options else ())
                                  for name, options in QUICK.items()])
def test_benchmark_runs(name: str, tmp_path: Path, data_dir: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    options = QUICK[name].replace("DATA", str(data_dir))
    if name in APART:
        done = run(f"{name} {options}", tmp_path, data_dir)
        code, out, err = done.returncode, done.stdout, done.stderr
    else:
        monkeypatch.chdir(tmp_path)
        monkeypatch.setenv("TRUEARC_DATA", str(data_dir))
        monkeypatch.setattr(train, "CHECKED", 3000)      # tests/model_export has a gate's graph as it is
        monkeypatch.setattr(train, "LEARNED", 2000)
        code, out, err = run_module(f"benchmarks.{name}", options.split(), monkeypatch)
    assert code in ((0, 1) if name in JUDGES else (0,)), err[-2000:]
    assert out.strip() and "Traceback" not in err


@pytest.mark.slow
def test_lateness_is_measured(tmp_path: Path, data_dir: Path) -> None:
    done = run("loop --lateness --seconds 1 --rates 100 --loads idle --layouts one", tmp_path, data_dir)
    assert done.returncode == 0 and "Traceback" not in done.stderr, done.stderr[-2000:]
