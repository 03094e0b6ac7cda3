"""The gate's model: an ONNX file with its own contract, the checks of the file's bytes, and its inference session.

The contract names the inputs and outputs. Every exported model contains the contract's hash, and a model with a
different hash is refused. So is a damaged or altered file: its metadata holds the hash of the file itself, computed
with UNSEALED in place of that hash.

Metadata and operations are read from the protocol-buffer wire format (field numbers of onnx.proto, IR version 8) before
anything loads the file. The time that an operation in OPERATIONS takes depends only on the shapes of its inputs, and
without Loop, If and Scan each operation runs once, so all configurations take the same time. The file is then loaded in
another process with limits of time and memory, because onnxruntime computes while it loads (it folds constants) and
cannot be stopped within a process. That process is `python -m truearc.robot.gate`; it receives the file's bytes on
standard input and performs all steps of loading.
"""

import hashlib
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt
from msgspec import Struct

from truearc.errors import InputError, load_bytes, naming
from truearc.robot.config.rig_spec import Rig, as_table

KEY_SEAL = "truearc.file_sha256"
UNSEALED = "seal" * 16                # as long as a SHA-256 in hex
# Those of the gates that truearc exports, now and earlier, and element-wise ones.
OPERATIONS = frozenset((
    "Abs", "Acos", "Add", "Clip", "Cos", "Div", "Erf", "Exp", "Gather", "Gemm", "Identity", "Log", "MatMul", "Max",
    "Min", "Mul", "Neg", "ReduceSumSquare", "Relu", "Sigmoid", "Split", "Sqrt", "Sub", "Tanh", "TopK"))
MODEL_GRAPH, MODEL_METADATA, MODEL_FUNCTIONS = 7, 14, 25
GRAPH_NODE, GRAPH_INITIALIZER, GRAPH_SPARSE = 1, 5, 15
NODE_OPERATION, NODE_ATTRIBUTE, NODE_DOMAIN = 4, 5, 7
ATTRIBUTE_NESTED = (5, 6, 10, 11, 22, 23)         # tensors and graphs: none of OPERATIONS has any
TENSOR_EXTERNAL = 13                              # data in another file, which no checksum of this one covers
VARINT, FIXED64, BYTES, FIXED32 = 0, 1, 2, 5
LONGEST_TAG, LONGEST_VARINT = 5, 10               # bytes


class Feature(Struct, frozen=True):
    """One input column: name (with its unit), and the range outside which no launcher can be."""

    name: str
    low: float
    high: float


# The three configuration parameters of the paper (section II), in this order.
FEATURES = (
    Feature("distance_m", 0.0, 20.0),     # horizontal, ball exit to target plane (its middle, if it faces up), measured
    Feature("motor_ratio", 0.0, 1.0),     # motor speed / free speed, measured
    Feature("hood_deg", 0.0, 90.0),       # launch elevation above horizontal, measured
)
INPUT = "features"                        # float32 [n, 3]
OUTPUT = "p"                              # float32 [n, 2]: p_two, p_three
OUTPUTS = ("p_two", "p_three")
NOVELTY = "novelty"                       # float32 [n, 1]: how far a configuration is from all that was recorded
NOVELTY_LIMIT = 1.0                       # more than this is outside the model's domain of validity


class Measure(Struct, frozen=True):
    """An output other than a probability: its quantity, and the largest value that still lies inside the domain."""

    name: str
    kind: str
    unit: str
    limit: float


VALIDITY = Measure(NOVELTY, "distance to the k-th nearest recorded configuration, features standardised, as a share of "
                            "the largest distance that counts as known; k and that distance are in the metadata",
                   "1", NOVELTY_LIMIT)

