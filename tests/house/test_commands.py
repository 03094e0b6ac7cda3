"""Every command that README.md, CONTRIBUTING.md and docs/ print is executed, in a quick form.

A page's commands are run in their order in one folder, as a reader would, with what the reader brings (`workspace`).
SHORTER makes long ones quick. ELSEWHERE has those that run in another test or in none, with the reason; of them the
options are compared with the parser's. So is a command in running text that is incomplete or has a placeholder.
"""

import contextlib
import csv
import glob
import io
import os
import re
import shlex
import shutil
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

import pytest

from tests.house.test_benchmarks import ROOT, run_module
from tests.sim.data.stranger_log import write_stranger_log
from truearc.cli.main import find_command, main, make_parser
from truearc.errors import InputError
from truearc.sim.gate import train
from truearc_proof.cli import prove_roles
from truearc_proof.rounds import solver

ROWS = 16                             # of the datasets that a reader brings
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "ARCHITECTURE.md", *sorted((ROOT / "docs").rglob("*.md")),
         *sorted((ROOT / "examples").glob("*/README.md"))]
PROGRAMS = ("truearc", "make", "python", "pytest", "pip", "sudo", "systemctl")
PLACEHOLDER = re.compile(r"\.\.\.|\||\[|\b(?:DIR|FILE|SESSION|SOURCE|DRIVER|SEED|N)\b")

# pattern -> what stands there instead, so that a command takes seconds
SHORTER = (
    (r"^(truearc init (my_shots|my-robot))$", r"\1 && cp rig.toml \2"),      # which the reader fills in
    (r"^make (?!-)", "make -n "),
    (r"^(pytest .*)", r"\1 -n 0 -q --collect-only"),
    (r"^(truearc emulate) --trials \d+ (.* --page)$", r"\1 --trials 1 \2 127.0.0.1:0"),
    (r"^(truearc emulate) --trials \d\d+(.*first-hour)$", r"\1 --trials 22\2"),
    (r"^(truearc emulate) --trials \d\d+(.*windy-hour)$", r"\1 --trials 12\2"),
    (r"wind_x_m_s = -3.0", "wind_x_m_s = -0.3"),     # too little to be found: tests/cli/test_demo.py has a find `since`
    (r"^(truearc emulate) --trials \d\d+(?! --bus)(?!.*-hour)", r"\1 --trials 2"),
    (r"^(truearc sysid --emulate)", r"\1 --only hood"),
    (r"^(truearc identifiability rig.toml.*) --shots 300", r"\1"),
    (r"^(truearc identifiability rig.toml)", r"\1 --shots 40"),
    (r"^truearc prove (?:--worlds \d+)", "truearc prove --worlds 1 --processes 1"),
    (r"^(truearc prove --worlds.*) --shots \d+", r"\1 --shots 40"),
    (r"--seed-from-entropy", "--engines numpy --seed 3"),
    (r"^(truearc prove check.*) --worlds \d+", r"\1 --worlds 1"),
    (r"^(truearc deploy \S+ --config my_launcher.toml) --wheels wheels", r"\1 --dry-run"),
    (r" --gate gate.onnx --core 3", " --core 3"),
    (r"(truearc doctor.*) \[--endpoints flat_endpoints.json\] \[--json\]", r"\1 --json"),
    (r" \[--labels labels.csv\]", ""),
)
# pattern -> why no test runs it; its options are checked
ELSEWHERE = {
    r"^pip (install|wheel|download)": "fetches packages; `make setup`, which CI runs, installs both distributions",
    r"^sudo ": "changes the machine's network or services",
    r"^systemctl ": "asks for a service that only a robot has",
    r"^truearc run ": "goes on until it is stopped; tests/loops runs it against emulated devices",
    r"^truearc advise ": "goes on until it is stopped; tests/frc/test_advise_session.py has it beside a robot",
    r"^truearc doctor.* --(set|move)": "writes to devices, or moves them; tests/robot/doctor does",
    r"^python -m tools\.pages": "writes pages, which tests/house/test_site.py compares",
    r"^truearc demo --game": "takes minutes; tests/cli/test_demo.py plays it in a small form",
    r"^truearc mcp ": "goes on until it is stopped; tests/cli/test_assistant.py asks it",
    r"^truearc serve ": "goes on until it is stopped; tests/cli/test_serve.py runs it and ends it by Ctrl-C",
    r"^truearc emulate .*--bus slcan:auto": "waits for a robot in another process; tests/loops/test_loops.py has both",
    r"^truearc sysid --config": "drives a real launcher; `sysid --emulate` runs here",
    r"^truearc sysid --csv": "needs a step test of a real launcher; tests/sim/sysid reads such tables",
    r"^truearc vision": "needs photographs, a board or a person; tests/robot/test_vision*.py run it on drawn ones",
    r"^truearc (track|discover data/(filmed|s )|emulate --film)":
        "films for minutes, or needs clips; tests/sim/video/test_filmed_robot.py runs the chain",
    r"^python -m benchmarks\.(?!proof)": "test_benchmarks.py does; system_rivals needs a package of its own",
    r"^python -m truearc_proof.world.season": "plays hundreds of worlds",
    r"^truearc reproduce": "tests/proof/reproduce runs it in a small form",
    r"^(mkdir away|truearc prove solve --out away|cp -r away)": "the page's round is solved by then; tests/proof/"
                                                                "test_round.py solves one without its keeper",
    r"^truearc discover --system": "needs the files of its page; tests/sim/systems runs the tutorial",
    r"^truearc discover (examples/tracks|my_tracks)": "tests/sim/discover/test_tutorial_tracks.py asks it",
    r"^truearc (discover (mpi|drops|falls|bb|two-weeks|new-and-old)|fit (mpi|bb))":
        "takes long; test_real.py, test_spin_vector.py, test_import_ball_drops.py ask it"}
