"""Every file of benchmarks/ runs: a quick form of each one that is a command, an import of the others."""

import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

from tests.house.here import ROOT, run_module
from truearc.sim.gate import surrogate

FILES = sorted((ROOT / "benchmarks").rglob("*.py"))
GATE = ROOT / "tests" / "golden" / "reference" / "export-physics" / "gate.onnx"
NAMES = [".".join(path.relative_to(ROOT).with_suffix("").parts) for path in FILES]
COMMANDS = {name.partition(".")[2] for name, path in zip(NAMES, FILES, strict=True)
            if 'if __name__ == "__main__":' in path.read_text(encoding="utf-8")}

# benchmark -> options that make it quick; DATA: the folder of shared recordings
QUICK = {
    "aim": "--rigs 1",
    "aim_tick": "--trials 1 --rounds 1",
    "adoption": "--worlds 1 --shots 14 --unseen 12 --seed 11 --only nothing --processes 1 --out worlds.jsonl",
    "ball_butler": "DATA/real/ball_butler_tracks.csv --flights 16",
    "ball_drops": "DATA/real/ball_drops.csv --quick",
    "coverage": "--replicates 1 --shots 30",
    "lift": "--seeds 1",
    "naming": "--level L0 --worlds 4 --shots 60 --seed 3 --processes 1 --out worlds.jsonl",
    "naming_rules": "--level L0 --worlds 1 --shots 60 --seed 3 --processes 1 --out worlds.jsonl",
    "demo_seeds": "--seeds 1 --first 7 --quick --processes 1 --out worlds.jsonl",
    "designed": "--worlds 1 --level L0 --seed 11 --only wind_x --processes 1 --out worlds.jsonl",
    "discovery": "--what nulls --level L0 --shots 60 --worlds 1 --only clean --seed 11 --processes 1 "
                 "--out worlds.jsonl",
    "discovery_speed": "--shots 60 --level L0",
    "fault_matrix": "--bus virtual --only strangers|disk.turns --out faults.jsonl",
    "faults": "--worlds 1 --shots 24 --seed 11 --only none --processes 1 --out worlds.jsonl",
    "field": "--what nulls --only clean --shots 60 --worlds 1 --seed 11 --rivals argmax --processes 1 "
             "--out worlds.jsonl",
    "follow": "--practices 1 --sessions 2 --seasons 0 --aimed 0 --seed 11 --processes 1 --out practices.jsonl",
    "fuzz": "--minutes 0.05 --seed 1",
    "gate": "--calls 20 --rounds 1 --shots 40",
    "grid_fit": "--quick --runs 1 --launches 12",
    "kill": "--kills 2",
    "ladder": "--worlds 1 --shots 60",
    "launcher_world": "--worlds 1 --level L1 --shots 24 --unseen 12 --seed 11 --processes 1 --out worlds.jsonl",
    "loop": "--trials 3",
    "memory": f"--gate {GATE} --minutes 0.05 --clients 1",
    "power": "--level L0 --worlds 1 --shots 60 --seed 3 --processes 1 --out worlds.jsonl",
    "real_sets": "DATA/real --only speeds",
    "real_tables": "DATA/real/frc_shot_tables.csv DATA/real/frc3476_tuning_history.csv "
                   "DATA/real/frc6328_event_corrections.csv --team 254",
    "motion_soak": "--only slip --seconds 5",
    "rivals": "DATA/real --only falls --steps 40 --left 1",
    "rivals_sealed": f"{ROOT}/docs/measured/sealed/L2d.tar.xz",
    "scale": "--level L0 --worlds 3 --shots 40 --seed 3 --processes 1 --out worlds.jsonl",
    "season_agreement": "--trials 6",
    "start_up": "--repeats 1 --command fit",
    "team_tables": "DATA/real/frc_shot_tables.csv --teams 401",
    "training": "--steps 200 --repeats 1",
    "vision": "--frames 1 --clutter 5 --files 5",
    "vision_hidden": "--frames 1",
    "vision_tag": "--frames 4 --distractors 4",
}
ELSEWHERE = {
    "advise": "tests/frc/test_advise_session.py plays it, well and with a key that is gone",
    "soak": "tests/loops/test_soak.py runs it",
    "stand_in_robot": "the robot of `advise`, above",
    "archives": "prints and unpacks an archive of git; test_commands.py runs it as the pages print it",
    "bare_loop": "asks for real-time priority on a core of its own, until a signal",
    "loop_frames": "the sender of `loop --frames`, below",
    "proof": "reads archives; test_commands.py runs it as docs/measured/proof.md prints it",
    "timed_run": "the robot of `loop --lateness`, below",
}
JUDGES = ("gate", "start_up")   # exit code 1 where a busy machine is too slow: not tested here
# Processes of their own: what they do to one (ends, pauses and hurries it, empties JAX's caches), and one as any other.
# The others run in this one, which has imported and compiled most of what they need: a tenth of the time.
APART = ("aim", "discovery", "fault_matrix", "fuzz", "kill", "loop", "start_up")


def run(words: str, folder: Path, data: Path) -> subprocess.CompletedProcess[str]:
    """Run `python -m benchmarks.WORDS` in a folder."""
    return subprocess.run([sys.executable, "-m", *f"benchmarks.{words}".split()], cwd=folder,
                          capture_output=True, text=True, check=False, timeout=300,
                          env={**os.environ, "PYTHONPATH": str(ROOT), "TRUEARC_DATA": str(data)})


def test_every_benchmark_has_a_quick_form() -> None:
    assert set(QUICK) | set(ELSEWHERE) == COMMANDS and not set(QUICK) & set(ELSEWHERE)


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
        monkeypatch.setattr(surrogate, "CHECKED", 3000)      # tests/model_export has a gate's graph as it is
        monkeypatch.setattr(surrogate, "LEARNED", 2000)
        code, out, err = run_module(f"benchmarks.{name}", options.split(), monkeypatch)
    assert code in ((0, 1) if name in JUDGES else (0,)), err[-2000:]
    assert out.strip() and "Traceback" not in err


@pytest.mark.slow
@pytest.mark.parametrize("options", ["--lateness --seconds 1 --rates 100 --loads idle --layouts one",
                                     f"--lateness --seconds 4 --rates 100 --loads asked --layouts three --gate {GATE}",
                                     "--frames --seconds 0.1 --buses slcan:socket --most 2000"])
def test_helpers_of_the_loop_run(options: str, tmp_path: Path, data_dir: Path) -> None:
    done = run(f"loop {options}", tmp_path, data_dir)
    assert done.returncode == 0 and "Traceback" not in done.stderr, done.stderr[-2000:]


@pytest.mark.parametrize("name", NAMES)
def test_benchmark_can_be_imported(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT))
    assert import_module(name).__doc__
