"""Whether a term has declared everything that a catalogue, and whoever reads of it, will ask it for."""

import re
from collections.abc import Iterator
from typing import Any

from truearc.errors import InputError
from truearc.sim.data.conditions import Circumstances
from truearc.sim.physics.term import DIRECTIONS, KINDS, STAGES, Term, WatchTerm
from truearc.sim.physics.term_fields import SCALES, Instrument, Parameter, Phrase, fits_scale

NAME = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")
UNIT = re.compile(r"(1|((kg|rad|rev|deg|m|s)\d*)+)(/((kg|rad|rev|deg|m|s)\d*)+)?")


def check_term(term: Term) -> None:
    """Refuse a term that leaves something out.

    Raises:
        InputError: names the class, and every declaration that is missing or wrong.
    """
    if not isinstance(term, KINDS):
        raise InputError(f"{_where(term)}: expected an instance of {', '.join(kind.__name__ for kind in KINDS)}")
    if problems := list(_problems(term)):
        raise InputError(f"{_where(term)}: {'; '.join(problems)}")


def _where(term: object) -> str:
    return type(term).__name__ if isinstance(term, Term) else repr(term)


def _problems(term: Term) -> Iterator[str]:
    """Each wrong declaration, "field: what is wrong"."""
    if not (isinstance(term.name, str) and NAME.fullmatch(term.name)):
        yield f"name: {term.name!r} is not lower-case words joined by _"
    if not type(term).__doc__:
        yield "no docstring, which the table of terms shows as its law"
    yield from _one_of(term, "stage", STAGES)
    yield from _one_of(term, "direction", DIRECTIONS)
    order = getattr(term, "order", None)
    if not (isinstance(order, tuple) and len(order) == 2 and isinstance(order[0], int | float) and order[1]):
        yield f"order: {order!r} is not a number and a reason, such as 50, \"a factor of the speed\""
    yield from _wording(term)
    yield from _recording(term)
    yield from _numbers(term)


def _one_of(term: Term, field: str, allowed: tuple[str, ...]) -> Iterator[str]:
    said = getattr(term, field, None)
    if said not in allowed:
        yield f"{field}: {said!r} is none of {', '.join(allowed)}"


def _wording(term: Term) -> Iterator[str]:
    sentence, phrase = getattr(term, "sentence", ""), getattr(term, "phrase", None)
    if not (isinstance(sentence, str) and sentence.endswith(".")):
        yield f"sentence: got {sentence!r}; expected a sentence with a full stop"
    if not isinstance(phrase, Phrase) or not all(isinstance(one, str) and one.count("{}") == 1 for one in phrase[:2]):
        yield "phrase: expected a Phrase with one {} for the size in either direction"
    if not term.label:
        yield "label: is empty"


def _recording(term: Term) -> Iterator[str]:
    instrument: Any = getattr(term, "instrument", 0)
    if not isinstance(instrument, Instrument) and not (instrument is None and term.always):
        yield "instrument: expected an Instrument (only a term that is always at work may have none)"
    elif instrument is not None and not NAME.fullmatch(instrument.id):
        yield f"instrument: got the id {instrument.id!r}; expected snake_case"
    elif instrument is not None and not (instrument.what and (instrument.sd is None or instrument.sd > 0.0)):
        yield f"instrument: {instrument!r} has no text, or an accuracy that is not above 0"
    if term.follows is not None and term.follows not in Circumstances._fields:
        yield f"follows: {term.follows!r} is none of {', '.join(Circumstances._fields)}"
    if term.follows is not None and not term.record:
        yield f"record: is empty, though the term follows {term.follows}, which has to be recorded"
    if not 0.0 < term.positive < 1.0:
        yield "positive: is a probability between 0 and 1"
    if term.law_sd is not None and not term.law_sd > 0.0:
        yield "law_sd: above 0, or None"
    if term.indoor_sd is not None and not term.indoor_sd > 0.0:
        yield "indoor_sd: above 0, or None"
    if term.calibration_sd is not None and not (isinstance(term, WatchTerm) and term.calibration_sd > 0.0):
        yield "calibration_sd: is for terms about a tracker, and above 0"


def _numbers(term: Term) -> Iterator[str]:
    parameters = getattr(term, "parameters", ())
    if not isinstance(parameters, tuple) or not parameters:
        yield "parameters: expected a tuple with at least one Parameter"
        return
    if len({one.name for one in parameters}) < len(parameters):
        yield "parameters: two have one name"
    for one in parameters:
        yield from (f"parameters: {one.name}: {problem}" for problem in _parameter(one))
    amplitude = parameters[0]
    if not term.always and not (amplitude.default == 0.0 and amplitude.low <= 0.0 < amplitude.high):
        yield f"parameters: {amplitude.name}: is the amplitude, whose default is 0 and whose range has 0 in it"
    if not term.always and amplitude.prior is None:
        yield f"parameters: {amplitude.name}: is the amplitude, and has no prior"


def _parameter(one: Parameter) -> Iterator[str]:
    if not UNIT.fullmatch(one.unit):
        yield f"unit: got {one.unit!r}; expected 1, or a product of m, kg, s, rad, rev, deg with powers"
    if not one.low <= one.default <= one.high or not one.low < one.high:
        yield f"default {one.default} is not within {one.low} to {one.high}"
    for field in ("source", "meaning"):
        if not getattr(one, field):
            yield f"{field}: is empty"
    if one.by_ball < 0.0 or (one.fit_each_ball and not one.by_ball):
        yield "by_ball: is not above 0"
    prior = one.prior
    if prior is not None and (prior.scale not in SCALES or prior.sd <= 0.0 or not prior.reason
                              or not fits_scale(prior.scale, prior.centre)):
        yield f"prior: its scale is none of {', '.join(SCALES)}, its centre is not on it, or sd or reason is missing"
