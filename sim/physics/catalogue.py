"""The catalogue of hypotheses, in the order in which they act, for fit, synth, discovery and the generic tests.

A Catalogue is passed as a value to all code that refers to terms. The default is catalogue(): the built-in terms and
those of installed distributions. A file given by the user defines terms at module level; an entry point names a term, a
term class, or an iterable of either:

    [project.entry-points."truearc.terms"]
    hood_flex = "truearc_hoodflex:HoodFlex"

Every catalogue contains unexplained effects: fitted free changes of the launch, the distance or the flight. Each
amplitude is multiplied by the circumstance stored under the term's name, which truearc.sim.infer.belief computes for
every shot. Discovery does not test these effects as hypotheses. A curve's points are parameters, like those of a term:
"curve.free_speed.0", ...
"""

import copyreg
import hashlib
import inspect
import math
import re
import sys
import traceback
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar

import jax.numpy as jnp
from msgspec import UnsetType

from truearc.errors import InputError, PluginError, distribution_of, load_plugin, load_text, place_of
from truearc.sim.data.dataset import Circumstances
from truearc.sim.physics import term as kinds
from truearc.sim.physics.term import Instrument, Parameter, Phrase, Term, Vec, WatchTerm, axes, complete, length
from truearc.sim.physics.terms import arrival, flight, launch, sensing

FOUND = "as discovery found it in recordings"
AT_SPEED_M_S = 10.0                   # where a push that goes with the speed is stated
CURVE = "curve"
POINT = Parameter("point", "1", -math.inf, math.inf, 0.0, FOUND)


class Nameless(kinds.Term):
    """`usual`: one standard deviation of a curve's point before any data, in the unit of the amplitude."""

    usual: ClassVar[float]


class FreeSpeed(Nameless, kinds.LaunchTerm):
    """exit speed times exp(share)."""

    parameters = (Parameter("share", "1", -5.0, 5.0, 0.0, FOUND),)
    sentence = "The ball leaves faster or slower, for an unexplained reason."
    follows = "free_speed"
    usual = 0.2
    label = "a curve of the launch speed"

    def leave(self, rig: kinds.Rig, values: kinds.Values, exit: kinds.Exit) -> kinds.Exit:
        return exit._replace(speed_m_s=exit.speed_m_s * jnp.exp(values["share"]))


class FreeElevation(Nameless, kinds.LaunchTerm):
    """exit elevation plus angle_rad."""

    parameters = (Parameter("angle_rad", "rad", -1.5, 1.5, 0.0, FOUND),)
    sentence = "The ball leaves steeper or flatter, for an unexplained reason."
    follows = "free_elevation"
    usual = 0.0175
    label = "a curve of the launch elevation"

    def leave(self, rig: kinds.Rig, values: kinds.Values, exit: kinds.Exit) -> kinds.Exit:
        return exit._replace(elevation_rad=exit.elevation_rad + values["angle_rad"])


class FreeDistance(Nameless, kinds.SensingTerm):
    """true distance = measured + bias_m."""

    parameters = (Parameter("bias_m", "m", -20.0, 20.0, 0.0, FOUND),)
    sentence = "The target is farther or nearer than measured, for an unexplained reason."
    follows = "free_distance"
    usual = 0.12
    label = "a curve of the distance"

    def sense(self, rig: kinds.Rig, values: kinds.Values, exit: kinds.Exit, distance_m: Any) -> tuple[kinds.Exit, Any]:
        return exit, distance_m + values["bias_m"]


class FreePush(Nameless, kinds.FlightTerm):
    """An acceleration size_m_s2 along, up across and left of the velocity by the shares of those names, between two
    times of the flight; times (speed / 10 m/s)^with_speed."""

    parameters = (
        Parameter("size_m_s2", "m/s2", -100.0, 100.0, 0.0, FOUND),
        *(Parameter(side, "1", -1.0, 1.0, 0.0, "a direction cosine") for side in ("along", "up", "left")),
        Parameter("from_s", "s", 0.0, 60.0, 0.0, "since release"),
        Parameter("to_s", "s", 0.0, 60.0, 60.0, "since release"),
        Parameter("with_speed", "1", 0.0, 1.0, 0.0, "0 or 1"))
    sentence = "An unexplained force pushes the ball in flight."
    follows = "free_push"
    usual = 1.5
    label = "a curve of a push"

    def acceleration(self, rig: kinds.Rig, values: kinds.Values, ball: kinds.BallState, forces: kinds.Forces) -> Vec:
        at_work = (ball.time_s >= values["from_s"]) & (ball.time_s < values["to_s"])
        size = values["size_m_s2"] * at_work * (length(ball.velocity_m_s) / AT_SPEED_M_S)**values["with_speed"]
        sides = zip(axes(ball.velocity_m_s), ("along", "up", "left"), strict=True)
        parts = [Vec(*(size * values[name] * part for part in side)) for side, name in sides]
        return Vec(*(sum(components[1:], components[0]) for components in zip(*parts, strict=True)))


