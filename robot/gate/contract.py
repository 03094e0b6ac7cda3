"""Contract of a gate model, and the checks of its file that need nothing but the bytes.

The contract names inputs and outputs. Its hash is stamped into every exported model; a model with another is refused.
So is a damaged or altered file: its metadata holds the hash of the file with UNSEALED in the hash's own place.

Metadata and operations are read before anything loads the file: protocol-buffer wire format, with the field numbers of
onnx.proto (IR version 8). The time of every operation of OPERATIONS depends on the shapes of its inputs alone, and
without Loop, If and Scan each is done once: all configurations take the same time.
"""

import hashlib
from collections.abc import Iterator

import msgspec
from msgspec import Struct

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
    Feature("distance_m", 0.0, 20.0),     # horizontal, ball exit to target plane, as measured by the robot
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
    """Canonical text of the contract."""
    return msgspec.json.encode({"features": FEATURES, "input": INPUT, "output": OUTPUT, "outputs": OUTPUTS,
                                "validity": VALIDITY}, order="deterministic")


def contract_hash() -> str:
    return hashlib.sha256(contract_json()).hexdigest()


def seal(data: bytes) -> bytes:
    """The file with its hash in the one place where UNSEALED stands; ValueError when there is not just one."""
    if data.count(UNSEALED.encode()) != 1:
        raise ValueError("the seal's place is missing or not unique")
    return data.replace(UNSEALED.encode(), hashlib.sha256(data).hexdigest().encode())


def is_intact(data: bytes, stamped: str) -> bool:
    """Whether the file is, apart from the seal, the one that was sealed."""
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
    """ValueError names what a model does beyond OPERATIONS, or keeps elsewhere."""
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
