"""Generator of the tables of docs/reference/formats.md and of truearc/schemas: `python -m tools.pages formats`.

The meaning of a key is the comment beside it in robot/launcher.toml, or beside the field of its struct.
"""

import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
from msgspec import UNSET, Struct, UnsetType

from truearc.hw.devices.canandmag import CanandmagConfig
from truearc.robot.aim_file import AimContent
from truearc.robot.config.limits import Bound, load_limits, shown
from truearc.robot.config.named_tables import BY_DRIVER
from truearc.robot.config.rig_spec import Rig, Target
from truearc.robot.config.schema import Config
from truearc.robot.recording.session import Header
from truearc.sim.data.table import UNITS
from truearc.sim.discover.finding import AimProposal, FindingRecord
from truearc.sim.discover.identifiability import Sight
from truearc_frc.table import LIMITS as NT4_LIMITS
from truearc_proof.table import make_markdown

LAUNCHER = Path(__file__).resolve().parents[1] / "robot" / "launcher.toml"
SPELLED = {"s": "s", "deg": "deg", "rad_s": "rad/s", "rev_s": "rev/s", "m_s": "m/s", "kg_m3": "kg/m³", "m_s2": "m/s²",
           "deg_s": "deg/s", "nm": "Nm", "nm_s": "Nm s", "nm_s2": "Nm s²", "hz": "Hz", "px": "px", "v": "V", "a": "A",
           "rpm": "rpm", "pa": "Pa", "ms": "ms"}
BY_KEY = {limit.key: limit for limit in load_limits()}
KEY = re.compile(r"#? ?([a-z0-9_]+) = ([^#]*?)\s*(?:# (.*))?$")


class Shot(Struct, tag_field="do", tag="shoot"):
    """Shots to make: a configuration that was shot, again."""

    shots: int                        # how many
    separates: tuple[str, ...]        # candidate terms that they tell apart
    like: str                         # shot_id of the shot that they repeat
    pace: float | UnsetType = UNSET   # wheels' speed over that shot's; absent: the same
    distance_m: float | UnsetType = UNSET          # as in shots.csv; likewise hood_deg, motor_ratio, wheels, exits


class Measurement(Struct, tag_field="do", tag="measure"):
    """A measurement to make instead."""

    what: str                         # for people
    instrument: str | UnsetType = UNSET            # what measures it: a name in docs/reference/terms.md
    record: str | UnsetType = UNSET                # or what to record: tracks or side
    covariate: str | UnsetType = UNSET             # or the covariate whose cause is sought
    separates: tuple[str, ...] | UnsetType = UNSET            # candidate terms that it tells apart
    probability: float | UnsetType = UNSET         # that the right one then stands alone
    shows: tuple[str, ...] | UnsetType = UNSET     # after "none": effects that it would show


class Design(Struct):
    """Plan of `truearc design --json`."""

    verdict: str                      # of the finding: named | set | unknown | none
    next: tuple[Shot | Measurement, ...]           # what to do; empty where there is nothing to tell apart
    schema: str = "truearc.design/1"  # truearc.design/1
    names: dict[str, float] | UnsetType = UNSET    # candidate terms and their probabilities
    as_then: tuple[str, ...] | UnsetType = UNSET   # what else must be as it was
    probability_before: float | UnsetType = UNSET  # that the right term stands alone (95 %) with the present shots
    probability_after: float | UnsetType = UNSET   # and once the planned shots have been made
    random_shots_worth_as_much: int | UnsetType | None = UNSET   # shots like the present ones; null: too many


DOCUMENTS: dict[str, tuple[type[Struct], str, str]] = {
    "finding": (FindingRecord, "schema", "`truearc discover DIR --json FILE`"),
    "identifiability": (Sight, "schema", "`truearc identifiability DIR --json FILE`"),
    "design": (Design, "schema", "`truearc design DIR --json FILE`"),
    "aim": (AimContent, "schema", "`truearc aim BELIEF --rig FILE --robot FILE`"),
    "proposal": (AimProposal, "schema", "`truearc follow ... --out DIR` as `DIR/proposal.json`"),
    "session": (Header, "format", "`session.json` of a recording"),
}
def comments_of(kind: type) -> dict[str, str]:
    """Comments beside the fields of a struct, by field."""
    return {found[1]: found[2] for found in re.finditer(r"^    (\w+): [^#\n]*# (.*)$", inspect.getsource(kind), re.M)}


def structs_of(kind: type[Struct]) -> list[type[Struct]]:
    """A struct and those in its fields, each once, outer ones first; without those of rig.toml (datasets' page)."""
    found: list[type[Struct]] = [kind]
    for one in found:
        for field in msgspec.structs.fields(one):
            found += [inner for inner in _inner(field.type)
                      if inner not in found and inner.__module__ not in (Rig.__module__, Target.__module__)]
    return found


def _inner(annotation: Any) -> list[type[Struct]]:
    if isinstance(annotation, type) and issubclass(annotation, Struct):
        return [annotation]
    return [inner for part in getattr(annotation, "__args__", ()) for inner in _inner(part)]