EXIT = {r"^truearc doctor": 1}        # exit codes that are documented: no launcher is there


# commands of several pages on which nothing else depends: the first page that has one runs it
ONCE = ("truearc discover examples/spreadsheet ", "pytest ", "truearc train --real data/week",
        "truearc export weights/ -o")
_done: set[str] = set()


class Workspace(NamedTuple):
    """A folder in which printed commands are run; `truearc` and what is readily run by `python -m` are called in this
    process."""

    folder: Path
    monkeypatch: pytest.MonkeyPatch

    def run(self, line: str) -> None:
        """Run one printed line; AssertionError with the output where its exit code is not the documented one."""
        for part in _parts(line):
            wanted = next((code for pattern, code in EXIT.items() if re.search(pattern, part)), 0)
            if part.startswith("truearc "):
                said = io.StringIO()
                with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
                    code, err = main(_words(part)[1:]), said.getvalue()
            elif re.fullmatch(r"python -m [\w.]+[^<>|$()]*", part):
                with self.monkeypatch.context() as patch:
                    code, _, err = run_module(_words(part)[2], _words(part)[3:], patch)
            else:
                path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
                done = subprocess.run(["bash", "-c", part], cwd=self.folder, capture_output=True, text=True,
                                      env={**os.environ, "PATH": path, "PYTHONPATH": str(ROOT)})
                code, err = done.returncode, done.stderr
            assert code == wanted, f"{part}: exit code {code}\n{err[-1500:]}"


def run_here(argv: list[str], check: bool) -> subprocess.CompletedProcess[str]:
    """Run `python -m truearc ...` in this process, which has imported and compiled most of what it needs."""
    assert argv[:3] == [sys.executable, "-m", "truearc"] and not check
    return subprocess.CompletedProcess(argv, main(argv[3:]))


