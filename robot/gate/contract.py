"""Inputs and outputs of a gate model.

The hash of this is stamped into every exported model; a model with another is refused.
"""

import hashlib

import msgspec
from msgspec import Struct


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