# Keys in the ONNX file's metadata.
KEY_CONTRACT = "truearc.contract"             # the JSON below
KEY_CONTRACT_HASH = "truearc.contract_sha256"
KEY_DOMAIN = "truearc.domain"                 # JSON {feature: [low, high]} of the data trained on
KEY_NOVELTY = "truearc.novelty"               # JSON: k, largest_distance, recorded configurations it is measured from
KEY_PROVENANCE = "truearc.provenance"         # JSON: dataset hashes, coefficients, seed, version


def contract_json() -> bytes:
    """Return the canonical text of the contract."""
    return msgspec.json.encode({"features": FEATURES, "input": INPUT, "output": OUTPUT, "outputs": OUTPUTS,
                                "validity": VALIDITY}, order="deterministic")


def contract_hash() -> str:
    return hashlib.sha256(contract_json()).hexdigest()


def seal(data: bytes) -> bytes:
    """Return the file with its hash in the one place where UNSEALED stands; ValueError if there is not exactly one."""
    if data.count(UNSEALED.encode()) != 1:
        raise ValueError("the seal's place is missing or not unique")
    return data.replace(UNSEALED.encode(), hashlib.sha256(data).hexdigest().encode())


def is_intact(data: bytes, stamped: str) -> bool:
    """Return whether the file, apart from the seal, is the one that was sealed."""
    if len(stamped) != len(UNSEALED) or data.count(stamped.encode()) != 1:
        return False
    return hashlib.sha256(data.replace(stamped.encode(), UNSEALED.encode())).hexdigest() == stamped


def read_metadata(data: bytes) -> dict[str, str]:
    """Return the model's metadata; ValueError when this is not ONNX, or a key is there twice."""
    metadata: dict[str, str] = {}
    if not list(_parts(data, MODEL_GRAPH)):
        raise ValueError("it has no graph")
    for entry in _parts(data, MODEL_METADATA):
        fields = dict(_fields(entry))
        key = fields.get(1, b"").decode()
        if key in metadata:
            raise ValueError(f"metadata key {key!r} is there twice")
        metadata[key] = fields.get(2, b"").decode()
    return metadata


def check_graph(data: bytes) -> None:
    """Raise ValueError naming what a model does beyond OPERATIONS, or stores elsewhere."""
    if list(_parts(data, MODEL_FUNCTIONS)):
        raise ValueError("it defines its own operations")
    for graph in _parts(data, MODEL_GRAPH):
        for node in _parts(graph, GRAPH_NODE):
            _check_node(node)
        if list(_parts(graph, GRAPH_SPARSE)):
            raise ValueError("it has sparse tensors")
        if any(_parts(tensor, TENSOR_EXTERNAL) for tensor in _parts(graph, GRAPH_INITIALIZER)):
            raise ValueError("some of its data is in another file")


def _check_node(node: bytes) -> None:
    for operation in [*_parts(node, NODE_OPERATION)] or [b""]:
        if (name := operation.decode(errors="replace")) not in OPERATIONS:
            raise ValueError(f"operation {name[:40]!r} is not one of {', '.join(sorted(OPERATIONS))}")
    if any(domain not in (b"", b"ai.onnx") for domain in _parts(node, NODE_DOMAIN)):
        raise ValueError("it has operations of another domain")
    if any(field in ATTRIBUTE_NESTED for attribute in _parts(node, NODE_ATTRIBUTE) for field, _ in _fields(attribute)):
        raise ValueError("an operation contains a graph or tensor")


def _parts(data: bytes, number: int) -> list[bytes]:
    """Every value of the field with this number."""
    return [value for field, value in _fields(data) if field == number]


def _fields(data: bytes) -> Iterator[tuple[int, bytes]]:
    """(number, bytes) of every field of one message; numbers have b"". ValueError when it is cut short or none."""
    at = 0
    while at < len(data):
        tag, at = _varint(data, at, LONGEST_TAG)
        kind, number = tag & 7, tag >> 3
        value = b""
        if kind == VARINT:
            _, at = _varint(data, at, LONGEST_VARINT)
        elif kind in (FIXED32, FIXED64, BYTES):
            size, at = _varint(data, at, LONGEST_TAG) if kind == BYTES else ({FIXED32: 4, FIXED64: 8}[kind], at)
            value, at = data[at:at + size] if kind == BYTES else b"", at + size
        else:
            raise ValueError(f"field {number} has no valid wire type")
        if at > len(data) or number == 0 or tag >> 32:
            raise ValueError("it is cut short or damaged")
        yield number, value


