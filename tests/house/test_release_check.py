"""What `make release-check` would make of this machine; the check itself needs a package index and some minutes."""

import sys
import tomllib
from pathlib import Path

from packaging.requirements import Requirement

from tools.release_check import VERSIONS, find_pythons, needed, places

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def test_pythons_that_do_not_start_are_left_out(tmp_path: Path) -> None:
    broken = tmp_path / "python3.12"
    broken.write_text("#!/bin/sh\nexit 127\n", encoding="utf-8")
    broken.chmod(0o755)
    here = f"{sys.version_info.major}.{sys.version_info.minor}"
    assert find_pythons([str(broken), str(tmp_path / "none"), sys.executable]) == {here: sys.executable}


def test_each_python_has_every_install_and_the_first_one_records() -> None:
    made = list(places({"3.11": "a", "3.13": "b"}))
    assert len({place.name for place in made}) == len(made) == 8 and made[0].name == "3.11-sim-newest"
    assert {(place.extras, place.lowest) for place in made} == {("sim", False), ("", False), ("frc", False),
                                                               ("sim,frc", True)}


def test_stated_pythons_are_those_that_are_tried() -> None:
    stated = {line.rpartition(" ")[2] for line in PROJECT["classifiers"] if "Python :: 3." in line}
    assert stated == set(VERSIONS) and PROJECT["requires-python"] == f">={VERSIONS[0]}"


def test_dependencies_state_a_lowest_and_a_first_untried_version() -> None:
    for one in map(Requirement, needed("sim,frc")):
        assert {bound.operator for bound in one.specifier} == {">=", "<"}, one.name
