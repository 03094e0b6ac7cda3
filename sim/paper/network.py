"""The paper's network, its training rows and their splits, its loss and accuracy, and its domain.

The network has three input features, eight hidden nodes and two output probabilities, with a sigmoid after each layer.
It is trained by truearc.sim.paper.train_many.
"""

import hashlib
import json
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import truearc.sim.physics  # noqa: F401 - the house's one switch to double precision
from truearc.errors import MAX_BYTES, InputError, load_bytes, naming
from truearc.robot.gate import FEATURES, OUTPUTS
from truearc.sim import statistics as figures
from truearc.sim.data.dataset import Shots

HIDDEN = 8
WEIGHTS_FILE = "weights.npz"
RECORD_FILE = "training.json"
SCHEMA = "truearc.training/1"
LABELS = {"miss": (0.0, 0.0), "two": (1.0, 0.0), "three": (1.0, 1.0)}     # three lies inside two
DOMAIN_MARGIN = 0.1                   # the domain is the recorded rows' box, wider by this share (half on each side)


class Layers(NamedTuple):
    """The trained parameters: `hidden_w` [3, 8], `hidden_b` [8], `out_w` [8, 2], `out_b` [2]."""

    hidden_w: Any
    hidden_b: Any
    out_w: Any
    out_b: Any


SHAPES = Layers((len(FEATURES), HIDDEN), (HIDDEN,), (HIDDEN, len(OUTPUTS)), (len(OUTPUTS),))


@dataclass(frozen=True)
class Network:
    """Trained layers behind a fixed standardisation, z = (features - mean) * scale; all float64 arrays.

    `mean` (unit of the feature) and `scale` (its inverse) are exact in float32, so the exported graph subtracts and
    multiplies by the very numbers that were trained with.
    """

    mean: np.ndarray                  # [3]
    scale: np.ndarray                 # [3]
    layers: Layers


def initial_layers(rng: np.random.Generator) -> Layers:
    """Return Glorot-uniform weights and zero biases (Keras's default, as the paper's implementation section
    implies)."""
    def uniform(shape: tuple[int, ...]) -> np.ndarray:
        if len(shape) == 1:
            return np.zeros(shape)
        limit = np.sqrt(6.0 / sum(shape))
        return rng.uniform(-limit, limit, shape)
    return Layers(*(uniform(shape) for shape in SHAPES))


def logits(layers: Layers, z: Any) -> Any:
    """Return log odds [n, 2] of (two, three) from standardised features [n, 3]; differentiable."""
    return jax.nn.sigmoid(z @ layers.hidden_w + layers.hidden_b) @ layers.out_w + layers.out_b


def probabilities(network: Network, features: np.ndarray) -> np.ndarray:
    """Return the trainer's own forward pass in float64: features [n, 3] (order and units of the contract) to p [n,
    2]."""
    z = (jnp.asarray(features, jnp.float64) - network.mean) * network.scale
    return np.asarray(jax.nn.sigmoid(logits(Layers(*map(jnp.asarray, network.layers)), z)))


