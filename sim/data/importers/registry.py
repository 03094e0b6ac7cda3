"""Whose recordings can be read: name, the files it takes, and the function that reads them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from truearc_proof.importers.ball_drops import import_ball_drops
from truearc_proof.importers.exit_speeds import import_971, import_fuel
from truearc_proof.importers.mpi import import_mpi
from truearc_proof.importers.set_points import import_254, import_2910, import_3476
from truearc.sim.data.dataset import Dataset

KINDS = {".csv": (".csv", ".parquet")} # of a name in `ways`: what a file may end in, where it is not just that


@dataclass(frozen=True)
class Importer:
    name: str
    ways: tuple[str, ...]             # files in order; `...`: the one before it, any number of times; `/`: a folder
    load: Callable[..., Dataset]

    def takes(self, files: Sequence[str]) -> bool:
        """Whether these are the files of one of its ways, by number and kind."""
        return any(_fits(way.split(), files) for way in self.ways)


def _fits(names: list[str], files: Sequence[str]) -> bool:
    if names[-1] == "...":
        names = names[:-1] + names[-2:-1] * (len(files) - len(names) + 1)
    return len(names) == len(files) and all(map(_is_kind, names, files))


def _is_kind(name: str, file: str) -> bool:
    if name.endswith("/"):
        return Path(file).is_dir()
    suffix = Path(name).suffix
    return Path(file).suffix.lower() in KINDS.get(suffix, (suffix,))


IMPORTERS = (
    Importer("mpi", ("RECORDING.hdf5 ...", "LAUNCHES.csv TRACKS.csv"), import_mpi),
    Importer("ball-drops", ("Ball_drops_data.xls balls.txt", "DROPS.csv"), import_ball_drops),
    Importer("frc-254", ("Constants.java", "TABLES.csv"), import_254),
    Importer("frc-2910", ("TargetWithShooterCommand.java", "TABLES.csv"), import_2910),
    Importer("frc-3476", ("CLONE/", "shooterconfig.json", "HISTORY.csv"), import_3476),
    Importer("frc-971", ("constants.cc", "SPEEDS.csv"), import_971),
    Importer("fuel", ("shooter.py", "SPEEDS.csv"), import_fuel),
)
