"""What ships: every tracked module and data file, one top-level name, and commands that work outside the checkout."""

import os
import shutil
import subprocess
import sys
import tarfile
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.house.wheels import ROOT, build_wheels

PLACES = {"truearc": "truearc", "hw": "truearc/hw", "robot": "truearc/robot", "sim": "truearc/sim",
          "model_export": "truearc/model_export", "proof/truearc_proof": "truearc_proof",
          "frc/truearc_frc": "truearc_frc"}


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


def test_wheel_has_one_top_level_name(site: Path) -> None:
    names = {path.name for path in site.iterdir() if not path.name.endswith(".dist-info")}
    assert names == {"truearc", "truearc_proof", "truearc_frc"}


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


def run(site: Path, folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """A command from the unpacked wheel, without the checkout on the path."""
    paths = [str(site), *(path for path in sys.path if "site-packages" in path)]
    code = ("import sys; sys.meta_path[:] = [f for f in sys.meta_path if 'editable' not in repr(f).lower()]; "
            f"sys.path[:0] = {paths!r}; from truearc.cli.main import main; sys.exit(main({list(words)!r}))")
    return subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=False,
                          env={**os.environ, "PYTHONSAFEPATH": "1"})


def test_import_works_beside_a_robot_py(site: Path, tmp_path: Path) -> None:
    (tmp_path / "robot.py").write_text("raise SystemExit('the wrong robot')")
    code = (f"import sys; sys.meta_path[:] = [f for f in sys.meta_path if 'editable' not in repr(f).lower()]; "
            f"sys.path.insert(1, {str(site)!r}); import truearc, truearc.robot.tick; print(truearc.__file__)")
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and done.stdout.startswith(str(site)), done.stderr


def test_doctor_and_emulate_run_from_the_wheel(site: Path, tmp_path: Path) -> None:
    done = run(site, tmp_path, "emulate", "--trials", "1", "--out", "session", "--page", "off", "--quiet")
    assert done.returncode == 0 and (tmp_path / "session" / "telemetry.mcap").exists(), done.stderr
    done = run(site, tmp_path, "doctor", "--help")
    assert done.returncode == 0, done.stderr


def test_operators_page_is_whole_in_the_wheel(site: Path, tmp_path: Path) -> None:
    paths = [str(site), *(path for path in sys.path if "site-packages" in path)]
    code = ("import sys; sys.meta_path[:] = [f for f in sys.meta_path if 'editable' not in repr(f).lower()]; "
            f"sys.path[:0] = {paths!r}; from truearc.robot.operator_ui.server import make_page; "
            "print(make_page(False))")
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert "data-robot" in done.stdout and "const whatIf" in done.stdout and "<!--" not in done.stdout, done.stderr


def test_a_packaged_camera_and_the_tuning_page_come_out_of_the_wheel(site: Path, tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "dark.png"), np.zeros((480, 640, 3), np.uint8))
    done = run(site, tmp_path, "vision", "dark.png", "--camera", "lifecam_hd3000_480p")
    assert done.returncode == 0 and done.stdout.splitlines()[1].startswith("dark.png,false"), done.stderr
    page = (ROOT / "truearc" / "cli" / "robot" / "pages" / "tune.html").read_text(encoding="utf-8")
    paths = [str(site), *(path for path in sys.path if "site-packages" in path)]
    code = ("import sys; sys.meta_path[:] = [f for f in sys.meta_path if 'editable' not in repr(f).lower()]; "
            f"sys.path[:0] = {paths!r}; from importlib.resources import files; "
            "print((files('truearc.cli.robot') / 'pages' / 'tune.html').read_text(encoding='utf-8'))")
    shown = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert shown.stdout.strip() == page.strip(), shown.stderr
