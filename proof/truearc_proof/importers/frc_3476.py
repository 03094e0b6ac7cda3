"""Team 3476's own `shooterconfig.json`, one version or all that a git clone has -> the tables of set_points."""

import subprocess
from pathlib import Path

from truearc.errors import InputError
from truearc.sim.data.table import Problems, RawTable, load_table, text_of
from truearc_proof.importers.originals import INCH_M, json_rows, part, scaled

FILE = "src/main/deploy/shooter/shooterconfig.json"
NO_DATE = "2021-01-01T00:00:00+00:00" # of a file without one: all its set points are of one moment


def load_3476(path: Path, problems: Problems) -> list[RawTable]:
    """Dated versions: in one CSV, or one after the other out of a clone's history; a JSON file has no date."""
    if path.is_dir():
        return _history(path)
    if path.suffix == ".json":
        return [_version(text_of(path), path, path.stem, NO_DATE)]
    return [load_table(path, problems)]


def _version(text: str, path: Path, commit: str, when: str) -> RawTable:
    found = json_rows(text, path, "shooterConfigs", ("distance", "hoodEjectAngle", "flywheelSpeed"))
    count = len(found.lines)
    return RawTable(path, {"commit": [commit] * count, "committed_at": [when] * count,
                        "distance_m": scaled(found.columns["distance"], INCH_M),
                        "hood_eject_angle_deg": found.columns["hoodEjectAngle"],
                        "flywheel_rpm": found.columns["flywheelSpeed"]}, found.lines)


def _history(clone: Path) -> list[RawTable]:
    """Return the versions, newest first, in the order of git; a commit that removed the file is left out."""
    if _git(clone, "rev-parse", "--is-shallow-repository").strip() == "true":
        raise InputError(f"{clone}: is a shallow clone, without the older versions: git -C {clone} fetch --unshallow")
    log = _git(clone, "-c", "log.showSignature=false", "log", "--abbrev=7", "--format=%h %cI", "--", FILE)
    dated = [line.split() for line in log.splitlines()]
    tables = [_version(_git(clone, "show", f"{commit}:{FILE}"), part(clone, f"{Path(FILE).name} of {commit}"),
                       commit, when)
              for commit, when in dated if _git(clone, "ls-tree", commit, "--", FILE)]
    if not tables:
        raise InputError(f"{clone}: its history has no {FILE} (the clone's top folder is wanted)")
    return tables


def _git(clone: Path, *words: str) -> str:
    try:
        done = subprocess.run(("git", "-C", str(clone), *words), capture_output=True, encoding="utf-8",
                              errors="replace", check=False)
    except FileNotFoundError as error:
        raise InputError(f"{clone}: reading a clone's history needs git, which is not installed here") from error
    if done.returncode:
        raise InputError(f"{clone}: {done.stderr.strip() or 'git says no'}")
    return done.stdout