def _parts(line: str) -> list[str]:
    """Commands of a line that `&&` or `;` separate, outside of parentheses and quotes."""
    if "(" in line or "'" in line:
        return [line]
    return [part.strip() for part in re.split(r"&&|;", line) if part.strip()]


def _words(command: str) -> list[str]:
    """As a shell splits them, and finds files by pattern."""
    return [one for word in shlex.split(command) for one in (sorted(glob.glob(word)) or [word])]


def commands_of(page: Path) -> list[tuple[str, bool]]:
    """Commands of a page in their order, without comments, and whether each is a line of a shell block."""
    found: list[tuple[str, bool]] = []
    inline = rf"`((?:{'|'.join(PROGRAMS)}) [^`]+)`"
    for match in re.finditer(rf"^ *```(\w*)\n(.*?)^ *```|{inline}", page.read_text(encoding="utf-8"),
                             re.DOTALL | re.MULTILINE):
        if match[1] == "sh":
            lines = match[2].replace("\\\n", " ").splitlines()
            commands = (_squeezed(re.sub(r"(?:^|\s{2,})# .*", "", line)) for line in lines)
            found += [(command, True) for command in commands if command]
        elif match[3] is not None:
            found.append((_squeezed(match[3]), False))
    return list(dict.fromkeys(found))


def _squeezed(text: str) -> str:
    return re.sub(r"\s+", " ", text.strip())


def shortened(command: str) -> str:
    """The quick form of a command."""
    for pattern, replacement in SHORTER:
        command = re.sub(pattern, replacement, command)
    return command


def check_options(command: str) -> None:
    """Every option that is printed is one of the command's; a truearc command or benchmark of that name is there."""
    command, _, more = command.partition(";")
    if more:
        check_options(more.strip())
    words = re.sub(r"\|\S+", "", command.replace("[", " ").replace("]", " ")).split()
    options = {word.partition("=")[0] for word in words if re.match(r"--?[a-z]", word)}
    if words[0] == "truearc":
        found = find_command([word for word in words[1:] if not word.startswith("-")])
        assert found is not None, command
        actions = make_parser(found)._actions
        assert options <= {option for action in actions for option in action.option_strings}, command
    elif words[:2] == ["python", "-m"] and words[2].startswith("benchmarks."):
        paths = [ROOT / f"{words[2].replace('.', '/')}.py", ROOT / "benchmarks" / "worlds.py"]
        said = "".join(path.read_text(encoding="utf-8") for path in paths)
        assert {option for option in options if f'"{option}"' not in said
                and not re.search(rf"\b{option[2:]}=", said)} <= {"-m"}, command      # of benchmarks.options: a keyword


def is_fragment(command: str) -> bool:
    """A command of running text that its parser refuses as incomplete: a name alone, or with some of its options."""
    words = shlex.split(command)[1:]
    if PLACEHOLDER.search(command) or all(re.fullmatch("[a-z][a-z-]*", word) for word in words):
        return command.startswith(("truearc ", "python "))
    found = find_command(words) if command.startswith("truearc ") else None
    try:
        if found is not None:
            with contextlib.redirect_stderr(io.StringIO()):
                make_parser(found).parse_args(words[len(found.name.split()):])
    except (SystemExit, InputError):
        return True
    return False


