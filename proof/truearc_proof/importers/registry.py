"""The registry of the importers for public data sets that this distribution adds to truearc.

The importers' modules are imported only when a file is read, not when `truearc import --help` lists them.
"""

from collections.abc import Callable
from importlib import import_module
from typing import Any

from truearc.sim.data.importers import Importer


def _later(module: str, name: str) -> Callable[..., Any]:
    """A function that imports `name` from a module of this folder when it is called."""
    def load(*files: str) -> Any:
        return getattr(import_module(f"truearc_proof.importers.{module}"), name)(*files)
    return load


MPI = Importer("mpi", ("RECORDING.hdf5 ...", "LAUNCHES.csv TRACKS.csv"), _later("mpi", "import_mpi"))
BALL_BUTLER = Importer("ball-butler", ("RECORDING.json", "FLIGHTS.csv"),
                       _later("ball_butler", "import_ball_butler"))
BALL_DROPS = Importer("ball-drops", ("DROPS.csv",), _later("ball_drops", "import_ball_drops"))
FRC_254 = Importer("frc-254", ("Constants.java", "TABLES.csv"), _later("set_points", "import_254"))
FRC_2910 = Importer("frc-2910", ("TargetWithShooterCommand.java", "TABLES.csv"), _later("set_points", "import_2910"))
FRC_3476 = Importer("frc-3476", ("shooterconfig.json", "HISTORY.csv"), _later("set_points", "import_3476"))
FRC_971 = Importer("frc-971", ("constants.cc", "SPEEDS.csv"), _later("set_points", "import_971"))
FTC_DECODE = Importer("ftc-decode", ("SHOTS.csv",), _later("real_shots", "import_ftc_decode"))
FUEL_CLIPS = Importer("fuel-clips", ("SHOTS.csv",), _later("real_shots", "import_fuel_clips"))
SEPIA_DROPS = Importer("sepia-drops", ("TIMES.dat HEIGHTS.height RADII.radii", "DROPS.txt"),
                       _later("ball_drops", "import_sepia_drops"))
