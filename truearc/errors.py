"""Errors for invalid input: InputError, readers and writers of text and TOML, reworded msgspec messages, and plug-ins.

Messages name file, line and key. Every module may import this one, which itself imports nothing from truearc.
"""

import csv
import json
import math
import re
import shutil
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import msgspec
from msgspec import Struct
from msgspec.structs import fields

if TYPE_CHECKING:                     # slow to import
    from importlib.metadata import EntryPoint

MAX_LINE = 20_000                     # characters: longer ones take minutes to parse
DEEP_KEY = re.compile(r"""(?:[\w"'-]+\s*\.\s*){16}""")     # no key of ours has as many parts; 9000 take half a minute
MAX_TEXT_BYTES, MAX_BYTES = 4_000_000, 500_000_000      # of a configuration or belief; of a model or table
NO_JSON = (msgspec.MsgspecError, UnicodeDecodeError, RecursionError)    # what decoding damaged JSON raises
KINDS = {"float": "a number", "int": "a whole number", "str": "a text in quotes", "bool": "true or false",
         "object": "a table", "array": "a list", "null": "nothing"}
LIMITS = {">=": "of at least", "<=": "of at most", ">": "above", "<": "below"}
LONGEST = 40                          # characters of a text that are shown
_INNER_PLACE = re.compile(r" - at `\$([^`]*)` - at `\$([^`]*)`$")      # of an axis's key, and of the axis
# the struct of a field's table, by its annotation and the value in the file; None where it has none
Kind = TypeVar("Kind")
StructOf = Callable[[Any, Any], Any]


class InputError(Exception):
    """Error in the user's file or option; the message names file, line, key or frame. Commands end with exit code 2."""


# --- reading

def load_text(path: str | Path) -> str:
    """Load a UTF-8 text file, with or without a byte-order mark; InputError names the file and says why it cannot be
    read, or that it is too long."""
    with naming(path):
        return load_bytes(path, MAX_TEXT_BYTES).decode("utf-8-sig").replace("\r\n", "\n")


def load_bytes(path: str | Path, most: int = MAX_BYTES) -> bytes:
    """Load a file; InputError if it is longer than `most` bytes: a device such as /dev/zero has no end, and a pipe may
    never begin."""
    with naming(path):
        if Path(path).exists() and not Path(path).is_file() and not Path(path).is_dir():
            raise InputError(f"{path}: is a pipe or a device, not a file; copy what it gives into a file")
        with Path(path).open("rb") as file:
            data = file.read(most + 1)
    if len(data) > most:
        raise InputError(f"{path}: is longer than {most} bytes, the most that is read of such a file")
    return data


def parse_table(text: str, name: str) -> dict[str, Any]:
    """Parse TOML text; InputError names its source and the line."""
    longest = max(map(len, text.splitlines()), default=0)
    if longest > MAX_LINE:
        raise InputError(f"{name}: has a line of {longest} characters; at most {MAX_LINE} are read")
    if deep := DEEP_KEY.search(text):
        raise InputError(f"{name}:{text.count(chr(10), 0, deep.start()) + 1}: a key of more than 16 parts")
    try:
        return tomllib.loads(text)
    except ValueError as error:       # not TOML, or a number of thousands of digits
        here = re.search(r"\(at line (\d+), column (\d+)\)", str(error))
        comma = here and re.match(r"\d,\d|,\d", text.splitlines()[int(here[1]) - 1][int(here[2]) - 1:])
        todo = "decimals have a point, no comma" if comma else "lines are key = value, and words stand in quotes"
        raise InputError(f"{name}: {error}; {todo}") from error
    except RecursionError as error:
        raise InputError(f"{name}: {in_words(error)}") from error


@contextmanager
def naming(path: str | Path) -> Iterator[None]:
    """Raise errors of reading, writing and decoding as InputError, starting with the file."""
    try:
        yield
    except (OSError, csv.Error, *NO_JSON) as error:
        raise InputError(f"{path}: {in_words(error)}") from error


@contextmanager
def about(what: str, kind: type[Exception] = InputError) -> Iterator[None]:
    """Turn errors of this kind into InputErrors that start with their subject."""
    try:
        yield
    except kind as error:
        raise InputError(f"{what}: {error}") from error


