"""External measurements of a term's amplitude, by a tape, a scale, an inclinometer: data for or against its name.

    {"target_height.rise_m": Measurement(0.04, 0.01)}
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from truearc.errors import InputError
from truearc.sim.physics.catalogue import Catalogue, find_terms


class Measurement(NamedTuple):
    """In the unit of the term's amplitude; 0: nothing of the kind is there."""

    value: float
    sd: float


Measured = Mapping[str, Measurement]  # by the column "term.parameter"


def column_of(term: str, among: Catalogue | None = None) -> str:
    """The column of a term's amplitude, its first parameter. InputError for a term that there is none of."""
    (found,) = find_terms([term], among)
    return f"{term}.{found.parameters[0].name}"


def nats_measured(measured: Measured, column: str, amplitude: float, sd: float) -> float:
    """Log likelihood ratio of what was measured of this column: of an amplitude ~ N(amplitude, sd^2), to nothing of the
    kind. 0 where nothing was measured."""
    if column not in measured:
        return 0.0
    value, own = measured[column]
    variance = own**2 + sd**2
    return float(0.5 * (np.log(own**2 / variance) + value**2 / own**2 - (value - amplitude)**2 / variance))


class MeasuredPrior(NamedTuple):
    centre: float
    precision: float


def prior_of(measured: Measured, column: str, usual: float) -> MeasuredPrior:
    """Of a term's amplitude that is usually of that size, once it was measured."""
    if column not in measured:
        return MeasuredPrior(0.0, usual**-2.0)
    value, sd = measured[column]
    precision = usual**-2.0 + sd**-2.0
    return MeasuredPrior(value * sd**-2.0 / precision, precision)


def read_measured(words: Sequence[str], option: str, among: Catalogue | None = None) -> Measured:
    """From TERM=VALUE,SD, one a word; InputError names the option and what is wrong."""
    found = {}
    for word in words:
        term, _, numbers = word.partition("=")
        try:
            value, sd = map(float, numbers.split(","))
        except ValueError as error:
            raise InputError(f"{option} {word}: not TERM=VALUE,SD, such as target_height=0.04,0.01") from error
        if not np.isfinite([value, sd]).all() or sd <= 0.0:
            raise InputError(f"{option} {word}: a finite value and a standard deviation above 0 are needed")
        try:
            found[column_of(term, among)] = Measurement(value, sd)
        except InputError as error:
            raise InputError(f"{option} {word}: {error}") from error
    return found