@pytest.fixture(scope="module")
def monday(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recorded session, as `truearc emulate` makes it, and beside it the same as another robot's log."""
    session = tmp_path_factory.mktemp("recorded") / "monday"
    assert main(["emulate", "--trials", "12", "--seed", "3", "--out", str(session), "--quiet"]) == 0
    write_stranger_log(session, session.with_name("practice.wpilog"))
    return session


def write_spreadsheet(path: Path) -> None:
    """A table of shots as people keep it: feet, rpm, their own words."""
    with (ROOT / "examples" / "spreadsheet" / "shots.csv").open(encoding="utf-8") as file:
        shots = list(csv.DictReader(file))[:ROWS]
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(["Shot", "Dist (ft)", "Hood (deg)", "Motor RPM", "Result"])
        table.writerows([k, float(one["distance_m"]) / 0.3048, one["hood_deg"], 5672 * float(one["motor_ratio"]),
                         "rim out" if one["outcome"] == "miss" else one["outcome"]] for k, one in enumerate(shots, 1))


@pytest.fixture
def workspace(tmp_path: Path, data_dir: Path, monday: Path, monkeypatch: pytest.MonkeyPatch) -> Workspace:
    """What a reader of the pages brings: a clone, datasets, a recorded session, and configurations.

    A solver runs in this process, without the refusal that would last as long as it; tests/proof has it on its own.
    """
    folder = tmp_path / "clone"
    folder.mkdir()
    (tmp_path / "shared").symlink_to(data_dir.parent)
    for name in ("Makefile", "pyproject.toml", "constraints.txt", "benchmarks", "tests", "tools", "robot", "hw", "sim",
                 "model_export", "truearc", "proof", "frc"):
        (folder / name).symlink_to(ROOT / name)
    for name in ("docs", "examples"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("*.egg-info", "__pycache__", "*.png"))
    for name in ("challenge", "shots", "my_dir", "home", "event"):
        shutil.copytree(ROOT / "examples" / "spreadsheet", folder / name, ignore=shutil.ignore_patterns("README.md"))
        rows = (folder / name / "shots.csv").read_text(encoding="utf-8").splitlines(keepends=True)
        (folder / name / "shots.csv").write_text("".join(rows[:1 + ROWS]), encoding="utf-8")
    shutil.copytree(ROOT / "examples" / "tracks", folder / "my_tracks")
    shutil.copytree(monday, folder / "sessions" / "monday")
    shutil.copy(monday.with_name("practice.wpilog"), folder)
    shutil.copy(ROOT / "examples" / "spreadsheet" / "rig.toml", folder)
    for name in ("launcher.toml", "my_launcher.toml", "other.toml"):
        shutil.copy(ROOT / "robot" / "launcher.toml", folder / name)
    shutil.copy(ROOT / "examples" / "truearc-hoodflex" / "truearc_hoodflex.py", folder / "my_terms.py")
    write_spreadsheet(folder / "mine.csv")
    (folder / "truth.json").write_text('{"kind": "one", "effects": {"wheel_slip": 0.1}}', encoding="utf-8")
    (folder / "data").mkdir()
    monkeypatch.chdir(folder)
    monkeypatch.setattr(solver, "forbid", lambda directory: None)
    monkeypatch.setattr(train, "CHECKED", 3000)       # tests/model_export has a gate's graph as it is
    monkeypatch.setattr(train, "LEARNED", 2000)
    monkeypatch.setattr(prove_roles, "subprocess", SimpleNamespace(run=run_here))
    return Workspace(folder, monkeypatch)


@pytest.mark.slow
@pytest.mark.parametrize("page", [pytest.param(page, marks=pytest.mark.data if page.name == "real-data.md" else ())
                                  for page in PAGES], ids=lambda page: str(page.relative_to(ROOT)))
def test_every_command_of_a_page_does_what_it_says(page: Path, workspace: Workspace) -> None:
    if page in (ROOT / "README.md", ROOT / "docs/tutorials/on-a-robot.md"):
        (workspace.folder / "my_launcher.toml").unlink()  # the page makes it
    failed = []
    for command, in_block in commands_of(page):
        began = time.monotonic()
        try:
            if any(re.search(pattern, command) for pattern in ELSEWHERE) or (not in_block and is_fragment(command)):
                check_options(command)
            elif command not in _done:
                workspace.run(shortened(command))
                _done.update({command} if command.startswith(ONCE) else ())
        except AssertionError as error:
            failed.append(str(error))
        if time.monotonic() - began > 2:
            print(f"{time.monotonic() - began:6.1f} s  {command}")
    assert not failed, "\n\n".join(failed)