def number_in(text: str) -> float:
    """Return the number in a cell of a table; NaN if there is none."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def in_words(error: Exception) -> str:
    """Return an error's text without its number and the file, which our messages name first."""
    if isinstance(error, OSError):
        return error.strerror or str(error)
    if isinstance(error, RecursionError):
        return "its values are nested too deeply"
    return "not UTF-8 text" if isinstance(error, UnicodeDecodeError) else reworded(str(error))


# --- writing

@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`; the file replaces `path` once the block has ended without an error.

    A character device, such as /dev/stdout, is written to as it is, and stays.

    Raises:
        InputError: there is something at `path` that is not a file. One of the block's names `path` instead.
        OSError: it cannot be written.
    """
    if Path(path).is_char_device():
        yield Path(path)
        return
    check_file(path)
    place = Path(path).resolve()      # behind a link, which stays
    new = place.with_name(f".{place.name}.part")
    try:
        yield new
        if place.exists():
            shutil.copymode(place, new)
        new.replace(place)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error
    except InputError as error:
        raise InputError(str(error).replace(str(new), str(path))) from error
    finally:
        new.unlink(missing_ok=True)


def save_whole(path: str | Path, data: bytes) -> None:
    """Write a file with whole_file."""
    with whole_file(path) as new:
        new.write_bytes(data)


def check_file(path: str | Path) -> None:
    """Raise InputError if there is something at `path` that is not a file."""
    if Path(path).is_dir():
        raise InputError(f"{path}: is a directory; name a file")
    if Path(path).exists() and not Path(path).is_file():
        raise InputError(f"{path}: is a pipe or a device, not a file; name a file")


def make_toml(table: dict[str, Any], prefix: str = "") -> str:
    """Return TOML text of nested tables, lists of tables and plain values; None is omitted."""
    plain = {key: value for key, value in table.items() if not isinstance(value, dict) and not _is_tables(value)}
    text = "".join(f"{_key(key)} = {_value(value)}\n" for key, value in plain.items() if value is not None)
    for key, value in table.items():
        name = prefix + _key(key)
        if isinstance(value, dict):
            text += f"\n[{name}]\n" + make_toml(value, name + ".")
        elif _is_tables(value):
            text += "".join(f"\n[[{name}]]\n" + make_toml(row, name + ".") for row in value)
    return text


def _is_tables(value: Any) -> bool:
    return isinstance(value, list | tuple) and len(value) > 0 and all(isinstance(row, dict) for row in value)


def _key(key: str) -> str:
    bare = key.replace("_", "").replace("-", "")
    return key if bare.isascii() and bare.isalnum() else _value(key)


def _value(value: Any) -> str:
    if isinstance(value, list | tuple):
        text = "[" + ", ".join(_value(part) for part in value) + "]"
        return text if len(text) <= MAX_LINE else "[\n" + ",\n".join(_value(part) for part in value) + "]"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        # a JSON string is a TOML basic string except for DEL, which TOML wants escaped
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return repr(value)


# --- what is wrong with a TOML file

def joined(message: str) -> str:
    """Return a message with the place of an axis's key after that of its axis."""
    return _INNER_PLACE.sub(r" - at `$\2\1`", message)


def reworded(message: str, table: Any = None, known: Callable[[str], Iterable[str]] = lambda key: ()) -> str:
    """Return msgspec's message in plain words, after the key at fault.

    table: what was decoded, for the value. known: the values of a key that takes few.
    """
    what, _, place = message.partition(" - at `")
    key = place.strip("$.`")
    if field := re.fullmatch(r"Object (contains unknown|missing required) field `(.*)`", what):
        return f"{key}.{field[2]}".lstrip(".") + (": unknown key" if "unknown" in field[1] else ": missing key")
    value = _at(table, key)
    got = f"the text {value[:LONGEST]!r}" if isinstance(value, str) else str(value).lower()
    if wanted := re.fullmatch(r"Expected `(.*?)(?: \| null)?`(.*?)(?:, got `?(\w+)`?)?", what):
        kind, limit = KINDS.get(wanted[1], wanted[1]), wanted[2]
        for sign, words in LIMITS.items():
            limit = limit.replace(f" {sign} ", f" {words} ").replace("length of", "length")
        if value is None or isinstance(value, list | dict):
            got = KINDS.get(wanted[3], wanted[3])
        what = f"{kind}{limit} is expected" + (f", got {got}" if got else "")
        if isinstance(value, str) and "number" in kind and re.fullmatch(r"[+-]?\d+([.,]\d+)?", value):
            what += f"; write {value.replace(',', '.')} without quotes"
    elif unknown := re.fullmatch(r"Invalid (?:enum )?value (.*)", what):
        there = ", ".join(known(key))
        what = f"{unknown[1]} is not known here" + (f"; there are {there}" if there else "")
    return f"{key}: {what}" if key else what


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return `; did you mean ...?` for the nearest of the known words; "" if none is near."""
    return "".join(f"; did you mean {near}?" for near in get_close_matches(word, list(known), 1))


def near_key(key: str, kind: Any, table: Any, struct_of: StructOf = lambda kind, value: struct_in(kind)) -> str:
    """Return did_you_mean for a dotted key that a file of the struct `kind`, decoded as `table`, does not have."""
    *above, name = key.split(".")
    for number, part in enumerate(above, 1):
        types = {one.name: one.type for one in fields(kind)} if kind is not None else {}
        annotation = types.get(re.sub(r"\[.*?\]", "", part))
        kind = struct_of(annotation, _at(table, ".".join(above[:number])))
    return "" if kind is None else did_you_mean(name, kind.__struct_fields__)


def parse_struct(text: str, kind: type[Kind], name: str, dec_hook: Callable[[type, Any], Any] | None = None,
                 struct_of: StructOf = lambda kind, value: struct_in(kind),
                 known: Callable[[str], Iterable[str]] = lambda key: ()) -> Kind:
    """Decode TOML text as a struct; `name` is its source.

    dec_hook: msgspec's, for types that it does not know. struct_of: the struct of a field's table, by its annotation
    and value. known: the values of a key that takes few.

    Raises:
        InputError: the text is no TOML, or a key is unknown, missing or of the wrong type; with its line.
    """
    table = parse_table(text, name)
    try:
        return msgspec.convert(table, kind, dec_hook=dec_hook)
    except msgspec.ValidationError as error:
        message, missing = joined(str(error)), missing_keys(table, kind, struct_of=struct_of)
        said = reworded(message, table, known)
        unknown = said.endswith(": unknown key")
        near = near_key(said.removesuffix(": unknown key"), kind, table, struct_of) if unknown else ""
        here = f"{name}{line_of(text, message)}: {said}{near}"
        if len(missing) > 1 and not near:
            lacks = f"keys are missing: {', '.join(missing)}{near_tables(table, kind)}"
            here = f"{here}; {lacks}" if unknown else f"{name}: {lacks}"
        raise InputError(here) from error


def near_tables(table: Any, kind: Any, prefix: str = "") -> str:
    """Return `; [PLACE] is unknown; did you mean ...?` for each unknown table with nearly the name of one in the struct
    `kind`."""
    own, said = {one.encode_name: struct_in(one.type) for one in fields(kind)}, ""
    for name, value in table.items():
        if isinstance(value, dict | list) and name not in own and (near := did_you_mean(name, own)):
            said += f"; [{prefix}{name}] is unknown{near}"
        elif isinstance(value, dict) and own.get(name) is not None:
            said += near_tables(value, own[name], f"{prefix}{name}.")
    return said


def struct_in(annotation: Any) -> Any:
    """Return the struct in a field's annotation, as in `tuple[Wheel, ...]`; None if there is none."""
    inner = (struct_in(part) for part in getattr(annotation, "__args__", ()))
    if isinstance(annotation, type) and issubclass(annotation, Struct):
        return annotation
    return next(filter(None, inner), None)


