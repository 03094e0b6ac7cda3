"""Conversion of trained weights of any kind to a float32 ONNX graph with provenance and seal in its metadata."""

import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import onnx
from onnx import NodeProto, TensorProto, helper, numpy_helper

from truearc.errors import naming, whole_file
from truearc.model_export import NETWORK_TOLERANCE, PHYSICS_TOLERANCE
from truearc.robot import gate as contract
from truearc.robot.gate import INPUT, KEY_SEAL, NOVELTY, OUTPUT, UNSEALED, load_gate, seal
from truearc.sim.gate import model as gates
from truearc.sim.gate.train import Domain, Surrogate, as_cosines, make_surrogate
from truearc.sim.paper.network import RECORD_FILE, Network, load_weights, probabilities, weights_hash

EDGES = 4                             # of the target: above and below, of two and of three


class Part(NamedTuple):
    """Nodes in order, and their constants by name; real numbers go out as float32, counts and positions as int64."""

    nodes: list[NodeProto]
    constants: dict[str, np.ndarray]


def network_part(network: Network) -> Part:
    """Return the nodes of the paper's network: standardise, Gemm and Sigmoid twice; `features` to `p`."""
    nodes = [helper.make_node("Sub", [INPUT, "mean"], ["centred"]),
             helper.make_node("Mul", ["centred", "scale"], ["standardised"]),
             helper.make_node("Gemm", ["standardised", "hidden_w", "hidden_b"], ["hidden_z"]),
             helper.make_node("Sigmoid", ["hidden_z"], ["hidden"]),
             helper.make_node("Gemm", ["hidden", "out_w", "out_b"], ["out_z"]),
             helper.make_node("Sigmoid", ["out_z"], [OUTPUT])]
    return Part(nodes, {"mean": network.mean, "scale": network.scale, **network.layers._asdict()})


def novelty_part(novelty: gates.Novelty) -> Part:
    """Return the nodes of the distance to the k-th nearest landmark over the largest known one; `features` to `novelty`
    [n, 1].

    |z - y|^2 is taken as |y|^2 - 2 z.y, of which the smallest are found, plus |z|^2: one matrix product a decision.
    """
    nodes = [helper.make_node("Gemm", [INPUT, "known_scale", "known_from"], ["known_z"]),
             helper.make_node("Gemm", ["known_z", "known_y", "known_y_squared"], ["known_apart"]),
             helper.make_node("TopK", ["known_apart", "known_k"], ["known_nearest", "known_which"], largest=0),
             helper.make_node("Gather", ["known_nearest", "known_last"], ["known_kth"], axis=1),
             helper.make_node("ReduceSumSquare", ["known_z"], ["known_own"], axes=[1], keepdims=1),
             helper.make_node("Add", ["known_kth", "known_own"], ["known_squared"]),
             helper.make_node("Relu", ["known_squared"], ["known_positive"]),
             helper.make_node("Sqrt", ["known_positive"], [NOVELTY])]
    landmarks, scale = novelty.landmarks / novelty.largest, novelty.scale / novelty.largest
    return Part(nodes, {
        "known_scale": np.diag(scale), "known_from": -novelty.mean * scale, "known_y": -2.0 * landmarks.T,
        "known_y_squared": (landmarks**2).sum(axis=1), "known_k": np.array([novelty.neighbour]),
        "known_last": np.array([novelty.neighbour - 1])})


def physics_part(surrogate: Surrogate, shape: gates.GateShape, aside: float) -> Part:
    """Return the nodes of the surrogate's mean and spread and the ordinal model's probabilities; `features` to `p`.

    Chebyshev polynomials as cos(k arccos u), their products as cosines of sums; no flight is integrated here. An
    outcome within a half-height has the probability (1 - lapse) (erf(above) - erf(below)) / 2 + its share of a lapse,
    and all that passes aside is a miss. Few nodes: at one row a decision each costs more than its arithmetic.
    """
    cosines = [helper.make_node("Gemm", [INPUT, "to_box", "from_middle"], ["box_free"]),
               helper.make_node("Clip", ["box_free", "minus_one", "one"], ["box_u"]),
               helper.make_node("Acos", ["box_u"], ["turn"]),
               helper.make_node("MatMul", ["turn", "frequencies"], ["turns"]),
               helper.make_node("Cos", ["turns"], ["cosines"])]
    divided = [helper.make_node("Gemm", ["cosines", "amplitudes", "edges_m"], ["apart_and_square"]),
               helper.make_node("Split", ["apart_and_square"], ["apart_m", "double_free_m2"], axis=1),
               helper.make_node("Max", ["double_free_m2", "double_least_m2"], ["double_m2"]),
               helper.make_node("Sqrt", ["double_m2"], ["spread_m"]),
               helper.make_node("Div", ["apart_m", "spread_m"], ["apart"])]
    direct = [helper.make_node("MatMul", ["cosines", "amplitudes"], ["apart"])]
    nodes = [*cosines, *(direct if surrogate.half_m else divided),
             helper.make_node("Erf", ["apart"], ["shares"]),
             helper.make_node("Gemm", ["shares", "within", "lapse_share"], ["free_p"]),
             helper.make_node("Clip", ["free_p", "zero", "one"], [OUTPUT])]
    constants = {**_polynomial_constants(surrogate, shape), **_outcome_constants(shape, aside)}
    used = {name for node in nodes for name in node.input}
    return Part(nodes, {name: value for name, value in constants.items() if name in used})


