"""The exported file against NumPy, onnx's own checker, the gate that has to load it, and its verification."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxruntime
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from onnx.reference import ReferenceEvaluator
from scipy.spatial import cKDTree

from truearc.api.results import Table
from truearc.errors import InputError
from truearc.model_export import NETWORK_TOLERANCE
from truearc.model_export.graph import export_weights, load_trained, make_model, network_part, novelty_part
from truearc.model_export.verify import HEADER, compare, domain_grid, features_of, find_faults, rate_shots
from truearc.robot import gate as contract
from truearc.robot.gate import KEY_SEAL, OUTPUT, Gate, load_gate
from truearc.robot.gate import NOVELTY as NOVELTY_OUTPUT
from truearc.sim.data.dataset import Shots
from truearc.sim.gate.model import describe_novelty, fit_novelty, novelty_record
from truearc.sim.paper.network import Layers, Network, initial_layers, load_weights, save_weights, weights_hash

DOMAIN = {"distance_m": [1.5, 9.0], "motor_ratio": [0.3, 0.9], "hood_deg": [20.0, 70.0]}
LOW, HIGH = np.array(list(DOMAIN.values())).T
NOVELTY = fit_novelty(np.random.default_rng(2).uniform(LOW, HIGH, (80, 3)))
RECORD = {"domain": DOMAIN, "novelty": novelty_record(NOVELTY), "seed": 11, "real_sha256": "ab",
          "curve": [[1, 0.5, 0.6, 0.7]]}


def make_network(seed: int, spread: float = 1.0) -> Network:
    rng = np.random.default_rng(seed)
    layers = Layers(*(spread * rng.normal(size=part.shape) for part in initial_layers(rng)))
    return Network(np.float32([5.0, 0.6, 45.0]).astype(float), np.float32([0.5, 6.0, 0.1]).astype(float), layers)


def make_bytes(network: Network) -> bytes:
    return make_model([network_part(network), novelty_part(NOVELTY)], DOMAIN, describe_novelty(NOVELTY), {})


def by_hand(network: Network, features: np.ndarray) -> np.ndarray:
    z = (features - network.mean) * network.scale
    hidden = 1.0 / (1.0 + np.exp(-(z @ network.layers.hidden_w + network.layers.hidden_b)))
    return 1.0 / (1.0 + np.exp(-(hidden @ network.layers.out_w + network.layers.out_b)))


def by_tree(features: np.ndarray) -> np.ndarray:
    """Novelty by SciPy's tree."""
    z = (features.astype(float) - NOVELTY.mean) * NOVELTY.scale
    return cKDTree(NOVELTY.landmarks).query(z, k=[NOVELTY.neighbour])[0][:, 0] / NOVELTY.largest


@settings(deadline=None)         # the first call loads the runtime
@given(st.integers(0, 2**32))
def test_three_engines_agree(seed: int) -> None:
    network = make_network(seed, spread=3.0)
    data = make_bytes(network)
    features = np.random.default_rng(seed).uniform([1.5, 0.3, 20.0], [9.0, 0.9, 70.0], (50, 3)).astype(np.float32)
    wanted = by_hand(network, features.astype(float))
    reference, far = ReferenceEvaluator(onnx.load_from_string(data)).run(None, {"features": features})
    session = onnxruntime.InferenceSession(data, providers=["CPUExecutionProvider"])
    found, novelty = session.run(["p", "novelty"], {"features": features})
    assert novelty.dtype == np.float32 and novelty.shape == (50, 1)
    assert np.abs(novelty - far).max() < 1e-4
    assert np.abs(novelty[:, 0] - by_tree(features)).max() < 1e-4
    assert found.dtype == np.float32 and found.shape == (50, 2)
    assert np.abs(found - wanted).max() < 1e-5
    assert np.abs(reference - wanted).max() < 1e-5


