"""The check of a release: wheels and source distributions are built, installed into empty environments and tried.

Usage: python tools/release_check.py [--pythons PYTHON,...] [--only TEXT]      (`make release-check`)

For each Python from 3.11 to 3.13 that is found, the base install, truearc-frc and [sim] are installed with the newest
versions of their dependencies, and then together with the lowest permitted versions that have a wheel for that Python.
Each environment replays, bit for bit, a session recorded in the first [sim] environment. Finally, it checks that the
dependencies have wheels for Windows, macOS and the robot's aarch64, without installing them. The exit code is 1 if a
check fails.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tomllib
import venv
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
HOME = ROOT / "build" / "release"
VERSIONS = ("3.11", "3.12", "3.13")
UV = HOME / "tools" / "bin" / "uv"
# of uv's names: what a wheel must run on; which parts have wheels there: [sim], truearc-frc
PLATFORMS = {"x86_64-pc-windows-msvc": "sim,frc", "aarch64-apple-darwin": "sim,frc", "x86_64-manylinux_2_35": "sim,frc",
             "aarch64-manylinux_2_35": "sim,frc", "aarch64-manylinux_2_31": "sim"}
READ_LOG = ("import truearc_frc.wpilog, truearc_frc.keys, ntcore; "
            "ntcore.NetworkTableInstance.create().startClient4('truearc')")
IMPORTS = "import truearc, truearc.robot.tick, truearc.hw.codec, importlib.metadata as m; print(m.version('truearc'))"


class Place(NamedTuple):
    """An environment to make: a Python, parts of truearc, and which versions of the dependencies."""

    python: str
    version: str
    extras: str
    lowest: bool

    @property
    def name(self) -> str:
        return f"{self.version}-{self.extras.replace(',', '-') or 'base'}-{'lowest' if self.lowest else 'newest'}"


def main() -> int:
    """Make and try every environment; print a line for each, and return 1 where one failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pythons", default="", help="interpreters, instead of all that are found")
    parser.add_argument("--only", default="", help="environments whose name has this text")
    args = parser.parse_args()
    shutil.rmtree(HOME, ignore_errors=True)
    venv.create(HOME / "tools", with_pip=True)
    _run(HOME / "tools" / "bin" / "python", "-m", "pip", "install", "--quiet", "uv>=0.9,<1")
    dist = build()
    pythons = find_pythons(args.pythons.split(",") if args.pythons else [])
    absent = [version for version in VERSIONS if version not in pythons]
    print(f"Pythons: {', '.join(pythons)}" + (f"; not found here: {', '.join(absent)}" if absent else ""), flush=True)
    failed = [place.name for place in places(pythons) if args.only in place.name and not _passes(place, dist)]
    failed += [] if args.only else [name for name in PLATFORMS if not has_wheels(name)]
    print(f"{len(failed)} failed: {', '.join(failed)}" if failed else "all passed")
    return bool(failed) or not pythons


def build() -> Path:
    """Build all distributions from what git has at HEAD: a source distribution, and a wheel from that."""
    source = HOME / "source"
    source.mkdir()
    archive = subprocess.run(["git", "archive", "HEAD"], cwd=ROOT, capture_output=True, check=True).stdout
    subprocess.run(["tar", "-x"], cwd=source, input=archive, check=True)
    for folder in (source, source / "proof", source / "frc"):
        _run(UV, "build", "--quiet", "--out-dir", HOME / "dist", folder)
    print("built: " + ", ".join(sorted(path.name for path in (HOME / "dist").glob("truearc*"))), flush=True)
    return HOME / "dist"


def find_pythons(named: list[str]) -> dict[str, str]:
    """Interpreters by version: those named, or those on the PATH and of pyenv that start."""
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    found: dict[str, str] = {}
    for one in named or [str(path) for version in VERSIONS
                         for path in (f"python{version}", *sorted(pyenv.glob(f"{version}.*/bin/python{version}")))]:
        done = subprocess.run([one, "-c", "import sys, venv; print('%d.%d' % sys.version_info[:2])"],
                              capture_output=True, text=True, check=False) if shutil.which(one) else None
        if done is not None and done.returncode == 0 and done.stdout.strip() in VERSIONS:
            found.setdefault(done.stdout.strip(), one)
    return found


