"""The gate's model: an ONNX file that carries its own contract, and one onnxruntime session over it."""

import hashlib
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt
import onnxruntime

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
from robot.gate.seal import KEY_SEAL, is_intact

Box = tuple[tuple[float, float], ...]             # (low, high) of each feature, in the contract's order


class Rating(NamedTuple):
    """What the model thinks of one configuration; both p are None when there is no number to be had."""

    p_two: float | None
    p_three: float | None
    in_domain: bool


LARGEST = float(np.finfo(np.float32).max)         # beyond this an input is infinite to the model
NO_RATING = Rating(None, None, False)


class Gate:
    """A loaded model. Made by load_gate only, which has checked all that can be checked before the first decision."""

    def __init__(self, session: Any, domain: Box, sha256: str, provenance: dict[str, Any]) -> None:
        self.domain = domain
        self.sha256 = sha256                      # of the file
        self.provenance = provenance
        self._run = session.run
        (self._d_low, self._d_high), (self._r_low, self._r_high), (self._h_low, self._h_high) = domain
        self._low = np.array([low for low, _ in domain])
        self._high = np.array([high for _, high in domain])

    def rate(self, distance_m: float, motor_ratio: float, hood_deg: float) -> Rating:
        """Rate one configuration: ball exit to target plane (m), motor speed / free speed, elevation (degrees).

        Outside the domain the p are still the model's, with in_domain False. A non-finite input or output gives no p.
        """
        # A NaN makes every comparison here false, so only real numbers reach the last line.
        if not (abs(distance_m) <= LARGEST and abs(motor_ratio) <= LARGEST and abs(hood_deg) <= LARGEST):
            return NO_RATING
        features = np.array(((distance_m, motor_ratio, hood_deg),), np.float32)
        p_two, p_three = self._run((OUTPUT,), {INPUT: features})[0][0].tolist()
        if not (0.0 <= p_two <= 1.0 and 0.0 <= p_three <= 1.0):
            return NO_RATING
        return Rating(p_two, p_three, self._d_low <= distance_m <= self._d_high
                      and self._r_low <= motor_ratio <= self._r_high and self._h_low <= hood_deg <= self._h_high)

    def rate_many(self, features: npt.NDArray[np.float64]) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.bool_]]:
        """As rate, of float64 rows [n, 3] in the contract's order: p [n, 2] (p_two, p_three) and in_domain [n].

        A row without a usable p has NaN in both columns and in_domain False.
        """
        features = np.asarray(features, np.float64).reshape(-1, len(FEATURES))
        sound: npt.NDArray[np.bool_] = np.all(np.abs(features) <= LARGEST, axis=1)
        narrow = np.where(sound[:, None], features, 0.0).astype(np.float32)
        p = np.asarray(self._run((OUTPUT,), {INPUT: narrow})[0], np.float64)
        usable = sound & np.all((p >= 0.0) & (p <= 1.0), axis=1)
        inside = np.all((features >= self._low) & (features <= self._high), axis=1)
        return np.where(usable[:, None], p, np.nan), usable & inside


def load_gate(path: str | Path) -> Gate:
    """Load and check an ONNX file; BadInput names the file and what is wrong with it.

    Refused: unreadable, not ONNX, no contract or another one, other inputs or outputs, no usable domain, no
    provenance, a seal that does not fit, and a p that is not a probability anywhere on a grid of 27 points over the
    domain.
    """
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        raise BadInput(f"{path}: {error.strerror or error}") from error
    opened = _open_session(path, data)
    _check_contract(path, opened.metadata)
    _check_nodes(path, "input", opened.inputs, INPUT, len(FEATURES))
    _check_nodes(path, "output", opened.outputs, OUTPUT, len(OUTPUTS))
    domain = _parse_domain(path, opened.metadata)
    provenance = _parse_object(path, opened.metadata, KEY_PROVENANCE)
    if not is_intact(data, opened.metadata.get(KEY_SEAL, "")):
        raise BadInput(f"{path}: damaged or altered since it was exported (metadata key {KEY_SEAL!r} does not fit)")
    gate = Gate(opened.session, domain, hashlib.sha256(data).hexdigest(), provenance)
    _probe(path, gate)
    return gate


class _Node(NamedTuple):
    name: str
    type: str
    shape: list[Any]                              # a size, a name, or None


class _Opened(NamedTuple):
    session: Any
    metadata: dict[str, str]
    inputs: list[_Node]
    outputs: list[_Node]