def _varint(data: bytes, at: int, longest: int) -> tuple[int, int]:
    """(value, where the next byte is)."""
    value = 0
    for shift, byte in enumerate(data[at:at + longest]):
        value |= (byte & 0x7F) << 7 * shift
        if byte < 0x80:
            return value, at + shift + 1
    raise ValueError("it is cut short or damaged")


Box = tuple[tuple[float, float], ...]             # (low, high) of each feature, in the contract's order


Floats = npt.NDArray[np.float64]
Nodes = list[tuple[str, str, list[Any]]]        # name, type, shape: each a size, a name, or None
# Of computing: starting the process takes 0.6 s of it here, loading 5 ms; a Raspberry Pi 4 is some five times slower.
LIMIT_S = 10
PATIENCE = 12                         # times that, by the clock: the page's process got a twentieth of a busy core
DATA_BYTES = 400 << 20                # that it may ask for: a gate of 65 kB takes 60 MB
_passed: set[str] = set()             # SHA-256 of the files that this process has had tried


class Rating(NamedTuple):
    """The model's output for one configuration; both p are None when it gives no finite number.

    `novelty`: how far from all that was recorded; more than 1 is outside the domain; None when there is no number.
    """

    p_two: float | None
    p_three: float | None
    in_domain: bool
    novelty: float | None = None


class Ratings(NamedTuple):
    """Many ratings: `p` [n, 2] (p_two, p_three) and `novelty` [n] with NaN for no number, `in_domain` [n]."""

    p: Floats
    in_domain: npt.NDArray[np.bool_]
    novelty: Floats


LARGEST = float(np.finfo(np.float32).max)         # beyond this an input is infinite to the model
NO_RATING = Rating(None, None, False)
BOTH = (OUTPUT, NOVELTY)
MOST_BYTES = 16 << 20                             # 12 bytes a recorded shot: a million of them
BLOCK = 4096                                      # rows handed to the model at once: novelty looks at rows x recorded