def unknown_keys(table: dict[str, Any], kind: Any, prefix: str = "") -> list[str]:
    """Return dotted names in a parsed table that no field of `kind` takes."""
    known = kind.__annotations__
    names: list[str] = []
    for key, value in table.items():
        inner = struct_in(known.get(key))
        if key not in known:
            names.append(prefix + key)
        elif inner is not None:
            for row in value if isinstance(value, list) else [value]:
                if isinstance(row, dict):
                    names += unknown_keys(row, inner, f"{prefix}{key}.")
    return names


def missing_keys(table: Mapping[str, Any], kind: Any, prefix: str = "",
                 struct_of: StructOf = lambda kind, value: struct_in(kind)) -> list[str]:
    """Return dotted names of required fields of the struct `kind` that a table lacks, in the struct's order."""
    names: list[str] = []
    for one in msgspec.structs.fields(kind):
        value, inner = table.get(one.encode_name), struct_in(one.type)
        if one.encode_name not in table:
            inside = missing_keys({}, inner, f"{prefix}{one.encode_name}.", struct_of) if inner is not None else []
            names += (inside or [prefix + one.encode_name]) if one.required else []
            continue
        for row in value if isinstance(value, list) else [value]:
            own = struct_of(one.type, row) if inner is None else inner
            if isinstance(row, dict) and own:
                here = missing_keys(row, own, f"{prefix}{one.encode_name}.", struct_of)
                names += [name for name in here if name not in names]
    return names