NAMELESS: tuple[Nameless, ...] = (FreeDistance(), FreeSpeed(), FreeElevation(), FreePush())


def find_nameless(name: str) -> Nameless:
    """Return the unexplained effect of this name; KeyError if there is none."""
    return {one.name: one for one in NAMELESS}[name]


NAME = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")
UNIT = re.compile(r"(1|((kg|rad|rev|deg|m|s)\d*)+)(/((kg|rad|rev|deg|m|s)\d*)+)?")


def check_term(term: Term) -> None:
    """Reject an incomplete term.

    Raises:
        InputError: names the class, and every declaration that is missing or wrong.
    """
    if not isinstance(term, kinds.KINDS):
        raise InputError(f"{_where(term)}: expected an instance of {', '.join(kind.__name__ for kind in kinds.KINDS)}")
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
    for field, allowed in (("stage", kinds.STAGES), ("direction", kinds.DIRECTIONS)):
        if (said := getattr(term, field, None)) not in allowed:
            yield f"{field}: {said!r} is none of {', '.join(allowed)}"
    order = getattr(term, "order", None)
    if not (isinstance(order, tuple) and len(order) == 2 and isinstance(order[0], int | float) and order[1]):
        yield f"order: {order!r} is not a number and a reason, such as 50, \"a factor of the speed\""
    yield from _wording(term)
    yield from _recording(term)
    yield from _numbers(term)


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
    for field in ("law_sd", "indoor_sd"):
        if (sd := getattr(term, field)) is not None and not sd > 0.0:
            yield f"{field}: above 0, or None"
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
    if prior is not None and (prior.scale not in kinds.SCALES or prior.sd <= 0.0 or not prior.reason
                              or not kinds.fits_scale(prior.scale, prior.centre)):
        yield (f"prior: its scale is none of {', '.join(kinds.SCALES)}, its centre is not on it, or sd or reason is "
               "missing")


GROUP = "truearc.terms"
PREFIX = "truearc_terms_from_"        # of modules made of files, followed by the digest of path and text


@dataclass(frozen=True)
class Catalogue:
    """Terms, each complete, sorted by stage and by the order that they declare within it; names are unique.

    Raises:
        InputError: a term leaves something out, or two have one name.
    """

    terms: tuple[Term, ...]

    def __post_init__(self) -> None:
        for term in self.terms:
            check_term(term)
        check_unique([*NAMELESS, *self.terms])
        ordered = sorted(self.terms, key=lambda term: (kinds.STAGES.index(term.stage), term.order[0], term.name))
        object.__setattr__(self, "terms", tuple(ordered))

    def __iter__(self) -> Iterator[Term]:
        return iter(self.terms)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the terms, in order."""
        return tuple(term.name for term in self.terms)

    @property
    def always(self) -> tuple[str, ...]:
        """Names of terms that are active in every simulation."""
        return tuple(term.name for term in self.terms if term.always)

    def of(self, rig: kinds.Rig) -> "Catalogue":
        """Return the terms that can act on this rig's shots."""
        board = rig.target is not None and not isinstance(rig.target.backboard, UnsetType)
        return self if board else Catalogue(tuple(term for term in self.terms if not term.of_backboard))

    def get(self, name: str) -> Term | None:
        """Return the term, or the unexplained effect, of this name; None if there is none."""
        return next((term for term in (*self.terms, *NAMELESS) if term.name == name), None)

    def find(self, names: Iterable[str]) -> tuple[Term, ...]:
        """Return terms by name, in the catalogue's order, unexplained effects last.

        Raises:
            InputError: names the first unknown one.
        """
        wanted = set(names)
        for name in sorted(wanted - {term.name for term in (*self.terms, *NAMELESS)}):
            near = ([one.name for one in self.terms if one.label == name or one.name.startswith(f"{name}_")]
                    or get_close_matches(name, self.names, 1))
            like = f" (did you mean {' or '.join(map(repr, near))}?)" if near else ""
            raise InputError(f"there is no term {name!r}{like}; the catalogue has {', '.join(sorted(self.names))}")
        return tuple(term for term in (*self.terms, *NAMELESS) if term.name in wanted)