def make_schema(name: str) -> dict[str, Any]:
    """JSON schema of a document, with the comments of its fields as descriptions."""
    kind, version_key, _ = DOCUMENTS[name]
    schema = msgspec.json.schema(kind)
    comments = {one.__name__: comments_of(one) for one in structs_of(kind)}
    for title, part in schema["$defs"].items():
        for key, value in part["properties"].items():
            part["properties"][key] = _with_null(value)
            if key in comments.get(title, {}) and "$ref" not in value:
                part["properties"][key]["description"] = comments[title][key]
    version = f"truearc.{name}/{2 if name == 'session' else 1}"
    root = schema["$defs"][kind.__name__]
    root["properties"][version_key] = {"const": version}
    root["required"] = sorted({*root["required"], version_key})
    name_of_it = "urn:" + version.replace("/", ":")
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "$id": name_of_it, **schema}


def _with_null(value: Any) -> Any:
    """The schema with null for a number, which stands for one that is not finite."""
    if isinstance(value, list):
        return [_with_null(one) for one in value]
    if not isinstance(value, dict):
        return value
    if value.get("type") == "number":
        return {**value, "type": ["number", "null"]}
    return {key: _with_null(one) if key not in ("required", "default") else one for key, one in value.items()}


def launcher_keys() -> Iterator[tuple[str, str, str]]:
    """(dotted key, shipped value, comment) of every key of robot/launcher.toml but those of axes and [rig]."""
    section = ""
    for line in LAUNCHER.read_text(encoding="utf-8").splitlines():
        if header := re.match(r"(?:# )?\[+([\w.]+)\]+", line):
            section = header[1] + "."
        elif (found := KEY.match(line)) and not section.startswith(("axes.", "rig.")):
            yield section + found[1], "" if line.startswith("#") else found[2], found[3] or ""


def range_of(key: str) -> str:
    """Limits of a key of launcher.toml, else what its declaration says; "" where there are none."""
    if key in BY_KEY:
        return f"{'0, or ' * BY_KEY[key].or_zero}from {_bound_text(BY_KEY[key].low)} to {_bound_text(BY_KEY[key].high)}"
    kind: Any = msgspec.inspect.type_info(Config)
    if key == "hood_encoder.driver":
        return ", ".join(BY_DRIVER)
    if key.startswith("hood_encoder."):
        kind, key = msgspec.inspect.type_info(CanandmagConfig), key.removeprefix("hood_encoder.")
    for part in key.split("."):
        kind = next(field.type for field in kind.fields if field.encode_name == part)
        kind = kind.types[0] if isinstance(kind, msgspec.inspect.UnionType) else kind
    limits = [f"{sign} {value:g}" for sign, value in (
        ("from", getattr(kind, "ge", None)), ("above", getattr(kind, "gt", None)), ("to", getattr(kind, "le", None)),
        ("below", getattr(kind, "lt", None))) if value is not None and abs(value) < 1e7]
    words = [str(value) for value in getattr(kind, "values", ())]
    return ", ".join(words) or " ".join(limits) or {"BoolType": "true, false"}.get(type(kind).__name__, "")


def _bound_text(bound: Bound) -> str:
    return ", ".join(f"`{shown(one)}`" if isinstance(one, str) else shown(one)
                     for one in (bound if isinstance(bound, tuple) else (bound,)))


def unit_of(key: str) -> str:
    """Unit by a key's ending; "" where it has none."""
    endings = sorted({*SPELLED, *UNITS}, key=len, reverse=True)
    ending = next((one for one in endings if key.endswith("_" + one)), None)
    return "" if ending is None else SPELLED.get(ending, ending)


def documents() -> str:
    """The JSON documents, each a table per object in it."""
    return "\n".join(line for name in DOCUMENTS for line in _document(name))


def _document(name: str) -> Iterator[str]:
    kind, _, made_by = DOCUMENTS[name]
    yield f"\n### {name}\n{made_by}; schema `truearc/schemas/{name}.json`."
    for one in structs_of(kind):
        comments = comments_of(one)
        if one is not kind:
            yield f"\n`{one.__name__}`"
        yield "\n" + make_markdown(("key", "type", "meaning"), [
            (f"`{field.encode_name}`", _type_text(field.type), comments.get(field.name, "").replace(" | ", " or "))
            for field in msgspec.structs.fields(one)])


def _type_text(annotation: Any) -> str:
    if isinstance(annotation, type) and issubclass(annotation, Struct):
        return f"`{annotation.__name__}`"
    names = {int: "integer", float: "number", str: "text", bool: "true or false", type(None): "null", Any: "any"}
    if annotation in names:
        return names[annotation]
    parts = [one for one in getattr(annotation, "__args__", ()) if one not in (Ellipsis, UnsetType)]
    origin = getattr(annotation, "__origin__", None)
    if origin is tuple:
        return f"[{' or '.join(dict.fromkeys(_type_text(one) for one in parts))}]"
    if origin is dict:
        return f"{{{_type_text(parts[1])}}}"
    said = " or ".join(_type_text(one) for one in parts if one is not type(None))
    return f"{said}?" if type(None) in parts else said


def launcher() -> str:
    """The keys of launcher.toml."""
    return make_markdown(("key", "unit", "shipped", "range", "meaning"), [
        (f"`{key}`", unit_of(key), f"`{value}`" if value else "absent", range_of(key), meaning)
        for key, value, meaning in launcher_keys()])


def limits() -> str:
    return make_markdown(("key", "least", "greatest", "reason"), [
        (f"`{one.key}`", "0, or " * one.or_zero + _bound_text(one.low), _bound_text(one.high), one.why)
        for one in (*BY_KEY.values(), *NT4_LIMITS)])
