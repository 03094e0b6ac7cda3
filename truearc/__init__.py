"""Aim a ball launcher, forecast its shots, and find the physics that its simulation lacks.

    import truearc as ta
    week = ta.load_dataset("data/week")
    found = ta.discover(week, seed=0)
    print(found)

Every name is imported when it is first used: `import truearc` itself loads no NumPy and no JAX.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from truearc.api import paper
    from truearc.api.aiming import AimTable, aim, export_aim, verify_aim
    from truearc.api.discovery import Finding, discover
    from truearc.api.fitting import Fit, fit
    from truearc.api.following import Following, follow
    from truearc.api.gate import GateTraining, train_gate
    from truearc.api.planning import Identifiability, ShotDesign, design_shots, identifiability
    from truearc.api.prediction import predict
    from truearc.api.recording import Recording
    from truearc.api.table import Table
    from truearc.model_export.graph import export_weights
    from truearc.model_export.verify import verify_gate
    from truearc.robot.config.rig_spec import Rig
    from truearc.robot.config.schema import InputError, load_config
    from truearc.sim.data.dataset import Dataset, dataset, load_dataset, load_rig, save_dataset
    from truearc.sim.data.recordings import shots_from_sessions
    from truearc.sim.discover.finding import load_finding
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
    from truearc.sim.world.emulated_robot import emulate

    __version__: str

__all__ = [
    "AimTable", "AirTerm", "ArrivalTerm", "Belief", "Dataset", "Finding", "Fit", "FlightTerm", "Following",
    "GateTraining", "Identifiability", "InputError", "LaunchTerm", "Parameter", "Prior", "Recording", "Rig",
    "SensingTerm", "ShotDesign", "Table", "WatchTerm", "aim", "catalogue", "dataset", "design_shots", "discover",
    "emulate", "export_aim", "export_weights", "fit", "follow", "identifiability", "load_belief", "load_config",
    "load_dataset", "load_finding", "load_rig", "paper", "predict", "save_dataset", "shots_from_sessions",
    "train_gate", "verify_aim",
    "verify_gate",
]

# module -> the names that are imported from it when they are first used
_NAMES = {
    "truearc.api": "paper",
    "truearc.api.aiming": "AimTable aim export_aim verify_aim",
    "truearc.api.discovery": "Finding discover",
    "truearc.api.fitting": "Fit fit",
    "truearc.api.following": "Following follow",
    "truearc.api.gate": "GateTraining train_gate",
    "truearc.api.planning": "Identifiability ShotDesign design_shots identifiability",
    "truearc.api.prediction": "predict",
    "truearc.api.recording": "Recording",
    "truearc.api.table": "Table",
    "truearc.model_export.graph": "export_weights",
    "truearc.model_export.verify": "verify_gate",
    "truearc.sim.data.recordings": "shots_from_sessions",
    "truearc.sim.physics.catalogue": "catalogue",
    "truearc.sim.world.emulated_robot": "emulate",
    "truearc.robot.config.rig_spec": "Rig",
    "truearc.robot.config.schema": "InputError load_config",
    "truearc.sim.data.dataset": "Dataset dataset load_dataset load_rig save_dataset",
    "truearc.sim.discover.finding": "load_finding",
    "truearc.sim.infer.belief": "Belief load_belief",
    "truearc.sim.physics.term": "AirTerm ArrivalTerm FlightTerm LaunchTerm Parameter Prior SensingTerm WatchTerm",
}
_MODULES = {name: module for module, names in _NAMES.items() for name in names.split()}


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version
        value: Any = version("truearc")
    elif name in _MODULES:
        module = _MODULES[name]
        value = import_module(f"{module}.{name}") if name == "paper" else getattr(import_module(module), name)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, "__version__"})
