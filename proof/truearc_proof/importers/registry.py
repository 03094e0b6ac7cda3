"""The importers of particular public data sets that this distribution registers with truearc."""

from truearc.sim.data.importers.registry import Importer
from truearc_proof.importers.ball_drops import import_ball_drops
from truearc_proof.importers.exit_speeds import import_971, import_fuel
from truearc_proof.importers.mpi import import_mpi
from truearc_proof.importers.set_points import import_254, import_2910, import_3476

MPI = Importer("mpi", ("RECORDING.hdf5 ...", "LAUNCHES.csv TRACKS.csv"), import_mpi)
BALL_DROPS = Importer("ball-drops", ("Ball_drops_data.xls balls.txt", "DROPS.csv"), import_ball_drops)
FRC_254 = Importer("frc-254", ("Constants.java", "TABLES.csv"), import_254)
FRC_2910 = Importer("frc-2910", ("TargetWithShooterCommand.java", "TABLES.csv"), import_2910)
FRC_3476 = Importer("frc-3476", ("CLONE/", "shooterconfig.json", "HISTORY.csv"), import_3476)
FRC_971 = Importer("frc-971", ("constants.cc", "SPEEDS.csv"), import_971)
FUEL = Importer("fuel", ("shooter.py", "SPEEDS.csv"), import_fuel)
