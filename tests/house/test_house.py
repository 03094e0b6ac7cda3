"""The rules of ARCHITECTURE.md, one test a rule: style, types, sizes, imports, clocks."""

import ast
import re
import subprocess
import sys
import tomllib
from functools import cache
from pathlib import Path

import pytest

from tests.conftest import LONG

ROOT = Path(__file__).parents[2]
TOPS = ("hw", "robot", "sim", "model_export", "truearc", "proof", "frc")
FILES = sorted(path for top in TOPS for path in (ROOT / top).rglob("*.py"))
BARE = ("hw", "robot", "sim", "model_export")
HEAVY = ("jax", "mujoco", "onnx", "scipy", "matplotlib", "pyarrow", "joblib", "rich")


def run(*command, cwd=ROOT):
    done = subprocess.run(command, cwd=cwd, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_ruff():
    run(sys.executable, "-m", "ruff", "check", ".")


@pytest.mark.slow    # a minute where nothing is cached; pre-commit and `make test-long` run it
def test_mypy():
    assert (ROOT / "build" / "view" / "truearc").is_dir(), "run `make setup`, which makes build/view for mypy"
    run(sys.executable, "-m", "mypy")


@cache
def trees():
    """(path from the root, syntax tree) of every file of the product."""
    return [(path.relative_to(ROOT).as_posix(), ast.parse(path.read_text(encoding="utf-8"))) for path in FILES]


def test_every_test_is_run_by_one_of_two_commands():
    """`make test` and `make test-long` select by one mark, and tests/conftest.py marks tests that exist."""
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    selected = re.findall(r"^(\S+): setup\n\t.*-m pytest -m (.*)$", makefile, re.MULTILINE)
    assert selected == [("test", '"not slow"'), ("test-long", "slow")]
    assert [place for place in LONG if not (ROOT / place.partition("::")[0]).exists()] == []
    assert "make test\n" in (ROOT / ".ci" / "run").read_text("utf-8").replace("make test-long", "")


def test_mutants_are_made_of_files_that_exist_and_build_the_allow_list():
    """Frames that may be sent are decided where `make mutants` looks: not in a family's other modules."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["mutmut"]
    mutated = {ROOT / name.removeprefix("truearc/") for name in settings["only_mutate"]}
    assert {path for path in mutated if not path.is_file()} == set()
    assert {path for path in (ROOT / "hw").rglob("*.py")
            if re.search(r"\ballow(_seldom)?\(", path.read_text("utf-8"))} - mutated == set()


def imported_modules(tree):
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module


def test_everything_is_imported_through_truearc():
    """From the checkout's root `import robot` works, too, and would make a second copy of every class."""
    others = [path for folder in ("tests", "benchmarks", "tools", "examples") for path in (ROOT / folder).rglob("*.py")]
    bare = {f"{path}: {name}" for path, tree in (
        *trees(), *((str(path), ast.parse(path.read_text(encoding="utf-8"))) for path in others))
        for name in imported_modules(tree) if name.partition(".")[0] in BARE}
    assert bare == set()


def test_only_one_file_reads_a_clock():
    """Commands may time themselves; an importer of dated tables reads dates, no clock."""
    readers = {path for path, tree in trees()
               if "/cli/" not in path and {"time", "datetime"} & set(imported_modules(tree))}
    assert readers == {"hw/real/clock.py", "proof/truearc_proof/importers/set_points.py"}


@pytest.mark.parametrize("module", ["main", "robot", "run_robot", "doctor_checks", "deploy", "session", "session_work",
                                    "vision_images"])
def test_the_robots_own_commands_need_only_the_base_install(module):
    """Imported in a process in which the heavy packages do not exist."""
    code = (f"import sys\nfor name in {HEAVY!r}: sys.modules[name] = None\n" f"import truearc.cli.{module}")
    run(sys.executable, "-c", code)


def test_no_registry_host_or_machine_path_in_the_tree():
    tracked = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True).stdout.split()
    if not tracked:
        pytest.skip("not a git checkout")
    forbidden = ("/work" + "/main", "/root" + "/", "/simple" + "/")
    for name in tracked:
        text = (ROOT / name).read_bytes()
        assert not any(word.encode() in text for word in forbidden), name
