"""coefficients.toml: what we believe, term by term, and where the belief came from.

    schema = "truearc.coefficients/1"
    [drag]
    cd = 0.91
    [magnus]
    cl = 0.06
    [provenance]
    method = "grid"

A fit by likelihood adds [scatter] and [covariance], which truearc.sim.infer.belief reads.
"""

import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from truearc.robot.config.schema import InputError, load_text
from truearc.robot.config.toml_text import make_toml
from truearc.sim.physics.catalogue import Catalogue, find_terms

SCHEMA = "truearc.coefficients/1"
APART = ("schema", "scatter", "covariance", "curve", "provenance")

Coefficients = dict[str, dict[str, float]]


def load_coefficients(path: str | Path, among: Catalogue | None = None) -> Coefficients:
    """{term: {parameter: value}}; InputError names an unknown term or parameter, or a value that is not finite.

    among: the catalogue of the terms, truearc.sim.physics.catalogue.catalogue() when not given.
    """
    table = load_table(path)
    return {name: _values(path, name, values, among) for name, values in table.items() if name not in APART}


def load_provenance(path: str | Path) -> dict[str, Any]:
    """The file's [provenance] table, empty when it has none."""
    provenance = load_table(path).get("provenance", {})
    if not isinstance(provenance, dict):
        raise InputError(f"{path}: provenance is not a table")
    return provenance


def save_coefficients(path: str | Path, coefficients: Mapping[str, Mapping[str, float]],
                      provenance: Mapping[str, Any], more: Mapping[str, Any] | None = None) -> None:
    """Write coefficients, further tables, and how they came about (plain values); floats read back exactly."""
    terms = {name: {key: float(value) for key, value in values.items()} for name, values in coefficients.items()}
    text = make_toml({"schema": SCHEMA, **terms, **(more or {}), "provenance": dict(provenance)})
    Path(path).write_text(text, encoding="utf-8")


def load_table(path: str | Path) -> dict[str, Any]:
    """All that the file says; InputError when it is not a coefficients file."""
    try:
        table = tomllib.loads(load_text(path))
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: {error}") from error
    if table.get("schema") != SCHEMA:
        raise InputError(f"{path}: schema is {table.get('schema')!r}, not {SCHEMA!r}")
    return table


def _values(path: str | Path, name: str, values: Any, among: Catalogue | None) -> dict[str, float]:
    try:
        (term,) = find_terms([name], among)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    known = {parameter.name for parameter in term.parameters}
    if not isinstance(values, dict):
        raise InputError(f"{path}: {name} is not a table")
    for key, value in values.items():
        if key not in known:
            raise InputError(f"{path}: {name}.{key}: {name} has no such parameter ({', '.join(sorted(known))})")
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise InputError(f"{path}: {name}.{key}: {value!r} is not a finite number")
    return {key: float(value) for key, value in values.items()}