def places(pythons: dict[str, str]) -> Iterator[Place]:
    """Environments, [sim] first: it records the session that the others replay."""
    for version, python in pythons.items():
        for extras, lowest in (("sim", False), ("", False), ("frc", False), ("sim,frc", True)):
            yield Place(python, version, extras, lowest)


def has_wheels(platform: str) -> bool:
    """Whether every dependency has a wheel for a platform, for the first and last Python; prints what is missing."""
    answers = [subprocess.run([UV, "pip", "compile", "--quiet", "--only-binary", ":all:", "--python-platform", platform,
                               "--python-version", version, "-"], input="\n".join(needed(PLATFORMS[platform])),
                              capture_output=True, text=True, check=False) for version in (VERSIONS[0], VERSIONS[-1])]
    missing = [answer.stderr.strip() for answer in answers if answer.returncode]
    print(f"{'FAILED' if missing else 'ok':8s} wheels for {platform} [{PLATFORMS[platform]}]", *missing, flush=True)
    return not missing


def needed(extras: str) -> list[str]:
    """Requirements of the base install and these parts of truearc."""
    own, frc = (tomllib.loads((ROOT / folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]
                for folder in (".", "frc"))
    return [*own["dependencies"], *(own["optional-dependencies"]["sim"] if "sim" in extras else ()),
            *(one for one in frc["dependencies"] if "frc" in extras and one != "truearc")]


def _passes(place: Place, dist: Path) -> bool:
    home = HOME / place.name
    try:
        _install(place, home, dist)
        _try(place, home)
    except subprocess.CalledProcessError as error:
        print(f"FAILED   {place.name}: {' '.join(map(str, error.cmd))}\n{(error.stdout or '')[-3000:]}", flush=True)
        return False
    shutil.rmtree(home)
    print(f"ok       {place.name}", flush=True)
    return True


def _install(place: Place, home: Path, dist: Path) -> None:
    """Into an empty environment; its interpreter fetches nothing of its own."""
    _run(UV, "venv", "--quiet", "--no-python-downloads", "--python", place.python, home)
    install = (UV, "pip", "install", "--quiet", "--only-binary", ":all:", "--python", home / "bin" / "python")
    wheel, proof, frc = (next(dist.glob(f"{name}-*.whl")) for name in ("truearc", "truearc_proof", "truearc_frc"))
    others = [*([proof] if place.extras == "sim" else []), *([frc] if "frc" in place.extras else [])]
    if place.lowest:
        _run(*install, "--resolution", "lowest-direct", *needed(place.extras))
        _run(*install, "--no-deps", wheel, *others)
    else:
        _run(*install, f"{wheel}[sim]" if "sim" in place.extras else wheel, *others)


def _try(place: Place, home: Path) -> None:
    python, truearc = home / "bin" / "python", home / "bin" / "truearc"
    stated = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    said = _run(python, "-I", "-c", IMPORTS, cwd=home).strip()
    if said != stated:
        raise subprocess.CalledProcessError(1, ["truearc", "--version"], f"{said} instead of {stated}")
    _run(truearc, "--help", cwd=home)
    session = HOME / "session"
    if "sim" in place.extras:
        shutil.copytree(HOME / "source" / "examples" / "spreadsheet", home / "week")
        _run(truearc, "fit", "week", "--terms", "gravity,drag", "-o", "belief.toml", cwd=home)
        _run(truearc, "emulate", "--trials", "1", "--seed", "3", "--page", "off", "--out", "own", cwd=home)
        if not session.exists():
            shutil.copytree(home / "own", session)
        if not place.lowest:
            _run(truearc, "prove", "--help", cwd=home)
    _run(truearc, "session", "replay", session, "--check", cwd=home)
    if "frc" in place.extras:
        _run(python, "-I", "-c", READ_LOG, cwd=home)


def _run(*command: str | Path, cwd: Path = ROOT) -> str:
    """Return a command's output; CalledProcessError with its output where it fails."""
    return subprocess.run(command, cwd=cwd, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=True,
                          env={**os.environ, "PYTHONPATH": "", "PYTHONSAFEPATH": "1"}).stdout


if __name__ == "__main__":
    sys.exit(main())