class Gate:
    """A loaded model, made only by load_gate, which checks all that can be checked before the first decision."""

    def __init__(self, session: Any, domain: Box, sha256: str, provenance: dict[str, Any]) -> None:
        self.domain = domain
        self.sha256 = sha256                      # of the file
        self.provenance = provenance
        self._run = session.run
        (self._d_low, self._d_high), (self._r_low, self._r_high), (self._h_low, self._h_high) = domain
        self._low = np.array([low for low, _ in domain])
        self._high = np.array([high for _, high in domain])

    @property
    def target(self) -> dict[str, Any] | None:
        """Return [target] of rig.toml that it was trained for, if that faces up; None: one that faces front."""
        return self.provenance.get("target")

    @property
    def hit_or_miss(self) -> bool:
        """Return whether it faces up and every hit counts the same; p_two is then p_three."""
        return self.target is not None and "ring" not in self.target

    def rate(self, distance_m: float, motor_ratio: float, hood_deg: float) -> Rating:
        """Rate one configuration: ball exit to target plane (m), motor speed / free speed, elevation (degrees).

        Outside the domain the p are still the model's, with in_domain False. A non-finite input or output gives no p.
        """
        # A NaN makes every comparison here false, so only real numbers reach the last line.
        if not (abs(distance_m) <= LARGEST and abs(motor_ratio) <= LARGEST and abs(hood_deg) <= LARGEST):
            return NO_RATING
        p, novelty = self._run(BOTH, {INPUT: np.array(((distance_m, motor_ratio, hood_deg),), np.float32)})
        p_two, p_three = p[0].tolist()
        if not (0.0 <= p_two <= 1.0 and 0.0 <= p_three <= 1.0):
            return NO_RATING
        new = novelty.item()
        return Rating(p_two, p_three, 0.0 <= new <= NOVELTY_LIMIT and self._d_low <= distance_m <= self._d_high
                      and self._r_low <= motor_ratio <= self._r_high and self._h_low <= hood_deg <= self._h_high,
                      new if 0.0 <= new <= LARGEST else None)

    def rate_many(self, features: Floats) -> Ratings:
        """Rate float64 rows [n, 3] in the contract's order, as rate does.

        A row without a usable p has NaN in both columns and in_domain False.
        """
        features = np.asarray(features, np.float64).reshape(-1, len(FEATURES))
        sound: npt.NDArray[np.bool_] = np.all(np.abs(features) <= LARGEST, axis=1)
        narrow = np.where(sound[:, None], features, 0.0).astype(np.float32)
        p, novelty = self._run_many(narrow)
        usable = sound & np.all((p >= 0.0) & (p <= 1.0), axis=1)
        inside = np.all((features >= self._low) & (features <= self._high), axis=1)
        known = (novelty >= 0.0) & (novelty <= NOVELTY_LIMIT)
        measured = usable & (novelty >= 0.0) & (novelty <= LARGEST)
        return Ratings(np.where(usable[:, None], p, np.nan), usable & inside & known,
                       np.where(measured, novelty, np.nan))

    def _run_many(self, features: npt.NDArray[np.float32]) -> tuple[Floats, Floats]:
        blocks = [self._run(BOTH, {INPUT: features[first:first + BLOCK]})
                  for first in range(0, max(len(features), 1), BLOCK)]
        p, novelty = (np.concatenate([np.asarray(block[k], np.float64) for block in blocks]) for k in range(2))
        if novelty.shape != (len(features), 1):
            raise ValueError(f"novelty of shape {novelty.shape} for {len(features)} rows")
        return p, novelty[:, 0]


def load_gate(path: str | Path) -> Gate:
    """Load and check an ONNX file; InputError names the file and what is wrong with it.

    Refused: unreadable, not ONNX, no contract or another one, a seal that does not fit; before onnxruntime has seen
    any of it. Then operations other than a gate's, other inputs or outputs, no usable domain, no word on what novelty
    is measured from, no provenance, and a p that is not a probability or a novelty that is not a number anywhere on a
    grid of 27 points over the domain. Another process goes first (truearc.robot.gate), whose time is limited.
    """
    data = load_bytes(path, MOST_BYTES)
    check_file(path, data)
    sha256 = hashlib.sha256(data).hexdigest()
    try_gate(path, data, sha256)
    return open_gate(path, data, sha256)


def load_gate_for(path: str | Path, rig: Rig) -> Gate:
    """Load a gate for a launcher; InputError also if it was trained for a target of another kind or size."""
    gate = load_gate(path)
    own = facing_up_of(rig)
    if gate.target != own:
        raise InputError(f"{path}: trained for a target that {say_target(gate.target)}, but this robot's "
                         f"{say_target(own)}; train one with this robot's target")
    return gate


def facing_up_of(rig: Rig) -> dict[str, Any] | None:
    """Return [target] of rig.toml if that faces up, without what changes no outcome; else None."""
    if rig.target is None or not rig.target.faces_up:
        return None
    return {key: value for key, value in as_table(rig)["target"].items() if key != "points"}


def say_target(target: dict[str, Any] | None) -> str:
    """Return what Gate.target, or facing_up_of, says of a target."""
    if target is None:
        return "faces front"
    return "faces up (" + ", ".join(f"{key} {value}" for key, value in target.items() if key != "facing") + ")"


