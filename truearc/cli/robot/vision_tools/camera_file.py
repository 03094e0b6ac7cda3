"""Camera files, packaged cameras and tables of measured distances; loads no image library."""

import csv
import io
import re
from pathlib import Path

from truearc.cli.common import SHIPPED
from truearc.errors import InputError, load_text, naming, number_in
from truearc.robot.config.limits import warn_of_pitch
from truearc.robot.config.schema import CameraFile, Config, load_toml

CAMERAS = SHIPPED.parent / "cameras"


def load_camera(name: str | None) -> CameraFile:
    """The camera, tape and vision sections of a file, of a packaged camera, or of the packaged launcher.toml."""
    path = SHIPPED if name is None else Path(name)
    if name in packaged_cameras():
        path = CAMERAS / f"{name}.toml"
    is_launcher = re.search(r"^\s*\[gate\]", load_text(path), re.MULTILINE) is not None
    file = load_toml(path, Config) if is_launcher else load_toml(path, CameraFile)
    if file.camera.target == "apriltag" and file.apriltag is None:
        raise InputError(f"{path}: camera.target: an AprilTag is to be seen, and there is no [apriltag]")
    warn_of_pitch(path, file.camera)
    return CameraFile(file.camera, file.tape, file.vision, file.apriltag)


def packaged_cameras() -> list[str]:
    """Return the names of the cameras that come with the package."""
    return sorted(path.stem for path in CAMERAS.glob("*.toml"))


def load_labels(path: str, columns: tuple[str, ...] = ("label_distance_m",)) -> dict[str, float]:
    """File name -> distance, from the first of these columns that is there; rows without a distance are left out."""
    labels: dict[str, float] = {}
    with naming(path):
        rows = csv.DictReader(io.StringIO(load_text(path).removeprefix("\ufeff"), newline=""))
        names = rows.fieldnames or ()
        column = next((name for name in columns if name in names), None)
        if column is None or "file" not in names:
            raise InputError(f"{path}:1: missing column {columns[0] if 'file' in names else 'file'!r}")
        for row in rows:
            if None in row:           # a comma too many, such as a decimal one
                raise InputError(f"{path}:{rows.line_num}: more cells than columns: is a decimal point a comma?")
            if row[column]:
                labels[row["file"]] = distance_m = number_in(row[column])
                if not 0.0 < distance_m < 1e4:
                    raise InputError(f"{path}:{rows.line_num}: {column}: {row[column]!r} is not a distance in metres")
    return labels
