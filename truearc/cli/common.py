"""The common parts of commands: option types, refusals, shared options and files, progress, and the rule for outputs.

A command refuses to replace an existing output unless `--force` is given. The `type=` of an option marks the option as
an output. Recorded sessions and proof rounds are never replaced.
"""

import argparse
import csv
import io
import math
import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from truearc import robot
from truearc.errors import InputError, check_file, load_text, naming, number_in, parse_table, save_whole
from truearc.hw.real.clock import wall_clock
from truearc.robot.config.limits import warn_of_pitch
from truearc.robot.config.rig_spec import Rig
from truearc.robot.config.schema import CameraFile, Config, load_config, load_toml
from truearc.sim.printed import Progress, show_progress

if TYPE_CHECKING:
    from truearc.sim.physics.catalogue import Catalogue
    from truearc.sim.report import Origin

SHIPPED = Path(robot.__file__).parent / "launcher.toml"
CAMERAS = SHIPPED.parent / "cameras"
Number = TypeVar("Number", int, float)
Kind = TypeVar("Kind")


def number(kind: type[Number], low: float = -math.inf, high: float = math.inf) -> Callable[[str], Number]:
    """Return the `type=` of an option that takes a finite number from `low` to `high`, both included."""
    least = "a finite number" if low == -math.inf else f"at least {low:g}"
    limits = least if high == math.inf else f"{low:g} to {high:g}"

    def parse(text: str) -> Number:
        try:
            value = kind(text)
        except ValueError as error:
            what, example = ("a whole number", max(0.0, low)) if kind is int else ("a number", max(0.5, low))
            raise argparse.ArgumentTypeError(f"{text!r} is not {what}; give one such as {example:g}") from error
        if not math.isfinite(value) or not low <= value <= high:
            raise argparse.ArgumentTypeError(f"got {text}; expected {limits}")
        return value

    return parse


def listed(kind: Callable[[str], Kind]) -> Callable[[str], tuple[Kind, ...]]:
    """Return the `type=` of an option that takes a comma-separated list of at least one item."""
    def parse(text: str) -> tuple[Kind, ...]:
        words = [word.strip() for word in text.split(",") if word.strip()]
        if not words:
            raise argparse.ArgumentTypeError(f"got {text!r}; expected at least one entry, separated by commas")
        if twice := sorted({word for word in words if words.count(word) > 1}):
            raise argparse.ArgumentTypeError(f"got {', '.join(twice)} more than once; keep one")
        return tuple(map(kind, words))

    return parse


def write_out(path: str | Path | None, text: str) -> None:
    """Write UTF-8 text unchanged; do nothing without a path.

    Raises:
        OSError: the file cannot be written, which the command line reports. An existing file is then left unchanged.
    """
    if path is not None:
        save_whole(path, text.encode())


def origin_of(args: argparse.Namespace) -> "Origin":
    """Return the time and the command line for the head of a report."""
    from truearc.sim.report import Origin  # loads Matplotlib
    return Origin(wall_clock(), getattr(args, "typed", ""))


def add_accept(parser: argparse.ArgumentParser) -> None:
    """Add the option that overrides a plausibility check by name."""
    parser.add_argument("--accept", action="append", default=[], metavar="CHECK", help="use the data although this "
                        "plausibility check objects; it is recorded; may be repeated")


def print_or_write(path: Path | None, text: str) -> None:
    """Write text to standard output, or to a file if one is named."""
    if path is None:
        sys.stdout.write(text if text.endswith("\n") else f"{text}\n")
    else:
        write_out(path, text)


def fixed(value: float | None, digits: int) -> str:
    """Return a cell with this number of decimals; empty for None."""
    return "" if value is None else f"{value:.{digits}f}"


def refuse(args: argparse.Namespace, options: tuple[str, ...], why: str) -> None:
    """Refuse options that do not apply in a mode of a command, so that none is ignored.

    Args:
        args: Parsed arguments; the options default to None, False or an empty list.
        options: As typed, such as `--tape-sigma`; the attribute of `args` follows from it.
        why: The rest of the message, such as `applies with --distances only`.

    Raises:
        InputError: One of the options was given; the message names it.
    """
    for option in options:
        given = getattr(args, option.lstrip("-").replace("-", "_"))
        if given is not None and given is not False and given != []:       # a given 0 is given
            raise InputError(f"{option}: {why}")


def add_terms_from(parser: argparse.ArgumentParser) -> None:
    """Add --terms-from, the user's own terms beside the catalogue's, to a command that names terms."""
    parser.add_argument("--terms-from", metavar="FILE.py", action="append",
                        help="Python file that defines further terms (docs/how-to/add-a-term.md); may be repeated")


def catalogue_of(args: argparse.Namespace) -> "Catalogue":
    """Return the built-in terms, those of installed distributions, and those of the files of --terms-from.

    Raises:
        InputError: names the file or distribution whose terms cannot be loaded, are incomplete, or have a taken name.
    """
    from truearc.sim.physics.catalogue import Catalogue, catalogue, terms_of_file
    known = catalogue()
    for path in args.terms_from or ():
        known = Catalogue((*known, *terms_of_file(path, known)))
    return known


def make_progress(what: str, quiet: bool = False) -> Progress:
    """Return a function of (share done 0-1, note) that shows how far `what` is; does nothing when quiet."""
    return show_progress(what, quiet)