@cache
def catalogue() -> Catalogue:
    """Return the built-in terms and those of installed distributions, which are searched once, on first use.

    Raises:
        InputError: names the distribution whose terms cannot be loaded, are incomplete, or have a name already in use.
    """
    return Catalogue((*TERMS, *terms_of_distributions(TERMS)))


def as_catalogue(terms: Iterable[Term] | None) -> Catalogue:
    """Return these terms as a catalogue, or catalogue() if none are given. InputError as Catalogue."""
    if terms is None:
        return catalogue()
    return terms if isinstance(terms, Catalogue) else Catalogue(tuple(terms))


def find_terms(names: Iterable[str], among: Catalogue | None = None) -> tuple[Term, ...]:
    """Find terms as Catalogue.find does; among: the catalogue, catalogue() by default, here and below."""
    return as_catalogue(among).find(names)


def sensing_terms(names: Iterable[str], among: Catalogue | None = None) -> tuple[kinds.SensingTerm, ...]:
    """Return those of the named terms that correct the robot's sensor readings of a configuration."""
    return tuple(term for term in find_terms(names, among) if isinstance(term, kinds.SensingTerm))


def watch_terms(names: Iterable[str], among: Catalogue | None = None) -> tuple[WatchTerm, ...]:
    """Return those of the named terms that concern the tracker."""
    return tuple(term for term in find_terms(names, among) if isinstance(term, WatchTerm))


def launch_terms(names: Iterable[str], among: Catalogue | None = None) -> tuple[kinds.LaunchTerm, ...]:
    """Return those of the named terms that act while the wheels hold the ball."""
    return tuple(term for term in find_terms(names, among) if isinstance(term, kinds.LaunchTerm))


def flight_terms(names: Iterable[str], among: Catalogue | None = None) -> tuple[kinds.InFlight, ...]:
    """Return those of the named terms that act in the air, on the ball or on the air it meets."""
    return tuple(term for term in find_terms(names, among) if isinstance(term, kinds.InFlight))


def arrival_terms(names: Iterable[str], among: Catalogue | None = None) -> tuple[kinds.ArrivalTerm, ...]:
    """Return those of the named terms that concern the target."""
    return tuple(term for term in find_terms(names, among) if isinstance(term, kinds.ArrivalTerm))


def effective(params: Mapping[str, Mapping[str, Any]], circumstances: Circumstances,
              among: Catalogue | None = None) -> dict[str, dict[str, Any]]:
    """Return {term: {parameter: value}}, complete, as the terms' hooks take them for shots under these circumstances.

    Numbers of a term that follows a circumstance become arrays like it; InputError names an unknown term.
    """
    return {term.name: dict(term.at_shot(complete(term, params[term.name]), circumstances))
            for term in find_terms(params, among)}


def find_parameter(name: str, among: Catalogue | None = None) -> Parameter:
    """Return the parameter called "term.parameter", or a curve's point; InputError if the catalogue has none of that
    name."""
    term_name, _, key = name.partition(".")
    if term_name == CURVE:
        return POINT
    (term,) = find_terms([term_name], among)
    for parameter in term.parameters:
        if parameter.name == key:
            return parameter
    raise InputError(f"{name}: {term_name} has no such parameter")


def terms_of_distributions(known: Sequence[Term]) -> tuple[Term, ...]:
    """Return terms of all entry points of the group, besides the `known` ones.

    Raises:
        InputError: names the distribution and entry point that cannot be loaded, are incomplete, or have a taken name.
    """
    found: list[Term] = []
    for point in sorted(entry_points(group=GROUP), key=lambda point: (distribution_of(point), point.name)):
        where = place_of(point)
        try:
            loaded = load_plugin(point)
        except PluginError as error:
            raise InputError(str(error)) from error
        found += _checked(_as_terms(loaded, where), [*known, *found], where)
    return tuple(found)


