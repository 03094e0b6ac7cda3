"""What ships: all that git tracks, imports in one direction, and commands that work outside the checkout."""

import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

from truearc.robot.deploy import copy_source

ROOT = Path(__file__).parents[2]
# code that imports truearc from the unpacked wheels alone
ALONE = ("import sys; sys.meta_path[:] = [one for one in sys.meta_path if 'editable' not in repr(one).lower()]; "
         "sys.path[:] = [{site!r}] + [one for one in sys.path if one]; ")
LINT = ALONE + "from importlinter.cli import lint_imports_command; lint_imports_command()"
CYCLES = ALONE + ("import graphlib, grimp; "
                  "graph = grimp.build_graph('truearc', 'truearc_proof', 'truearc_frc', cache_dir=None); "
                  "graphlib.TopologicalSorter({{one: graph.find_modules_directly_imported_by(one) "
                  "for one in graph.modules}}).prepare()")
PLACES = {"truearc": "truearc", "hw": "truearc/hw", "robot": "truearc/robot", "sim": "truearc/sim",
          "model_export": "truearc/model_export", "proof/truearc_proof": "truearc_proof",
          "frc/truearc_frc": "truearc_frc"}


def build_wheels(folder: Path) -> Path:
    """Build all wheels and unpack them side by side; returns the folder that holds the packages."""
    source = copy_source(ROOT, folder / "source")
    ignore = shutil.ignore_patterns("__pycache__", "*.egg-info", "build")
    others = [shutil.copytree(ROOT / name, source / name, ignore=ignore) for name in ("proof", "frc")]
    done = subprocess.run([sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation",
                           "--wheel-dir", str(folder), str(source), *map(str, others)],
                          capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    site = folder / "site"
    for wheel in folder.glob("*.whl"):
        with zipfile.ZipFile(wheel) as archive:
            archive.extractall(site)
    return site


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_wheels(tmp_path_factory.mktemp("wheels"))


def tracked() -> set[str]:
    """Files that the wheels should hold, by git."""
    done = subprocess.run(["git", "ls-files", *PLACES], cwd=ROOT, capture_output=True, text=True, check=False)
    names = done.stdout.split()
    if not names:
        pytest.skip("not a git checkout")
    return {to + name.removeprefix(folder) for name in names for folder, to in PLACES.items()
            if name.startswith(folder + "/") and (ROOT / name).exists()}


def test_wheels_hold_what_git_tracks(site: Path) -> None:
    held = {path.relative_to(site).as_posix() for path in site.rglob("*") if path.is_file()}
    assert {name for name in held if ".dist-info/" not in name} == tracked()


def test_source_distribution_holds_what_git_tracks(tmp_path: Path) -> None:
    """All but settings of tools, whose names begin with a dot."""
    done = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False)
    names = {name for name in done.stdout.splitlines() if (ROOT / name).exists()}
    if not names:
        pytest.skip("not a git checkout")
    for name in names:
        (tmp_path / "source" / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / name, tmp_path / "source" / name)
    code = f"from setuptools import build_meta; build_meta.build_sdist({str(tmp_path)!r})"
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path / "source", capture_output=True, check=True)
    with tarfile.open(next(tmp_path.glob("*.tar.gz"))) as archive:
        held = {name.partition("/")[2] for name in archive.getnames()}
    assert {name for name in names - held if not name.startswith(".")} == set()


def test_version_is_the_same_everywhere() -> None:
    text = {name: (ROOT / name).read_text(encoding="utf-8") for name in ("CITATION.cff", "CHANGELOG.md", "README.md")}
    (version,) = {tomllib.loads((ROOT / name / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
                  for name in (".", "proof", "frc")}
    released = re.search(r"^date-released: (\S+)$", text["CITATION.cff"], re.MULTILINE)
    assert released is not None and f"## {version} - {released[1]}" in text["CHANGELOG.md"]
    assert f"\nversion: {version}\n" in text["CITATION.cff"] and f"Version {version}." in text["README.md"]


def test_import_directions(site: Path) -> None:
    """On the unpacked wheels: the linter does not follow the links of build/view."""
    run_python(site, LINT.format(site=str(site)), "--no-cache", "--config", str(ROOT / "pyproject.toml"))


def test_no_modules_import_each_other(site: Path) -> None:
    """Not even inside a function: graphlib.CycleError names the modules."""
    run_python(site, CYCLES.format(site=str(site)))


def run_python(folder: Path, code: str, *words: str) -> str:
    """Python with this code in a folder; what it printed."""
    done = subprocess.run([sys.executable, "-c", code, *words], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def run(site: Path, folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """A command from the unpacked wheel, without the checkout on the path."""
    paths = [str(site), *(path for path in sys.path if "site-packages" in path)]
    code = ("import sys; sys.meta_path[:] = [f for f in sys.meta_path if 'editable' not in repr(f).lower()]; "
            f"sys.path[:0] = {paths!r}; from truearc.cli.main import main; sys.exit(main({list(words)!r}))")
    return subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=False,
                          env={**os.environ, "PYTHONSAFEPATH": "1"})


def test_import_works_beside_a_robot_py(site: Path, tmp_path: Path) -> None:
    (tmp_path / "robot.py").write_text("raise SystemExit('the wrong robot')")
    code = ALONE.replace("if one", "") + "import truearc, truearc.robot.tick; print(truearc.__file__)"
    assert run_python(tmp_path, code.format(site=str(site))).startswith(str(site))


def test_doctor_and_emulate_run_from_the_wheel(site: Path, tmp_path: Path) -> None:
    done = run(site, tmp_path, "emulate", "--trials", "1", "--out", "session", "--page", "off", "--quiet")
    assert done.returncode == 0 and (tmp_path / "session" / "telemetry.mcap").exists(), done.stderr
    done = run(site, tmp_path, "doctor", "--help")
    assert done.returncode == 0, done.stderr


def test_operators_page_is_whole_in_the_wheel(site: Path, tmp_path: Path) -> None:
    code = "from truearc.robot.operator_ui.server import make_page; print(make_page(False))"
    page = run_python(tmp_path, ALONE.format(site=str(site)) + code)
    assert "data-robot" in page and "const whatIf" in page and "<!--" not in page