def check_file(path: str | Path, data: bytes) -> dict[str, str]:
    """Return the metadata of an intact gate, from its bytes alone; InputError as in load_gate."""
    try:
        metadata = read_metadata(data)
    except ValueError as error:
        raise InputError(f"{path}: not a usable ONNX model ({error})") from error
    _check_contract(path, metadata)
    if not is_intact(data, metadata.get(KEY_SEAL, "")):
        raise InputError(f"{path}: damaged or altered since it was exported (metadata key {KEY_SEAL!r} does "
                         "not fit)")
    try:
        check_graph(data)
    except ValueError as error:
        raise InputError(f"{path}: not a gate exported by truearc: {error}") from error
    return metadata


def open_gate(path: str | Path, data: bytes, sha256: str) -> Gate:
    """Load the gate in those bytes, in this process and however long it takes; InputError as in load_gate."""
    metadata = check_file(path, data)
    session, inputs, outputs = _open_session(path, data)
    _check_nodes(path, "input", inputs, {INPUT: len(FEATURES)})
    _check_nodes(path, "output", outputs, {OUTPUT: len(OUTPUTS), NOVELTY: 1})
    domain = _parse_domain(path, metadata)
    _parse_object(path, metadata, KEY_NOVELTY)
    provenance = _parse_object(path, metadata, KEY_PROVENANCE)
    gate = Gate(session, domain, sha256, provenance)
    _probe(path, gate)
    return gate


def _open_session(path: str | Path, data: bytes) -> tuple[Any, Nodes, Nodes]:
    """The session, its inputs and its outputs."""
    import onnxruntime  # slow to import, and most of who knows the contract loads no model
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    options.execution_mode = onnxruntime.ExecutionMode.ORT_SEQUENTIAL
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")    # a spin-wait would eat the tick's core
    options.add_session_config_entry("session.inter_op.allow_spinning", "0")
    options.log_severity_level = 4                # errors are raised, and reported once
    try:
        # Without the fallback: it would print, and try the same again.
        session = onnxruntime.InferenceSession(data, options, providers=["CPUExecutionProvider"], enable_fallback=0)
        inputs, outputs = ([(node.name, node.type, node.shape) for node in nodes]
                           for nodes in (session.get_inputs(), session.get_outputs()))
        return session, inputs, outputs
    except Exception as error:                    # onnxruntime's own errors share no other base; names may not be UTF-8
        raise InputError(f"{path}: not a usable ONNX model ({_first_line(error)})") from error


def _check_contract(path: str | Path, metadata: dict[str, str]) -> None:
    for key in (KEY_CONTRACT, KEY_CONTRACT_HASH):
        if key not in metadata:
            raise InputError(f"{path}: carries no contract (metadata key {key!r} is missing); export it with truearc")
    stamped = metadata[KEY_CONTRACT_HASH]
    if stamped != contract_hash():
        raise InputError(f"{path}: made for another contract (sha256 {stamped[:12]}..., this robot's is "
                       f"{contract_hash()[:12]}...): {metadata[KEY_CONTRACT][:300]}")
    if metadata[KEY_CONTRACT].encode() != contract_json():
        raise InputError(f"{path}: metadata key {KEY_CONTRACT!r} does not match its hash")


def _check_nodes(path: str | Path, kind: str, nodes: Nodes, wanted: dict[str, int]) -> None:
    """`wanted`: name -> width, in the contract's order."""
    if [name for name, _, _ in nodes] != list(wanted) or not all(
            type_ == "tensor(float)" and len(shape) == 2 and not isinstance(shape[0], int) and shape[1] == wanted[name]
            for name, type_, shape in nodes):
        said = ", ".join(f"{name} {type_} {shape}" for name, type_, shape in nodes)
        asked = ", ".join(f"{name} tensor(float) [n, {width}]" for name, width in wanted.items())
        raise InputError(f"{path}: the {kind} is {said}; the contract asks for {asked}")


