"""The rules of ARCHITECTURE.md, held by a machine: imports, style, types, sizes, names."""

import ast
import re
import subprocess
import sys
import tomllib
from collections import defaultdict
from pathlib import Path

import pytest

from tests.house.wheels import build_wheels
from tools.count_lines import WHEEL, count_files, python_files

ROOT = Path(__file__).parents[2]
TOPS = ("hw", "robot", "sim", "model_export", "truearc", "proof", "frc")
FILES = sorted(path for top in TOPS for path in (ROOT / top).rglob("*.py"))
LONGEST_FILE, LONGEST_FUNCTION = 600, 60
MOST_LINES = 36800                   # of code in the wheel, by tools/count_lines.py; interlocks of motion took 2,000
BARE = ("hw", "robot", "sim", "model_export")
LINT = ("import sys; sys.meta_path[:] = [one for one in sys.meta_path if 'editable' not in repr(one).lower()]; "
        "sys.path[:] = [{site!r}] + [one for one in sys.path if one]; "
        "from importlinter.cli import lint_imports_command; lint_imports_command()")
CYCLES = ("import sys; sys.meta_path[:] = [one for one in sys.meta_path if 'editable' not in repr(one).lower()]; "
          "sys.path[:] = [{site!r}] + [one for one in sys.path if one]; import graphlib, grimp; "
          "graph = grimp.build_graph('truearc', 'truearc_proof', 'truearc_frc', cache_dir=None); "
          "graphlib.TopologicalSorter("
          "{{one: graph.find_modules_directly_imported_by(one) for one in graph.modules}}).prepare()")
BINARY = re.compile(r"[rwxa+]*b[rwxa+]*")
OTHER_OPENS = ("os", "tarfile", "Image", "stream")
HEAVY = ("jax", "mujoco", "onnx", "scipy", "matplotlib", "optax", "pyarrow", "joblib", "rich")


def run(*command, cwd=ROOT):
    done = subprocess.run(command, cwd=cwd, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_ruff():
    run(sys.executable, "-m", "ruff", "check", ".")


def test_mypy():
    assert (ROOT / "build" / "view" / "truearc").is_dir(), "run `make setup`, which makes build/view for mypy"
    run(sys.executable, "-m", "mypy")


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    return build_wheels(tmp_path_factory.mktemp("wheels"))


def test_import_directions(site):
    """On the unpacked wheels: the linter does not follow the links of build/view."""
    run(sys.executable, "-c", LINT.format(site=str(site)), "--no-cache", "--config", str(ROOT / "pyproject.toml"),
        cwd=site)


def test_no_modules_import_each_other(site):
    """Not even inside a function: graphlib.CycleError names the modules."""
    run(sys.executable, "-c", CYCLES.format(site=str(site)), cwd=site)


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_sizes(path):
    source = path.read_text(encoding="utf-8")
    assert len(source.splitlines()) <= LONGEST_FILE
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            assert node.end_lineno - node.lineno < LONGEST_FUNCTION, f"{path.name}: {node.name}"


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_text_files_name_their_encoding(path):
    """Windows' default is another one. Binary modes, and `open` of modules that read no text, need none."""
    for call in (node for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(node, ast.Call)):
        place, _, name = ast.unparse(call.func).rpartition(".")
        modes = [part.value for arg in call.args for part in ast.walk(arg)
                 if isinstance(part, ast.Constant) and isinstance(part.value, str)]
        is_text = name in ("read_text", "write_text", "TextIOWrapper") or (
            name == "open" and place not in OTHER_OPENS and not any(BINARY.fullmatch(mode) for mode in modes))
        assert not is_text or any(word.arg == "encoding" for word in call.keywords), f"{path.name}:{call.lineno}"


@pytest.mark.parametrize("top", TOPS)
def test_public_class_names_are_unique_within_a_top_folder(top):
    """Emulators excepted: each device family may have the same names there."""
    places = defaultdict(list)
    for path in FILES:
        if path.relative_to(ROOT).parts[0] == top and path.name != "emulator.py":
            for node in ast.parse(path.read_text(encoding="utf-8")).body:
                if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                    places[node.name].append(str(path.relative_to(ROOT)))
    assert {name: where for name, where in places.items() if len(where) > 1} == {}


def test_wheel_stays_within_its_lines():
    assert count_files([path for place in WHEEL for path in python_files(ROOT / place)]).lines <= MOST_LINES


def test_mutants_are_made_of_files_that_exist_and_build_the_allow_list():
    """Frames that may be sent are decided where `make mutants` looks: not in a family's other modules."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["mutmut"]
    mutated = {ROOT / name.removeprefix("truearc/") for name in settings["only_mutate"]}
    assert {path for path in mutated if not path.is_file()} == set()
    assert {path for path in (ROOT / "hw").rglob("*.py")
            if re.search(r"\ballow(_seldom)?\(", path.read_text("utf-8"))} - mutated == set()


def imported_modules(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module


def test_everything_is_imported_through_truearc():
    """From the checkout's root `import robot` works, too, and would make a second copy of every class."""
    others = [path for folder in ("tests", "benchmarks", "tools", "examples") for path in (ROOT / folder).rglob("*.py")]
    bare = {f"{path.relative_to(ROOT)}: {name}" for path in (*FILES, *others) for name in imported_modules(path)
            if name.partition(".")[0] in BARE}
    assert bare == set()


def reads_a_clock(node):
    if isinstance(node, ast.Import):
        return any(alias.name == "time" for alias in node.names)
    return isinstance(node, ast.ImportFrom) and node.module in ("time", "datetime")


def test_only_one_file_reads_a_clock():
    """Doors may time themselves, and so may the world's survey, which prints what the world costs; an importer of
    dated tables reads dates, no clock."""
    readers = {str(path.relative_to(ROOT)) for path in FILES
               if "cli" not in path.relative_to(ROOT).parts
               and any(map(reads_a_clock, ast.walk(ast.parse(path.read_text(encoding="utf-8")))))}
    assert readers == {str(Path("hw/real/clock.py")), str(Path("proof/truearc_proof/world/survey.py")),
                       str(Path("proof/truearc_proof/importers/set_points.py"))}


@pytest.mark.parametrize("module", ["robot.run_robot", "session.replay_session", "robot.vision_tools.measure",
                                    "robot.doctor_checks", "robot.deploy", "robot.sysid", "robot.sysid_drive",
                                    "session.recover", "session.convert_formats", "start.completion"])
def test_the_robots_own_commands_need_only_the_base_install(module):
    """Imported in a process in which the heavy packages do not exist."""
    code = (f"import sys\nfor name in {HEAVY!r}: sys.modules[name] = None\n"
            f"import truearc.cli.{module}")
    run(sys.executable, "-c", code)


def test_no_registry_host_or_machine_path_in_the_tree():
    tracked = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True).stdout.split()
    if not tracked:
        pytest.skip("not a git checkout")
    forbidden = ("/work" + "/main", "/root" + "/", "/simple" + "/")
    for name in tracked:
        text = (ROOT / name).read_bytes()
        assert not any(word.encode() in text for word in forbidden), name
