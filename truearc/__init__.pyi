# The public names, for static tools; truearc/__init__.py imports each from here when it is first used.
from truearc.api import paper
from truearc.api.discovery import Finding, Identifiability, ShotDesign, design_shots, discover, identifiability
from truearc.api.emulation import emulate
from truearc.api.fitting import Fit, Pooled, fit, pool
from truearc.api.following import Following, follow
from truearc.api.forecasting import AimTable, aim, export_aim, predict, verify_aim
from truearc.api.gate import GateTraining, train_gate
from truearc.api.results import Recording, Table, load_finding
from truearc.api.systems import SystemFinding, SystemFit, SystemIdentifiability
from truearc.errors import InputError
from truearc.model_export.graph import export_weights
from truearc.model_export.verify import verify_gate
from truearc.robot.config.rig_spec import Rig
from truearc.robot.config.schema import load_config
from truearc.sim.data.dataset import Dataset
from truearc.sim.data.files import dataset, load_dataset, load_rig, save_dataset
from truearc.sim.data.import_shots import import_shots
from truearc.sim.data.recordings import shots_from_sessions
from truearc.sim.infer.belief import Belief, load_belief
from truearc.sim.physics.catalogue import catalogue
from truearc.sim.physics.term import (
    AirTerm,
    ArrivalTerm,
    FlightTerm,
    LaunchTerm,
    Parameter,
    Prior,
    SensingTerm,
    WatchTerm,
)
from truearc.sim.systems.score_table import System
from truearc.sim.systems.system import Runs, effect, normal, positive

__all__ = [
    "AimTable", "AirTerm", "ArrivalTerm", "Belief", "Dataset", "Finding", "Fit", "FlightTerm", "Following",
    "GateTraining", "Identifiability", "InputError", "LaunchTerm", "Parameter", "Pooled", "Prior", "Recording",
    "Rig", "Runs", "SensingTerm", "ShotDesign", "System", "SystemFinding", "SystemFit", "SystemIdentifiability",
    "Table", "WatchTerm", "aim", "catalogue", "dataset", "design_shots", "discover", "effect", "emulate",
    "export_aim", "export_weights", "fit", "follow", "identifiability", "import_shots", "load_belief",
    "load_config", "load_dataset", "load_finding", "load_rig", "normal", "paper", "pool", "positive", "predict",
    "save_dataset", "shots_from_sessions", "train_gate", "verify_aim", "verify_gate",
]

__version__: str