def standardisation(features: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return `mean` [3] and `scale` [3] = 1 / standard deviation of these rows; a feature that never varies gets scale
    1."""
    deviation = features.std(axis=0)
    scale = np.divide(1.0, deviation, out=np.ones_like(deviation), where=deviation > 1e-9)
    return exact_in_float32(features.mean(axis=0)), exact_in_float32(scale)


def exact_in_float32(values: np.ndarray) -> np.ndarray:
    """Return these values rounded to float32, so that an exported graph computes with the same numbers."""
    return values.astype(np.float32).astype(np.float64)


def save_weights(directory: str | Path, network: Network, record: dict[str, Any]) -> None:
    """Write weights.npz and training.json; the same network and record give the same bytes.

    InputError when the directory cannot be written.
    """
    save_with_record(directory, record, lambda folder: np.savez(
        folder / WEIGHTS_FILE, mean=network.mean, scale=network.scale, **network.layers._asdict()))


def save_with_record(directory: str | Path, record: dict[str, Any], save_model: Callable[[Path], object]) -> None:
    """Make a weights directory, have `save_model` write the model into it, and write training.json.

    InputError when the directory cannot be written.
    """
    text = as_json(SCHEMA, record)
    directory = Path(directory)
    try:
        directory.mkdir(parents=True, exist_ok=True)
        save_model(directory)
        (directory / RECORD_FILE).write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{error.filename}: {error.strerror}") from error


def as_json(schema: str, table: dict[str, Any]) -> str:
    """Return the text of a JSON object that names its schema; ValueError if a number is not finite."""
    return json.dumps({"schema": schema, **table}, indent=1, allow_nan=False) + "\n"


def load_weights(directory: str | Path) -> tuple[Network, dict[str, Any]]:
    """Read what save_weights wrote; InputError names the file and what is wrong with it."""
    arrays = _load_arrays(Path(directory) / WEIGHTS_FILE)
    network = Network(arrays["mean"], arrays["scale"], Layers(*(arrays[name] for name in Layers._fields)))
    return network, load_record(Path(directory) / RECORD_FILE)


def weights_hash(directory: str | Path, model_file: str = WEIGHTS_FILE) -> str:
    """Return the SHA-256 of the bytes of the model's file and training.json; InputError if either cannot be read."""
    digest = hashlib.sha256()
    for name in (model_file, RECORD_FILE):
        digest.update(load_bytes(Path(directory) / name))
    return digest.hexdigest()


def _load_arrays(path: Path) -> dict[str, np.ndarray]:
    load_bytes(path)
    try:
        with zipfile.ZipFile(path) as packed:
            if (size := sum(entry.file_size for entry in packed.infolist())) > MAX_BYTES:
                raise ValueError(f"unpacks to {size} bytes; at most {MAX_BYTES} are read")
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: np.asarray(file[name], np.float64) for name in file.files}
    except Exception as error:        # NumPy, zipfile and zlib each raise their own kinds on a damaged archive
        raise InputError(f"{path}: not a weights file ({error})") from error
    for name, shape in {"mean": (len(FEATURES),), "scale": (len(FEATURES),), **SHAPES._asdict()}.items():
        if name not in arrays:
            raise InputError(f"{path}: array {name!r} is missing")
        if arrays[name].shape != shape:
            raise InputError(f"{path}: array {name!r} has shape {arrays[name].shape}, not {shape}")
        if not np.isfinite(arrays[name]).all():
            raise InputError(f"{path}: array {name!r} holds a number that is not finite")
    return arrays


def load_record(path: Path) -> dict[str, Any]:
    """Load the training.json of a weights directory of any kind; InputError names the file and what is wrong with
    it."""
    record = load_json(path, SCHEMA)
    domain = record.get("domain")
    if not isinstance(domain, dict) or set(domain) != {feature.name for feature in FEATURES}:
        raise InputError(f"{path}: key 'domain' does not name the contract's features")
    return record


def load_json(path: Path, schema: str | None = None) -> dict[str, Any]:
    """Load a JSON object, of this schema if one is given; InputError names the file and what is wrong with it."""
    try:
        with naming(path):            # of values nested too deeply, too
            table = json.loads(load_bytes(path))
    except ValueError as error:
        raise InputError(f"{path}: not JSON ({error})") from error
    if not isinstance(table, dict):
        raise InputError(f"{path}: not a JSON object")
    if schema is not None and table.get("schema") != schema:
        raise InputError(f"{path}: key 'schema' is not {schema!r}")
    return table


class Rows(NamedTuple):
    """Training rows: `features` [n, 3] in the contract's order and units, `labels` [n, 2] (hit two, hit three)."""

    features: np.ndarray
    labels: np.ndarray


