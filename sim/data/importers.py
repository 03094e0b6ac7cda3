"""Importers of foreign recordings, which are registered as entry points of the group `truearc.importers`."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import TYPE_CHECKING

from truearc.errors import InputError, PluginError, load_plugin, place_of

if TYPE_CHECKING:
    from truearc.sim.data.dataset import Dataset
    from truearc.sim.data.log import Log

GROUP = "truearc.importers"
KINDS = {".csv": (".csv", ".parquet")} # of a name in `ways`: what a file may end in, where it is not just that


@dataclass(frozen=True)
class Importer:
    name: str
    ways: tuple[str, ...]             # files in order; `...`: the one before it, any number of times
    load: "Callable[..., Dataset] | None"             # None: of any team's files, under a map of their keys
    # one of any team's logs, given what is called with the share of it that is read; None: they are CSV
    read: "Callable[[Path, Callable[[float], None]], Log] | None" = None

    def takes(self, files: Sequence[str]) -> bool:
        """Return whether these files match one of its forms, by number and kind."""
        return any(_fits(way.split(), files) for way in self.ways)


def _fits(names: list[str], files: Sequence[str]) -> bool:
    if names[-1] == "...":
        names = names[:-1] + names[-2:-1] * (len(files) - len(names) + 1)
    return len(names) == len(files) and all(map(_is_kind, names, files))


def _is_kind(name: str, file: str) -> bool:
    suffix = Path(name).suffix
    return Path(file).suffix.lower() in KINDS.get(suffix, (suffix,))


CSV = Importer("csv", ("FILE.csv ...", "FILE.txt ...", "FILE.xlsx ..."), None)


@cache
def load_importers() -> tuple[Importer, ...]:
    """Return every installed importer, sorted by name.

    An entry point of the group `truearc.importers` names an `Importer`.

    Raises:
        InputError: an entry point cannot be loaded, or is not an `Importer`; the message names its distribution.
    """
    installed = [_load(point) for point in entry_points(group=GROUP)]
    return tuple(sorted((CSV, *installed), key=lambda importer: importer.name))


def _load(point: EntryPoint) -> Importer:
    try:
        importer = load_plugin(point)
    except PluginError as error:
        raise InputError(str(error)) from error
    if not isinstance(importer, Importer):
        raise InputError(f"{place_of(point)} is not an Importer")
    return importer