def _polynomial_constants(surrogate: Surrogate, shape: gates.GateShape) -> dict[str, np.ndarray]:
    """`amplitudes` [F, 8]: four times minus the mean, to which the edges are added; four times twice the variance.

    Of an opening that faces up [F, 4]: minus the passages of the edges, between those of the near and the far one.
    """
    frequencies, (mean_m, square_m2) = as_cosines(surrogate)
    amplitudes = np.stack([-mean_m] * EDGES + [2.0 * square_m2] * EDGES, axis=1)
    if surrogate.half_m:
        near, far = mean_m, square_m2
        shares = [0.5 * (1.0 - edge_m / surrogate.half_m)
                  for edge_m in (shape.two_m, shape.three_m, -shape.two_m, -shape.three_m)]
        amplitudes = np.stack([-(share * near + (1.0 - share) * far) for share in shares], axis=1) / np.sqrt(2.0)
    return {"to_box": np.diag(surrogate.per_half), "from_middle": -surrogate.middle * surrogate.per_half,
            "frequencies": frequencies.T.astype(float), "minus_one": np.array(-1.0), "one": np.array(1.0),
            "amplitudes": amplitudes, "double_least_m2": np.array(2.0 * surrogate.least_m2)}


def _outcome_constants(shape: gates.GateShape, aside: float) -> dict[str, np.ndarray]:
    """`within`: erf at (two, three, -two, -three) to the shares within two and within three."""
    half = 0.5 * (1.0 - aside) * (1.0 - shape.lapse) * np.eye(2)
    lapses = np.array([gates.LAPSE_CELLS[1:4].sum(), gates.LAPSE_CELLS[2]])
    edges_m = [shape.two_m, shape.three_m, -shape.two_m, -shape.three_m]
    return {"edges_m": np.array(edges_m + [0.0] * EDGES), "within": np.concatenate([half, -half]),
            "lapse_share": (1.0 - aside) * shape.lapse * lapses, "zero": np.array(0.0)}


OPSET = 17                            # old enough for every onnxruntime in use, new enough for all that is used here
IR_VERSION = 8                        # the one that came with opset 17
NAMED = 8                             # recorded shots outside a narrowed domain that are named
APART = ("curve", "domain", "novelty", "recorded")      # of the training record: not provenance


@dataclass(frozen=True)
class Trained:
    """`probabilities`: the trainer's own float64 p [n, 2] of features [n, 3]; `tolerance`: of the graph's p to it.

    `make_part` makes the nodes that give p, figures of their own for the provenance, and the domain over which they do;
    `sha256`: of the directory.
    """

    kind: str
    record: dict[str, Any]
    sha256: str
    probabilities: Callable[[np.ndarray], np.ndarray]
    make_part: Callable[[], tuple[Part, dict[str, Any], Domain]]
    novelty: gates.Novelty
    tolerance: float
    bounded: bool                     # the graph's p means something inside the domain only


def load_trained(directory: str | Path) -> Trained:
    """Load a weights directory; InputError names the file and what is wrong with it."""
    if (Path(directory) / gates.MODEL_FILE).is_file():
        return _physics(directory)
    network, record = load_weights(directory)
    novelty = gates.parse_novelty(record.get("novelty"), str(Path(directory) / RECORD_FILE))
    return Trained("network", record, weights_hash(directory), lambda features: probabilities(network, features),
                   lambda: (network_part(network), {}, record["domain"]), novelty, NETWORK_TOLERANCE, False)


