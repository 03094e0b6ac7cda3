"""Each command of benchmarks/ runs, in a quick form."""

import contextlib
import io
import os
import runpy
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from truearc.sim.gate import train

ROOT = Path(__file__).parents[2]
GATE = ROOT / "tests" / "golden" / "reference" / "export-physics" / "gate.onnx"

# benchmark -> options that make it quick; DATA: the folder of shared recordings
QUICK = {
    "aim": "--rigs 1",
    "demo_seeds": "--seeds 1 --first 7 --quick --processes 1 --out worlds.jsonl",
    "discovery": "--what nulls --level L0 --shots 60 --worlds 1 --only clean --seed 11 --processes 1 "
                 "--out worlds.jsonl",
    "discovery_speed": "--shots 60 --level L0",
    "fault_matrix": "--bus virtual --only strangers|disk.turns --out faults.jsonl",
    "filmed": "--worlds 1 --quick --first 7 --processes 1 --out worlds.jsonl",
    "follow": "--practices 1 --sessions 2 --seasons 0 --seed 11 --processes 1 --out practices.jsonl",
    "fuzz": "--minutes 0.05 --seed 1",
    "gate": "--calls 20 --rounds 1 --shots 40",
    "grid_fit": "--quick --runs 1 --launches 12",
    "kill": "--kills 2",
    "loop": "--trials 3",
    "plausibility": "--rigs 2 --processes 1 --out rigs.jsonl",
    "power": "--level L0 --worlds 1 --shots 60 --seed 3 --processes 1 --out worlds.jsonl",
    "real_sets": "DATA/real --only speeds",
    "real_systems": "DATA --only tanks",
    "seasons": "--seasons 1 --changes nothing --practice 40 --event 16 --seed 20060 --processes 1 --out seasons.jsonl",
    "system_speed": "--runs 8 --samples 150",
    "systems": "--worlds 1 --nulls 1 --runs 8 --seed 11 --processes 1 --out worlds.jsonl",
    "track": "--flights 3 --clips 1 --rates 60 --rows 360 --kinds plain --clutter 2 --matched 2",
    "vision": "--frames 1 --clutter 5 --files 5",
    "vision_tag": "--frames 4 --distractors 4"}
JUDGES = ("gate",)              # exit code 1 where a busy machine is too slow: not tested here
# Processes of their own: what they do to one (ends, pauses and hurries it, empties JAX's caches), and one as any other.
# The others run in this one, which has imported and compiled most of what they need: a tenth of the time.
APART = ("aim", "discovery", "fault_matrix", "fuzz", "kill", "loop")


def run_module(name: str, words: Sequence[str], monkeypatch: pytest.MonkeyPatch) -> tuple[int, str, str]:
    """Run `python -m NAME WORDS`; exit code and what it printed."""
    monkeypatch.syspath_prepend(str(ROOT))
    monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.setattr(sys, "argv", [name, *words])
    code, out, err = 0, io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            runpy.run_module(name, run_name="__main__", alter_sys=True)
        except SystemExit as left:
            code = left.code if isinstance(left.code, int) else int(left.code is not None)
    return code, out.getvalue(), err.getvalue()


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