def _open_session(path: str | Path, data: bytes) -> _Opened:
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    options.execution_mode = onnxruntime.ExecutionMode.ORT_SEQUENTIAL
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")    # a spin-wait would eat the tick's core
    options.add_session_config_entry("session.inter_op.allow_spinning", "0")
    options.log_severity_level = 4                # what goes wrong is raised, and said once
    try:
        # Without the fallback: it would print, and try the same again.
        session = onnxruntime.InferenceSession(data, options, providers=["CPUExecutionProvider"], enable_fallback=0)
        inputs, outputs = ([_Node(node.name, node.type, node.shape) for node in nodes]
                           for nodes in (session.get_inputs(), session.get_outputs()))
        return _Opened(session, dict(session.get_modelmeta().custom_metadata_map), inputs, outputs)
    except Exception as error:                    # onnxruntime's own errors share no other base; names may not be UTF-8
        raise BadInput(f"{path}: not a usable ONNX model ({_first_line(error)})") from error


def _check_contract(path: str | Path, metadata: dict[str, str]) -> None:
    for key in (KEY_CONTRACT, KEY_CONTRACT_HASH):
        if key not in metadata:
            raise BadInput(f"{path}: carries no contract (metadata key {key!r} is missing); export it with truearc")
    stamped = metadata[KEY_CONTRACT_HASH]
    if stamped != contract_hash():
        raise BadInput(f"{path}: made for another contract (sha256 {stamped[:12]}..., this robot's is "
                       f"{contract_hash()[:12]}...): {metadata[KEY_CONTRACT][:300]}")
    if metadata[KEY_CONTRACT].encode() != contract_json():
        raise BadInput(f"{path}: metadata key {KEY_CONTRACT!r} does not say what its hash stands for")


def _check_nodes(path: str | Path, kind: str, nodes: list[_Node], name: str, width: int) -> None:
    wanted = len(nodes) == 1 and nodes[0].name == name and nodes[0].type == "tensor(float)"
    if not (wanted and len(nodes[0].shape) == 2 and not isinstance(nodes[0].shape[0], int)
            and nodes[0].shape[1] == width):
        said = ", ".join(f"{node.name} {node.type} {node.shape}" for node in nodes)
        raise BadInput(f"{path}: the {kind} is {said}; the contract asks for {name} tensor(float) [n, {width}]")


def _parse_domain(path: str | Path, metadata: dict[str, str]) -> Box:
    domain = _parse_object(path, metadata, KEY_DOMAIN)
    if set(domain) != {feature.name for feature in FEATURES}:
        raise BadInput(f"{path}: the domain names {sorted(domain)}, not the contract's features")
    box = []
    for feature in FEATURES:
        try:
            low, high = msgspec.convert(domain[feature.name], tuple[float, float])
        except msgspec.ValidationError as error:
            raise BadInput(f"{path}: the domain of {feature.name} is not [low, high]") from error
        if not feature.low <= low <= high <= feature.high:
            raise BadInput(f"{path}: the domain of {feature.name} is [{low}, {high}], which is not an interval "
                           f"within [{feature.low}, {feature.high}]")
        box.append((low, high))
    return tuple(box)


def _parse_object(path: str | Path, metadata: dict[str, str], key: str) -> dict[str, Any]:
    if key not in metadata:
        raise BadInput(f"{path}: metadata key {key!r} is missing")
    try:
        return msgspec.json.decode(metadata[key], type=dict[str, Any])
    except msgspec.MsgspecError as error:
        raise BadInput(f"{path}: metadata key {key!r}: {error}") from error


def _probe(path: str | Path, gate: Gate) -> None:
    axes = [np.linspace(low, high, 3) for low, high in gate.domain]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(FEATURES))
    try:
        p, _ = gate.rate_many(points)
    except Exception as error:                    # as above
        raise BadInput(f"{path}: does not run ({_first_line(error)})") from error
    if p.shape != (len(points), len(OUTPUTS)):
        raise BadInput(f"{path}: gives an output of shape {p.shape} for {len(points)} rows")
    bad = np.isnan(p).any(axis=1)
    if bad.any():
        where = ", ".join(f"{feature.name}={value:g}" for feature, value in zip(FEATURES, points[bad][0], strict=True))
        raise BadInput(f"{path}: gives no probability inside its own domain ({where})")


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:200]
