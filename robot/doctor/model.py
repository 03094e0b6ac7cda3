"""The gate's model."""

from pathlib import Path

from truearc.hw.finding import Finding, failure, ok
from truearc.robot.config.schema import GateConfig, InputError
from truearc.robot.gate.contract import FEATURES
from truearc.robot.gate.model import load_gate

CHECK = "gate model"


def check_model(gate: GateConfig, path: Path | None) -> Finding:
    """Whether the model that the policy asks for is there, whole, and made for this robot's contract."""
    if path is None:
        if gate.policy == "model":
            return failure(CHECK, "gate.policy is 'model' and no model was given", "give --gate, as to `truearc run`")
        return ok(CHECK, f"none is needed: gate.policy is {gate.policy!r}")
    try:
        model = load_gate(path)
    except InputError as error:
        return failure(CHECK, str(error), "export it again with this version of truearc, and copy it whole")
    domain = ", ".join(f"{feature.name} {low:g} to {high:g}"
                       for feature, (low, high) in zip(FEATURES, model.domain, strict=True))
    return ok(CHECK, f"sha256 {model.sha256[:12]}, this robot's contract; speaks of {domain}")
