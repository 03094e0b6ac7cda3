"""Weights to a stamped ONNX file: standardise, Gemm and Sigmoid twice, float32."""

import json
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from robot.config import BadInput
from robot.gate.contract import (
    FEATURES,
    INPUT,
    KEY_CONTRACT,
    KEY_CONTRACT_HASH,
    KEY_DOMAIN,
    KEY_PROVENANCE,
    OUTPUT,
    OUTPUTS,
    contract_hash,
    contract_json,
)
from robot.gate.seal import KEY_SEAL, UNSEALED, seal
from sim.network import Network, load_weights, weights_hash

OPSET = 17                            # old enough for every onnxruntime in use, new enough for all that is used here
IR_VERSION = 8                        # the one that came with opset 17


def make_model(network: Network, domain: dict[str, list[float]], provenance: dict[str, Any]) -> bytes:
    """ONNX bytes of a network: `features` float32 [n, 3] in, `p` float32 [n, 2] (p_two, p_three) out.

    `domain` is {feature: [low, high]} in the contract's units. The contract, its hash, the domain, the provenance and
    the file's own seal stand in the metadata. The same arguments give the same bytes. Nothing forces p_three <= p_two:
    the seed's network does not either, and is exported as trained.
    """
    graph = helper.make_graph(
        [helper.make_node("Sub", [INPUT, "mean"], ["centred"]),
         helper.make_node("Mul", ["centred", "scale"], ["standardised"]),
         helper.make_node("Gemm", ["standardised", "hidden_w", "hidden_b"], ["hidden_z"]),
         helper.make_node("Sigmoid", ["hidden_z"], ["hidden"]),
         helper.make_node("Gemm", ["hidden", "out_w", "out_b"], ["out_z"]),
         helper.make_node("Sigmoid", ["out_z"], [OUTPUT])],
        "truearc_gate",
        [helper.make_tensor_value_info(INPUT, TensorProto.FLOAT, ["n", len(FEATURES)])],
        [helper.make_tensor_value_info(OUTPUT, TensorProto.FLOAT, ["n", len(OUTPUTS)])],
        [numpy_helper.from_array(np.asarray(array, np.float32), name) for name, array in _arrays(network)])
    model = helper.make_model(graph, producer_name="truearc", producer_version=version("truearc"),
                              opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR_VERSION)
    helper.set_model_props(model, {
        KEY_CONTRACT: contract_json().decode(), KEY_CONTRACT_HASH: contract_hash(),
        KEY_DOMAIN: _canonical(domain), KEY_PROVENANCE: _canonical(provenance), KEY_SEAL: UNSEALED})
    onnx.checker.check_model(model, full_check=True)
    return seal(model.SerializeToString(deterministic=True))


def export_weights(directory: str | Path, path: str | Path) -> bytes:
    """Write the ONNX file of a weights directory and return its bytes; BadInput when the directory is unusable.

    The provenance is the training record without its loss curve, plus the SHA-256 of the directory.
    """
    network, record = load_weights(directory)
    provenance = {key: value for key, value in record.items() if key not in ("curve", "domain")}
    provenance["weights_sha256"] = weights_hash(directory)
    data = make_model(network, record["domain"], provenance)
    try:
        Path(path).write_bytes(data)
    except OSError as error:
        raise BadInput(f"{path}: {error.strerror or error}") from error
    return data


def _arrays(network: Network) -> list[tuple[str, np.ndarray]]:
    return [("mean", network.mean), ("scale", network.scale), *network.layers._asdict().items()]


def _canonical(value: dict[str, Any]) -> str:
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)