def _parse_domain(path: str | Path, metadata: dict[str, str]) -> Box:
    domain = _parse_object(path, metadata, KEY_DOMAIN)
    if set(domain) != {feature.name for feature in FEATURES}:
        raise InputError(f"{path}: the domain names {sorted(domain)}, not the contract's features")
    box = []
    for feature in FEATURES:
        try:
            low, high = msgspec.convert(domain[feature.name], tuple[float, float])
        except msgspec.ValidationError as error:
            raise InputError(f"{path}: the domain of {feature.name} is not [low, high]") from error
        if not feature.low <= low <= high <= feature.high:
            raise InputError(f"{path}: the domain of {feature.name} is [{low}, {high}], which is not an interval "
                           f"within [{feature.low}, {feature.high}]")
        box.append((low, high))
    return tuple(box)


def _parse_object(path: str | Path, metadata: dict[str, str], key: str) -> dict[str, Any]:
    if key not in metadata:
        raise InputError(f"{path}: metadata key {key!r} is missing")
    with naming(f"{path}: metadata key {key!r}"):
        return msgspec.json.decode(metadata[key], type=dict[str, Any])


def _probe(path: str | Path, gate: Gate) -> None:
    axes = [np.linspace(low, high, 3) for low, high in gate.domain]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(FEATURES))
    try:
        p, _, novelty = gate.rate_many(points)
    except Exception as error:                    # as above
        raise InputError(f"{path}: does not run ({_first_line(error)})") from error
    if p.shape != (len(points), len(OUTPUTS)):
        raise InputError(f"{path}: gives an output of shape {p.shape} for {len(points)} rows")
    for bad, what in ((np.isnan(p).any(axis=1), "probability"), (np.isnan(novelty), "novelty")):
        if bad.any():
            where = ", ".join(f"{feature.name}={value:g}"
                              for feature, value in zip(FEATURES, points[bad][0], strict=True))
            raise InputError(f"{path}: gives no {what} inside its own domain ({where})")


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:200]


def try_gate(path: object, data: bytes, sha256: str) -> None:
    """Try a model, once in a process.

    InputError when it is not a gate, takes too long or too much memory, or crashes.
    """
    if sha256 in _passed:
        return
    command = [sys.executable, "-P", "-m", "truearc.robot.gate", str(path), str(LIMIT_S)]
    try:
        done = subprocess.run(command, input=data, capture_output=True, timeout=PATIENCE * LIMIT_S, check=False)
    except subprocess.TimeoutExpired as error:
        raise InputError(f"{path}: takes longer than {PATIENCE * LIMIT_S} s to load and to rate a configuration; is "
                         "this computer overloaded?") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be tried ({error.strerror})") from error
    if done.returncode == -getattr(signal, "SIGXCPU", 0) != 0:
        raise InputError(f"{path}: takes more than {LIMIT_S} s of processor time to load and to rate a configuration")
    if done.returncode == 2:
        raise InputError(done.stdout.decode(errors="replace").strip())
    if done.returncode:
        raise InputError(f"{path}: not a usable ONNX model (its trial ended with exit code {done.returncode})")
    _passed.add(sha256)


def limit_self(limit_s: int) -> None:
    """Limit the time and data of this process if the system can; its parent may have died."""
    try:
        import resource
    except ImportError:
        return
    resource.setrlimit(resource.RLIMIT_DATA, (DATA_BYTES, DATA_BYTES))
    resource.setrlimit(resource.RLIMIT_CPU, (limit_s, limit_s + 2))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def main(name: str, limit_s: str) -> int:
    """Run the trial's process: load standard input as the file of that name; return 2 with the error, or 0."""
    limit_self(int(limit_s))
    try:
        gate = open_gate(name, sys.stdin.buffer.read(), "")
        gate.rate(*(0.5 * (low + high) for low, high in gate.domain))
    except InputError as error:
        sys.stdout.buffer.write(str(error).encode())
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
