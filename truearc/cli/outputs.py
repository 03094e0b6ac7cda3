"""One rule for what commands write: an output that exists is refused, and `--force` replaces it.

The `type=` of an option says that it is an output. Recorded sessions and rounds of proof have rules of their own: they
are never replaced.
"""

import argparse
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from truearc.errors import InputError, check_file

DATASET = ("rig.toml", "shots.csv", "tracks.csv", "times.csv", "traces.csv", "left_out.txt", "shots.toml")
WEIGHTS = ("weights.npz", "physics.json", "training.json")
ADVICE = "name another, or replace it with --force"


def out_file(text: str) -> Path:
    """Return the path of a file to write; refuse it before any work where its directory is missing."""
    path = Path(text)
    if not path.resolve().parent.is_dir():
        raise argparse.ArgumentTypeError(f"{text}: there is no such directory to write to")
    return path


@dataclass(frozen=True)
class OutFolder:
    """The `type=` of an option that names a folder to write.

    names: what the command writes into it; a folder that holds anything else is not replaced.
    mark: a file that shows that the command made the folder, with whatever is in it; empty where `names` decide.
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
            elif path is not None and isinstance(action.type, OutFolder) and _is_used(path):
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


def _is_used(folder: Path) -> bool:
    return folder.exists() and (not folder.is_dir() or any(folder.iterdir()))


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
