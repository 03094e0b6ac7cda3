"""Comparison of two folders of results: names, texts and counts exact, numbers within a relative limit.

A file becomes leaves, {dotted key: text, number or array}. Two numbers differ by |a - b| / max(|a|, |b|, FLOOR); those
of a float32 array by their share of its largest, since weights and polynomial coefficients act as a whole.
"""

import csv
import json
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import numpy_helper

# Why numbers may differ at all: other processors, XLA and BLAS versions round sums in another order (1e-16), and what
# iterates carries that on. Measured on one machine with XLA and NumPy held to SSE and OpenBLAS to another kernel:
# computed 1e-14, fitted 1e-9, trained 6e-6. The limits leave room for other versions of the libraries.
EXACT = 0.0            # bytes of this very code: replay, hashes
COMPUTED = 1e-9        # evaluated, not iterated: simulated flights, the grid's shares
FITTED = 1e-6          # converged by Newton steps, then tested: likelihood fits and findings
REFITTED = 1e-4        # an ill-conditioned polynomial in float32: the flights that a gate's graph carries (5e-6)
TRAINED = 1e-3         # many steps of float32 Adam; float32 inference
FLOOR = 1e-6           # of the denominator: what is smaller than this counts as absolute (SI units)

# Absolute limits of what is counted in random draws, where a tie may fall on the other side.
COUNTED = {"*p_value": 0.001, "*p_alone": 0.001, "mismatch.families.*": 0.001,      # two of 2000 sign draws
           "probability_after": 0.05}          # a design's: it follows which of two aliased terms comes first (0.025)

# Compared for presence only: text for people, which may be reworded, and what names this version or these bytes. The
# hash of a configuration no longer depends on how it was made (test_schema.py).
PROSE = ("*sentence", "*.reason", "*.reasons", "next.*.what", "*truearc", "*version", "*file_sha256", "*maker",
         "*config_sha256")
# Keys that results have gained since proof-1; the references lack them.
ADDED = ("next.*.instrument", "next.*.record", "next.*.covariate", "adoption.*", "story.*",
         "recorded.*")             # of training.json
# Aliased terms tie to the last bit, which decides which of them is stated: `release_height`, `target_height`. Of terms
# and sets the order is not compared, and which of them a shot separates for presence only.
UNORDERED = ("set", "*.set")
TIED = ("next.*.separates",)

Leaf = Any             # str | bool | None | float | np.ndarray


@dataclass(frozen=True)
class Comparison:
    """What differs: `largest` is of the numbers alone, at `where`; `wrong` names everything beyond its limit."""

    leaves: int
    largest: float
    where: str
    wrong: tuple[str, ...]


def compare(reference: Path, new: Path, limit: float) -> Comparison:
    """Compare two folders, file by file."""
    old_leaves, new_leaves = read_folder(reference), read_folder(new)
    wrong = [f"{key}: only in the {side}" for side, one, other in (
        ("reference", old_leaves, new_leaves), ("new results", new_leaves, old_leaves)) for key in one.keys() - other
        if side == "reference" or not _matches(key, ADDED)]
    largest, where = 0.0, ""
    for key in sorted(old_leaves.keys() & new_leaves.keys()):
        old, fresh = old_leaves[key], new_leaves[key]
        found, counted = difference(key.partition(":")[2], old, fresh), _counted(key)
        allowed = limit if counted is None else max(limit, counted)
        if counted is None and found > largest:
            largest, where = found, key
        if found > allowed:
            wrong.append(f"{key}: {found:.3g} beyond {allowed:g}: {_short(old)} became {_short(fresh)}")
    return Comparison(len(old_leaves), largest, where, tuple(wrong))