def terms_of_file(path: str | Path, known: Iterable[Term]) -> tuple[Term, ...]:
    """Return terms that a Python file defines at module level, as classes or instances, besides the `known` ones.

    They can be sent to other processes, which get the file's text along with them.

    Raises:
        InputError: names the file, and the line where it fails; a term that is incomplete, or whose name is taken.
    """
    if Path(path).suffix != ".py":
        raise InputError(f"{path}: is not a Python file; name one: --terms-from FILE.py (docs/how-to/add-a-term.md)")
    module = _module_of(str(path), load_text(path))
    found = _checked(_as_terms(terms_in(module), str(path)), list(known), str(path))
    if not found:
        raise InputError(f"{path}: defines no term (a subclass of LaunchTerm, FlightTerm, ... or an instance of one)")
    return found


def terms_in(module: ModuleType) -> list[Any]:
    """Return terms at the module's top level, and classes of terms that it defines itself."""
    return [value for value in vars(module).values() if isinstance(value, Term) or _is_own_class(value, module)]


def check_unique(terms: Iterable[Term]) -> None:
    """Raise InputError naming the first term whose name is already taken."""
    seen: set[str] = set()
    for term in terms:
        if term.name in seen:
            raise InputError(f"{type(term).__name__}: there is a term {term.name!r} already; give it another name")
        seen.add(term.name)


def _as_terms(loaded: Any, where: str) -> tuple[Term, ...]:
    """The terms of a term, a class of one, or an iterable of either; each once."""
    parts = loaded if isinstance(loaded, Iterable) and not isinstance(loaded, type) else (loaded,)
    try:
        return tuple(dict.fromkeys(part() if isinstance(part, type) else part for part in parts))
    except Exception as error:
        raise InputError(f"{where}: {type(error).__name__}: {error}") from error


def _checked(found: Sequence[Term], known: Sequence[Term], where: str) -> tuple[Term, ...]:
    try:
        for term in found:
            check_term(term)
        check_unique([*known, *found])
    except InputError as error:
        raise InputError(f"{where}: {error}") from error
    return tuple(found)


def _is_own_class(value: Any, module: ModuleType) -> bool:
    """Whether a class is one of the terms to load; an abstract class whose `name` is not set is a base of others."""
    return (isinstance(value, type) and issubclass(value, Term) and value.__module__ == module.__name__
            and not (inspect.isabstract(value) and "name" not in vars(value)) and not value.__name__.startswith("_"))


def _module_of(path: str, text: str) -> ModuleType:
    """The module that the text makes; the same path and text give the same module, so that its classes stay equal."""
    name = PREFIX + hashlib.sha256(f"{path}\0{text}".encode()).hexdigest()[:16]
    if name in sys.modules:
        return sys.modules[name]
    module = ModuleType(name)
    module.__file__ = path
    sys.modules[name] = module        # dataclasses and pickle look a class's module up there
    try:
        exec(compile(text, path, "exec"), vars(module))
    except Exception as error:
        del sys.modules[name]
        raise InputError(f"{_line_of(error, path)}: {type(error).__name__}: {error}") from error
    for value in vars(module).values():
        if _is_own_class(value, module):
            copyreg.pickle(value, lambda term: (_rebuilt, (path, text, type(term).__qualname__, vars(term))))
    return module


def _line_of(error: Exception, path: str) -> str:
    """path:line of the file's own line that failed."""
    if isinstance(error, SyntaxError) and error.filename == path:
        return f"{path}:{error.lineno}"
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == path]
    return f"{path}:{lines[-1]}" if lines else path


def _rebuilt(path: str, text: str, name: str, state: dict[str, Any]) -> Term:
    """A term of a file in another process."""
    kind: Any = _module_of(path, text)
    for part in name.split("."):
        kind = getattr(kind, part)
    term: Term = object.__new__(kind)
    vars(term).update(state)
    return term


# One of each class on the four pages: a new class there is a new term.
BUILT_IN = Catalogue(tuple(kind() for page in (sensing, launch, flight, arrival) for kind in terms_in(page)))
TERMS = BUILT_IN.terms