def test_the_gate_takes_it_and_finds_contract_domain_and_provenance(tmp_path: Path) -> None:
    save_weights(tmp_path / "w", make_network(1), RECORD)
    export_weights(tmp_path / "w", tmp_path / "gate.onnx")
    gate = load_gate(tmp_path / "gate.onnx")
    assert gate.domain == ((1.5, 9.0), (0.3, 0.9), (20.0, 70.0))
    assert gate.provenance == {"schema": "truearc.training/1", "seed": 11, "real_sha256": "ab",
                               "weights_sha256": weights_hash(tmp_path / "w")}
    model = onnx.load(tmp_path / "gate.onnx")
    metadata = {entry.key: entry.value for entry in model.metadata_props}
    assert json.loads(metadata[contract.KEY_CONTRACT])["outputs"] == ["p_two", "p_three"]
    assert set(metadata) == {contract.KEY_CONTRACT, contract.KEY_CONTRACT_HASH, contract.KEY_DOMAIN,
                             contract.KEY_NOVELTY, contract.KEY_PROVENANCE, KEY_SEAL}
    assert json.loads(metadata[contract.KEY_CONTRACT])["validity"]["limit"] == 1.0
    assert json.loads(metadata[contract.KEY_NOVELTY])["k"] == NOVELTY.neighbour
    assert {entry.name for entry in model.graph.initializer if entry.data_type != onnx.TensorProto.FLOAT} == {
        "known_k", "known_last"}


def test_columns_are_in_the_order_of_the_contract(tmp_path: Path) -> None:
    """A network that looks at one feature only answers to that argument only."""
    for place in range(3):
        network = make_network(0)
        network.layers.hidden_w[[k for k in range(3) if k != place]] = 0.0
        path = tmp_path / "gate.onnx"
        path.write_bytes(make_bytes(network))
        rate = load_gate(path).rate
        base = {"distance_m": 4.0, "motor_ratio": 0.5, "hood_deg": 40.0}
        changed = [rate(**base)[:2] != rate(**(base | {feature.name: base[feature.name] * 1.2}))[:2]
                   for feature in contract.FEATURES]
        assert changed == [k == place for k in range(3)]


def test_bad_weights_and_bad_places_are_named(tmp_path: Path) -> None:
    save_weights(tmp_path / "w", make_network(1), RECORD)
    save_weights(tmp_path / "old", make_network(1), {key: RECORD[key] for key in RECORD if key != "novelty"})
    with pytest.raises(InputError, match=r"training\.json: key 'novelty'"):
        export_weights(tmp_path / "old", tmp_path / "gate.onnx")
    with pytest.raises(InputError, match="nowhere"):
        export_weights(tmp_path / "w", tmp_path / "nowhere" / "gate.onnx")


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


# --- rows of predictions, character by character

class Halves:
    """p_two = distance / 10, p_three = ratio / 2, novelty = 1 / distance; no number at all beyond 45 degrees."""

    def run(self, outputs: tuple[str, ...], inputs: dict[str, np.ndarray]) -> list[np.ndarray]:
        features = inputs["features"]
        p = np.column_stack([features[:, 0] / 10, features[:, 1] / 2]).astype(np.float32)
        p[features[:, 2] > 45.0] = np.nan
        return [p, 1.0 / features[:, :1]]


GATE = Gate(Halves(), ((1.0, 6.0), (0.0, 1.0), (0.0, 90.0)), "", {})


def make_ratings(gate: Gate, shots: Shots, name: str) -> str:
    return Table(HEADER, tuple(rate_shots(gate, shots, name))).to_csv()


def make_shots(**columns: list[float]) -> Shots:
    numbers = {"distance_m": [5.0, 7.5, 2.5], "motor_ratio": [0.5, 0.25, 1.0], "hood_deg": [30.0, 40.0, 50.0]}
    return Shots(("a", "b,c", "d"), {name: np.array(values) for name, values in (numbers | columns).items()}, {})


def test_rows_to_the_letter() -> None:
    assert make_ratings(GATE, make_shots(distance_m=[4.0, 8.0, 2.0]), "DIR") == (
        'shot_id,p_two,p_three,in_domain,novelty\na,0.4000000059604645,0.25,true,0.25\n"b,c",0.800000011920929,0.125,false,0.125\nd,,,false,\n')


def test_missing_features_are_named_with_their_shots() -> None:
    with pytest.raises(InputError, match=r"DIR: column hood_deg: no value for shot_id b,c$"):
        make_ratings(GATE, make_shots(hood_deg=[30.0, np.nan, 50.0]), "DIR")
    many = Shots(tuple("abcdefgh"), {"distance_m": np.ones(8), "hood_deg": np.ones(8)}, {})
    with pytest.raises(InputError, match="column motor_ratio: no value for shot_id a, b, c, d, e and 3 more"):
        features_of(many, "DIR")