def load_any_rig(path: str) -> Rig:
    """Load the rig of a rig.toml, or of a launcher.toml, which has it in a table [rig]."""
    try:
        is_launcher = "rig" in parse_table(load_text(path), path)
    except InputError:
        is_launcher = False           # the loader below names what is wrong
    from truearc.sim.data.files import load_rig, states_three
    if is_launcher:
        return load_config(path).rig
    rig = load_rig(path)
    if rig.target is not None and not rig.target.faces_up and not states_three(path):
        print(f"warning: {path}: target.three_half_height_m is not stated: {rig.target.three_half_height_m:g} is "
              "taken; write 0 where every hit counts alike", file=sys.stderr)
    return rig


def load_camera(name: str | None) -> CameraFile:
    """Load the camera, tape and vision sections of a file, of a packaged camera, or of the packaged launcher.toml."""
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
    """Load file name -> distance, from the first of these columns that exists; rows without a distance are omitted."""
    labels: dict[str, float] = {}
    with naming(path):
        rows = csv.DictReader(io.StringIO(load_text(path).removeprefix("\ufeff"), newline=""))
        names = rows.fieldnames or ()
        column = next((name for name in columns if name in names), None)
        if column is None or "file" not in names:
            raise InputError(f"{path}:1: missing column {columns[0] if 'file' in names else 'file'!r}; a row names a "
                             f"picture and its taped distance: file,{columns[0]}")
        for row in rows:
            if None in row:           # a comma too many, such as a decimal one
                raise InputError(f"{path}:{rows.line_num}: more cells than columns: is a decimal point a comma?")
            if row[column]:
                labels[row["file"]] = distance_m = number_in(row[column])
                if not 0.0 < distance_m < 1e4:
                    raise InputError(f"{path}:{rows.line_num}: {column}: {row[column]!r} is not a distance in metres")
    return labels


# --- outputs

DATASET = ("rig.toml", "shots.csv", "tracks.csv", "times.csv", "traces.csv", "left_out.txt", "imported.toml",
           "film.json", "shots.toml")
WEIGHTS = ("weights.npz", "physics.json", "training.json")
ADVICE = "name another, or replace it with --force"


def out_file(text: str) -> Path:
    """Return the path of a file to write; refuse it before any work if its directory is missing."""
    path = Path(text)
    if not path.resolve().parent.is_dir():
        raise argparse.ArgumentTypeError(f"{text}: there is no such directory to write to")
    return path


@dataclass(frozen=True)
class OutFolder:
    """The `type=` of an option that names a folder to write.

    names: what the command writes into it; a folder that contains anything else is not replaced.
    mark: a file that shows that the command made the folder, whatever it contains; empty if `names` decide.
    """

    names: tuple[str, ...] = ()
    mark: str = ""

    def __call__(self, text: str) -> Path:
        return Path(text)

    def foreign(self, folder: Path) -> list[str]:
        """Return what a folder holds that the command did not write, sorted."""
        found = sorted(path.name for path in folder.iterdir())
        return [] if self.mark in found else [name for name in found if name not in self.names]


def add_force(parser: argparse.ArgumentParser) -> None:
    """Add `--force` to a command that has outputs."""
    if any(action.type is out_file or isinstance(action.type, OutFolder) for action in parser._actions):
        parser.add_argument("--force", action="store_true", help="replace outputs that exist")


@contextmanager
def fresh_outputs(parser: argparse.ArgumentParser, args: argparse.Namespace) -> Iterator[None]:
    """Refuse outputs that exist; with `--force`, keep the folders to replace until the command is done.

    Raises:
        InputError: an output exists and `--force` is not given, or it is not the command's to replace; two outputs are
            one.
    """
    said: dict[Path, str] = {}
    with ExitStack() as folders:
        for action in parser._actions:
            path = getattr(args, action.dest, None)
            if path is not None and (action.type is out_file or isinstance(action.type, OutFolder)):
                option = action.option_strings[0] if action.option_strings else action.dest
                if (other := said.setdefault(path.resolve(), option)) != option and not path.is_char_device():
                    raise InputError(f"{other}, {option}: both write {path}; name two")
            if path is not None and action.type is out_file:
                refuse_file(path, args.force)
            elif (path is not None and isinstance(action.type, OutFolder) and path.exists()
                    and (not path.is_dir() or any(path.iterdir()))):
                _refuse_folder(path, action.type, args.force)
                folders.enter_context(_set_aside(path))
        yield


def refuse_file(path: Path, force: bool) -> None:
    """Refuse a file that exists, unless `force`, and what is neither a file nor a character device in any case."""
    if path.is_char_device():
        return
    check_file(path)
    if path.is_file() and not force:
        raise InputError(f"{path}: exists already; {ADVICE}")


def _refuse_folder(folder: Path, kind: OutFolder, force: bool) -> None:
    if not folder.is_dir():
        raise InputError(f"{folder}: is a file; name a folder")
    foreign = kind.foreign(folder)
    if foreign:
        raise InputError(f"{folder}: holds {foreign[0]}, which this command does not write; name another folder")
    if not force:
        raise InputError(f"{folder}: is not empty; {ADVICE}")


@contextmanager
def _set_aside(folder: Path) -> Iterator[None]:
    """Move a folder out of the way; it comes back where the command fails or makes no other."""
    with tempfile.TemporaryDirectory(dir=folder.resolve().parent, prefix=f".{folder.name}.") as beside:
        old = Path(beside) / "old"
        folder.rename(old)
        try:
            yield
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            raise
        finally:
            if not folder.exists():
                old.rename(folder)