def difference(key: str, old: Leaf, new: Leaf) -> float:
    """0 where equal, infinite where not numbers of one shape and unequal."""
    if _matches(key, PROSE):
        return 0.0
    if not (_is_number(old) and _is_number(new)):
        return 0.0 if type(old) is type(new) and old == new else np.inf
    one, other = np.asarray(old, dtype=float), np.asarray(new, dtype=float)
    if one.shape != other.shape or (np.isfinite(one) != np.isfinite(other)).any():
        return np.inf
    with np.errstate(invalid="ignore"):
        gap = np.where((one == other) | (np.isnan(one) & np.isnan(other)), 0.0, np.abs(one - other))
        scale = np.maximum(np.maximum(np.abs(one), np.abs(other)), FLOOR)
        if _counted(key) is not None:
            scale = np.ones_like(scale)
        elif getattr(old, "dtype", None) == np.float32:
            scale = np.full_like(scale, np.max(scale, initial=FLOOR))
        return float(np.max(np.where(gap == 0, 0.0, gap / scale), initial=0.0))


def read_folder(folder: Path) -> dict[str, Leaf]:
    """Leaves of every file, keyed `file:dotted.key`."""
    return {f"{path.relative_to(folder).as_posix()}:{key}": leaf
            for path in sorted(folder.rglob("*")) if path.is_file() for key, leaf in _read(path)}


def _read(path: Path) -> Iterator[tuple[str, Leaf]]:
    match path.suffix:
        case ".json":
            yield from _flatten("", json.loads(path.read_text()))
        case ".jsonl":
            yield from _flatten("", [json.loads(line) for line in path.read_text().splitlines()])
        case ".toml":
            yield from _flatten("", tomllib.loads(path.read_text()))
        case ".csv":
            yield from _columns(path)
        case ".npz":
            with np.load(path) as arrays:
                yield from arrays.items()
        case ".onnx":
            yield from _graph(path)
        case _:
            raise ValueError(f"{path}: no reader for this kind of file")


def _flatten(key: str, value: Any) -> Iterator[tuple[str, Leaf]]:
    if _matches(key, PROSE + TIED):          # whatever is below: a sentence may become a code with numbers
        yield key, ""
    elif isinstance(value, list) and _matches(key, UNORDERED):
        yield key, " ".join(sorted(value))
    elif isinstance(value, list) and value and all(isinstance(one, dict) and "term" in one for one in value):
        yield from _flatten(key, {one["term"]: one for one in value})
    elif isinstance(value, dict):
        for name, inner in value.items():
            yield from _flatten(f"{key}.{name}" if key else name, inner)
    elif isinstance(value, list):
        yield f"{key}.length", len(value)
        for index, inner in enumerate(value):
            yield from _flatten(f"{key}.{index}", inner)
    else:
        yield key, value


def _columns(path: Path) -> Iterator[tuple[str, Leaf]]:
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    for name in rows[0] if rows else ():
        texts = [row[name] for row in rows]
        try:
            yield name, np.array([float(text) if text else np.nan for text in texts])
        except ValueError:
            yield name, "\n".join(texts)


def _graph(path: Path) -> Iterator[tuple[str, Leaf]]:
    """Metadata, as JSON where it is, order of operators, and constants of an ONNX file."""
    model = onnx.load(path)
    for entry in model.metadata_props:
        text = entry.value
        yield from _flatten(f"metadata.{entry.key}", json.loads(text) if text.startswith(("{", "[")) else text)
    yield "operators", " ".join(node.op_type for node in model.graph.node)
    for tensor in model.graph.initializer:
        yield f"constant.{tensor.name}", numpy_helper.to_array(tensor)


def _is_number(leaf: Leaf) -> bool:
    if isinstance(leaf, np.ndarray):
        return leaf.dtype.kind in "biuf"
    return isinstance(leaf, int | float) and not isinstance(leaf, bool)


def _counted(key: str) -> float | None:
    return next((limit for pattern, limit in COUNTED.items() if _matches(key, (pattern,))), None)


def _matches(key: str, patterns: tuple[str, ...]) -> bool:
    return any(fnmatch(key.rpartition(":")[2], pattern) for pattern in patterns)


def _short(leaf: Leaf) -> str:
    return str(leaf).replace("\n", " ")[:60]
