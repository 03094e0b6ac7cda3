"""Every file of benchmarks/ runs: a quick form of each one that is a command, an import of the others."""

import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FILES = sorted((ROOT / "benchmarks").rglob("*.py"))
GATE = ROOT / "tests" / "golden" / "reference" / "export-physics" / "gate.onnx"
NAMES = [".".join(path.relative_to(ROOT).with_suffix("").parts) for path in FILES]
COMMANDS = {name.partition(".")[2] for name, path in zip(NAMES, FILES, strict=True)
            if 'if __name__ == "__main__":' in path.read_text(encoding="utf-8")}

# benchmark -> options that make it quick; DATA: the folder of shared recordings
QUICK = {
    "aim": "--rigs 1",
    "aim_tick": "--trials 1 --rounds 1",
    "adoption": "--worlds 1 --shots 40 --seed 11 --only nothing --processes 1 --out worlds.jsonl",
    "ball_drops": "DATA/real/ball_drops.csv",
    "coverage": "--replicates 1 --shots 30",
    "naming": "--level L0 --worlds 4 --shots 60 --seed 3 --processes 1 --out worlds.jsonl",
    "demo_seeds": "--seeds 1 --first 7 --quick --processes 1 --out worlds.jsonl",
    "designed": "--worlds 1 --level L0 --seed 11 --only wind_x --processes 1 --out worlds.jsonl",
    "discovery": "--what nulls --level L0 --shots 60 --worlds 1 --only clean --seed 11 --processes 1 "
                 "--out worlds.jsonl",
    "discovery_speed": "--shots 60",
    "fault_matrix": "--bus virtual --only strangers --out faults.jsonl",
    "faults": "--worlds 1 --seed 11 --only none --processes 1 --out worlds.jsonl",
    "field": "--what nulls --only clean --shots 60 --worlds 1 --seed 11 --rivals argmax --processes 1 "
             "--out worlds.jsonl",
    "follow": "--practices 1 --sessions 2 --seasons 0 --seed 11 --processes 1 --out practices.jsonl",
    "gate": "--calls 20 --rounds 1 --shots 40",
    "grid_fit": "--quick --runs 1 --launches 12",
    "kill": "--kills 2",
    "ladder": "--worlds 1",
    "launcher_world": "--worlds 1 --level L1 --shots 40 --seed 11 --processes 1 --out worlds.jsonl",
    "loop": "--trials 3",
    "season_agreement": "--trials 6",
    "soak": "--minutes 0.1",
    "start_up": "--repeats 1 --command fit",
    "team_tables": "DATA/real/frc_shot_tables.csv --teams 401",
    "training": "--steps 200 --repeats 1",
    "vision": "--frames 1 --clutter 5 --files 5",
    "vision_hidden": "--frames 1",
}
ELSEWHERE = {
    "archives": "prints and unpacks an archive of git; test_commands.py runs it as the pages print it",
    "bare_loop": "asks for real-time priority on a core of its own, until a signal",
    "loop_frames": "the sender of `loop --frames`, below",
    "proof": "reads archives; test_commands.py runs it as docs/proof.md prints it",
    "real_tables": "reads what docs/real-data.md imports; test_commands.py runs it as that page prints it",
    "timed_run": "the robot of `loop --lateness`, below",
}
JUDGES = ("gate", "soak", "start_up")           # exit code 1 where a busy machine is too slow: not what is tested here


def run(words: str, folder: Path, data: Path) -> subprocess.CompletedProcess[str]:
    """Run `python -m benchmarks.WORDS` in a folder."""
    return subprocess.run([sys.executable, "-m", *f"benchmarks.{words}".replace("DATA", str(data)).split()], cwd=folder,
                          capture_output=True, text=True, check=False, timeout=300,
                          env={**os.environ, "PYTHONPATH": str(ROOT), "TRUEARC_DATA": str(data)})


def test_every_benchmark_has_a_quick_form() -> None:
    assert set(QUICK) | set(ELSEWHERE) == COMMANDS and not set(QUICK) & set(ELSEWHERE)


@pytest.mark.slow
@pytest.mark.parametrize("name", [pytest.param(name, marks=pytest.mark.data if "DATA" in options else ())
                                  for name, options in QUICK.items()])
def test_benchmark_runs(name: str, tmp_path: Path, data_dir: Path) -> None:
    done = run(f"{name} {QUICK[name]}", tmp_path, data_dir)
    assert done.returncode in ((0, 1) if name in JUDGES else (0,)), done.stderr[-2000:]
    assert done.stdout.strip() and "Traceback" not in done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("options", ["--lateness --seconds 1 --rates 100 --loads idle --layouts one",
                                     f"--lateness --seconds 8 --rates 100 --loads asked --layouts three --gate {GATE}",
                                     "--frames --seconds 0.1 --buses slcan:socket"])
def test_helpers_of_the_loop_run(options: str, tmp_path: Path, data_dir: Path) -> None:
    done = run(f"loop {options}", tmp_path, data_dir)
    assert done.returncode == 0 and "Traceback" not in done.stderr, done.stderr[-2000:]


@pytest.mark.parametrize("name", NAMES)
def test_benchmark_can_be_imported(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT))
    assert import_module(name).__doc__