def training_rows(shots: Shots, name: str) -> tuple[Rows, list[str]]:
    """Return rows with an outcome and all three features, and a sentence for each kind of excluded shot of dataset
    `name`."""
    outcomes = shots.text("outcome")
    unjudged = np.array([outcome not in LABELS for outcome in outcomes], bool)
    features, kept, left_out = usable_rows(shots, name, unjudged, "no outcome")
    return Rows(features, np.array([LABELS[outcomes[row]] for row in kept], float).reshape(-1, 2)), left_out


def usable_rows(shots: Shots, name: str, silent: np.ndarray, why: str) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Return (features [k, 3], their rows in `shots` [k], a sentence for each kind of excluded shot of dataset `name`).

    Rows lack no feature, and are not `silent` [n], as `why` explains. InputError if none is left.
    """
    features = np.stack([shots.number(feature.name) for feature in FEATURES], axis=1)
    gaps = np.isnan(features)
    lacking = " or ".join(f"no {shots.written.get(feature.name, (feature.name,))[0]}"
                          for feature, lacks in zip(FEATURES, gaps[~silent].T, strict=True) if lacks.any())
    gap = gaps.any(axis=1) & ~silent
    left_out = [f"{name}: {int(rows.sum())} of {len(shots)} shots left out: {reason}"
                for reason, rows in ((why, silent), (lacking, gap)) if rows.any()]
    kept = np.flatnonzero(~silent & ~gap)
    if not kept.size:
        raise InputError("there is nothing to train on; " + "; ".join(left_out or [f"{name}: no shots"]))
    return features[kept], kept, left_out


def cross_entropy(log_odds: Any, labels: Any) -> Any:
    """Return the binary cross-entropy of each row, summed over the two outputs: log odds [n, 2], labels [n, 2] -> [n]
    nats."""
    return jnp.sum(jax.nn.softplus(log_odds) - labels * log_odds, axis=-1)


def mean_loss(network: Network, rows: Rows) -> float:
    """Return the mean cross-entropy of at least one row, in nats."""
    z = (rows.features - network.mean) * network.scale
    return float(jnp.mean(cross_entropy(logits(network.layers, z), rows.labels)))


def split_heldout(rows: Rows, share: float, seed: int, option: str = "--holdout") -> tuple[Rows, Rows]:
    """Return (kept, held out): `share` of each class is held out, drawn by seed, separately for each option.

    InputError names the option unless 0 <= share < 1.
    """
    if not 0.0 <= share < 1.0:
        raise InputError(f"{option} is {share}; it must be at least 0 and less than 1")
    rng = np.random.default_rng([seed, 1, *(() if option == "--holdout" else option.encode())])
    level = rows.labels.sum(axis=1)
    out = np.zeros(len(level), bool)
    for value in np.unique(level):
        members = rng.permutation(np.flatnonzero(level == value))
        out[members[:round(share * len(members))]] = True
    return Rows(*(array[~out] for array in rows)), Rows(*(array[out] for array in rows))


def accuracy(network: Network, rows: Rows) -> dict[str, Any]:
    """Return the shares of rows with correct outcome (of three), two-point hit and three-point hit at p = 0.5.

    Keys: shots, outcome, two, three; the shares are None without rows.
    """
    if not len(rows.features):
        return {"shots": 0, "outcome": None, "two": None, "three": None}
    p, hit = probabilities(network, rows.features), rows.labels >= 0.5
    two, three = ((p >= 0.5) == hit).mean(axis=0).tolist()
    return {"shots": len(rows.features), "outcome": figures.accuracy(p, hit), "two": two, "three": three}


def domain_of(features: np.ndarray) -> dict[str, list[float]]:
    """Return the model's valid domain: the box around the recorded rows [n, 3], 10 % wider, within the contract.

    Simulated rows do not widen it: they cover configurations about which no robot has shown anything.
    """
    low, high = features.min(axis=0), features.max(axis=0)
    margin = 0.5 * DOMAIN_MARGIN * (high - low)
    return {feature.name: [float(max(feature.low, low[k] - margin[k])), float(min(feature.high, high[k] + margin[k]))]
            for k, feature in enumerate(FEATURES)}
