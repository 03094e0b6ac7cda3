"""Whose recordings can be read: name, the files it takes, and the function that reads them."""

from collections.abc import Callable
from dataclasses import dataclass

from sim.importers.ball_drops import import_ball_drops
from sim.importers.exit_speeds import import_971, import_fuel
from sim.importers.mpi import import_mpi
from sim.importers.set_points import import_254, import_2910, import_3476
from sim.shots import Dataset


@dataclass(frozen=True)
class Importer:
    name: str
    files: tuple[str, ...]            # what they are, in the order given
    load: Callable[..., Dataset]


IMPORTERS = (
    Importer("mpi", ("LAUNCHES.csv", "TRACKS.csv"), import_mpi),
    Importer("ball-drops", ("DROPS.csv",), import_ball_drops),
    Importer("frc-254", ("TABLES.csv or Constants.java",), import_254),
    Importer("frc-2910", ("TABLES.csv",), import_2910),
    Importer("frc-3476", ("HISTORY.csv or shooterconfig.json",), import_3476),
    Importer("frc-971", ("SPEEDS.csv or constants.cc",), import_971),
    Importer("fuel", ("SPEEDS.csv",), import_fuel),
)