def _physics(directory: str | Path) -> Trained:
    gate, record = gates.load_physics_gate(directory)

    def make_part() -> tuple[Part, dict[str, Any], Domain]:
        surrogate, errors, domain = make_surrogate(gate, record["domain"])
        return physics_part(surrogate, gate.shape, gate.aside), {"surrogate": {
            "degree": surrogate.degree, "mean_error_m": errors.mean_m, "p_error": errors.p}}, domain

    return Trained(gates.KIND, record, weights_hash(directory, gates.MODEL_FILE), gate.probabilities, make_part,
                   gate.novelty, PHYSICS_TOLERANCE, True)


def make_model(parts: Sequence[Part], domain: dict[str, list[float]], novelty: dict[str, Any],
               provenance: dict[str, Any]) -> bytes:
    """Return ONNX bytes: `features` float32 [n, 3] in, `p` [n, 2] (p_two, p_three) and `novelty` [n, 1] float32 out.

    `domain` is {feature: [low, high]} in the contract's units; `novelty` is what the second output is measured from.
    They, the contract, its hash, the provenance and the file's own seal stand in the metadata. The same arguments give
    the same bytes. Nothing forces p_three <= p_two in the paper's network: it is exported as trained.
    """
    constants = {name: array for part in parts for name, array in part.constants.items()}
    graph = helper.make_graph(
        [node for part in parts for node in part.nodes], "truearc_gate",
        [helper.make_tensor_value_info(contract.INPUT, TensorProto.FLOAT, ["n", len(contract.FEATURES)])],
        [helper.make_tensor_value_info(contract.OUTPUT, TensorProto.FLOAT, ["n", len(contract.OUTPUTS)]),
         helper.make_tensor_value_info(contract.NOVELTY, TensorProto.FLOAT, ["n", 1])],
        [numpy_helper.from_array(np.asarray(array, np.int64 if array.dtype.kind == "i" else np.float32), name)
         for name, array in constants.items()])
    model = helper.make_model(graph, producer_name="truearc", producer_version=version("truearc"),
                              opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR_VERSION)
    helper.set_model_props(model, {
        contract.KEY_CONTRACT: contract.contract_json().decode(), contract.KEY_CONTRACT_HASH: contract.contract_hash(),
        contract.KEY_DOMAIN: _canonical(domain), contract.KEY_NOVELTY: _canonical(novelty),
        contract.KEY_PROVENANCE: _canonical(provenance), KEY_SEAL: UNSEALED})
    onnx.checker.check_model(model, full_check=True)
    return seal(model.SerializeToString(deterministic=True))


def export_weights(directory: str | Path, path: str | Path) -> bytes:
    """Write the ONNX file of a weights directory and return its bytes; InputError if the directory is unusable.

    The provenance is the training record without its loss curve, plus the SHA-256 of the directory. InputError also if
    the graph cannot reproduce the trained model (see truearc.model_export.graph). A warning on stderr reports a domain
    narrowed for that purpose and the recorded shots outside it.
    """
    trained = load_trained(directory)
    provenance = {key: value for key, value in trained.record.items() if key not in APART}
    provenance["weights_sha256"] = trained.sha256
    part, more, domain = trained.make_part()
    provenance |= more
    if domain != trained.record["domain"]:
        print(f"warning: {path}: {say_narrowed(trained, domain)}", file=sys.stderr)
    data = make_model([part, novelty_part(trained.novelty)], domain,
                      gates.describe_novelty(trained.novelty), provenance)
    with naming(path), whole_file(path) as new:
        new.write_bytes(data)
        load_gate(new)                # what the robot would refuse is refused here
    return data


def say_narrowed(trained: Trained, domain: dict[str, list[float]]) -> str:
    """Report which recorded shots lie outside a domain over which the graph follows the physics."""
    known = trained.novelty           # weights of earlier versions do not say which shot had which settings
    recorded = trained.record.get("recorded") or dict(enumerate(known.landmarks / known.scale + known.mean, 1))
    low, high = np.array([domain[feature.name] for feature in contract.FEATURES]).T
    outside = [f"{name} ({row[0]:.2f} m, motor ratio {row[1]:.3f}, hood {row[2]:.1f} deg)"
               for name, row in recorded.items() if ((np.array(row) < low) | (np.array(row) > high)).any()]
    edges = ", ".join(f"{name} {edge[0]:.4g} to {edge[1]:.4g}" for name, edge in domain.items())
    return (f"the domain is narrowed to {edges}: beyond it no graph follows the physics closely; the robot holds "
            f"there. {len(outside)} of {len(recorded)} recorded shots lie outside"
            + (f": {'; '.join(outside[:NAMED])}" if outside else "") + ("; ..." if len(outside) > NAMED else ""))


def _canonical(value: dict[str, Any]) -> str:
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)
