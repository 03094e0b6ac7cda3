"""A fitted gate in a weights directory: physics.json, which its probabilities follow from, beside training.json."""

from pathlib import Path
from typing import Any

import msgspec

from truearc.robot.config.rig_spec import Rig
from truearc.robot.config.schema import InputError
from truearc.sim.gate.fit import GateFit
from truearc.sim.gate.likelihood import SIZE, Widths
from truearc.sim.gate.model import PhysicsGate, Scaling
from truearc.sim.gate.novelty import finite_array, novelty_record, parse_novelty
from truearc.sim.infer.belief import as_table, from_table
from truearc.sim.paper.network import RECORD_FILE, as_json, load_json, load_record, save_with_record

MODEL_FILE = "physics.json"
MODEL_SCHEMA = "truearc.physics-gate/1"
KIND = "physics"


def save_physics_gate(directory: str | Path, gate: PhysicsGate, record: dict[str, Any]) -> None:
    """Write physics.json and training.json; the same gate and record give the same bytes.

    InputError when the directory cannot be written.
    """
    text = as_json(MODEL_SCHEMA, _plain(gate))
    save_with_record(directory, {**record, "kind": KIND, "novelty": novelty_record(gate.novelty)},
                     lambda folder: (folder / MODEL_FILE).write_text(text, encoding="utf-8"))


def load_physics_gate(directory: str | Path) -> tuple[PhysicsGate, dict[str, Any]]:
    """Read what save_physics_gate wrote; InputError names the file and what is wrong with it."""
    path = Path(directory) / MODEL_FILE
    record = load_record(Path(directory) / RECORD_FILE)
    table = load_json(path, MODEL_SCHEMA)
    novelty = parse_novelty(record.get("novelty"), str(Path(directory) / RECORD_FILE))
    try:
        gate = PhysicsGate(msgspec.convert(table["facts"], Rig), from_table(table["belief"], str(path)),
                           Scaling(*(finite_array(table["scaling"][name], (3,)) for name in
                                     ("mean", "deviation", "low", "high"))), _fit(table["fit"]),
                           float(table["temperature"]), float(table["aside"]), novelty)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"{path}: not a gate ({error!r})") from error
    return gate, record


def _plain(gate: PhysicsGate) -> dict[str, Any]:
    fit = gate.fit
    return {
        "facts": msgspec.to_builtins(gate.rig),
        "belief": as_table(gate.belief),
        "scaling": {name: getattr(gate.scaling, name).tolist() for name in ("mean", "deviation", "low", "high")},
        "fit": {"height_m": float(fit.widths.height_m), "speed": float(fit.widths.speed), "theta": fit.theta.tolist(),
                "covariance": fit.covariance.tolist(), "evidence": fit.evidence},
        "temperature": gate.temperature, "aside": gate.aside}


def _fit(table: dict[str, Any]) -> GateFit:
    return GateFit(Widths(float(table["height_m"]), float(table["speed"])), finite_array(table["theta"], (SIZE,)),
               finite_array(table["covariance"], (SIZE, SIZE)), float(table["evidence"]))
