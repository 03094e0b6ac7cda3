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
from pathlib import Path
from typing import Any

from truearc.errors import InputError, load_text, parse_table
from truearc.sim.physics.catalogue import Catalogue, find_terms
from truearc.sim.physics.term_fields import LOG

SCHEMA = "truearc.coefficients/1"
APART = ("schema", "scatter", "covariance", "curve", "provenance")

Coefficients = dict[str, dict[str, float]]


def coefficients_in(table: dict[str, Any], path: str | Path, among: Catalogue | None = None) -> Coefficients:
    """{term: {parameter: value}} of a loaded file; InputError names an unknown term or parameter, or a value that is
    not finite.

    among: the catalogue of the terms, truearc.sim.physics.catalogue.catalogue() when not given.
    """
    return {name: _values(path, name, values, among) for name, values in table.items() if name not in APART}


def load_table(path: str | Path) -> dict[str, Any]:
    """All that the file says; InputError when it is not a coefficients file."""
    table = parse_table(load_text(path), str(path))
    if table.get("schema") != SCHEMA:
        raise InputError(f"{path}: schema is {table.get('schema')!r}, not {SCHEMA!r}")
    return table


def _values(path: str | Path, name: str, values: Any, among: Catalogue | None) -> dict[str, float]:
    try:
        (term,) = find_terms([name], among)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    known = {parameter.name: parameter for parameter in term.parameters}
    if not isinstance(values, dict):
        raise InputError(f"{path}: {name} is not a table")
    for key, value in values.items():
        if key not in known:
            raise InputError(f"{path}: {name}.{key}: {name} has no such parameter ({', '.join(sorted(known))})")
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise InputError(f"{path}: {name}.{key}: {value!r} is not a finite number")
        if value < 0.0 and (prior := known[key].prior) is not None and prior.scale == LOG:
            raise InputError(f"{path}: {name}.{key}: {value:g} is below 0, which it cannot be")
    return {key: float(value) for key, value in values.items()}
