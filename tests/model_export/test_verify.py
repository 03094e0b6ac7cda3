"""Verification must fail where it should: other weights, other numbers, a runtime that is not a function."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from truearc.model_export.graph import export_weights, load_trained
from truearc.model_export.tolerances import NETWORK_TOLERANCE
from truearc.model_export.verify import compare, domain_grid, find_faults
from truearc.robot.gate import NOVELTY as NOVELTY_OUTPUT
from truearc.robot.gate import OUTPUT, Gate, load_gate
from truearc.sim.gate.model import fit_novelty, novelty_record
from truearc.sim.paper.network import Layers, Network, initial_layers, load_weights, save_weights

DOMAIN = {"distance_m": [1.5, 9.0], "motor_ratio": [0.3, 0.9], "hood_deg": [20.0, 70.0]}

LOW, HIGH = np.array(list(DOMAIN.values())).T
NOVELTY = fit_novelty(np.random.default_rng(2).uniform(LOW, HIGH, (80, 3)))
RECORD = {"domain": DOMAIN, "novelty": novelty_record(NOVELTY)}


def make_network(seed: int) -> Network:
    rng = np.random.default_rng(seed)
    layers = Layers(*(3.0 * rng.normal(size=part.shape) for part in initial_layers(rng)))
    return Network(np.float32([5.0, 0.6, 45.0]).astype(float), np.float32([0.5, 6.0, 0.1]).astype(float), layers)


@pytest.fixture
def exported(tmp_path: Path) -> tuple[Gate, Path]:
    save_weights(tmp_path / "w", make_network(1), RECORD)
    export_weights(tmp_path / "w", tmp_path / "gate.onnx")
    return load_gate(tmp_path / "gate.onnx"), tmp_path / "w"


def test_a_faithful_export_passes(exported: tuple[Gate, Path]) -> None:
    gate, weights = exported
    trained = load_trained(weights)
    grid = domain_grid(gate)
    assert grid.shape == (31**3, 3)
    assert grid.min(axis=0).tolist() == [1.5, 0.3, 20.0] and grid.max(axis=0).tolist() == [9.0, 0.9, 70.0]
    result = compare(gate, trained, grid)
    assert result.passed and result.rows == 31**3 and 0.0 < result.worst < NETWORK_TOLERANCE
    assert 0.0 < result.novelty < 1e-3
    assert find_faults(gate, grid) == []
    assert gate.provenance["weights_sha256"] == trained.sha256


def test_a_slightly_different_network_does_not(exported: tuple[Gate, Path], tmp_path: Path) -> None:
    gate, weights = exported
    network, record = load_weights(weights)
    network.layers.out_b[1] += 1e-3
    save_weights(tmp_path / "other", network, record)
    other = load_trained(tmp_path / "other")
    result = compare(gate, other, domain_grid(gate))
    # the logistic curve is steepest at 1/4
    assert not result.passed and result.worst == pytest.approx(0.25e-3, rel=0.1)
    assert gate.provenance["weights_sha256"] != other.sha256


def test_another_novelty_does_not(exported: tuple[Gate, Path]) -> None:
    gate, weights = exported
    trained = load_trained(weights)
    wider = replace(trained, novelty=replace(trained.novelty, largest=1.02 * trained.novelty.largest))
    result = compare(gate, wider, domain_grid(gate))
    assert not result.passed and result.worst < NETWORK_TOLERANCE and result.novelty == pytest.approx(0.02, rel=0.1)


def test_class_flips_are_counted(exported: tuple[Gate, Path], tmp_path: Path) -> None:
    gate, weights = exported
    network, record = load_weights(weights)
    network.layers.out_w[:] *= -1.0
    network.layers.out_b[:] *= -1.0                                     # p becomes 1 - p: every class flips
    save_weights(tmp_path / "other", network, record)
    other = load_trained(tmp_path / "other")
    result = compare(gate, other, domain_grid(gate))
    assert result.flips == result.rows and not result.passed


class Session:
    """A runtime that misbehaves: what it answers depends on the number of rows, or on how often it was asked."""

    def __init__(self, how: str) -> None:
        self.how, self.calls = how, 0

    def run(self, outputs: tuple[str, ...], inputs: dict[str, Any]) -> list[np.ndarray]:
        assert outputs == (OUTPUT, NOVELTY_OUTPUT)
        self.calls += 1
        rows = len(inputs["features"])
        p = np.full((rows, 2), 0.25, np.float32)
        if self.how == "batch":
            p += 0.01 * (rows > 1)
        if self.how == "forgetful":
            p += 1e-7 * self.calls
        if self.how == "nan":
            p[-1, 1] = np.nan
        return [p, np.full((rows, 1), 0.5 + 0.01 * (self.how == "drifting") * self.calls, np.float32)]


@pytest.mark.parametrize(("how", "words"), [
    ("sound", None), ("batch", "rated alone and rated together"), ("forgetful", "rated twice"),
    ("drifting", "rated twice"),
    ("nan", "1 of 125 rows get no probability")])
def test_a_runtime_that_is_not_a_function_is_found_out(how: str, words: str | None) -> None:
    gate = Gate(Session(how), ((1.0, 2.0), (0.1, 0.2), (10.0, 20.0)), "", {})
    faults = find_faults(gate, domain_grid(gate, 5))
    assert (faults == []) if words is None else any(words in fault for fault in faults)


def test_a_gate_without_numbers_cannot_pass_a_comparison(exported: tuple[Gate, Path]) -> None:
    trained = load_trained(exported[1])
    gate = Gate(Session("nan"), ((1.0, 2.0), (0.1, 0.2), (10.0, 20.0)), "", {})
    assert not compare(gate, trained, domain_grid(gate, 3)).passed