def _at(table: Any, key: str) -> Any:
    """What stands in nested tables at a dotted key; None where nothing does."""
    for name in re.findall(r"[^.\[\]]+", key):
        try:
            table = table[int(name) if isinstance(table, list | tuple) else name]
        except (LookupError, TypeError, ValueError):
            return None
    return table


def line_of(text: str, message: str) -> str:
    """Return ':line' of the key in the message, in the table that it names, else of that table; '' if neither is
    found."""
    *names, place = [re.sub(r"\[.*?\]", "", quoted.removeprefix("$").removeprefix("."))
                     for quoted in re.findall(r"`([^`]+)`", message)] or [""]
    table, _, key = place.rpartition(".")
    places = {(place, name) for name in names} | {(table, key)}
    header, begins = "", ""
    for number, line in enumerate(text.splitlines(), 1):
        if found := re.match(r"\s*\[+\s*([\w.]+)\s*\]", line):
            header = found[1]
            begins = begins or (f":{number}" if header == place else "")
        elif (found := re.match(r"\s*([\w-]+)\s*=", line)) and (header, found[1]) in places:
            return f":{number}"
    return begins


def line_of_key(text: str, key: str) -> str:
    """Return ':line' of a dotted key, else of its table; '' if several tables have that name, or none has."""
    table = key.rpartition(".")[0]
    return line_of(text, f"`{key}`") if len(re.findall(rf"(?m)^\s*\[+\s*{re.escape(table)}\s*\]", text)) <= 1 else ""


# --- entry points of installed distributions

PROOF, FRC = "truearc-proof", "truearc-frc"             # distributions in the repository's folders proof/ and frc/
INSTALL_HINTS = {name: f"pip install ./{name.removeprefix('truearc-')} (in a checkout of the repository)"
                 for name in (PROOF, FRC)}
OTHER_FORMATS = ("wpilog",)           # of truearc-frc
# command, table of launcher.toml, or format -> the distribution that has it
ELSEWHERE = {"prove": PROOF, "reproduce": PROOF, "advise": FRC, "nt4": FRC, **dict.fromkeys(OTHER_FORMATS, FRC)}
EXPORTS = "truearc.exports"           # group: format -> function of (ExportRows, binary file)


class PluginError(ValueError):
    """An entry point cannot be used; the message names its distribution."""


def needs(name: str) -> str:
    """Return which distribution has one of ELSEWHERE, and how to install it."""
    return f"needs {ELSEWHERE[name]}: {INSTALL_HINTS[ELSEWHERE[name]]}"


def distribution_of(point: "EntryPoint") -> str:
    """Return the name and version of the distribution that declares it."""
    return f"{point.dist.name} {point.dist.version}" if point.dist else "an unknown distribution"


def place_of(point: "EntryPoint") -> str:
    """Return distribution, group, name and value, for messages."""
    return f"{distribution_of(point)}: entry point {point.group}: {point.name} = {point.value}"


def load_plugin(point: "EntryPoint") -> Any:
    """Import the object of the entry point.

    Raises:
        PluginError: it cannot be imported, whatever the reason.
    """
    try:
        return point.load()
    except Exception as error:
        raise PluginError(f"{place_of(point)}: {type(error).__name__}: {error}; fix or uninstall it") from error


def only_point(points: "tuple[EntryPoint, ...]", name: str) -> "EntryPoint":
    """Return the only entry point of a name.

    Raises:
        LookupError: there is none.
        PluginError: there are several.
    """
    if not points:
        raise LookupError(name)
    if len(points) > 1:
        raise PluginError(f"{place_of(points[0])}: {place_of(points[1])} has the same name; uninstall one of them")
    return points[0]
